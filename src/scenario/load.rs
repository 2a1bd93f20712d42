//! A scenario from its files: the scenario, its vehicle with tables and mass reports, its command schedule.
//!
//! Nothing is read here: whoever loads a scenario hands over a function that gives the text of a file.

use std::fmt::Display;
use std::path::Path;

use super::{Scenario, ScenarioFile, Schedule};
use crate::input::{Document, InputError, InputText};
use crate::vehicle::{VehicleInputs, folder_of};

/// What a file is, told by its keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// A vehicle file: it has a `[vehicle]` table.
    Vehicle,
    /// A scenario: it names its vehicle file.
    Scenario,
    /// A campaign: it names its scenario.
    Campaign,
}

/// A scenario and the text of every file it names, with the values that replace those of the files. Scenarios
/// that differ in single values are made of it without another look at the disk.
#[derive(Clone)]
pub struct ScenarioInputs {
    name: String,
    document: Document,
    vehicle: VehicleInputs,
    commands: Option<(InputText, Schedule)>,
}

impl FileKind {
    /// # Errors
    /// When it is none of them.
    pub fn of(document: &Document) -> Result<Self, InputError> {
        if matches!(document.get("scenario"), Some(toml::Value::String(_))) {
            return Ok(Self::Campaign);
        }
        match document.get("vehicle") {
            Some(toml::Value::Table(_)) => Ok(Self::Vehicle),
            Some(toml::Value::String(_)) => Ok(Self::Scenario),
            _ => Err(InputError::of_file(
                document.file(),
                "neither a vehicle file (no [vehicle] table), nor a scenario (no vehicle = \"FILE\"), \
                 nor a campaign (no scenario = \"FILE\")",
            )),
        }
    }
}

impl Scenario {
    /// The scenario of the file at `path`, with its vehicle; `read` gives the text of a file:
    /// `|file| std::fs::read_to_string(file)`. Relative paths in a file start at its own folder.
    ///
    /// # Errors
    /// When a file cannot be read, or is wrong: with file, line, key and allowed range.
    pub fn load<E: Display>(
        path: impl AsRef<Path>,
        read: impl FnMut(&Path) -> Result<String, E>,
    ) -> Result<Self, InputError> {
        ScenarioInputs::read(path.as_ref(), &[], None, read)?.scenario()
    }
}

impl ScenarioInputs {
    /// Reads the scenario at `path` and every file it names. `overrides` are dotted keys of the scenario, or
    /// behind `vehicle.` of its vehicle file, with TOML values; `commands` replaces the schedule that the
    /// scenario names.
    ///
    /// # Errors
    /// When a file cannot be read, or its values cannot be.
    pub fn read<E: Display>(
        path: &Path,
        overrides: &[(&str, &str)],
        commands: Option<&Path>,
        mut read: impl FnMut(&Path) -> Result<String, E>,
    ) -> Result<Self, InputError> {
        let mut document = InputText::read(path, &mut read)?.document()?;
        refuse_other_kinds(&document)?;
        let mut vehicle_overrides = Vec::new();
        for &(key, value) in overrides {
            match key.strip_prefix("vehicle.") {
                Some(inner) => vehicle_overrides.push((key, inner, value)),
                None => document.set(key, value)?,
            }
        }
        let file = ScenarioFile::read(&document)?;
        let folder = folder_of(path);
        let vehicle_path = folder.join(&file.vehicle);
        let mut vehicle = InputText::read(&vehicle_path, &mut read)?.document()?;
        file.set_vehicle(&document, &mut vehicle)?;
        for (key, inner, value) in vehicle_overrides {
            vehicle.set_given(key, inner, value)?;
        }
        let vehicle = VehicleInputs::read(vehicle, &vehicle_path, &mut read)?;
        let commands_path =
            commands.map(Path::to_owned).or_else(|| file.commands.as_ref().map(|name| folder.join(name)));
        let commands = match commands_path {
            None => None,
            Some(path) => {
                let table = InputText::read(&path, &mut read)?;
                let schedule = Schedule::parse(&table.text).map_err(|e| table.error_at(e.line, e.message))?;
                Some((table, schedule))
            }
        };
        let name = path.file_stem().map_or_else(|| "scenario".into(), |s| s.to_string_lossy().into_owned());
        Ok(Self { name, document, vehicle, commands })
    }

    /// Puts a value at a dotted path of the scenario, or behind `vehicle.` of its vehicle; messages say that
    /// it was given at `place`.
    ///
    /// # Errors
    /// When there is no such place. Whether the key is known is judged by [`ScenarioInputs::scenario`].
    pub fn put(&mut self, place: &str, key: &str, value: toml::Value) -> Result<(), InputError> {
        match key.strip_prefix("vehicle.") {
            Some(inner) => self.vehicle.document.put(place, key, inner, value),
            None => self.document.put(place, key, key, value),
        }
    }

    /// The scenario with its vehicle.
    ///
    /// # Errors
    /// When a value is wrong.
    pub fn scenario(&self) -> Result<Scenario, InputError> {
        let file = ScenarioFile::read(&self.document)?;
        let vehicle = self.vehicle.vehicle()?;
        let schedule = self.commands.as_ref().map(|(_, schedule)| schedule.clone());
        Scenario::new(&self.name, file, vehicle, schedule)
            .map_err(|contradictions| self.document.error(contradictions))
    }

    /// Every value in force, absent ones at their defaults: the scenario, with the vehicle file at `vehicle`.
    ///
    /// # Errors
    /// When a value is wrong.
    pub fn values(&self) -> Result<serde_json::Value, InputError> {
        let json = |values: Result<serde_json::Value, serde_json::Error>| {
            values.map_err(|e| InputError::of_file(self.document.file(), e.to_string()))
        };
        let mut values = json(serde_json::to_value(ScenarioFile::read(&self.document)?))?;
        values["vehicle"] = json(serde_json::to_value(self.vehicle.file()?))?;
        Ok(values)
    }

    /// Text of the tables that the vehicle file names.
    pub fn tables(&self) -> [&str; 2] {
        self.vehicle.tables()
    }

    /// Every file, exactly as read, without the values that replace its own: its name and its text.
    pub fn files(&self) -> impl Iterator<Item = (&str, &str)> {
        let commands = self.commands.iter().map(|(one, _)| (one.file.as_str(), one.text.as_str()));
        std::iter::once((self.document.file(), self.document.text()))
            .chain(self.vehicle.files())
            .chain(commands)
    }
}

/// A file of another kind would be refused for its keys, which says less.
fn refuse_other_kinds(document: &Document) -> Result<(), InputError> {
    let message = match FileKind::of(document) {
        Ok(FileKind::Vehicle) => "this is a vehicle file; a scenario names one: vehicle = \"FILE\"",
        Ok(FileKind::Campaign) => "this is a campaign, which names its scenario: use `hopbench campaign`",
        Ok(FileKind::Scenario) | Err(_) => return Ok(()),
    };
    Err(InputError::of_file(document.file(), message))
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPEN_LOOP: &str = include_str!("../../scenarios/open_loop_a.toml");
    const COMMANDS: &str = include_str!("../../scenarios/open_loop_a.csv");
    const VEHICLE: &str = include_str!("../../scenarios/vehicles/reference.toml");
    const MAP: &str = include_str!("../../scenarios/vehicles/cea_reference_fit.csv");
    const AREA: &str = include_str!("../../scenarios/vehicles/valve_area_vs_angle.csv");

    /// Files as a disk would have them, in the order in which they are read.
    const DISK: [(&str, &str); 5] = [
        ("in/a.toml", OPEN_LOOP),
        ("in/vehicles/reference.toml", VEHICLE),
        ("in/vehicles/cea_reference_fit.csv", MAP),
        ("in/vehicles/valve_area_vs_angle.csv", AREA),
        ("in/open_loop_a.csv", COMMANDS),
    ];

    /// Loads with one file as `changed` has it; `None`: that file is not there.
    fn load(
        file: &str,
        changed: Option<&str>,
        overrides: &[(&str, &str)],
    ) -> Result<ScenarioInputs, InputError> {
        ScenarioInputs::read(Path::new("in/a.toml"), overrides, None, |path| {
            let found = DISK.iter().find(|(name, _)| Path::new(name) == path);
            match found {
                Some((name, _)) if *name == file => changed.map(str::to_owned).ok_or("no such file"),
                Some((_, text)) => Ok((*text).to_owned()),
                None => Err("not asked for"),
            }
        })
    }

    fn refused(file: &str, changed: Option<&str>, overrides: &[(&str, &str)]) -> String {
        load(file, changed, overrides).and_then(|inputs| inputs.scenario()).unwrap_err().to_string()
    }

    #[test]
    fn every_file_is_kept_as_it_was_read() {
        let inputs = load("", None, &[("seed", "9"), ("vehicle.engine.grain.length_m", "0.24")]).unwrap();
        assert_eq!(inputs.files().collect::<Vec<_>>(), DISK);
        let scenario = inputs.scenario().unwrap();
        assert_eq!((scenario.name.as_str(), scenario.file.seed), ("a", 9));
        assert_eq!(scenario.vehicle.engine_parameters.grain.length_m, 0.24);
    }

    #[test]
    fn a_diagnostic_names_the_file_it_stands_in() {
        for (file, _) in DISK {
            assert_eq!(refused(file, None, &[]), format!("{file}: no such file"));
        }
        let commands = "time_s,valve_deg\n0,95\n";
        assert!(
            refused("in/open_loop_a.csv", Some(commands), &[]).starts_with("in/open_loop_a.csv:2: valve_deg")
        );
        let table = refused("in/vehicles/cea_reference_fit.csv", Some("of\n1\n"), &[]);
        assert!(table.starts_with("in/vehicles/cea_reference_fit.csv: "), "{table}");
        let shorter = VEHICLE.replace("[engine.grain]", "[engine.grain]\nlenght_m = 1");
        let line = VEHICLE.lines().position(|line| line == "[engine.grain]").unwrap() + 2;
        let unknown = refused("in/vehicles/reference.toml", Some(&shorter), &[]);
        assert!(
            unknown.starts_with(&format!("in/vehicles/reference.toml:{line}: engine.grain.lenght_m")),
            "{unknown}"
        );
        let given = refused("", None, &[("vehicle.engine.grain.length_m", "-1")]);
        assert!(given.ends_with("(given by --set vehicle.engine.grain.length_m)"), "{given}");
        assert!(refused("in/a.toml", Some(VEHICLE), &[]).starts_with("in/a.toml: this is a vehicle file"));
    }

    #[test]
    fn a_value_put_in_place_later_is_judged_like_one_of_the_file() {
        let mut inputs = load("", None, &[]).unwrap();
        inputs.put("draws.toml:3", "vehicle.engine.grain.length_m", 0.24.into()).unwrap();
        assert_eq!(inputs.scenario().unwrap().vehicle.engine_parameters.grain.length_m, 0.24);
        inputs.put("draws.toml:4", "wind.mean_speed_m_s", (-1.0).into()).unwrap();
        let message = inputs.scenario().unwrap_err().to_string();
        assert!(message.ends_with("(given by draws.toml:4 wind.mean_speed_m_s)"), "{message}");
    }
}
