//! A campaign: one scenario flown many times with values drawn anew, as many flights at once as there are
//! cores.
//!
//! The autopilot is told of the scenario as it is written; the plant flies what was drawn. A flight follows
//! from campaign and seed alone, so rows are the same bits whoever flies them, in whatever order, on however
//! many machines. Rows are written as flights end, in order, so that an interrupted campaign goes on where it
//! stopped.

pub mod slot;
mod statistics;
pub mod table;

mod definition;

mod flight;

pub mod folder;
pub mod picture;
pub mod summary;

pub use definition::{Campaign, Configuration};
pub use flight::FlightResult;
