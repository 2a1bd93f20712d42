//! Least-fuel motions against CVXPY and ECOS (tools/reference/make_lcvx_points.py; versions in the data
//! files), and the conditions of optimality of the program itself.

// The test prints its figures for the record.
#![allow(clippy::disallowed_macros)]

use crate::fixture::lcvx;
use hopbench::autopilot::lcvx::conic::{self, Accuracy, Program, Solution};
use hopbench::autopilot::lcvx::{GlideSlope, Motion, Objective, Problem, program};
use hopbench::frame::Vec3;

const PROBLEMS: &str = include_str!("lcvx_problems.csv");
const TRAJECTORIES: &str = include_str!("lcvx_trajectories.csv");

/// As accurate as the stored answers.
const ACCURACY: Accuracy = Accuracy { feasibility: 1e-10, gap: 1e-10, iterations_max: 60 };

fn rows<const N: usize>(text: &str) -> Vec<[f64; N]> {
    let lines = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    let rows = lines.map(|line| line.split(',').map(|x| x.parse().unwrap()).collect::<Vec<f64>>());
    rows.map(|row| row.try_into().unwrap()).collect()
}

struct Stored {
    unique: bool,
    flight_time_s: f64,
    fuel_kg: f64,
    problem: Problem,
}

fn stored() -> Vec<Stored> {
    let of_row = |row: [f64; 25]| {
        let vector = |at: usize| Vec3::new(row[at], row[at + 1], row[at + 2]);
        let mut problem = lcvx::descent(0.0);
        problem.start.position_ned_m = vector(3);
        problem.start.velocity_ned_m_s = vector(6);
        problem.start.mass_kg = row[9];
        problem.target.position_ned_m = vector(10);
        problem.target.velocity_ned_m_s.z = row[13];
        let engine = &mut problem.engine;
        [engine.thrust_min_n, engine.thrust_max_n] = [row[14], row[15]];
        [engine.mass_flow_per_thrust_s_m, engine.dry_mass_kg] = [row[16], row[17]];
        let limits = &mut problem.limits;
        [limits.tilt_rad, limits.speed_m_s, limits.climb_m_s, limits.sink_m_s] =
            [row[18], row[19], row[20], row[21]];
        let [angle_rad, offset_m] = [row[22], row[23]];
        limits.glide_slope = (angle_rad > 0.0).then_some(GlideSlope { angle_rad, offset_m });
        Stored { unique: row[1] == 1.0, flight_time_s: row[2], fuel_kg: row[24], problem }
    };
    rows(PROBLEMS).into_iter().map(of_row).collect()
}

fn solved(stored: &Stored) -> (Program, Solution) {
    let program = program(&stored.problem, Objective::Fuel, stored.flight_time_s);
    let solution = conic::solve(&program, ACCURACY);
    assert_eq!(solution.status, conic::Status::Solved);
    (program, solution)
}

#[test]
fn fuel_and_motion_of_twenty_problems() {
    let nodes = rows::<10>(TRAJECTORIES);
    let (mut fuel, mut position, mut velocity, mut compared) = (0f64, 0f64, 0f64, 0);
    for (index, stored) in stored().iter().enumerate() {
        let (_, solution) = solved(stored);
        let motion = Motion::new(&stored.problem, stored.flight_time_s, &solution.x);
        fuel = fuel.max((motion.fuel_kg() / stored.fuel_kg - 1.0).abs());
        if !stored.unique {
            continue;
        }
        let way = stored.problem.target.position_ned_m - stored.problem.start.position_ned_m;
        for (k, node) in nodes.iter().filter(|node| node[0] == index as f64).enumerate() {
            let off_m = (motion.position_ned_m[k] - Vec3::new(node[1], node[2], node[3])).norm();
            let off_m_s = (motion.velocity_ned_m_s[k] - Vec3::new(node[4], node[5], node[6])).norm();
            position = position.max(off_m / way.norm());
            velocity = velocity.max(off_m_s / stored.problem.limits.speed_m_s);
            compared += 1;
        }
    }
    println!("fuel {fuel:.1e}, position {position:.1e} of the way, velocity {velocity:.1e} of the limit");
    assert_eq!(compared, 18 * 30);
    // Both solvers stop at a gap of 1e-10 or as close as rounding lets them. The motion is less certain than
    // the cost, because near the optimum the cost is flat: it varies over about the root of the gap, 1e-5 to
    // 1e-4.
    assert!(fuel < 1e-6 && position < 5e-5 && velocity < 3e-4);
}

#[test]
fn conditions_of_optimality_hold() {
    let (mut primal, mut dual, mut gap, mut outside) = (0f64, 0f64, 0f64, 0f64);
    for stored in stored() {
        let (program, solution) = solved(&stored);
        let (x, s, z) = (&solution.x, &solution.s, &solution.z);
        let mut rest: Vec<f64> = s.iter().zip(&program.right).map(|(s, b)| s - b).collect();
        let mut slope = program.cost.clone();
        for column in 0..x.len() {
            for k in program.column_starts[column]..program.column_starts[column + 1] {
                rest[program.rows[k]] += program.values[k] * x[column];
                slope[column] += program.values[k] * z[program.rows[k]];
            }
        }
        // Relative to the numbers that meet in them.
        let size = |v: &[f64]| v.iter().fold(1.0, |most: f64, x| most.max(x.abs()));
        primal = primal.max(size_of(&rest) / size(x));
        dual = dual.max(size_of(&slope) / size(z));
        let product: f64 = s.iter().zip(z).map(|(s, z)| s * z).sum();
        gap = gap.max(product.abs() / solution.cost);
        let linear = program.equalities + program.inequalities;
        for k in program.equalities..linear {
            outside = outside.max(-s[k]).max(-z[k]);
        }
        let mut at = linear;
        for &cone in &program.cones {
            for v in [&s[at..at + cone], &z[at..at + cone]] {
                outside = outside.max(v[1..].iter().map(|x| x * x).sum::<f64>().sqrt() - v[0]);
            }
            at += cone;
        }
        assert!(s[..program.equalities].iter().all(|s| s.abs() < 1e-12));
    }
    println!(
        "A x + s - b {primal:.1e}, A' z + q {dual:.1e}, s z {gap:.1e}, outside of the cones {outside:.1e}"
    );
    // Solver accuracy 1e-10 by its own norms, which divide by more.
    assert!(primal < 1e-7 && dual < 1e-7 && gap < 1e-7 && outside < 1e-12);
}

fn size_of(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
}
