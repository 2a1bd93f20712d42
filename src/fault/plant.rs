//! Faults of plant and actuators as plain values. `Default` is the sound vehicle. What they do to the
//! plant: `plant/fault.rs`.

use super::{Acting, Component, Mode};

/// What is broken in the vehicle now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlantEffect {
    /// The igniter does nothing.
    pub igniter_dead: bool,
    /// The igniter's flame comes later by this much, and burns as long (s).
    pub light_delay_s: f64,
    /// Share of the oxidiser which passes the injector unburnt that stays in the chamber and burns at once
    /// when the flame comes, see `propulsion/hard_start.rs`.
    pub hard_start: f64,
    /// Oxidiser valve.
    pub valve: ServoEffect,
    /// Gimbal servos x and y.
    pub gimbal: [ServoEffect; 2],
    /// Share of the full-open area that passes a shut valve, and falls to nothing as it opens.
    pub valve_leak_share: f64,
    /// Oxidiser isolation valve.
    pub isolation: StrokeEffect,
    /// Thrusters for positive and for negative roll.
    pub rcs: [ThrusterEffect; 2],
    /// Regulator outlet below its set pressure (Pa); the tank follows as its liquid leaves.
    pub regulator_droop_pa: f64,
    /// Share of the injector's area that is gone, below 1.
    pub injector_blocked_share: f64,
    /// Share of c* that is gone, on pressure and thrust, below 1.
    pub efficiency_drop_share: f64,
}

/// What is broken in a servo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ServoEffect {
    /// Stays where it is; one that moves stops within milliseconds.
    pub stuck: bool,
    /// Driven to this share of its upper limit, whatever the command, as fast as it goes: hard-over.
    pub held_at_share: Option<f64>,
    /// Share of its rate and bandwidth that is left; 1 is sound.
    pub rate_share: f64,
    /// Angle above what it believes (rad), within the stops; a valve so off does not shut.
    pub offset_rad: f64,
    /// Play between servo and load, stop to stop, beside its own (rad).
    pub slack_rad: f64,
}

impl Default for ServoEffect {
    fn default() -> Self {
        Self { stuck: false, held_at_share: None, rate_share: 1.0, offset_rad: 0.0, slack_rad: 0.0 }
    }
}

/// What is broken in a valve with two ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeEffect {
    /// Stays where it is.
    pub stuck: bool,
    /// Stroke time over the sound one; 1 is sound.
    pub slowness: f64,
}

impl Default for StrokeEffect {
    fn default() -> Self {
        Self { stuck: false, slowness: 1.0 }
    }
}

/// What is broken in a thruster.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ThrusterEffect {
    /// Never opens.
    pub dead: bool,
    /// Share of its full flow that always passes, with its thrust.
    pub leak_share: f64,
}

impl PlantEffect {
    /// The effect with one more fault; faults of other groups change nothing.
    pub(super) fn add(&mut self, fault: &Acting) {
        let value = fault.value;
        match (fault.component, fault.mode) {
            (Component::Igniter, Mode::Off) => self.igniter_dead = true,
            (Component::Igniter, Mode::Delay) => self.light_delay_s += value,
            (Component::Igniter, Mode::HardStart) => self.hard_start = both_lost(self.hard_start, value),
            (Component::Valve, Mode::Leak) => {
                self.valve_leak_share = both_lost(self.valve_leak_share, value);
            }
            (Component::Valve, _) => self.valve.add(fault),
            (Component::GimbalX, _) => self.gimbal[0].add(fault),
            (Component::GimbalY, _) => self.gimbal[1].add(fault),
            (Component::Isolation, Mode::Stuck) => self.isolation.stuck = true,
            (Component::Isolation, Mode::Slow) => self.isolation.slowness *= value,
            (Component::RcsPositive, _) => self.rcs[0].add(fault),
            (Component::RcsNegative, _) => self.rcs[1].add(fault),
            (Component::Regulator, Mode::Droop) => self.regulator_droop_pa += value,
            (Component::Injector, Mode::Blocked) => {
                self.injector_blocked_share = both_lost(self.injector_blocked_share, value);
            }
            (Component::Combustion, Mode::EfficiencyDrop) => {
                self.efficiency_drop_share = both_lost(self.efficiency_drop_share, value);
            }
            _ => {}
        }
    }
}

impl ServoEffect {
    fn add(&mut self, fault: &Acting) {
        match fault.mode {
            Mode::Stuck => self.stuck = true,
            Mode::HardOver => self.held_at_share = Some(fault.value),
            Mode::Slow => self.rate_share *= fault.value,
            Mode::Offset => self.offset_rad += fault.value,
            Mode::Slack => self.slack_rad += fault.value,
            _ => {}
        }
    }
}

impl ThrusterEffect {
    fn add(&mut self, fault: &Acting) {
        match fault.mode {
            Mode::Off => self.dead = true,
            Mode::Leak => self.leak_share = both_lost(self.leak_share, fault.value),
            _ => {}
        }
    }
}

/// Two losses, the second of what the first has left.
fn both_lost(first_share: f64, second_share: f64) -> f64 {
    1.0 - (1.0 - first_share) * (1.0 - second_share)
}
