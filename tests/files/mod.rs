//! The project's own scenarios and vehicles, for tests.
#![allow(dead_code)] // each test binary uses its part
#![allow(clippy::disallowed_methods)] // tests read files; the library does not

use std::path::{Path, PathBuf};

use hopbench::input::{Document, InputError};
use hopbench::scenario::{Scenario, ScenarioFile, Schedule};
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::Flight;
use hopbench::vehicle::{Vehicle, VehicleFile};

pub fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios")
}

pub fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The vehicle of a document, with the tables beside `scenarios/vehicles`.
pub fn vehicle_of(document: &Document) -> Result<Vehicle, InputError> {
    let mut file = VehicleFile::read(document)?;
    let vehicles = folder().join("vehicles");
    for (index, name) in file.mass_reports() {
        file.import_mass(index, &text(&vehicles.join(name))).unwrap();
    }
    let (map, area) =
        (text(&vehicles.join(&file.engine.map.file)), text(&vehicles.join(&file.feed.valve.area_file)));
    Vehicle::new(file, &map, &area).map_err(|e| match e {
        hopbench::vehicle::VehicleError::Invalid(fault) => document.error(vec![fault]),
        table => panic!("{table}"),
    })
}

pub fn reference_document() -> Document {
    Document::parse("reference.toml", &text(&folder().join("vehicles/reference.toml"))).unwrap()
}

pub fn reference() -> Vehicle {
    vehicle_of(&reference_document()).unwrap()
}

/// A scenario of the project with values replaced, `vehicle.` ones in the vehicle file.
pub fn scenario(name: &str, overrides: &[(&str, &str)]) -> Scenario {
    try_scenario(name, overrides).unwrap_or_else(|e| panic!("{e}"))
}

pub fn try_scenario(name: &str, overrides: &[(&str, &str)]) -> Result<Scenario, InputError> {
    let path = folder().join(format!("{name}.toml"));
    let mut document = Document::parse(name, &text(&path))?;
    let of_vehicle = |key: &str| key.strip_prefix("vehicle.").map(str::to_owned);
    for (key, value) in overrides.iter().filter(|(key, _)| of_vehicle(key).is_none()) {
        document.set(key, value)?;
    }
    let file = ScenarioFile::read(&document)?;
    let mut vehicle = Document::parse(&file.vehicle, &text(&folder().join(&file.vehicle)))?;
    file.set_vehicle(&document, &mut vehicle)?;
    for (key, value) in overrides {
        if let Some(key) = of_vehicle(key) {
            vehicle.set(&key, value)?;
        }
    }
    let schedule = file.commands.as_ref().map(|c| Schedule::parse(&text(&folder().join(c))).unwrap());
    let vehicle = vehicle_of(&vehicle)?;
    Scenario::new(name, file, vehicle, schedule).map_err(|faults| document.error(faults))
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
