//! Scenarios and vehicles from the disk, with the values that the command line puts in place of theirs.

use std::path::Path;

use hopbench::input::{Diagnostic, Document, InputError, InputText};
use hopbench::scenario::{Scenario, ScenarioInputs};
use hopbench::vehicle::{Vehicle, VehicleInputs};

/// Values that replace those of the files, as `KEY=VALUE`.
pub type Overrides = [String];

/// A file that cannot be used, for a reason that lies outside its values.
pub fn unusable(file: &Path, message: impl Into<String>) -> InputError {
    InputError::of_file(file.display().to_string(), message)
}

/// Scenario and vehicle contradict each other, found when a flight is set up.
pub fn contradiction(file: &Path, invalid: hopbench::input::Invalid) -> InputError {
    InputError {
        file: file.display().to_string(),
        diagnostics: vec![Diagnostic { line: None, key: invalid.key, message: invalid.message }],
    }
}

/// Refuses a scenario that nobody can fly.
pub fn flyable(file: &Path, scenario: &Scenario) -> Result<(), InputError> {
    if scenario.schedule.is_none() && !scenario.file.sensors.enabled {
        return Err(unusable(file, "sensors.enabled = false needs a command schedule"));
    }
    Ok(())
}

/// A TOML file, parsed.
pub fn document(path: &Path) -> Result<Document, InputError> {
    InputText::read(path, &mut from_disk)?.document()
}

/// A vehicle file with the tables it names.
pub fn vehicle(path: &Path, overrides: &Overrides) -> Result<Vehicle, InputError> {
    let mut document = document(path)?;
    for (key, value) in pairs(overrides)? {
        document.set_given(key, key.strip_prefix("vehicle.").unwrap_or(key), value)?;
    }
    VehicleInputs::read(document, path, from_disk)?.vehicle()
}

/// A scenario with its vehicle and schedule; `commands` replaces the schedule that the file names.
pub fn scenario(path: &Path, overrides: &Overrides, commands: Option<&Path>) -> Result<Scenario, InputError> {
    inputs(path, overrides, commands)?.scenario()
}

/// A scenario and every file it names, as read: what a campaign varies and a run keeps.
pub fn inputs(
    path: &Path,
    overrides: &Overrides,
    commands: Option<&Path>,
) -> Result<ScenarioInputs, InputError> {
    ScenarioInputs::read(path, &pairs(overrides)?, commands, from_disk)
}

fn from_disk(path: &Path) -> std::io::Result<String> {
    std::fs::read_to_string(path)
}

fn pairs(overrides: &Overrides) -> Result<Vec<(&str, &str)>, InputError> {
    overrides
        .iter()
        .map(|pair| {
            pair.split_once('=')
                .map(|(key, value)| (key.trim(), value.trim()))
                .ok_or_else(|| InputError::of_file("--set", format!("'{pair}' is not KEY=VALUE")))
        })
        .collect()
}
