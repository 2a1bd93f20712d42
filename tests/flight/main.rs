//! Whole flights.

#[path = "../fixture/mod.rs"]
mod fixture;

mod autopilot;
mod disturbed;
mod examples;
mod faults;
mod feed;
mod navigation;
mod plant_faults;
mod scenarios;
mod sensor_faults;
mod tracking;
