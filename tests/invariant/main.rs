//! What must hold whatever the numbers.

#[path = "../fixture/mod.rs"]
mod fixture;

mod contact;
mod engine;
mod faults;
mod feed;
mod flight;
mod gas;
mod lcvx;
mod motion;
mod mpc;
mod paper_mode;
mod random_vehicles;
mod thrust_allocation;
mod tracking;
