//! Who commanded the vehicle, and when.

use serde::Serialize;

/// Who commands the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// A flight controller from outside: at the other end of a link, or a law of one's own.
    Fc,
    /// The built-in autopilot.
    Autopilot,
    /// An open-loop schedule.
    Commands,
}

/// A span of the run under one source of commands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FlownBy {
    /// Who commanded.
    pub source: Source,
    /// From this run time (s).
    pub from_s: f64,
    /// To this run time (s).
    pub to_s: f64,
}
