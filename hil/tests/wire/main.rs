//! What crosses a wire: exact bytes, the rules of a run, what breaks.

#[path = "../fixture/mod.rs"]
mod fixture;

mod bench;
mod doctor;
mod endurance;
mod faults;
mod handover;
mod links;
mod serial;
mod services;
