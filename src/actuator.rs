//! Actuators: position servos with finite bandwidth, rate, travel and play; command delay; stroke valves.
//!
//! A [`Servo`] is a second-order lag `θ'' = ω² (command - θ) - 2ζω θ'` whose acceleration is bounded so
//! that neither the rate limit nor a stop is ever crossed:
//!
//! ```text
//! rate:   θ'' ≤ k (limit - θ')
//! stop:   θ'' ≤ k² (stop - θ) - 2 k θ'
//! ```
//!
//! and likewise on the other side, with `k = 10 ω` but at most 1000 1/s, which RK4 at 1 ms resolves. These
//! bounds let the rate reach its limit and the angle its stop exponentially; well inside them the servo is
//! exactly linear, so smooth motion keeps the integrator's order. Source: the bounds are first- and
//! second-order barrier conditions (Nagumo; Nguyen and Sreenath, 2016), chosen over a switch at the limit
//! because they need no event. Play is a hysteresis behind the servo, remembered between steps.

use crate::time::SimTime;
use std::collections::VecDeque;

/// Fastest approach to a limit [1/s].
const FASTEST_BARRIER_1_S: f64 = 1000.0;
/// Approach to a limit over natural frequency.
const BARRIER_OVER_FREQUENCY: f64 = 10.0;

/// Gimbal servos, the `[gimbal]` table of a vehicle file; both axes are alike.
#[derive(Clone, Debug, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gimbal {
    /// Travel to each side of centre, per axis [rad].
    #[schemars(range(min = 0.001, max = 0.6))]
    pub limit_rad: f64,
    /// Greatest rate [rad/s].
    #[schemars(range(min = 0.01, max = 100.0))]
    pub rate_limit_rad_s: f64,
    /// Natural frequency of the position loop [rad/s].
    #[schemars(range(min = 1.0, max = 500.0))]
    pub natural_frequency_rad_s: f64,
    /// Damping ratio of the position loop.
    #[schemars(range(min = 0.05, max = 2.0))]
    pub damping_ratio: f64,
    /// Time from a command to motion [s].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub delay_s: f64,
    /// Play between servo and engine, stop to stop [rad].
    #[schemars(range(min = 0.0, max = 0.2))]
    pub backlash_rad: f64,
    /// Whether the swinging engine reacts on the body.
    pub engine_inertia: bool,
}

impl Gimbal {
    /// The servo of one axis.
    pub fn servo(&self) -> Servo {
        Servo {
            natural_frequency_rad_s: self.natural_frequency_rad_s,
            damping_ratio: self.damping_ratio,
            rate_limit_rad_s: self.rate_limit_rad_s,
            lower_rad: -self.limit_rad,
            upper_rad: self.limit_rad,
            backlash_rad: self.backlash_rad,
        }
    }
}

/// A position servo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// Natural frequency [rad/s].
    pub natural_frequency_rad_s: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
    /// Greatest rate either way [rad/s].
    pub rate_limit_rad_s: f64,
    /// Lower stop [rad].
    pub lower_rad: f64,
    /// Upper stop [rad].
    pub upper_rad: f64,
    /// Play behind the servo, stop to stop [rad].
    pub backlash_rad: f64,
}

/// Where a servo is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ServoState {
    /// Angle [rad].
    pub angle_rad: f64,
    /// Rate [rad/s].
    pub rate_rad_s: f64,
}

/// Time derivative of [`ServoState`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ServoRate {
    /// Rate [rad/s].
    pub rate_rad_s: f64,
    /// Acceleration [rad/s²].
    pub acceleration_rad_s2: f64,
}

/// What the servo moves, behind the play.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ServoOutput {
    /// Angle [rad].
    pub angle_rad: f64,
    /// Rate [rad/s].
    pub rate_rad_s: f64,
    /// Acceleration [rad/s²].
    pub acceleration_rad_s2: f64,
}

impl Servo {
    /// At rest at an angle, inside the stops.
    pub fn at_rest(&self, angle_rad: f64) -> ServoState {
        ServoState { angle_rad: angle_rad.max(self.lower_rad).min(self.upper_rad), rate_rad_s: 0.0 }
    }

    /// Rate under a command [rad], already delayed; a command that is no number holds the angle.
    pub fn rate(&self, state: &ServoState, command_rad: f64) -> ServoRate {
        let (angle, rate) = (state.angle_rad, state.rate_rad_s);
        let command = if command_rad.is_nan() { angle } else { command_rad };
        let command = command.max(self.lower_rad).min(self.upper_rad);
        let w = self.natural_frequency_rad_s;
        let linear = w * (w * (command - angle) - 2.0 * self.damping_ratio * rate);
        let k = (BARRIER_OVER_FREQUENCY * w).min(FASTEST_BARRIER_1_S);
        let stop_upper = k * (k * (self.upper_rad - angle) - 2.0 * rate);
        let stop_lower = k * (k * (self.lower_rad - angle) - 2.0 * rate);
        let rate_upper = k * (self.rate_limit_rad_s - rate);
        let rate_lower = k * (-self.rate_limit_rad_s - rate);
        let acceleration_rad_s2 = linear.min(stop_upper).max(stop_lower).min(rate_upper).max(rate_lower);
        ServoRate { rate_rad_s: rate, acceleration_rad_s2 }
    }

    /// What moves behind the play, given where it was left (`held_rad`, from [`Servo::held_after`]).
    pub fn output(&self, state: &ServoState, rate: &ServoRate, held_rad: f64) -> ServoOutput {
        let half = 0.5 * self.backlash_rad;
        let (low, high) = (state.angle_rad - half, state.angle_rad + half);
        if self.backlash_rad > 0.0 && held_rad > low && held_rad < high {
            return ServoOutput { angle_rad: held_rad, rate_rad_s: 0.0, acceleration_rad_s2: 0.0 };
        }
        ServoOutput {
            angle_rad: held_rad.min(high).max(low),
            rate_rad_s: rate.rate_rad_s,
            acceleration_rad_s2: rate.acceleration_rad_s2,
        }
    }

    /// Where the play leaves the output after a step: the memory of the hysteresis.
    pub fn held_after(&self, state: &ServoState, held_rad: f64) -> f64 {
        let half = 0.5 * self.backlash_rad;
        held_rad.min(state.angle_rad + half).max(state.angle_rad - half)
    }
}

/// Delays a command by a fixed time, in whole microseconds.
///
/// Only changes are stored, in a ring allocated once. Should it ever be full the oldest waiting change
/// takes effect early.
#[derive(Clone, Debug, PartialEq)]
pub struct DelayLine<T> {
    delay: SimTime,
    current: T,
    waiting: VecDeque<(SimTime, T)>,
    capacity: usize,
}

impl<T: Copy + PartialEq> DelayLine<T> {
    /// A line with nothing on the way; `capacity` changes fit, at least one.
    pub fn new(delay: SimTime, initial: T, capacity: usize) -> Self {
        let capacity = capacity.max(1);
        Self { delay, current: initial, waiting: VecDeque::with_capacity(capacity), capacity }
    }

    /// A line for one command every `interval`.
    pub fn for_interval(delay: SimTime, initial: T, interval: SimTime) -> Self {
        let waiting = delay.us() / interval.us().max(1) + 2;
        Self::new(delay, initial, usize::try_from(waiting).unwrap_or(usize::MAX).min(65_536))
    }

    /// Takes a command given at `now`; times must not go back.
    pub fn push(&mut self, now: SimTime, value: T) {
        let newest = self.waiting.back().map_or(self.current, |entry| entry.1);
        if newest == value {
            return;
        }
        if self.waiting.len() == self.capacity
            && let Some((_, early)) = self.waiting.pop_front()
        {
            self.current = early;
        }
        self.waiting.push_back((now + self.delay, value));
    }

    /// The command in effect at `now`: the newest that is old enough.
    pub fn at(&mut self, now: SimTime) -> T {
        while let Some(&(due, value)) = self.waiting.front()
            && due <= now
        {
            self.current = value;
            self.waiting.pop_front();
        }
        self.current
    }
}

/// A valve that runs from end to end in a fixed time, its area linear in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrokeValve {
    /// Time from shut to open [s]; 0 moves at once.
    pub stroke_time_s: f64,
}

impl StrokeValve {
    /// Opening (0 shut, 1 open) after `dt_s` on the way from `opening` to `target`. Exact for any step,
    /// and at a fraction of a step too.
    pub fn opening_after(&self, opening: f64, target: f64, dt_s: f64) -> f64 {
        let target = target.clamp(0.0, 1.0);
        if self.stroke_time_s <= 0.0 {
            return target;
        }
        let travel = dt_s.max(0.0) / self.stroke_time_s;
        if opening < target { (opening + travel).min(target) } else { (opening - travel).max(target) }
    }
}
