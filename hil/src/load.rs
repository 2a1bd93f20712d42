//! Files into scenarios and vehicles: reads text, applies `--set`, and puts file names into messages.

use std::path::{Path, PathBuf};

use hopbench::input::{Diagnostic, Document, InputError};
use hopbench::scenario::{Scenario, ScenarioFile, Schedule};
use hopbench::vehicle::{Table, Vehicle, VehicleError, VehicleFile};

/// Values that replace those of the files, as `KEY=VALUE`.
pub type Overrides = [String];

/// What a file is, told by its keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A vehicle file: it has a `[vehicle]` table.
    Vehicle,
    /// A scenario: it names its vehicle file.
    Scenario,
    /// A campaign: it names its scenario.
    Campaign,
}

/// A file that cannot be used, for a reason that lies outside its values.
pub fn unusable(file: &Path, message: impl Into<String>) -> InputError {
    InputError {
        file: file.display().to_string(),
        diagnostics: vec![Diagnostic { line: None, key: String::new(), message: message.into() }],
    }
}

/// Scenario and vehicle contradict each other, found when a flight is set up.
pub fn contradiction(file: &Path, fault: hopbench::input::Invalid) -> InputError {
    InputError {
        file: file.display().to_string(),
        diagnostics: vec![Diagnostic { line: None, key: fault.key, message: fault.message }],
    }
}

/// Refuses a scenario that nobody can fly.
pub fn flyable(file: &Path, scenario: &Scenario) -> Result<(), InputError> {
    if scenario.schedule.is_none() && !scenario.file.sensors.enabled {
        return Err(unusable(file, "sensors.enabled = false needs a command schedule"));
    }
    Ok(())
}

/// Text of an input file.
pub fn text(path: &Path) -> Result<String, InputError> {
    std::fs::read_to_string(path).map_err(|e| unusable(path, e.to_string()))
}

/// A TOML file, parsed.
pub fn document(path: &Path) -> Result<Document, InputError> {
    Document::parse(&path.display().to_string(), &text(path)?)
}

/// Whether a document is a vehicle, a scenario or a campaign.
pub fn kind(document: &Document) -> Result<Kind, InputError> {
    if matches!(document.get("scenario"), Some(toml::Value::String(_))) {
        return Ok(Kind::Campaign);
    }
    match document.get("vehicle") {
        Some(toml::Value::Table(_)) => Ok(Kind::Vehicle),
        Some(toml::Value::String(_)) => Ok(Kind::Scenario),
        _ => Err(unusable(
            Path::new(document.file()),
            "neither a vehicle file (no [vehicle] table), nor a scenario (no vehicle = \"FILE\"), nor a campaign (no scenario = \"FILE\")",
        )),
    }
}

/// A vehicle file with the tables it names.
pub fn vehicle(path: &Path, overrides: &Overrides) -> Result<Vehicle, InputError> {
    let mut document = document(path)?;
    for (key, value) in pairs(overrides)? {
        document.set_given(key, key.strip_prefix("vehicle.").unwrap_or(key), value)?;
    }
    VehicleTexts::gather(path, document)?.vehicle()
}

/// A scenario with its vehicle and schedule; `commands` replaces the schedule that the file names.
pub fn scenario(path: &Path, overrides: &Overrides, commands: Option<&Path>) -> Result<Scenario, InputError> {
    ScenarioTexts::gather(path, overrides, commands)?.scenario()
}

/// A vehicle file and the files it names, as text.
#[derive(Clone)]
struct VehicleTexts {
    document: Document,
    reports: Vec<(usize, PathBuf, String)>,
    map: (PathBuf, String),
    area: (PathBuf, String),
}

impl VehicleTexts {
    fn gather(path: &Path, document: Document) -> Result<Self, InputError> {
        let file = VehicleFile::read(&document)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let beside = |name: &str| {
            let path = folder.join(name);
            text(&path).map(|text| (path, text))
        };
        let reports = file
            .mass_reports()
            .into_iter()
            .map(|(index, name)| beside(&name).map(|(path, text)| (index, path, text)))
            .collect::<Result<_, _>>()?;
        let (map, area) = (beside(&file.engine.map.file)?, beside(&file.feed.valve.area_file)?);
        Ok(Self { document, reports, map, area })
    }

    fn file(&self) -> Result<VehicleFile, InputError> {
        let mut file = VehicleFile::read(&self.document)?;
        for (index, path, report) in &self.reports {
            file.import_mass(*index, report).map_err(|e| InputError {
                file: path.display().to_string(),
                diagnostics: vec![Diagnostic { line: Some(e.line), key: String::new(), message: e.message }],
            })?;
        }
        Ok(file)
    }

    fn vehicle(&self) -> Result<Vehicle, InputError> {
        Vehicle::new(self.file()?, &self.map.1, &self.area.1).map_err(|e| match e {
            VehicleError::Table { table: Table::Map, message } => unusable(&self.map.0, message),
            VehicleError::Table { table: Table::ValveArea, message } => unusable(&self.area.0, message),
            VehicleError::Invalid(fault) => self.document.error(vec![fault]),
        })
    }
}

/// A scenario and every file it needs, read once: scenarios that differ in single values are made of it without
/// another look at the disk.
#[derive(Clone)]
pub struct ScenarioTexts {
    name: String,
    flight: Document,
    vehicle: VehicleTexts,
    schedule: Option<Schedule>,
}

impl ScenarioTexts {
    /// Reads the files; `commands` replaces the schedule that the scenario names.
    ///
    /// # Errors
    /// When a file cannot be read, or its values cannot be.
    pub fn gather(path: &Path, overrides: &Overrides, commands: Option<&Path>) -> Result<Self, InputError> {
        let mut flight = document(path)?;
        match kind(&flight) {
            Ok(Kind::Vehicle) => {
                let message = "this is a vehicle file; a scenario names one: vehicle = \"FILE\"";
                return Err(unusable(path, message));
            }
            Ok(Kind::Campaign) => {
                let message = "this is a campaign, which names its scenario: use `hopbench campaign`";
                return Err(unusable(path, message));
            }
            _ => {}
        }
        let mut vehicle_overrides = Vec::new();
        for (key, value) in pairs(overrides)? {
            match key.strip_prefix("vehicle.") {
                Some(key) => vehicle_overrides.push((key, value)),
                None => flight.set(key, value)?,
            }
        }
        let file = ScenarioFile::read(&flight)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let vehicle_path = folder.join(&file.vehicle);
        let mut vehicle = document(&vehicle_path)?;
        file.set_vehicle(&flight, &mut vehicle)?;
        for (key, value) in vehicle_overrides {
            vehicle.set_given(&format!("vehicle.{key}"), key, value)?;
        }
        let vehicle = VehicleTexts::gather(&vehicle_path, vehicle)?;
        let schedule_path: Option<PathBuf> =
            commands.map(Path::to_owned).or_else(|| file.commands.as_ref().map(|c| folder.join(c)));
        let schedule = match &schedule_path {
            None => None,
            Some(path) => Some(Schedule::parse(&text(path)?).map_err(|e| InputError {
                file: path.display().to_string(),
                diagnostics: vec![Diagnostic { line: Some(e.line), key: String::new(), message: e.message }],
            })?),
        };
        let name = path.file_stem().map_or_else(|| "scenario".into(), |s| s.to_string_lossy().into_owned());
        Ok(Self { name, flight, vehicle, schedule })
    }

    /// Puts a value at a dotted path of the scenario, or behind `vehicle.` of its vehicle; messages say that it
    /// was given at `place`.
    ///
    /// # Errors
    /// When there is no such place. Whether the key is known is judged by [`ScenarioTexts::scenario`].
    pub fn put(&mut self, place: &str, key: &str, value: toml::Value) -> Result<(), InputError> {
        match key.strip_prefix("vehicle.") {
            Some(inner) => self.vehicle.document.put(place, key, inner, value),
            None => self.flight.put(place, key, key, value),
        }
    }

    /// Every value in force, absent ones at their defaults: the scenario, with the vehicle file at `vehicle`.
    ///
    /// # Errors
    /// When a value is wrong.
    pub fn values(&self) -> Result<serde_json::Value, InputError> {
        let file = ScenarioFile::read(&self.flight)?;
        let json = |values: Result<serde_json::Value, serde_json::Error>| {
            values.map_err(|e| unusable(Path::new(self.flight.file()), e.to_string()))
        };
        let mut values = json(serde_json::to_value(&file))?;
        values["vehicle"] = json(serde_json::to_value(self.vehicle.file()?))?;
        Ok(values)
    }

    /// Text of the tables that the vehicle file names.
    pub fn tables(&self) -> [&str; 2] {
        [&self.vehicle.map.1, &self.vehicle.area.1]
    }

    /// The scenario with its vehicle.
    ///
    /// # Errors
    /// When a value is wrong.
    pub fn scenario(&self) -> Result<Scenario, InputError> {
        let file = ScenarioFile::read(&self.flight)?;
        let vehicle = self.vehicle.vehicle()?;
        Scenario::new(&self.name, file, vehicle, self.schedule.clone())
            .map_err(|faults| self.flight.error(faults))
    }
}

fn pairs(overrides: &Overrides) -> Result<Vec<(&str, &str)>, InputError> {
    overrides
        .iter()
        .map(|pair| {
            pair.split_once('=').map(|(key, value)| (key.trim(), value.trim())).ok_or_else(|| InputError {
                file: "--set".to_owned(),
                diagnostics: vec![Diagnostic {
                    line: None,
                    key: String::new(),
                    message: format!("'{pair}' is not KEY=VALUE"),
                }],
            })
        })
        .collect()
}
