//! Whole flights.

mod campaign;
mod example;
