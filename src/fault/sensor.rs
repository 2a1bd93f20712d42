//! Faults of sensors: what becomes of a finished measurement.

use super::{Acting, Component, Mode};
use crate::noise::Stream;
use crate::signal::Measurement;

/// What the plume depends on.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Scene {
    /// Pivot above its rest height (m).
    pub(super) height_m: f64,
    /// The engine burns.
    pub(super) lit: bool,
    /// Thrust (N).
    pub(super) thrust_n: f64,
}

/// What one fault keeps while it acts.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    stream: Stream,
}

impl Memory {
    pub(super) fn new(stream: Stream) -> Self {
        Self { stream }
    }

    /// What the fault makes of a measurement.
    pub(super) fn spoil(&mut self, acting: &Acting, _scene: &Scene, measurement: &mut Measurement) {
        if acting.mode == Mode::Off {
            match acting.component {
                Component::Gnss => measurement.gnss = None,
                Component::Altimeter => measurement.altimeter = None,
                _ => {}
            }
        }
    }
}
