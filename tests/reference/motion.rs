//! Reference: rigid body, slosh and swinging engine against a cloud of point masses moved by Gauss's
//! principle (tools/reference/make_motion_reference.py; tool versions in the data file).

use crate::fixture::motion::{State, balance, gimbal_sine};
use hopbench::dynamics::Load;
use hopbench::dynamics::mass::{FlowTerms, MassProperties};
use hopbench::dynamics::rigid_body::{Swing, accelerations, thrust_direction_body};
use hopbench::dynamics::slosh::{Coupling, HardeningLaw, Mode, SloshState};
use hopbench::frame::{Mat3, Vec3, point_inertia};
use hopbench::integrator::rk4_step;
use nalgebra::{Quaternion, Vector2};
use std::collections::BTreeMap;

const DATA: &str = include_str!("motion_reference.csv");
const STEP_S: f64 = 1e-3;

struct Inputs(BTreeMap<&'static str, Vec<f64>>);

impl Inputs {
    fn read() -> Self {
        let lines = DATA.lines().filter_map(|line| line.strip_prefix("# ")?.split_once(" = "));
        Self(lines.map(|(key, v)| (key, v.split(' ').map(|x| x.parse().unwrap()).collect())).collect())
    }
    fn one(&self, key: &str) -> f64 {
        self.0[key][0]
    }
    fn three(&self, key: &str) -> Vec3 {
        Vec3::from_column_slice(&self.0[key])
    }
    fn two(&self, key: &str) -> Vector2<f64> {
        Vector2::from_column_slice(&self.0[key])
    }
    /// A rigid part about O.
    fn part(&self, name: &str) -> MassProperties {
        let mass_kg = self.one(&format!("{name}_mass_kg"));
        let centre = self.three(&format!("{name}_centre_m"));
        let [xx, yy, zz, xy, xz, yz] = self.0[format!("{name}_inertia_kg_m2").as_str()][..] else {
            panic!("{name}: six components of inertia")
        };
        MassProperties {
            mass_kg,
            first_moment_kg_m: centre * mass_kg,
            inertia_kg_m2: Mat3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) + point_inertia(centre) * mass_kg,
        }
    }
}

/// Greatest deviations over a case: position m, velocity m/s, quaternion, rate rad/s, slosh m.
fn deviations(case: &str) -> [f64; 5] {
    let inputs = Inputs::read();
    let (body, engine) = (inputs.part("body"), inputs.part("engine"));
    let mode = Mode {
        mass_kg: inputs.one("slosh_mass_kg"),
        station_z_body_m: inputs.one("slosh_station_m"),
        stiffness_1_s2: inputs.one("slosh_stiffness_1_s2"),
        damping_rate_1_s: inputs.one("slosh_damping_1_s"),
        baffle_rate: 0.0,
        hardening_1_m2_s2: inputs.one("slosh_hardening_1_m2_s2"),
        hardening_law: HardeningLaw::PerAxis,
        stop_radius_m: 1.0, // out of reach
        stop_stiffness_1_s2: 1e4,
        stop_damping_rate_1_s: 0.0,
        coupling: Coupling::TwoWay,
    };
    let station = Vec3::new(0.0, 0.0, mode.station_z_body_m);
    let vehicle = MassProperties {
        mass_kg: body.mass_kg + engine.mass_kg + mode.mass_kg,
        first_moment_kg_m: body.first_moment_kg_m + engine.first_moment_kg_m + station * mode.mass_kg,
        inertia_kg_m2: body.inertia_kg_m2 + engine.inertia_kg_m2 + point_inertia(station) * mode.mass_kg,
    };
    let flow = FlowTerms::none();
    let sine = |key: &str| <[f64; 3]>::try_from(&inputs.0[key][..]).unwrap();
    let (sine_x, sine_y) = (sine("gimbal_x"), sine("gimbal_y"));

    let q = &inputs.0["q_ned_from_body"];
    let mut state = State {
        position_ned_m: Vec3::zeros(),
        velocity_ned_m_s: inputs.three("velocity_ned_m_s"),
        q_ned_from_body: Quaternion::new(q[0], q[1], q[2], q[3]).normalize(),
        rate_body_rad_s: inputs.three("rate_body_rad_s"),
        slosh: SloshState {
            displacement_body_m: inputs.two("slosh_m"),
            velocity_body_m_s: inputs.two("slosh_velocity_m_s"),
        },
        second_slosh: SloshState::default(),
    };
    let mut step = 0;
    let mut worst = [0.0_f64; 5];
    for line in DATA.lines().filter(|line| line.split(',').next() == Some(case)) {
        let row: Vec<f64> = line.split(',').skip(1).map(|x| x.parse().unwrap()).collect();
        let (thrust_n, gravity_m_s2, time_s) = (row[0], row[1], row[2]);
        while step < (time_s / STEP_S).round() as u32 {
            state = rk4_step(&state, STEP_S, |s, fraction| {
                let gimbal = gimbal_sine(sine_x, sine_y, (f64::from(step) + fraction) * STEP_S);
                let mut balance = balance(&vehicle, &flow, s.rate_body_rad_s);
                balance.load = Load::at(Vec3::zeros(), thrust_direction_body(gimbal.angle_rad) * thrust_n);
                balance.slosh[0] = Some((&mode, &s.slosh));
                balance.swing = Some(Swing { part: &engine, gimbal });
                s.rate(&accelerations(&balance), gravity_m_s2)
            });
            state.q_ned_from_body = state.q_ned_from_body.normalize();
            step += 1;
        }
        let expected = Quaternion::new(row[9], row[10], row[11], row[12]);
        let found = state.q_ned_from_body;
        let found_now = [
            (state.position_ned_m - Vec3::new(row[3], row[4], row[5])).norm(),
            (state.velocity_ned_m_s - Vec3::new(row[6], row[7], row[8])).norm(),
            (found - expected).norm().min((found + expected).norm()),
            (state.rate_body_rad_s - Vec3::new(row[13], row[14], row[15])).norm(),
            (state.slosh.displacement_body_m - Vector2::new(row[16], row[17])).norm(),
        ];
        worst = core::array::from_fn(|i| worst[i].max(found_now[i]));
    }
    assert_eq!(step, 5000, "the whole case was compared");
    worst
}

// RK4's error per radian of the fastest motion is (ω dt)⁴/120: at 13.6 rad/s and 1 ms 3e-10, over 70 rad
// of slosh 2e-8 of its 10 mm: 2e-10 m. The body, 70 times heavier and slower, stays below 1e-10.
// Achieved: 2e-11 m of slosh, 6e-12 rad/s, 4e-12 m/s, 2e-12 m.
fn assert_within_truncation(worst: [f64; 5]) {
    let [position, velocity, attitude, rate, slosh] = worst;
    let body = position.max(velocity).max(attitude).max(rate);
    assert!(body < 1e-10 && slosh < 2e-10, "deviations {worst:?}");
}

#[test]
fn free_motion_agrees_with_point_masses() {
    assert_within_truncation(deviations("free"));
}

#[test]
fn powered_motion_agrees_with_point_masses() {
    assert_within_truncation(deviations("powered"));
}
