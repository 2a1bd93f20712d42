//! Nanoseconds a call of the dynamics, in a plain loop: `cargo bench --bench dynamics`.
#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // a bench reads the clock and prints

#[path = "../tests/fixture/motion.rs"]
#[allow(dead_code, unreachable_pub)] // the tests use the rest
mod motion;

use hopbench::actuator::{Gimbal, ServoMemory, ServoState};
use hopbench::dynamics::landing_gear::{Anchors, Grip, LandingGear};
use hopbench::dynamics::mass::{ContentsRate, FlowTerms, Outflow};
use hopbench::dynamics::rigid_body::{GimbalMotion, Swing, accelerations};
use hopbench::dynamics::slosh::SloshState;
use hopbench::dynamics::{Kinematics, Load};
use hopbench::frame::{Mat3, Vec3};
use motion::{FULL, balance, full_mode, reference_vehicle};
use nalgebra::Vector2;
use std::hint::black_box;
use std::time::Instant;

fn time<T>(name: &str, mut f: impl FnMut() -> T) {
    const CALLS: u32 = 1_000_000;
    // The least of several rounds is what the machine can do undisturbed.
    let mut least_ns = f64::INFINITY;
    for _ in 0..7 {
        let start = Instant::now();
        for _ in 0..CALLS {
            black_box(f());
        }
        least_ns = least_ns.min(start.elapsed().as_secs_f64() * 1e9 / f64::from(CALLS));
    }
    println!("{name:<44}{least_ns:8.1} ns");
}

fn main() {
    let reference = reference_vehicle();
    let rate = ContentsRate {
        nitrous_kg_s: -0.35,
        port_radius_m_s: 1.3e-3,
        nitrogen_run_tank_kg_s: 0.03,
        nitrogen_bottle_kg_s: -0.03,
    };
    let masses = reference.model.evaluate(&FULL, &rate);
    let exit = Outflow { position_body_m: Vec3::new(0.0, 0.0, 0.43), mass_flow_kg_s: 0.42 };
    let flow = FlowTerms::new(&masses.rate, &[exit]);
    let mode = full_mode(&reference, 11.0);
    let slosh = SloshState {
        displacement_body_m: Vector2::new(0.003, -0.002),
        velocity_body_m_s: Vector2::new(0.01, 0.02),
    };
    let gimbal = GimbalMotion {
        angle_rad: Vector2::new(0.02, -0.01),
        rate_rad_s: Vector2::new(0.3, 0.2),
        acceleration_rad_s2: Vector2::new(-5.0, 7.0),
    };
    let mut frozen = balance(&masses.vehicle, &flow, Vec3::new(0.02, -0.03, 0.05));
    frozen.load =
        Load { force_body_n: Vec3::new(5.0, 3.0, -800.0), moment_body_n_m: Vec3::new(1.0, 0.5, 2.0) };
    let mut sloshing = frozen;
    sloshing.slosh[0] = Some((&mode, &slosh));
    let mut full = sloshing;
    full.swing = Some(Swing { part: &masses.swinging, gimbal });

    time("mass properties and rates", || reference.model.evaluate(black_box(&FULL), black_box(&rate)));
    time("flow terms, five outflows", || FlowTerms::new(black_box(&masses.rate), black_box(&[exit; 5])));
    time("slosh mode", || full_mode(&reference, black_box(11.0)));
    time("accelerations, liquid frozen", || accelerations(black_box(&frozen)));
    time("accelerations, two-way slosh", || accelerations(black_box(&sloshing)));
    time("accelerations, slosh and swinging engine", || accelerations(black_box(&full)));

    let gimbal: Gimbal = reference.section("gimbal");
    let servo = gimbal.servo();
    let memory = ServoMemory::default();
    time("servo rate", || servo.rate(black_box(&ServoState::default()), black_box(0.02), black_box(&memory)));

    let gear: LandingGear = reference.section("landing_gear");
    let pads = gear.pads_body_m();
    let mut motion = Kinematics {
        position_ned_m: Vec3::new(0.0, 0.0, -0.745),
        velocity_ned_m_s: Vec3::new(0.1, 0.0, 0.2),
        ned_from_body: Mat3::identity(),
        rate_body_rad_s: Vec3::new(0.01, 0.02, 0.0),
    };
    let anchors = gear.anchors_after(&pads, &motion, 0.0, &Anchors::default(), Grip::Free);
    time("contact, four pads down", || gear.contact(&pads, black_box(&motion), 0.0, &anchors, Grip::Free));
    motion.position_ned_m.z = -30.0;
    time("contact, in the air", || {
        gear.contact(&pads, black_box(&motion), 0.0, &Anchors::default(), Grip::Free)
    });
}
