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
//! because they need no event.
//!
//! Coulomb friction is a critically damped spring that sticks and slips, `θ'' += -ω² clamp(K (θ - anchor) + 2
//! K^(1/2) θ'/ω, ±friction)`. While the servo sticks the anchor stays; beyond the friction it is dragged
//! along, between steps. Friction is given as an angle, the error that the position loop needs to break away,
//! so no error below it is corrected: the steady error is at most the friction, and following a slow ramp the
//! servo lags by it. `K = 25`, less for a servo so fast that five times its frequency is beyond what RK4 at 1
//! ms resolves. Source: elastic-plastic (Prandtl) element, the rate-independent limit of the Dahl and LuGre
//! models (Olsson et al., Friction Models and Friction Compensation, 1998). Static and sliding friction are
//! the same. A servo that is told to go to a stop pushes on until it is there.
//!
//! Play is a hysteresis behind the servo: within it what the servo moves stands still, beyond it follows.
//! Which of the two is decided between steps and holds during one. When play is taken up the output's rate
//! jumps to the servo's, and what it hangs on feels a blow (`plant/play.rs`). Both are remembered in
//! [`ServoMemory`].

use crate::time::SimTime;
use std::collections::VecDeque;

/// Fastest approach to a limit (1/s).
const FASTEST_BARRIER_1_S: f64 = 1000.0;
/// Approach to a limit over natural frequency.
const BARRIER_OVER_FREQUENCY: f64 = 10.0;
/// Frequency of the servo on the spring of its friction, over natural frequency, and at most (rad/s).
const STICK_OVER_FREQUENCY: f64 = 5.0;
const FASTEST_STICK_RAD_S: f64 = 500.0;

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
    /// Coulomb friction, as the error at which the position loop breaks away (rad).
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub friction_rad: f64,
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
            friction_rad: self.friction_rad,
            drive_share: 1.0,
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
    /// Coulomb friction, as the error at which the position loop breaks away (rad).
    pub friction_rad: f64,
    /// What is left of the drive, on natural frequency and greatest rate: 1 sound; 0 seized, it stops within
    /// milliseconds and stays.
    pub drive_share: f64,
}

/// What a servo remembers between steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ServoMemory {
    /// Where the play was left: the angle of what the servo moves (rad).
    pub held_rad: f64,
    /// From servo to what it moves while the play is taken up (rad); `None`: inside the play.
    pub taken_up_rad: Option<f64>,
    /// Where friction holds the servo (rad).
    pub anchor_rad: f64,
}

impl ServoMemory {
    /// At rest at an angle, in the middle of the play.
    pub fn at(angle_rad: f64) -> Self {
        Self { held_rad: angle_rad, taken_up_rad: None, anchor_rad: angle_rad }
    }
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
    #[inline]
    pub fn rate(&self, state: &ServoState, command_rad: f64, memory: &ServoMemory) -> ServoRate {
        let (angle, rate) = (state.angle_rad, state.rate_rad_s);
        let command = if command_rad.is_nan() { angle } else { command_rad };
        let mut command = command.max(self.lower_rad).min(self.upper_rad);
        let w = self.natural_frequency_rad_s * self.drive_share;
        if self.friction_rad > 0.0 && w > 0.0 {
            if command == self.lower_rad {
                command -= self.friction_rad;
            } else if command == self.upper_rad {
                command += self.friction_rad;
            }
            let root = self.stick_over_loop();
            let held_rad = root * (root * (angle - memory.anchor_rad) + 2.0 * rate / w);
            command -= held_rad.clamp(-self.friction_rad, self.friction_rad);
        }
        let linear = w * (w * (command - angle) - 2.0 * self.damping_ratio * rate);
        // A drive that fails does not soften stops and gears.
        let k = (BARRIER_OVER_FREQUENCY * self.natural_frequency_rad_s).min(FASTEST_BARRIER_1_S);
        let rate_limit_rad_s = self.rate_limit_rad_s * self.drive_share;
        let stop_upper = k * (k * (self.upper_rad - angle) - 2.0 * rate);
        let stop_lower = k * (k * (self.lower_rad - angle) - 2.0 * rate);
        let rate_upper = k * (rate_limit_rad_s - rate);
        let rate_lower = k * (-rate_limit_rad_s - rate);
        let acceleration_rad_s2 = linear.min(stop_upper).max(stop_lower).min(rate_upper).max(rate_lower);
        ServoRate { rate_rad_s: rate, acceleration_rad_s2 }
    }

    /// Where a servo without dynamics goes at once from an angle (rad): to its command, unless it is seized.
    pub fn at_once(&self, angle_rad: f64, command_rad: f64) -> f64 {
        if self.drive_share > 0.0 { command_rad.max(self.lower_rad).min(self.upper_rad) } else { angle_rad }
    }

    /// What moves behind the play.
    #[inline]
    pub fn output(&self, state: &ServoState, rate: &ServoRate, memory: &ServoMemory) -> ServoOutput {
        let angle_rad = match memory.taken_up_rad {
            _ if self.backlash_rad <= 0.0 => state.angle_rad,
            Some(offset_rad) => state.angle_rad + offset_rad,
            None => {
                let angle_rad = memory.held_rad;
                return ServoOutput { angle_rad, ..ServoOutput::default() };
            }
        };
        ServoOutput { angle_rad, rate_rad_s: rate.rate_rad_s, acceleration_rad_s2: rate.acceleration_rad_s2 }
    }

    /// Where play and friction leave the servo after a step.
    #[inline]
    pub(crate) fn memory_after(&self, angle_rad: f64, memory: &ServoMemory) -> ServoMemory {
        let root = self.stick_over_loop();
        let within = |held_rad: f64, half: f64| held_rad.min(angle_rad + half).max(angle_rad - half);
        let half = 0.5 * self.backlash_rad;
        let held_rad = within(memory.held_rad, half);
        ServoMemory {
            held_rad,
            // Taken up where the servo moved it; a servo that turns round leaves it.
            taken_up_rad: if self.backlash_rad <= 0.0 || held_rad == memory.held_rad {
                None
            } else if held_rad > memory.held_rad {
                Some(-half)
            } else {
                Some(half)
            },
            anchor_rad: within(memory.anchor_rad, self.friction_rad / root / root),
        }
    }

    /// Natural frequency on the friction's spring over that of the position loop, K^(1/2).
    fn stick_over_loop(&self) -> f64 {
        STICK_OVER_FREQUENCY.min(FASTEST_STICK_RAD_S / self.natural_frequency_rad_s)
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
    pub(crate) fn for_interval(delay: SimTime, initial: T, interval: SimTime) -> Self {
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
    pub(crate) fn opening_after(&self, opening: f64, target: f64, dt_s: f64) -> f64 {
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
        friction_rad: 0.0,
        drive_share: 1.0,
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
        let mut memory = ServoMemory::at(start.angle_rad);
        for _ in 0..(time_s / dt_s).round() as u32 {
            state = rk4_step(&state, dt_s, |s, _| servo.rate(s, command_rad, &memory));
            memory = servo.memory_after(state.angle_rad, &memory);
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
            for (damping_ratio, command, friction_rad) in [
                (0.7, 10.0, 0.0),
                (0.1, 10.0, 0.02),
                (0.2, -0.122, 0.002),
                (2.0, -10.0, 0.1),
                (0.05, 0.1, 0.0),
                (0.05, 0.1, 0.01),
            ] {
                let servo = Servo { natural_frequency_rad_s, damping_ratio, friction_rad, ..GIMBAL };
                let mut state = ServoState { angle_rad: -0.1 * f64::signum(command), rate_rad_s: 0.0 };
                let mut memory = ServoMemory::at(state.angle_rad);
                for _ in 0..5_000 {
                    state = rk4_step(&state, 1e-3, |s, _| servo.rate(s, command, &memory));
                    memory = servo.memory_after(state.angle_rad, &memory);
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
    fn friction_leaves_an_error_up_to_itself_and_no_greater() {
        // The spring of the friction gives by f/K before it slips: an error e < f that builds up while the
        // servo sticks is worn down by e/(1 + K) and no more; a greater one is left at f or, where the
        // approach overshoots, anywhere between.
        let friction_rad = 2e-3;
        let servo = Servo { friction_rad, ..GIMBAL };
        for share in [0.1, 0.5, 0.9, 0.999] {
            let command = share * friction_rad;
            let left = command - moved(&servo, ServoState::default(), command, 2.0, 1e-3).angle_rad;
            let stuck = command * (1.0 - 1.0 / 26.0);
            assert!((left - stuck).abs() < 1e-12, "{share}: {left} against {stuck}");
        }
        for (start, command) in [(0.0, 0.05), (0.03, 0.01), (-0.1, 0.1), (0.0, 0.003), (0.02, 0.0165)] {
            let start = ServoState { angle_rad: start, rate_rad_s: 0.0 };
            let end = moved(&servo, start, command, 2.0, 1e-3);
            let error = command - end.angle_rad;
            assert!(error.abs() <= friction_rad * (1.0 + 1e-9) && end.rate_rad_s.abs() < 1e-9, "{error}");
        }
        // Without it the error is worn down to nothing.
        assert!((moved(&GIMBAL, ServoState::default(), 0.05, 2.0, 1e-3).angle_rad - 0.05).abs() < 1e-12);
    }

    #[test]
    fn behind_a_slow_ramp_the_servo_lags_by_friction_either_way() {
        // θ'' = 0 on a ramp of rate r: the error is the friction plus the loop's own lag, 2 ζ r/ω.
        let servo = Servo { friction_rad: 2e-3, ..GIMBAL };
        let lag = 2.0 * servo.damping_ratio * 0.01 / servo.natural_frequency_rad_s;
        let (mut state, mut memory, mut command) = (ServoState::default(), ServoMemory::default(), 0.0);
        for (rate, seconds) in [(0.01, 4), (-0.01, 8), (0.01, 8)] {
            for _ in 0..seconds * 1000 {
                let begin: f64 = command;
                state =
                    rk4_step(&state, 1e-3, |s, share| servo.rate(s, begin + rate * 1e-3 * share, &memory));
                memory = servo.memory_after(state.angle_rad, &memory);
                command += rate * 1e-3;
            }
            let error = command - state.angle_rad;
            let expected = (servo.friction_rad + lag) * f64::signum(rate);
            // The ramp runs half a step ahead of its samples at most: 1e-5 rad/s of 1 ms, and the anchor
            // moves between steps, so the spring gives by a step's motion, K 1e-5 rad, less clamped.
            assert!((error - expected).abs() < 1e-8, "{error} against {expected}");
        }
    }

    #[test]
    fn friction_of_a_stop_and_of_a_ball_on_its_seat_is_overcome() {
        let servo = Servo { friction_rad: 0.01, ..GIMBAL };
        for (start, command) in [(0.05, 0.5), (-0.05, -0.5)] {
            let start = ServoState { angle_rad: start, rate_rad_s: 0.0 };
            let end = moved(&servo, start, command, 2.0, 1e-3);
            assert!((end.angle_rad.abs() - servo.upper_rad).abs() < 1e-6, "{end:?}");
        }
    }

    #[test]
    fn a_command_that_is_no_number_holds_the_angle() {
        let state = ServoState { angle_rad: 0.05, rate_rad_s: 0.0 };
        let memory = ServoMemory::at(0.05);
        assert_eq!(GIMBAL.rate(&state, f64::NAN, &memory).acceleration_rad_s2, 0.0);
        assert!(GIMBAL.rate(&state, f64::INFINITY, &memory).acceleration_rad_s2.is_finite());
    }

    #[test]
    fn play_is_lost_on_every_reversal() {
        let servo = Servo { backlash_rad: 0.01, ..GIMBAL };
        let mut memory = ServoMemory::default();
        let mut at = |angle_rad: f64| {
            let state = ServoState { angle_rad, rate_rad_s: 0.3 };
            memory = servo.memory_after(angle_rad, &memory);
            let output = servo.output(&state, &servo.rate(&state, angle_rad, &memory), &memory);
            assert!((output.angle_rad - memory.held_rad).abs() < 1e-15);
            // Within the step that follows it goes with the servo or stays.
            let moved = ServoState { angle_rad: angle_rad + 1e-4, ..state };
            let along = servo.output(&moved, &servo.rate(&moved, angle_rad, &memory), &memory).angle_rad;
            let follows = if output.rate_rad_s == 0.0 { 0.0 } else { 1e-4 };
            assert!((along - output.angle_rad - follows).abs() < 1e-15);
            (output.angle_rad, output.rate_rad_s)
        };
        assert_eq!(at(0.004), (0.0, 0.0));
        assert_eq!(at(0.020), (0.015, 0.3));
        assert_eq!(at(0.012), (0.015, 0.0));
        assert_eq!(at(0.005), (0.010, 0.3));
        assert_eq!(at(0.005), (0.010, 0.0));
        let state = ServoState { angle_rad: 0.02, rate_rad_s: 0.3 };
        let memory = GIMBAL.memory_after(state.angle_rad, &ServoMemory::default());
        let output = GIMBAL.output(&state, &GIMBAL.rate(&state, 0.1, &memory), &memory);
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
