//! The discrete part of the propulsion system: who opens what when.
//!
//! With an automatic sequence arming opens the isolation valve and shuts the vent, throttle above the
//! shutdown fraction fires the igniter and releases the hold-down, disarming takes the power: each valve goes
//! where it stands without. Otherwise the flight controller's own channels do it. Before anything was armed
//! for the first time the initial state holds: nothing flows, not even through a valve that is open without
//! power.

use crate::scenario::{Scenario, SequenceSource};
use crate::signal::{ActuatorCommand, Discrete};
use crate::time::SimTime;

/// Positions that the discrete actuators are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Positions {
    pub(super) isolation_open: bool,
    pub(super) vent_open: bool,
    pub(super) released: bool,
    pub(super) igniter: bool,
}

/// Who commands the discrete actuators.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Authority {
    /// Arming and throttle imply everything.
    Automatic,
    /// The flight controller's own channels.
    Controls,
    /// A schedule's columns; the igniter waits for the throttle, so that it does not burn out before.
    Schedule,
}

/// Memory of the sequence.
#[derive(Clone, Debug)]
pub(super) struct Sequence {
    authority: Authority,
    unpowered: Discrete,
    release_time: SimTime,
    was_armed: bool,
    release_commanded: Option<SimTime>,
}

impl Sequence {
    pub(super) fn new(scenario: &Scenario, release_time_s: f64) -> Self {
        Self {
            authority: match scenario.file.sequence.source {
                _ if scenario.schedule.is_some() => Authority::Schedule,
                SequenceSource::Auto => Authority::Automatic,
                SequenceSource::Controls => Authority::Controls,
            },
            unpowered: Discrete {
                isolation_open: scenario.vehicle.isolation.open_without_power,
                vent_shut: !scenario.vehicle.vent.open_without_power,
                ..Discrete::SAFE
            },
            release_time: SimTime::from_s(release_time_s),
            was_armed: false,
            release_commanded: None,
        }
    }

    /// Takes in a command at `now`. `throttle_on`: it asks for more than the shutdown fraction.
    pub(super) fn advance(
        &mut self,
        now: SimTime,
        command: &ActuatorCommand,
        throttle_on: bool,
    ) -> Positions {
        self.was_armed |= command.armed;
        let wanted = if !command.armed {
            self.unpowered
        } else {
            match self.authority {
                Authority::Automatic => Discrete {
                    igniter: throttle_on,
                    isolation_open: true,
                    vent_shut: true,
                    hold_down_released: throttle_on,
                },
                Authority::Controls => command.discrete,
                Authority::Schedule => {
                    Discrete { igniter: command.discrete.igniter && throttle_on, ..command.discrete }
                }
            }
        };
        // A pin that was pulled stays pulled.
        if wanted.hold_down_released && self.release_commanded.is_none() {
            self.release_commanded = Some(now);
        }
        Positions {
            isolation_open: self.was_armed && wanted.isolation_open,
            vent_open: self.was_armed && !wanted.vent_shut,
            released: self.release_commanded.is_some_and(|at| now.since(at) >= self.release_time),
            igniter: wanted.igniter,
        }
    }
}
