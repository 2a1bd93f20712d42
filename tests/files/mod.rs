//! The project's own scenarios and vehicles, for tests.
#![allow(dead_code)] // each test binary uses its part
#![allow(clippy::disallowed_methods)] // tests read files; the library does not

use std::path::{Path, PathBuf};

use hopbench::input::InputError;
use hopbench::scenario::{Scenario, ScenarioInputs};
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::Flight;
use hopbench::vehicle::Vehicle;

pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios")
}

pub fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// A file of `scenarios/`, by its path from there.
pub fn read(path: &Path) -> std::io::Result<String> {
    std::fs::read_to_string(folder().join(path))
}

/// A vehicle of the project.
pub fn vehicle(name: &str) -> Vehicle {
    Vehicle::load(format!("vehicles/{name}.toml"), read).unwrap_or_else(|e| panic!("{e}"))
}

pub fn reference() -> Vehicle {
    vehicle("reference")
}

/// A scenario of the project with values replaced, `vehicle.` ones in the vehicle file.
pub fn scenario(name: &str, overrides: &[(&str, &str)]) -> Scenario {
    try_scenario(name, overrides).unwrap_or_else(|e| panic!("{e}"))
}

pub fn try_scenario(name: &str, overrides: &[(&str, &str)]) -> Result<Scenario, InputError> {
    ScenarioInputs::read(Path::new(&format!("{name}.toml")), overrides, None, read)?.scenario()
}

/// What the autopilot commands over the hop of 50 m, pad to pad.
pub fn commands_of_the_hop() -> Vec<ActuatorCommand> {
    let mut flight = Flight::new(&scenario("hop_50m", &[]), 1).expect("the hop is sound");
    let (mut command, mut commands) = (ActuatorCommand::SAFE, Vec::new());
    while flight.outcome().is_none() {
        commands.push(command);
        flight.step(&command);
        if let Some(next) = flight.autopilot_command() {
            command = next;
        }
    }
    commands
}
