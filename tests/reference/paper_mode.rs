//! Reference: the seed paper's scheme against a second implementation of it
//! (tools/reference/make_paper_mode_reference.py; tool versions in the data file).

#![allow(clippy::disallowed_macros)] // prints its figures for the record

use crate::fixture::files;
use hopbench::plant::Snapshot;
use hopbench::plant::column;
use hopbench::scenario::Schedule;
use hopbench::simulation::fly;

/// Greatest difference allowed, in the columns' own unit.
///
/// The sweep takes the same grid point in both codes, so flow, port, thrust and chamber pressure carry
/// round-off and the fit's solver only (normal equations in Chebyshev polynomials against numpy's singular
/// values). Density of nitrous oxide and nitrogen come from tables good to 2e-8: 3e-7 kg of mass, 1e-9 m of
/// centre of mass, 1e-6 m of height after 5 s at 14 m/s². P2 and valve area carry the tables' flux. Euler at
/// 0.02 s makes a difference in slosh grow 1.029 times a step, 1300 times in 5 s: from 1e-10 m to 2e-7 m, of
/// a spring of 190 N/m per kilogram and 1 kg.
const TOLERANCES: [(f64, &[&str]); 14] = [
    (1e-9, &["time_s"]),
    (2e-6, &["north_m", "east_m", "down_m"]),
    (5e-7, &["vn_m_s", "ve_m_s", "vd_m_s"]),
    (3e-8, &["qw", "qx", "qy", "qz"]),
    (3e-8, &["p_rad_s", "q_rad_s", "r_rad_s"]),
    (3e-7, &["mass_kg", "nitrous_kg", "fuel_kg", "nitrogen_bottle_kg", "nitrogen_ullage_kg"]),
    (1e-9, &["com_x_m", "com_y_m", "com_z_m", "port_radius_m", "throat_radius_m"]),
    (2e-8, &["ixx_kg_m2", "iyy_kg_m2", "izz_kg_m2", "ixz_kg_m2", "iyz_kg_m2"]),
    (1e-11, &["oxidizer_kg_s", "fuel_kg_s", "of_ratio"]),
    (1.0, &["chamber_pa", "injector_inlet_pa"]),
    (1e-11, &["valve_area_m2"]),
    (1e-6, &["thrust_n"]),
    (2e-7, &["slosh_x_m", "slosh_y_m"]),
    (4e-5, &["slosh_force_x_n", "slosh_force_y_n"]),
];

#[test]
fn the_scheme_of_the_paper_is_flown_alike_by_two_codes() {
    let mut scenario = files::scenario("open_loop_a", &[("fidelity", "\"paper\""), ("duration_s", "5.0")]);
    let root = files::folder().join("../tests/reference");
    let commands = files::text(&root.join("paper_mode_commands.csv"));
    scenario.schedule = Some(Schedule::parse(&commands).unwrap());
    let reference = files::text(&root.join("paper_mode.csv"));
    let mut lines = reference.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    let mut snapshots: Vec<Snapshot> = Vec::new();
    fly(&scenario, 1, |now| {
        if now.time.us().is_multiple_of(100_000) {
            snapshots.push(*now);
        }
    })
    .unwrap();
    assert_eq!((snapshots.len(), rows.len()), (51, 51));
    let mut missed = Vec::new();
    for (column, name) in names.iter().enumerate() {
        let own = column::csv().find(|column| column.name == *name).unwrap();
        let (mut worst, mut at) = (0.0f64, 0.0);
        for (row, snapshot) in rows.iter().zip(&snapshots) {
            let difference = (own.of(snapshot) - row[column]).abs();
            if difference > worst || difference.is_nan() {
                (worst, at) = (difference, row[0]);
            }
        }
        let (tolerance, _) = TOLERANCES.iter().find(|(_, names)| names.contains(name)).unwrap();
        println!("{name:20} {worst:9.2e} at {at:.1} s; allowed {tolerance:.0e}");
        if worst.is_nan() || worst > *tolerance {
            missed.push(*name);
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}
