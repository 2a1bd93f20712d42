//! Reference: sloshing modes against a Ritz solution of the linear problem, and motion on the nonlinear
//! spring against DOP853 (tools/reference/make_slosh_reference.py; tool versions in the data file).

#![allow(clippy::disallowed_macros)] // it prints what was achieved

use crate::fixture::motion::reference_vehicle;
use hopbench::dynamics::mass::TankGeometry;
use hopbench::dynamics::slosh::{Coupling, HardeningLaw, Mode, SloshState};
use hopbench::integrator::{Integrable, rk4_step};
use nalgebra::Vector2;

const DATA: &str = include_str!("slosh.csv");

fn rows(kind: &'static str) -> impl Iterator<Item = Vec<&'static str>> {
    DATA.lines().map(|line| line.split(',').collect()).filter(move |row: &Vec<&str>| row[0] == kind)
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

// The Ritz numbers hold 13 digits (more polynomials move the last ones of the deepest tank) of lengths and
// shares of order one; stations of shallow tanks, differences of such numbers, as many after the point.
// Achieved: 1.1e-13.
#[test]
fn frequency_mass_and_station_are_those_of_potential_flow() {
    let mut slosh = reference_vehicle().slosh;
    slosh.second_mode = true;
    let tank = TankGeometry { radius_m: 1.0, length_m: 10.0, floor_z_m: 0.0 };
    let mut worst = 0.0_f64;
    for row in rows("mode") {
        let [order, depth, frequency, share, station] = [1, 2, 3, 4, 5].map(|i| number(row[i]));
        let liquid_kg = core::f64::consts::PI * depth; // of density one
        let mode = slosh.modes(&tank, liquid_kg, 1.0, 1.0)[order as usize - 1].unwrap();
        worst = worst
            .max((mode.stiffness_1_s2 / frequency - 1.0).abs())
            .max((mode.mass_kg / liquid_kg / share - 1.0).abs())
            .max((-mode.station_z_body_m - station).abs());
    }
    assert_eq!(rows("mode").count(), 12);
    println!("modes: {worst:.2e}; allowed 1e-12");
    assert!(worst < 1e-12, "{worst:e}");
}

#[derive(Clone, Copy)]
struct State(SloshState);

impl Integrable for State {
    type Rate = State;
    fn advanced(&self, k: &Self, dt_s: f64) -> Self {
        Self(SloshState {
            displacement_body_m: self.0.displacement_body_m + k.0.displacement_body_m * dt_s,
            velocity_body_m_s: self.0.velocity_body_m_s + k.0.velocity_body_m_s * dt_s,
        })
    }
    fn rk4_mean(k1: &Self, k2: &Self, k3: &Self, k4: &Self) -> Self {
        let sum = k1.advanced(k2, 2.0).advanced(k3, 2.0).advanced(k4, 1.0);
        sum.advanced(&sum, -5.0 / 6.0)
    }
}

/// Greatest deviation of a case in displacement [m], at a step.
fn deviation(case: &str, steps_a_second: u32) -> f64 {
    let rows: Vec<_> = rows("motion").filter(|row| row[1] == case).collect();
    let [stiffness_1_s2, cubic, damping, baffle, drive, frequency] =
        [3, 4, 5, 6, 7, 8].map(|i| number(rows[0][i]));
    let mode = Mode {
        mass_kg: 1.0,
        station_z_body_m: 0.0,
        stiffness_1_s2,
        damping_rate_1_s: damping,
        baffle_rate: baffle,
        hardening_1_m2_s2: cubic,
        hardening_law: if rows[0][2] == "radial" { HardeningLaw::Radial } else { HardeningLaw::PerAxis },
        stop_radius_m: 1.0, // out of reach
        stop_stiffness_1_s2: 0.0,
        stop_damping_rate_1_s: 0.0,
        coupling: Coupling::TwoWay,
    };
    let dt_s = 1.0 / f64::from(steps_a_second);
    let at = |row: &[&str], i: usize| Vector2::new(number(row[i]), number(row[i + 1]));
    let mut state =
        State(SloshState { displacement_body_m: at(&rows[0], 10), velocity_body_m_s: at(&rows[0], 12) });
    let (mut step, mut worst) = (0, 0.0_f64);
    for row in &rows {
        while step < (number(row[9]) * f64::from(steps_a_second)).round() as u32 {
            state = rk4_step(&state, dt_s, |s, fraction| {
                let t = (f64::from(step) + fraction) * dt_s;
                let tank = Vector2::new(drive * libm::cos(frequency * t), 0.0);
                State(SloshState {
                    displacement_body_m: s.0.velocity_body_m_s,
                    velocity_body_m_s: mode.restoring_m_s2(&s.0) - tank,
                })
            });
            step += 1;
        }
        worst = worst.max((state.0.displacement_body_m - at(row, 10)).norm());
    }
    assert_eq!(step, 10 * steps_a_second, "the whole case was compared");
    worst
}

// RK4's error per radian is (ω dt)⁴/120: 5e-10 at 15 rad/s and 1 ms, over 150 rad and 0.09 m 6e-9 m at the
// plant's step; and half the step divides the error by sixteen. Achieved: 3.5e-9 m planar, undamped; 2e-10 m
// with a baffle.
#[test]
fn motion_on_the_spring_agrees_with_dop853() {
    let limit_m = 1e-8;
    for case in ["planar", "both_axes", "rotary", "baffle", "driven"] {
        let (coarse, fine) = (deviation(case, 1000), deviation(case, 2000));
        println!("{case}: {coarse:.2e} m at 1 ms, {fine:.2e} m at 0.5 ms; allowed {limit_m:e} m");
        assert!(coarse < limit_m, "{case}: {coarse:e} m");
        let order = coarse / fine;
        assert!((12.0..20.0).contains(&order), "{case}: {coarse:e} m to {fine:e} m");
    }
}
