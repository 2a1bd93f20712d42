//! Everything of Hopbench that touches the world: links, MAVLink, the clock, the states of a run.
//!
//! Modules stand in dependency order: a module imports only from above itself. Bytes move in [`link`], mean
//! something in [`mavlink`], and are chosen by [`profile`]; [`pace`] is the clock; [`mod@bench`] is the loop.

// Files.
pub mod load;

// Bytes.
pub mod link;
pub mod mavlink;
mod serial;

// Flight controllers and time.
pub mod pace;
pub mod realtime;

pub mod planner;
pub mod profile;
pub mod stream;
pub mod yardstick;

// The run.
pub mod bench;
pub mod certificate;
pub mod drawing;
pub mod live;
pub mod pilot;
pub mod report;
pub mod throttle_map;

// Many runs.
pub mod campaign;

// The program.
pub mod command;
