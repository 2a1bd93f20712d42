//! Hopbench: the plant of a throttled hybrid-rocket lander, and the autopilot that can fly it.
//!
//! Modules stand in dependency order: a module imports only from above itself.

// Vocabulary.
pub mod controls;
pub mod frame;
pub mod input;
pub mod integrator;
pub mod interpolate;
pub mod noise;
pub mod signal;
pub mod time;

// The world and its fluids.
pub mod environment;
pub mod fluid;

// Subsystems: they take plain values and do not import each other.
pub mod actuator;
pub mod dynamics;
pub mod propulsion;
pub mod sensor;

// The vehicle, wired.
pub mod plant;
pub mod vehicle;

// Guidance, navigation and control.
pub mod autopilot;

// Flights.
pub mod scenario;
pub mod simulation;
