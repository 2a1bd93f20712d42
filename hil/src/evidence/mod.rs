//! Evidence: what a run leaves, and what is made of it.
//!
//! [`run_folder`] is where a run's files go, [`summary`] its report on the terminal, [`certificate`] its page
//! on timing, [`throttle_map`] the engine's map as table and picture, [`valve_map`] how good the valve's
//! table is, [`campaign`] many runs and their statistics.

pub mod certificate;
mod drawing;
pub mod run_folder;
pub mod summary;
pub mod throttle_map;
pub mod valve_map;

pub mod campaign;
