//! What must hold whatever the numbers.

mod campaign;
mod planner;
