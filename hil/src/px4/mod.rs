//! A PX4 airframe for a vehicle file: allocation, output functions, gains, limits and failsafes, for PX4 in
//! software (SITL) and on its own board (HITL).
//!
//! PX4 sees the lander as its custom airframe: one motor, the engine, and servos that make torque. A servo's
//! command is then the torque setpoint over the servo's scale, clipped to ±1, whatever the thrust. Gains
//! follow from what one unit of a servo does to the vehicle at hover: see [`tuning`]. Speeds follow from the
//! propellant: see [`budget`]. Every parameter carries a sentence that says where its number comes from.
//!
//! Observed on PX4 v1.16.1 with the tuning of a 70 kg plant, which [`tuning`] gives back; the files
//! themselves have not flown on PX4. Parameter names are those of that version.

mod lander;

mod allocation;
pub mod tuning;

pub mod budget;

pub mod parameters;

mod airframe;

pub mod files;

pub use airframe::{Airframe, airframe};
pub use lander::{Lander, SwingingEngine};
