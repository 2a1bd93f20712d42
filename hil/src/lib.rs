//! Everything of Hopbench that touches the world: links, MAVLink, the clock, the states of a run.
//!
//! Modules stand in dependency order: a module imports only from above itself. Bytes move in [`link`], mean
//! something in [`mavlink`], suffer in between what [`disruption`] says, and are chosen by [`profile`]; [`pace`] is the
//! clock; [`mod@bench`] is the loop; [`ground`] is for those who watch.

// Files.
pub mod load;

// Bytes.
pub mod port;

pub mod link;
pub mod mavlink;

// What becomes of them on a bad wire.
pub mod disruption;

// What may be asked of a bench.
pub mod desk;
pub mod failure;
pub mod parameter;

// Flight controllers and time.
pub mod pace;
pub mod realtime;

pub mod planner;
pub mod profile;
pub mod px4;
pub mod stream;
pub mod yardstick;

// People who watch.
pub mod ground;

// What is wrong.
pub mod doctor;

// The run.
pub mod live;

pub mod bench;
pub mod certificate;
pub mod drawing;
pub mod pilot;
pub mod report;
pub mod throttle_map;

// Many runs.
pub mod campaign;

// The program.
pub mod command;
