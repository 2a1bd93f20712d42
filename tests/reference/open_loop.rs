//! Reference: the two open-loop runs against a second implementation of the whole vehicle
//! (tools/reference/make_open_loop_reference.py; tool versions in the data files).

// The test reads the files that `hopbench fly` reads, and prints its figures for the record.
#![allow(clippy::disallowed_macros, clippy::disallowed_methods)]

use crate::fixture::files;

use hopbench::plant::column;
use hopbench::plant::{Plant, Snapshot, State};
use hopbench::scenario::{Scenario, Schedule};
use hopbench::simulation::fly;
use hopbench::time::SimTime;

/// Steps between two rows of a reference file, 10 Hz.
const STEPS_PER_ROW: usize = 100;
/// The same in microseconds.
const INTERVAL_US: u64 = 100_000;

fn scenario(run: &str, chamber: &str, gimbal_inertia: bool) -> Scenario {
    let (chamber, gimbal_inertia) = (format!("\"{chamber}\""), gimbal_inertia.to_string());
    files::scenario(
        &format!("open_loop_{run}"),
        &[("model.chamber", &chamber), ("model.gimbal_inertia", &gimbal_inertia)],
    )
}

/// Snapshots at 10 Hz.
fn flown(scenario: &Scenario) -> Vec<Snapshot> {
    let mut step = 0usize;
    let mut rows = Vec::new();
    fly(scenario, 1, |snapshot| {
        if step.is_multiple_of(STEPS_PER_ROW) {
            rows.push(*snapshot);
        }
        step += 1;
    })
    .unwrap();
    rows
}

/// Greatest difference allowed, in the columns' own unit.
///
/// The plant's fluid tables give density and flux to 2e-8; so much is allowed of flow, pressure, thrust and
/// mass. Over 8 s at 14 m/s2 it makes 2e-6 m/s and 1e-5 m along the thrust axis. Rates and attitude see the
/// thrust through the gimbal angle only (0.03 rad at most). The gimbal servo at 1 ms is good to
/// (omega dt)^4 / 120 = 5e-8 of an overshooting step. The reference itself is good to 1e-9.
const TOLERANCES: [(f64, &[&str]); 14] = [
    (1e-9, &["time_s"]),
    (1e-5, &["north_m", "east_m", "down_m"]),
    (2e-6, &["vn_m_s", "ve_m_s", "vd_m_s"]),
    (3e-8, &["qw", "qx", "qy", "qz"]),
    (3e-8, &["p_rad_s", "q_rad_s", "r_rad_s"]),
    (3e-7, &["mass_kg", "nitrous_kg", "fuel_kg", "nitrogen_bottle_kg", "nitrogen_ullage_kg"]),
    (1e-9, &["com_x_m", "com_y_m", "com_z_m", "port_radius_m", "throat_radius_m"]),
    (2e-8, &["ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2", "ixy_kg_m2", "ixz_kg_m2", "iyz_kg_m2"]),
    (1e-8, &["oxidizer_kg_s", "fuel_kg_s"]),
    (0.1, &["chamber_pa", "injector_inlet_pa"]),
    (2e-8, &["quality"]),
    (2e-5, &["thrust_n"]),
    (5e-7, &["gimbal_x_deg", "gimbal_y_deg"]),
    (1e-9, &["slosh_x_m", "slosh_y_m"]),
];

fn compare(file: &str, run: &str, chamber: &str, gimbal_inertia: bool) {
    let reference = files::text(&files::folder().join(format!("../tests/reference/open_loop_{file}.csv")));
    let mut lines = reference.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    let snapshots = flown(&scenario(run, chamber, gimbal_inertia));
    assert_eq!(snapshots.len(), rows.len());
    let mut missed = Vec::new();
    for (column, name) in names.iter().enumerate() {
        let own = column::csv().find(|column| column.name == *name).unwrap();
        let (mut worst, mut at, mut size) = (0.0f64, 0.0, 0.0f64);
        for (row, snapshot) in rows.iter().zip(&snapshots) {
            let difference = (own.of(snapshot) - row[column]).abs();
            if difference > worst {
                (worst, at) = (difference, row[0]);
            }
            size = size.max(row[column].abs());
        }
        let (tolerance, _) = TOLERANCES.iter().find(|(_, names)| names.contains(name)).unwrap();
        println!("{file} {name:20} {worst:9.2e} at {at:.1} s, of {size:.6}; allowed {tolerance:.0e}");
        if worst.is_nan() || worst > *tolerance {
            missed.push(*name);
        }
    }
    assert!(missed.is_empty(), "{file}: {missed:?}");
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

const VARIANTS: [(&str, &str, bool); 5] = [
    ("a", "quasi_steady", false),
    ("a", "filling", false),
    ("b", "quasi_steady", false),
    ("b", "quasi_steady", true),
    ("b", "filling", true),
];

/// States at a regular interval, flown at a step.
fn stepped(scenario: &Scenario, step: SimTime, end: SimTime) -> Vec<State> {
    let schedule = scenario.schedule.as_ref().unwrap();
    let mut plant = Plant::with_step(scenario, step).unwrap();
    let mut states = Vec::new();
    while plant.time() < end {
        plant.step(schedule.at(plant.time()));
        if plant.time().us().is_multiple_of(INTERVAL_US) {
            states.push(*plant.state());
        }
    }
    states
}

#[test]
fn halving_the_step_does_not_move_the_vehicle() {
    for (run, chamber, gimbal_inertia) in VARIANTS {
        let scenario = scenario(run, chamber, gimbal_inertia);
        let end = SimTime::from_s(scenario.file.duration_s.unwrap());
        let [whole, half, quarter] =
            [1_000, 500, 250].map(|us| stepped(&scenario, SimTime::from_us(us), end));
        let moved = |coarse: &[State], fine: &[State]| {
            let pairs = coarse.iter().zip(fine);
            pairs.map(|(a, b)| (a.position_ned_m - b.position_ned_m).norm()).fold(0.0, f64::max)
        };
        let worst = moved(&whole, &half);
        println!("{run} {chamber} {gimbal_inertia}: {worst:.1e} m, {:.1e} m", moved(&half, &quarter));
        // While the chamber of run a fills, P2 passes the vapour pressure of the tank inside a step (46.9 to
        // 47.5 bar after the row at 1.35 s, again after 6.55 s). Dyer's flux has an infinite slope there, so
        // the order is lost for one step: 1.1e-6 m.
        let allowed_m = if run == "a" && chamber == "filling" { 2e-6 } else { 1e-6 };
        assert!(worst < allowed_m, "{run} {chamber} {gimbal_inertia}: {worst:e} m");
    }
}

/// Runge and Kutta's method is of fourth order as long as nothing jumps.
#[test]
fn halving_the_step_divides_the_error_by_sixteen() {
    let mut scenario = scenario("a", "quasi_steady", false);
    let row = "time_s,valve_deg,gimbal_x_deg,gimbal_y_deg,rcs_roll\n0.0,22.0,0.3,-0.2,1\n";
    scenario.schedule = Some(Schedule::parse(row).unwrap());
    let end = SimTime::from_s(2.0);
    let last = |us| *stepped(&scenario, SimTime::from_us(us), end).last().unwrap();
    // Finer ones differ by what the pressure P2 is solved to, 1e-10 m.
    let states = [40_000, 20_000, 10_000].map(last);
    let difference = |pair: &[State]| {
        let (a, b) = (&pair[0], &pair[1]);
        [(a.position_ned_m - b.position_ned_m).norm(), (a.slosh_m - b.slosh_m).norm()]
    };
    let differences: Vec<_> = states.windows(2).map(difference).collect();
    for pair in differences.windows(2) {
        for (what, (coarse, fine)) in ["position", "slosh"].iter().zip(pair[0].iter().zip(&pair[1])) {
            let ratio = coarse / fine;
            println!("{what}: {coarse:.2e} m / {fine:.2e} m = {ratio:.2}");
            // The fifth-order term shows at 14 rad/s times 40 ms.
            assert!((14.0..18.0).contains(&ratio), "{what}: {ratio}");
        }
    }
}
