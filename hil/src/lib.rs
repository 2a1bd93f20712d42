//! Everything of Hopbench that touches the world: links, MAVLink, the clock, the states of a run.
//!
//! Modules stand in dependency order: a module imports only from above itself.

// Bytes.
#[cfg(target_os = "linux")]
pub mod link;
pub mod mavlink;
#[cfg(target_os = "linux")]
mod serial;

// Flight controllers and time.
#[cfg(target_os = "linux")]
pub mod pace;
#[cfg(target_os = "linux")]
pub mod profile;
