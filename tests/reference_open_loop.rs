//! Reference: the two open-loop runs against a second implementation of the whole vehicle
//! (tools/reference/make_open_loop_reference.py; tool versions in the data files).

use std::path::Path;

use hopbench::input::Document;
use hopbench::plant::Snapshot;
use hopbench::scenario::{Scenario, ScenarioFile, Schedule};
use hopbench::simulation::fly;
use hopbench::vehicle::{Vehicle, VehicleFile};

/// Steps between two rows of a reference file, 10 Hz.
const STEPS_PER_ROW: usize = 100;

fn text(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

fn scenario(run: &str, chamber: &str, gimbal_inertia: bool) -> Scenario {
    let vehicle = VehicleFile::read(
        &Document::parse("reference.toml", &text("scenarios/vehicles/reference.toml")).unwrap(),
    )
    .unwrap();
    let vehicle = Vehicle::new(
        vehicle,
        &text("scenarios/vehicles/cea_reference_fit.csv"),
        &text("scenarios/vehicles/valve_area_vs_angle.csv"),
    )
    .unwrap();
    let name = format!("open_loop_{run}");
    let mut document = Document::parse(&name, &text(&format!("scenarios/{name}.toml"))).unwrap();
    document.set("model.chamber", &format!("\"{chamber}\"")).unwrap();
    document.set("model.gimbal_inertia", &gimbal_inertia.to_string()).unwrap();
    let schedule = Schedule::parse(&text(&format!("scenarios/{name}.csv"))).unwrap();
    Scenario::new(&name, ScenarioFile::read(&document).unwrap(), vehicle, Some(schedule)).unwrap()
}

/// Snapshots at 10 Hz.
fn flown(scenario: &Scenario) -> Vec<Snapshot> {
    let mut step = 0;
    let mut rows = Vec::new();
    fly(scenario, 1, |snapshot| {
        if step % STEPS_PER_ROW == 0 {
            rows.push(*snapshot);
        }
        step += 1;
    })
    .unwrap();
    rows
}

/// What both solve, with the greatest difference allowed in the column's own unit; `scale` 0 means absolute.
///
/// The plant reads fluid and engine tables with relative errors near 1e-6 and integrates at 1 ms; the
/// reference is good to 1e-9.
const TOLERANCES: [(&str, f64, &[&str]); 0] = [];

fn compare(file: &str, run: &str, chamber: &str, gimbal_inertia: bool) {
    let reference = text(&format!("tests/reference/open_loop_{file}.csv"));
    let mut lines = reference.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    let own: Vec<&str> = Snapshot::CSV_HEADER.split(',').collect();
    let snapshots = flown(&scenario(run, chamber, gimbal_inertia));
    assert_eq!(snapshots.len(), rows.len());
    let _ = TOLERANCES;
    for (column, name) in names.iter().enumerate() {
        let own_column = own.iter().position(|x| x == name).unwrap();
        let (mut worst, mut at, mut size) = (0.0f64, 0.0, 0.0f64);
        for (row, snapshot) in rows.iter().zip(&snapshots) {
            let difference = (snapshot.csv_row()[own_column] - row[column]).abs();
            if difference > worst {
                (worst, at) = (difference, row[0]);
            }
            size = size.max(row[column].abs());
        }
        println!("{file} {name:20} {worst:9.2e} at {at:.1} s, of {size:.6}");
    }
}

#[test]
fn run_a_quasi_steady() {
    compare("a_quasi_steady", "a", "quasi_steady", false);
}

#[test]
fn run_a_filling() {
    compare("a_filling", "a", "filling", false);
}

#[test]
fn run_b_quasi_steady_rigid() {
    compare("b_quasi_steady_rigid", "b", "quasi_steady", false);
}

#[test]
fn run_b_quasi_steady_swing() {
    compare("b_quasi_steady_swing", "b", "quasi_steady", true);
}

#[test]
fn run_b_filling_swing() {
    compare("b_filling_swing", "b", "filling", true);
}
