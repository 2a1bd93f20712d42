//! Evidence: what a run leaves, and what is made of it.
//!
//! [`report`] is the folder of a run and the summary on the terminal, [`certificate`] its page on timing,
//! [`throttle_map`] the engine's map as table and picture, [`campaign`] many runs and their statistics.

pub mod certificate;
pub mod drawing;
pub mod report;
pub mod throttle_map;
pub mod valve_map;

pub mod campaign;
