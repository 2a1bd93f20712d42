//! One equation at a time against SciPy (tools/reference/make_scipy_points.py; version in the data files):
//! regression, chamber pressure and thrust, filling, slosh, tumbling.

// The test prints its figures for the record.
#![allow(clippy::disallowed_macros)]

use crate::fixture::bare_engine;
use crate::fixture::motion;
use hopbench::dynamics::mass::{FlowTerms, MassProperties};
use hopbench::dynamics::rigid_body::accelerations;
use hopbench::dynamics::slosh::SloshState;
use hopbench::frame::{Mat3, Vec3};
use hopbench::integrator::{Integrable, rk4_step};
use hopbench::propulsion::{ChamberGas, EngineCondition, FeedMap, NozzleFlow, WarmStart};
use nalgebra::Vector2;

const REGRESSION: &str = include_str!("regression_points.csv");
const NOZZLE: &str = include_str!("nozzle_points.csv");
const FILLING: &str = include_str!("filling_points.csv");
const SLOSH: &str = include_str!("slosh_points.csv");
const TUMBLING: &str = include_str!("tumbling_points.csv");

fn rows<const N: usize>(text: &str) -> Vec<[f64; N]> {
    let lines = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    let rows = lines.map(|line| line.split(',').map(|x| x.parse().unwrap()).collect::<Vec<f64>>());
    rows.map(|row| row.try_into().unwrap()).collect()
}

/// Keeps the greatest, and a NaN if there is one.
fn grow(worst: &mut f64, error: f64) {
    if error.abs() > *worst || error.is_nan() {
        *worst = error.abs();
    }
}

/// The flow of the reference runs (kg/s).
fn throttled_kg_s(t: f64) -> f64 {
    0.30 + 0.12 * libm::sin(0.9 * t) + 0.05 * libm::sin(4.1 * t + 0.6)
}

/// Numbers that move together along a rate.
#[derive(Clone)]
struct Numbers<const N: usize>([f64; N]);

impl<const N: usize> Integrable for Numbers<N> {
    type Rate = Self;
    fn advanced(&self, k: &Self, dt_s: f64) -> Self {
        Self(core::array::from_fn(|i| self.0[i] + k.0[i] * dt_s))
    }
    fn rk4_mean(a: &Self, b: &Self, c: &Self, d: &Self) -> Self {
        Self(core::array::from_fn(|i| (a.0[i] + 2.0 * (b.0[i] + c.0[i]) + d.0[i]) / 6.0))
    }
}

#[test]
fn regression_under_a_throttled_flow() {
    let (mut radius, mut flow, mut mass) = (0.0, 0.0, 0.0);
    for ports in [1u32, 3, 7] {
        let mut grain = bare_engine::vehicle().engine.grain;
        grain.port_count = ports;
        let rows: Vec<_> =
            rows::<6>(REGRESSION).into_iter().filter(|row| row[0] == f64::from(ports)).collect();
        assert_eq!(rows.len(), 11);
        let mut at = Numbers([rows[0][3]]);
        let mut step = 0;
        for [_, time_s, oxidizer_kg_s, port_radius_m, fuel_kg_s, left_kg] in rows {
            while step < (time_s * 1e3).round() as u32 {
                at = rk4_step(&at, 1e-3, |r, share| {
                    let now = throttled_kg_s((f64::from(step) + share) * 1e-3);
                    Numbers([grain.regression_rate_m_s(now, r.0[0])])
                });
                step += 1;
            }
            grow(&mut radius, at.0[0] - port_radius_m);
            let own = grain.regression_rate_m_s(oxidizer_kg_s, port_radius_m)
                * grain.fuel_per_regression_kg_m(port_radius_m);
            grow(&mut flow, own / fuel_kg_s - 1.0);
            // The fuel left is that of the vehicle, which stops at burn-through; the rows stay above.
            grow(&mut mass, grain.fuel_kg(port_radius_m) - left_kg.max(0.0));
        }
    }
    println!("regression: radius {radius:.1e} m, fuel flow {flow:.1e}, fuel left {mass:.1e} kg");
    // RK4 at 1 ms on a rate that turns at 4 rad/s: (4e-3)⁴/120 of 1 mm/s is 2e-15 m/s, over 20 s; DOP853 to
    // 1e-12.
    assert!(radius < 1e-12 && flow < 1e-13 && mass < 1e-13, "{radius:e} {flow:e} {mass:e}");
}

#[test]
fn chamber_pressure_and_thrust_against_flow() {
    let (engine, feed) = (bare_engine::engine(), FeedMap::new(65e5, 290.0));
    let rows = rows::<7>(NOZZLE);
    assert_eq!(rows.len(), 120);
    let (mut fuel, mut pressure, mut thrust, mut states) = (0.0, 0.0, 0.0, [0; 3]);
    for [port_m, throat_m, oxidizer_kg_s, fuel_kg_s, chamber_pa, thrust_n, state] in rows {
        let condition = bare_engine::condition(port_m * 1e3, throat_m * 1e3);
        let point = bare_engine::at_flow(&engine, &feed, oxidizer_kg_s, &condition);
        let expected = [NozzleFlow::Unchoked, NozzleFlow::Separated, NozzleFlow::Full][state as usize - 1];
        assert_eq!(point.nozzle_flow, expected, "{oxidizer_kg_s} kg/s");
        states[state as usize - 1] += 1;
        grow(&mut fuel, point.fuel_kg_s / fuel_kg_s - 1.0);
        grow(&mut pressure, point.chamber_pa / chamber_pa - 1.0);
        grow(&mut thrust, (point.thrust_n - thrust_n) / thrust_n.max(1.0));
    }
    println!("nozzle: fuel {fuel:.1e}, Pc {pressure:.1e}, thrust {thrust:.1e}; rows by state {states:?}");
    assert!(states.iter().all(|n| *n > 5), "{states:?}");
    // Both sides solve to round-off; the map is the same piecewise cubic, its slopes by the same rule.
    assert!(fuel < 1e-12 && pressure < 1e-10 && thrust < 1e-10, "{fuel:e} {pressure:e} {thrust:e}");
}

#[test]
fn chamber_that_fills() {
    let (engine, feed) = (bare_engine::filling_engine(), FeedMap::new(65e5, 290.0));
    let area_m2 = engine.valve_area().fully_open().1;
    let rows = rows::<5>(FILLING);
    let mut at = Numbers([rows[0][1], rows[0][2]]);
    let evaluate = |gas: &Numbers<2>, time_s: f64| {
        let condition = EngineCondition {
            chamber_gas: Some(ChamberGas { oxidizer_kg: gas.0[0], fuel_kg: gas.0[1] }),
            fuel_flow_kg_s: None,
            oxidizer_flow_limit_kg_s: throttled_kg_s(time_s),
            outlet: None,
            ..bare_engine::condition(35.0, 10.0)
        };
        engine.operating_point(&feed, area_m2, &condition, WarmStart::default())
    };
    let dt_s = 1e-4;
    let (mut step, mut mass, mut pressure, mut flow) = (0, 0.0, 0.0, 0.0);
    for [time_s, oxidizer_kg, fuel_kg, chamber_pa, nozzle_kg_s] in rows {
        while step < (time_s / dt_s).round() as u32 {
            at = rk4_step(&at, dt_s, |gas, share| {
                let rate = evaluate(gas, (f64::from(step) + share) * dt_s).chamber_gas_rate;
                Numbers([rate.oxidizer_kg_s, rate.fuel_kg_s])
            });
            step += 1;
        }
        let now = evaluate(&at, time_s);
        grow(&mut mass, (at.0[0] - oxidizer_kg) / oxidizer_kg);
        grow(&mut mass, (at.0[1] - fuel_kg) / fuel_kg);
        grow(&mut pressure, now.chamber_pa / chamber_pa - 1.0);
        grow(&mut flow, now.nozzle_kg_s / nozzle_kg_s - 1.0);
    }
    println!("filling: masses {mass:.1e}, Pc {pressure:.1e}, nozzle flow {flow:.1e}");
    // The chamber turns over in some 3 ms: (0.1/3)⁴/120 = 1e-8 per time constant, forgotten within the next.
    assert!(mass < 1e-8 && pressure < 1e-8 && flow < 1e-8, "{mass:e} {pressure:e} {flow:e}");
}

#[test]
fn slosh_mode_and_its_oscillator() {
    let reference = motion::reference_vehicle();
    let tank = reference.model.tank();
    let mode =
        |kg: f64, g: f64| reference.slosh.modes(tank, kg, motion::FULL.nitrous_density_kg_m3, g)[0].unwrap();
    let rows = rows::<6>(SLOSH);
    let (mut frequency, mut mass, mut station) = (0.0, 0.0, 0.0);
    for [_, kg, g, omega, slosh_kg, z_m] in rows.iter().filter(|row| row[0] == 0.0) {
        let mode = mode(*kg, *g);
        grow(&mut frequency, mode.stiffness_1_s2.sqrt() / omega - 1.0);
        grow(&mut mass, mode.mass_kg / slosh_kg - 1.0);
        grow(&mut station, -mode.station_z_body_m - z_m);
    }
    println!("mode: frequency {frequency:.1e}, mass {mass:.1e}, station {station:.1e} m");
    // The density of the file's heading has ten digits; the rest is round-off.
    assert!(frequency < 1e-10 && mass < 1e-10 && station < 1e-10);

    // Driven along x and, as strongly, along y: axes are independent (cubic per axis).
    let driven = rows.iter().filter(|row| row[0] == 1.0).collect::<Vec<_>>();
    assert_eq!(driven.len(), 33);
    let mode = mode(9.0, 9.80665);
    let mut at = Numbers([driven[0][3], driven[0][4], -driven[0][3], driven[0][4]]);
    let (mut step, mut displacement) = (0, 0.0);
    for [_, time_s, _, x_m, _, _] in driven {
        while step < (time_s * 1e3).round() as u32 {
            at = rk4_step(&at, 1e-3, |s, share| {
                let t = (f64::from(step) + share) * 1e-3;
                let drive = 1.2 * libm::sin(9.0 * t) + 0.4 * libm::cos(17.0 * t);
                let state = SloshState {
                    displacement_body_m: Vector2::new(s.0[0], s.0[2]),
                    velocity_body_m_s: Vector2::new(s.0[1], s.0[3]),
                };
                let pull = mode.restoring_m_s2(&state);
                Numbers([s.0[1], pull.x - drive, s.0[3], pull.y + drive])
            });
            step += 1;
        }
        grow(&mut displacement, at.0[0] - x_m);
    }
    println!("driven oscillator: {displacement:.1e} m");
    // RK4 at 1 ms: (14e-3)⁴/120 per radian over 110 rad of 20 mm is 7e-10 m.
    assert!(displacement < 7e-10, "{displacement:e}");
}

#[test]
fn a_body_of_three_unequal_moments_tumbles_as_jacobi_says() {
    let flow = FlowTerms::none();
    // In axes turned against the principal ones the tensor is full.
    let turn = *nalgebra::Rotation3::from_euler_angles(0.4, -0.7, 1.1).matrix();
    let centre = Vec3::new(0.02, -0.01, -0.4);
    let inertia = turn * Mat3::from_diagonal(&Vec3::new(12.0, 21.0, 26.0)) * turn.transpose();
    let vehicle = MassProperties {
        mass_kg: 70.0,
        first_moment_kg_m: centre * 70.0,
        inertia_kg_m2: inertia + hopbench::frame::point_inertia(centre) * 70.0,
    };
    let rows = rows::<4>(TUMBLING);
    let mut state = motion::State::at_rest();
    state.rate_body_rad_s = turn * Vec3::new(rows[0][1], rows[0][2], rows[0][3]);
    let (mut step, mut worst) = (0, 0.0);
    for [time_s, a, b, c] in rows {
        while step < (time_s * 1e3).round() as u32 {
            state = rk4_step(&state, 1e-3, |s, _| {
                s.rate(&accelerations(&motion::balance(&vehicle, &flow, s.rate_body_rad_s)), 0.0)
            });
            step += 1;
        }
        grow(&mut worst, (state.rate_body_rad_s - turn * Vec3::new(a, b, c)).norm());
    }
    println!("tumbling: {worst:.1e} rad/s");
    // (ω dt)⁴/120 per radian over 25 rad: 4e-12 of 2 rad/s.
    assert!(worst < 1e-11, "{worst:e}");
}
