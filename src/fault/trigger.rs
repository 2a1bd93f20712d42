//! When a fault begins.

use super::Fault;
use crate::event::EventKind;
use crate::time::SimTime;

/// What triggers go by.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Circumstances {
    /// Run time.
    pub time: SimTime,
    /// Time since ignition (s).
    pub mission_s: Option<f64>,
    /// Pivot above its rest height (m).
    pub height_m: f64,
    /// The engine burns.
    pub lit: bool,
    /// Thrust (N).
    pub thrust_n: f64,
}

/// What an entry that waits has seen so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Waiting {
    heard: bool,
    was_above: bool,
}

impl Waiting {
    pub(super) fn hear(&mut self, fault: &Fault, event: &EventKind) {
        self.heard |= fault.at_event.as_ref() == Some(event);
    }

    /// Whether it has come to the trigger of `fault`.
    pub(super) fn triggered(&mut self, fault: &Fault, now: &Circumstances) -> bool {
        if let Some(at_s) = fault.at_s {
            now.mission_s.is_some_and(|mission_s| mission_s >= at_s)
        } else if let Some(above_m) = fault.above_m {
            now.height_m > above_m
        } else if let Some(below_m) = fault.below_m {
            self.was_above |= now.height_m > below_m;
            self.was_above && now.height_m < below_m
        } else if fault.at_event.is_some() {
            self.heard
        } else {
            true
        }
    }
}
