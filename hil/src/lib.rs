//! Everything of Hopbench that touches the world: files, links, MAVLink, the clock, the states of a run.
//!
//! Rooms stand in dependency order; a room imports only from above itself, and `tests/floors.rs` checks it.
//!
//! | floor | rooms |
//! |---|---|
//! | files | [`load`] scenarios and vehicles from the disk, with the values that the command line puts in place of theirs |
//! | the wire | [`wire`]: serial ports, links, MAVLink, damage in between, what is sent when |
//! | what a run leaves, and aids | [`evidence`] report, certificate, pictures, campaigns; [`doctor`] what is wrong with this machine or board; [`px4`] an airframe for a vehicle; strangers to each other |
//! | the run | [`mod@bench`]: the loop that steps the plant, its clock, hand-over, services, who watches |
//! | the program | [`command`]: one file for each command |
//!
//! Where to add what: the last table of the README.

// Files.
pub mod load;

// Bytes and what they mean.
pub mod wire;

// What a run leaves; what is wrong; an airframe.
pub mod evidence;

pub mod doctor;
pub mod px4;

// The run.
pub mod bench;

// The program.
pub mod command;
