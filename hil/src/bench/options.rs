//! Options of a run: who sits at the other end, who waits for whom and how long.

use std::time::Duration;

use hopbench::simulation::Source;

use crate::wire::profile::{Pacing, Profile};

/// How a run is to be made.
#[derive(Clone, Debug)]
pub struct Options {
    /// What the flight controller expects.
    pub profile: &'static Profile,
    /// Who waits for whom.
    pub pacing: Pacing,
    /// Lockstep may run ahead of real time.
    pub fast: bool,
    /// Longest wait for one answer in lockstep.
    pub lockstep_timeout: Duration,
    /// Who sits at the other end.
    pub source: Source,
    /// Symbols a second, where the link has such a rate.
    pub baud: Option<u32>,
}
