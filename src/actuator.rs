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

/// Fastest approach to a limit (1/s).
const FASTEST_BARRIER_1_S: f64 = 1000.0;
/// Approach to a limit over natural frequency.
const BARRIER_OVER_FREQUENCY: f64 = 10.0;

/// Gimbal servos, the `[gimbal]` table of a vehicle file; both axes are alike.
#[derive(Clone, Debug, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gimbal {
    /// Travel to each side of centre, per axis (rad).
    #[schemars(range(min = 0.001, max = 0.6))]
    pub limit_rad: f64,
    /// Greatest rate (rad/s).
    #[schemars(range(min = 0.01, max = 100.0))]
    pub rate_limit_rad_s: f64,
    /// Natural frequency of the position loop (rad/s).
    #[schemars(range(min = 1.0, max = 500.0))]
    pub natural_frequency_rad_s: f64,
    /// Damping ratio of the position loop.
    #[schemars(range(min = 0.05, max = 2.0))]
    pub damping_ratio: f64,
    /// Time from a command to motion (s).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub delay_s: f64,
    /// Play between servo and engine, stop to stop (rad).
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
    /// Natural frequency (rad/s).
    pub natural_frequency_rad_s: f64,
    /// Damping ratio.
    pub damping_ratio: f64,
    /// Greatest rate either way (rad/s).
    pub rate_limit_rad_s: f64,
    /// Lower stop (rad).
    pub lower_rad: f64,
    /// Upper stop (rad).
    pub upper_rad: f64,
    /// Play behind the servo, stop to stop (rad).
    pub backlash_rad: f64,
}

/// Where a servo is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ServoState {
    /// Angle (rad).
    pub angle_rad: f64,
    /// Rate (rad/s).
    pub rate_rad_s: f64,
}

/// Time derivative of [`ServoState`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ServoRate {
    /// Rate (rad/s).
    pub rate_rad_s: f64,
    /// Acceleration (rad/s²).
    pub acceleration_rad_s2: f64,
}

/// What the servo moves, behind the play.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ServoOutput {
    /// Angle (rad).
    pub angle_rad: f64,
    /// Rate (rad/s).
    pub rate_rad_s: f64,
    /// Acceleration (rad/s²).
    pub acceleration_rad_s2: f64,
}

impl Servo {
    /// At rest at an angle, inside the stops.
    pub fn at_rest(&self, angle_rad: f64) -> ServoState {
        ServoState { angle_rad: angle_rad.max(self.lower_rad).min(self.upper_rad), rate_rad_s: 0.0 }
    }

    /// Rate under a command (rad), already delayed; a command that is no number holds the angle.
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
    /// Time from shut to open (s); 0 moves at once.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::{Integrable, rk4_step};

    const GIMBAL: Servo = Servo {
        natural_frequency_rad_s: 50.265_482_457_4,
        damping_ratio: 0.7,
        rate_limit_rad_s: core::f64::consts::FRAC_PI_2,
        lower_rad: -0.122_173_047_6,
        upper_rad: 0.122_173_047_6,
        backlash_rad: 0.0,
    };

    impl Integrable for ServoState {
        type Rate = ServoRate;
        fn advanced(&self, k: &ServoRate, dt_s: f64) -> Self {
            Self {
                angle_rad: self.angle_rad + k.rate_rad_s * dt_s,
                rate_rad_s: self.rate_rad_s + k.acceleration_rad_s2 * dt_s,
            }
        }
        fn rk4_mean(k1: &ServoRate, k2: &ServoRate, k3: &ServoRate, k4: &ServoRate) -> ServoRate {
            let mean = |f: fn(&ServoRate) -> f64| (f(k1) + 2.0 * (f(k2) + f(k3)) + f(k4)) / 6.0;
            ServoRate {
                rate_rad_s: mean(|k| k.rate_rad_s),
                acceleration_rad_s2: mean(|k| k.acceleration_rad_s2),
            }
        }
    }

    fn moved(servo: &Servo, start: ServoState, command_rad: f64, time_s: f64, dt_s: f64) -> ServoState {
        let mut state = start;
        for _ in 0..(time_s / dt_s).round() as u32 {
            state = rk4_step(&state, dt_s, |s, _| servo.rate(s, command_rad));
        }
        state
    }

    /// Step response of the linear second-order lag.
    fn closed_form(servo: &Servo, command_rad: f64, t: f64) -> f64 {
        let (w, zeta) = (servo.natural_frequency_rad_s, servo.damping_ratio);
        let damped = w * (1.0 - zeta * zeta).sqrt();
        let (s, c) = libm::sincos(damped * t);
        command_rad * (1.0 - libm::exp(-zeta * w * t) * (c + zeta * w / damped * s))
    }

    #[test]
    fn small_step_follows_the_closed_form_at_fourth_order() {
        // 1.8 degrees either way, as the open-loop runs command: 83 deg/s at most, so no limit acts.
        let command = 3.6_f64.to_radians() * 0.99;
        let error = |dt_s: f64| {
            let found = moved(&GIMBAL, ServoState::default(), command, 0.04, dt_s).angle_rad;
            (found - closed_form(&GIMBAL, command, 0.04)).abs()
        };
        // (ω dt)⁴/120 over 2 rad: 1e-7 of the command at 1 ms.
        assert!(error(1e-3) < 1e-8, "{:e}", error(1e-3));
        let ratio = error(2e-3) / error(1e-3);
        assert!((14.0..18.5).contains(&ratio), "{ratio}");
    }

    #[test]
    fn neither_rate_limit_nor_stop_is_ever_crossed() {
        for natural_frequency_rad_s in [5.0, 50.0, 250.0, 500.0] {
            for (damping_ratio, command) in
                [(0.7, 10.0), (0.1, 10.0), (0.2, -0.122), (2.0, -10.0), (0.05, 0.1)]
            {
                let servo = Servo { natural_frequency_rad_s, damping_ratio, ..GIMBAL };
                let mut state = ServoState { angle_rad: -0.1 * f64::signum(command), rate_rad_s: 0.0 };
                for _ in 0..5_000 {
                    state = rk4_step(&state, 1e-3, |s, _| servo.rate(s, command));
                    // What RK4 makes of the approach, exp(-k t), stays on its side of the limit.
                    assert!(
                        state.rate_rad_s.abs() <= servo.rate_limit_rad_s * (1.0 + 1e-9),
                        "{servo:?} {state:?}"
                    );
                    assert!(state.angle_rad.abs() <= servo.upper_rad + 1e-6, "{servo:?} {state:?}");
                }
            }
        }
    }

    #[test]
    fn a_large_step_runs_at_the_rate_limit() {
        let servo = Servo { lower_rad: -2.0, upper_rad: 2.0, ..GIMBAL };
        let early = moved(&servo, ServoState::default(), 2.0, 0.3, 1e-3);
        let late = moved(&servo, ServoState::default(), 2.0, 0.8, 1e-3);
        let mean = (late.angle_rad - early.angle_rad) / 0.5;
        assert!((mean / servo.rate_limit_rad_s - 1.0).abs() < 1e-6, "{mean}");
    }

    #[test]
    fn a_command_that_is_no_number_holds_the_angle() {
        let state = ServoState { angle_rad: 0.05, rate_rad_s: 0.0 };
        assert_eq!(GIMBAL.rate(&state, f64::NAN).acceleration_rad_s2, 0.0);
        assert!(GIMBAL.rate(&state, f64::INFINITY).acceleration_rad_s2.is_finite());
    }

    #[test]
    fn play_is_lost_on_every_reversal() {
        let servo = Servo { backlash_rad: 0.01, ..GIMBAL };
        let mut held = 0.0;
        let mut at = |angle_rad: f64| {
            let state = ServoState { angle_rad, rate_rad_s: 0.3 };
            let output = servo.output(&state, &servo.rate(&state, angle_rad), held);
            held = servo.held_after(&state, held);
            assert!((output.angle_rad - held).abs() < 1e-15);
            (output.angle_rad, output.rate_rad_s)
        };
        assert_eq!(at(0.004), (0.0, 0.0));
        assert_eq!(at(0.020), (0.015, 0.3));
        assert_eq!(at(0.012), (0.015, 0.0));
        assert_eq!(at(0.005), (0.010, 0.3));
        let state = ServoState { angle_rad: 0.02, rate_rad_s: 0.3 };
        let output = GIMBAL.output(&state, &GIMBAL.rate(&state, 0.1), 0.0);
        assert_eq!((output.angle_rad, output.rate_rad_s), (0.02, 0.3));
        assert!(output.acceleration_rad_s2 > 0.0);
    }

    #[test]
    fn commands_arrive_in_order_exactly_one_delay_later() {
        let us = SimTime::from_us;
        let mut line = DelayLine::for_interval(us(5_000), 0.0, us(1_000));
        for step in 0..100_u64 {
            line.push(us(1_000 * step), step as f64);
            let expected = step.saturating_sub(5) as f64;
            assert_eq!(line.at(us(1_000 * step)), expected);
        }
        assert_eq!(line.at(us(103_999)), 98.0);
        assert_eq!(line.at(us(104_000)), 99.0);
        let mut direct = DelayLine::new(SimTime::ZERO, 1.0, 4);
        direct.push(us(7), 2.0);
        assert_eq!(direct.at(us(7)), 2.0);
    }

    #[test]
    fn a_full_line_lets_the_oldest_through_early() {
        let us = SimTime::from_us;
        let mut line = DelayLine::new(us(10), 0, 2);
        for value in 1..=3 {
            line.push(us(value), value);
        }
        assert_eq!(line.at(us(3)), 1);
        assert_eq!(line.at(us(13)), 3);
    }

    #[test]
    fn a_stroke_takes_its_time_in_any_steps() {
        let valve = StrokeValve { stroke_time_s: 0.2 };
        let mut opening = 0.0;
        for _ in 0..150 {
            opening = valve.opening_after(opening, 1.0, 1e-3);
        }
        assert!((opening - 0.75).abs() < 1e-12);
        assert!((valve.opening_after(0.0, 1.0, 0.15) - 0.75).abs() < 1e-15);
        assert_eq!(valve.opening_after(opening, 1.0, 0.1), 1.0);
        assert_eq!(valve.opening_after(0.1, 0.0, 1.0), 0.0);
        assert_eq!(StrokeValve { stroke_time_s: 0.0 }.opening_after(0.0, 1.0, 0.0), 1.0);
    }
}
