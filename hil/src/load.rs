//! Files into scenarios and vehicles: reads text, applies `--set`, and puts file names into messages.

use std::path::{Path, PathBuf};

use hopbench::input::{Document, Fault, InputError};
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
}

/// A file that cannot be used, for a reason that lies outside its values.
pub fn unusable(file: &Path, message: impl Into<String>) -> InputError {
    InputError {
        file: file.display().to_string(),
        faults: vec![Fault { line: None, key: String::new(), message: message.into() }],
    }
}

/// Scenario and vehicle contradict each other, found when a flight is set up.
pub fn contradiction(file: &Path, fault: hopbench::input::Invalid) -> InputError {
    InputError {
        file: file.display().to_string(),
        faults: vec![Fault { line: None, key: fault.key, message: fault.message }],
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

/// Whether a document is a vehicle or a scenario.
pub fn kind(document: &Document) -> Result<Kind, InputError> {
    match document.get("vehicle") {
        Some(toml::Value::Table(_)) => Ok(Kind::Vehicle),
        Some(toml::Value::String(_)) => Ok(Kind::Scenario),
        _ => Err(unusable(
            Path::new(document.file()),
            "neither a vehicle file (no [vehicle] table) nor a scenario (no vehicle = \"FILE\")",
        )),
    }
}

/// A vehicle file with the tables it names.
pub fn vehicle(path: &Path, overrides: &Overrides) -> Result<Vehicle, InputError> {
    let mut document = document(path)?;
    for (key, value) in pairs(overrides)? {
        document.set_given(key, key.strip_prefix("vehicle.").unwrap_or(key), value)?;
    }
    vehicle_of(path, &document)
}

fn vehicle_of(path: &Path, document: &Document) -> Result<Vehicle, InputError> {
    let mut file = VehicleFile::read(document)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    for (index, name) in file.mass_reports() {
        let report_path = folder.join(name);
        file.import_mass(index, &text(&report_path)?).map_err(|e| InputError {
            file: report_path.display().to_string(),
            faults: vec![Fault { line: Some(e.line), key: String::new(), message: e.message }],
        })?;
    }
    let map_path = folder.join(&file.engine.map.file);
    let area_path = folder.join(&file.feed.valve.area_file);
    let (map, area) = (text(&map_path)?, text(&area_path)?);
    Vehicle::new(file, &map, &area).map_err(|e| match e {
        VehicleError::Table { table: Table::Map, message } => unusable(&map_path, message),
        VehicleError::Table { table: Table::ValveArea, message } => unusable(&area_path, message),
        VehicleError::Invalid(fault) => document.error(vec![fault]),
    })
}

/// A scenario with its vehicle and schedule; `commands` replaces the schedule that the file names.
pub fn scenario(path: &Path, overrides: &Overrides, commands: Option<&Path>) -> Result<Scenario, InputError> {
    let mut flight = document(path)?;
    if kind(&flight) == Ok(Kind::Vehicle) {
        return Err(unusable(path, "this is a vehicle file; a scenario names one: vehicle = \"FILE\""));
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
    let mut vehicle_document = document(&vehicle_path)?;
    file.set_vehicle(&flight, &mut vehicle_document)?;
    for (key, value) in vehicle_overrides {
        vehicle_document.set_given(&format!("vehicle.{key}"), key, value)?;
    }
    let vehicle = vehicle_of(&vehicle_path, &vehicle_document)?;
    let schedule_path: Option<PathBuf> =
        commands.map(Path::to_owned).or_else(|| file.commands.as_ref().map(|c| folder.join(c)));
    let schedule = match &schedule_path {
        None => None,
        Some(path) => Some(Schedule::parse(&text(path)?).map_err(|e| InputError {
            file: path.display().to_string(),
            faults: vec![Fault { line: Some(e.line), key: String::new(), message: e.message }],
        })?),
    };
    let name = path.file_stem().map_or_else(|| "scenario".into(), |s| s.to_string_lossy().into_owned());
    Scenario::new(&name, file, vehicle, schedule).map_err(|faults| flight.error(faults))
}

fn pairs(overrides: &Overrides) -> Result<Vec<(&str, &str)>, InputError> {
    overrides
        .iter()
        .map(|pair| {
            pair.split_once('=').map(|(key, value)| (key.trim(), value.trim())).ok_or_else(|| InputError {
                file: "--set".to_owned(),
                faults: vec![Fault {
                    line: None,
                    key: String::new(),
                    message: format!("'{pair}' is not KEY=VALUE"),
                }],
            })
        })
        .collect()
}
