//! Hopbench: the plant of a throttled hybrid-rocket lander, and the autopilot that can fly it.
//!
//! This package is pure: no files, threads, clocks or global state. The package `hopbench-hil` puts it on a
//! wire. The same scenario and seed give the same bits on every machine.
//!
//! # The house
//!
//! Modules stand in dependency order; a module imports only from above itself, and `tests/floors.rs` checks
//! it.
//!
//! | floor | modules |
//! |---|---|
//! | vocabulary | [`frame`] axes and signs, [`hash`] of bytes, [`input`] files and what is wrong with them, [`integrator`], [`interpolate`], [`noise`] named streams, [`time`] integer microseconds, [`signal`] what crosses to a flight computer, [`controls`] its sixteen channels, [`event`] what happens, by name |
//! | the world | [`environment`] air, wind, ground, field, place; [`fluid`] nitrous oxide and nitrogen |
//! | subsystems | [`actuator`] servos and delays, [`disturbance`] what is off and when, [`dynamics`] mass, slosh, motion, drag, legs, [`fault`] what breaks and when, [`propulsion`] from the valve to the nozzle, [`sensor`]; they take plain values and do not import each other |
//! | the autopilot | [`autopilot`]: navigation, optimal guidance ([`autopilot::lcvx`]), predictive control ([`autopilot::mpc`], [`autopilot::tracking`]) above cascaded loops; sees a [`signal::Measurement`], emits a [`signal::ActuatorCommand`], knows neither vehicle nor plant |
//! | the vehicle | [`vehicle`] every parameter, checked, in the structural frame; [`scenario`] a flight as data; [`plant`] the block diagram, and what is written down of it ([`plant::column`]) |
//! | flights | [`simulation`] plant, sensors and autopilot on one clock, with a referee and a report |
//!
//! Where to add what: the last table of the README.
//!
//! # A flight in fifteen lines
//!
//! ```
//! use hopbench::scenario::Scenario;
//! use hopbench::simulation::fly;
//!
//! let hop = Scenario::load("scenarios/hop_50m.toml", |file| std::fs::read_to_string(file))?;
//! let mut peak_thrust_n = 0.0_f64;
//! let flight = fly(&hop, 1, |now| peak_thrust_n = peak_thrust_n.max(now.thrust_n))?; // seed 1
//! let report = flight.report();
//! let touchdown = report.touchdown.expect("the autopilot brings it down");
//! assert!(report.expect.passed && report.max_altitude_m > 49.0 && peak_thrust_n < 1100.0);
//! println!("touchdown at {:.2} m/s, {} events", touchdown.vertical_speed_m_s, report.events.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A guidance law of one's own: `examples/own_guidance.rs`, by [`simulation::fly_with`]. Many flights, each
//! with values drawn anew: `examples/monte_carlo.rs`.
//!
//! # One step
//!
//! ```text
//! ActuatorCommand ─► sequence, engine controller ─► delays ─► valve, gimbal, thrusters
//!                                                               │
//!          ┌────────────────────────────────────────────────────┘
//!          ▼
//!   tank ─► valve ─► P2 ─► injector ─► chamber ─► nozzle ─► thrust      fluid, propulsion
//!          │                  │
//!          ▼                  ▼
//!   liquid, gas, grain ─► mass, first moment, inertia, rates            dynamics::mass
//!          │                                                            ┌─ drag, legs, thrusters
//!          ▼                                                            ▼
//!   slosh + rigid body + swinging engine: one balance of momentum ─► accelerations
//!          │                                                            dynamics::rigid_body
//!          ▼
//!   RK4, 1 ms ─► State ─► sensors ─► Measurement
//! ```
//!
//! # Models
//!
//! The reference vehicle flies the simplest model that is right for it; a vehicle file may choose more.
//!
//! | part | always | by choice |
//! |---|---|---|
//! | feed | flashing flow through valve and injector ([`propulsion::FeedMap`]) | manifold that stores, line with inertia, choked single phase, an outlet that uncovers |
//! | chamber | c* of mixture and pressure, separated and unchoked nozzle | gas as a state, fuel that lags |
//! | pressurant | real gas at constant temperature | bottle and ullage with energy, vapour, wall heat; regulator with droop and lock-up |
//! | liquid | first mode, two-way | second mode, rotary coupling, baffle; the paper's one-way form; frozen |
//! | servos, legs | second order, limits, delay; anchors that slip | play, friction; static above sliding friction |
//! | air | mean, gusts | profile, Dryden turbulence |
//!
//! A scenario may fly the seed paper's whole scheme instead (`fidelity = "paper"`), hold a coupling still
//! (`physics.freeze`), disturb the engine (`[[disturbance]]`) or break something ([`fault`]). What each is
//! worth: `docs/findings.md`; what proves it: `tests/README.md`.
//!
//! # Frames
//!
//! ```text
//!        structural (vehicle files)         body FRD                     world NED
//!
//!              z  nose                      (0,0,-1.28) thrusters           hover:
//!              │                              │                          q_ned_from_body = 1
//!          ┌───┴───┐                      ┌───┴───┐                      leg 1 points north
//!          │ N2    │                      │       │
//!          │ N2O   │                      │  COM at -0.40               x north
//!          └───┬───┘                      └───┬───┘                     ╱
//!   pivot O ──►●──── x leg 1       pivot O ──►●──── x forward, leg 1   ●───── y east
//!             ╱│                             ╱│                        │
//!        y  ╱ engine                    right y  engine                z down
//!   (z × x, to the left)                      │                        origin on the pad surface
//!                                             z toward the nozzle
//! ```
//!
//! Body FRD is (x, -y, -z) of structural. Thrust acts along body -z. A positive `gimbal_x`, `gimbal_y` or
//! `rcs_roll` gives a positive moment about body x, y, z. "Roll" is about the long axis, which PX4 calls yaw.
//! SI and radians everywhere; the unit ends the name, the frame is in it.
//!
//! # Invariants
//!
//! * Mass on board plus mass gone is constant to 1e-9, mostly to round-off; fuel never grows; nitrogen leaves
//!   by thrusters and vent only, and by the nozzle once an outlet that uncovers draws gas.
//! * Without flow the thrust is exactly zero; it is never negative.
//! * The rate of the state is pure ([`plant::Plant::evaluate`]); commands, ignition, contact, sampling and
//!   noise happen between steps.
//! * No input makes a panic or a number that is not finite.

// Vocabulary.
pub mod frame;
pub mod hash;
pub mod input;
pub mod integrator;
pub mod interpolate;
pub mod noise;
pub mod time;

pub mod signal;

pub mod controls;

pub mod event;

// The world and its fluids.
pub mod environment;
pub mod fluid;

// Subsystems: they take plain values and do not import each other.
pub mod actuator;
pub mod disturbance;
pub mod dynamics;
pub mod fault;
pub mod propulsion;
pub mod sensor;

// Guidance, navigation and control: measurements in, commands out.
pub mod autopilot;

// The vehicle and its flights as data, then wired.
pub mod vehicle;

pub mod scenario;

pub mod plant;

pub mod simulation;
