//! The discrete part of the propulsion system: who opens what when, and how a flame starts and ends.
//!
//! With an automatic sequence arming opens the isolation valve and shuts the vent, throttle above the
//! shutdown fraction fires the igniter and releases the hold-down, disarming safes everything. Otherwise
//! the flight controller's own channels do it. Before anything was armed for the first time the initial
//! state holds: nothing flows, not even through a vent that is open without power.

use crate::propulsion::IgnitionParameters;
use crate::scenario::SequenceSource;
use crate::signal::{ActuatorCommand, Discrete};
use crate::time::SimTime;

/// Something that the plant noticed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlantEvent {
    /// When.
    pub time: SimTime,
    /// Name from the manual's list.
    pub name: &'static str,
    /// Numbers and reasons.
    pub detail: String,
}

/// How the burning fraction moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flame {
    /// No flame.
    Out,
    /// Rising to the whole flow.
    Lit,
    /// Dying for want of fuel.
    Tail,
}

/// Positions that the discrete actuators are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Positions {
    pub(super) isolation_open: bool,
    pub(super) vent_open: bool,
    pub(super) released: bool,
}

/// What the sequence looks at after each step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observed {
    pub(super) oxidizer_kg_s: f64,
    pub(super) chamber_pa: f64,
    pub(super) burning_fraction: f64,
    /// Fuel left over quasi-steady fuel flow is below the tail's time constant.
    pub(super) grain_spent: bool,
}

/// Memory of the sequence.
#[derive(Clone, Debug)]
pub(super) struct Sequence {
    source: SequenceSource,
    release_time: SimTime,
    was_armed: bool,
    igniter_level: bool,
    igniter_fired: Option<SimTime>,
    release_commanded: Option<SimTime>,
    weak_since: Option<SimTime>,
    pub(super) flame: Flame,
    pub(super) ignition: Option<SimTime>,
}

impl Sequence {
    pub(super) fn new(source: SequenceSource, release_time_s: f64, running: bool) -> Self {
        Self {
            source,
            release_time: SimTime::from_s(release_time_s),
            was_armed: running,
            igniter_level: running,
            igniter_fired: None,
            release_commanded: running.then_some(SimTime::ZERO),
            weak_since: None,
            flame: if running { Flame::Lit } else { Flame::Out },
            ignition: running.then_some(SimTime::ZERO),
        }
    }

    /// Takes in a command at `now`. `throttle_on`: it asks for more than the shutdown fraction.
    pub(super) fn obey(&mut self, now: SimTime, command: &ActuatorCommand, throttle_on: bool) -> Positions {
        self.was_armed |= command.armed;
        let wanted = if !command.armed {
            Discrete::SAFE
        } else {
            match self.source {
                SequenceSource::Auto => Discrete {
                    igniter: throttle_on,
                    isolation_open: true,
                    vent_shut: true,
                    hold_down_released: throttle_on,
                },
                SequenceSource::Controls => command.discrete,
            }
        };
        if wanted.igniter && !self.igniter_level {
            self.igniter_fired = Some(now);
        }
        self.igniter_level = wanted.igniter;
        // A pin that was pulled stays pulled.
        if wanted.hold_down_released && self.release_commanded.is_none() {
            self.release_commanded = Some(now);
        }
        Positions {
            isolation_open: wanted.isolation_open,
            vent_open: self.was_armed && !wanted.vent_shut,
            released: self.release_commanded.is_some_and(|at| now.since(at) >= self.release_time),
        }
    }

    /// Moves the flame on after a step; says what changed.
    pub(super) fn burn(
        &mut self,
        now: SimTime,
        ignition: &IgnitionParameters,
        observed: &Observed,
    ) -> Option<&'static str> {
        match self.flame {
            Flame::Out => {
                let fired_s = now.since(self.igniter_fired?).s();
                let igniter_burns = (ignition.igniter_delay_s..=ignition.igniter_burn_s).contains(&fired_s);
                let may = self.ignition.is_none() || ignition.relight;
                if igniter_burns
                    && may
                    && !observed.grain_spent
                    && observed.oxidizer_kg_s >= ignition.minimum_oxidizer_flow_kg_s
                {
                    self.flame = Flame::Lit;
                    self.ignition.get_or_insert(now);
                    return Some("ignition");
                }
            }
            Flame::Lit | Flame::Tail => {
                // While it still rises the pressure may lie below the limit; no flow ends any flame.
                let weak = observed.oxidizer_kg_s <= 0.0
                    || observed.chamber_pa < ignition.extinction_pressure_pa
                        && (observed.burning_fraction > 0.5 || self.flame == Flame::Tail);
                if !weak {
                    self.weak_since = None;
                } else if now.since(*self.weak_since.get_or_insert(now)).s() >= ignition.extinction_time_s {
                    self.weak_since = None;
                    self.flame = Flame::Out;
                    self.igniter_fired = None;
                    return Some("shutdown");
                }
                if observed.grain_spent && self.flame == Flame::Lit {
                    self.flame = Flame::Tail;
                    return Some("fuel_burn_through");
                }
            }
        }
        None
    }
}
