//! Everything of Hopbench that touches the world: links, MAVLink, the clock, the states of a run.
//!
//! Modules stand in dependency order: a module imports only from above itself. Bytes move in [`link`], mean
//! something in [`mavlink`], suffer in between what [`disruption`] says, and are chosen by [`profile`]; [`pace`] is
//! the clock; [`mod@bench`] is the loop.

// Files.
pub mod load;

// Bytes.
pub mod link;
pub mod mavlink;
mod serial;

// What becomes of them on a bad wire.
pub mod disruption;

// Flight controllers and time.
pub mod pace;
pub mod planner;
pub mod profile;
pub mod stream;

// The run.
pub mod bench;
pub mod drawing;
pub mod live;
pub mod pilot;
pub mod report;
pub mod throttle_map;

// Many runs.
pub mod campaign;

// The program.
pub mod command;
