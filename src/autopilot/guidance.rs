//! Reference generator: a motion that the vehicle can follow, from where it is to where the phase wants it.
//!
//! Speed toward the goal follows `v = √(2 a d)` with a linear end, acceleration is bounded by
//! construction, and a moving average over 0.2 s makes the jerk finite. The average of a motion is
//! itself a motion with consistent derivatives, and it ends where the original ends.
//!
//! This is the seam for optimal guidance: whatever fills a [`Reference`] each step can stand here.

use super::phase::{Mission, Phase};
pub use super::trajectory::Reference;
use crate::frame::Vec3;

/// Samples in the moving average: 0.2 s at 250 Hz.
const WINDOW: usize = 50;
/// Its length at the rate it is meant for (s).
const WINDOW_S: f64 = 0.2;
/// Slope of the linear end of the approach (1/s).
const APPROACH_RATE_1_S: f64 = 3.0;
/// Share of the terminal speed that is flown: the rest is for the error of tracking it.
const TERMINAL_SHARE: f64 = 0.93;
/// The terminal speed is reached this much above the terminal height (m).
const TERMINAL_LEAD_M: f64 = 0.1;
/// Height above which the sideways part may begin (m).
const LATERAL_HEIGHT_M: f64 = 3.0;

#[derive(Clone, Copy, Debug)]
struct Motion {
    position: Vec3,
    velocity: Vec3,
    acceleration: Vec3,
}

/// The generator's state. Positions relative to the local origin.
#[derive(Clone, Debug)]
pub struct ReferenceGenerator {
    now: Motion,
    window: [Motion; WINDOW],
    cursor: usize,
    rest_ned_m: Vec3,
    heading_rad: f64,
}

impl ReferenceGenerator {
    /// At rest on the pad, pivot at `rest_ned_m`.
    pub fn at_rest(rest_ned_m: Vec3, heading_rad: f64) -> Self {
        Self::moving(
            rest_ned_m,
            &Reference { position_ned_m: rest_ned_m, heading_rad, ..Reference::default() },
        )
    }

    /// Starting from a motion under way: the hand-over in flight. The first reference is that motion.
    pub fn moving(rest_ned_m: Vec3, start: &Reference) -> Self {
        let (p, v, a) = (start.position_ned_m, start.velocity_ned_m_s, start.acceleration_ned_m_s2);
        let at =
            |t: f64| Motion { position: p + v * t + a * (0.5 * t * t), velocity: v + a * t, acceleration: a };
        // The mean of the window lies at its middle: the unsmoothed motion runs half a window ahead.
        let step_s = WINDOW_S / WINDOW as f64;
        let middle = 0.5 * (WINDOW - 1) as f64;
        let window = core::array::from_fn(|k| at((k as f64 - middle) * step_s));
        Self { now: at(middle * step_s), window, cursor: 0, rest_ned_m, heading_rad: start.heading_rad }
    }

    /// Smoothed reference.
    pub fn reference(&self) -> Reference {
        let mut sum =
            Motion { position: Vec3::zeros(), velocity: Vec3::zeros(), acceleration: Vec3::zeros() };
        for m in &self.window {
            sum.position += m.position;
            sum.velocity += m.velocity;
            sum.acceleration += m.acceleration;
        }
        let share = 1.0 / WINDOW as f64;
        Reference {
            position_ned_m: sum.position * share,
            velocity_ned_m_s: sum.velocity * share,
            acceleration_ned_m_s2: sum.acceleration * share,
            heading_rad: self.heading_rad,
        }
    }

    /// Height of the reference above rest (m), unsmoothed.
    pub fn height_m(&self) -> f64 {
        self.rest_ned_m.z - self.now.position.z
    }

    /// The reference has arrived at the hover height.
    pub fn is_at_hover(&self, mission: &Mission) -> bool {
        (self.height_m() - mission.hover_height_m).abs() < 0.05 && self.now.velocity.z.abs() < 0.2
    }

    /// The reference has arrived over the landing point.
    pub fn is_over_target(&self, mission: &Mission) -> bool {
        let d = self.target(mission) - self.now.position;
        libm::hypot(d.x, d.y) < 0.1
    }

    /// Advances by `dt_s`.
    pub fn step(&mut self, mission: &Mission, phase: Phase, dt_s: f64) {
        let mut wanted = Vec3::zeros();
        if self.height_m() > LATERAL_HEIGHT_M || phase >= Phase::Descent {
            let to_target = self.target(mission) - self.now.position;
            let distance = libm::hypot(to_target.x, to_target.y);
            if distance > 1e-9 {
                let speed =
                    approach_speed(distance, mission.lateral_acceleration_m_s2, mission.lateral_speed_m_s);
                wanted.x = to_target.x / distance * speed;
                wanted.y = to_target.y / distance * speed;
            }
        }
        wanted.z = -self.climb_speed(mission, phase);

        let mut change = wanted - self.now.velocity;
        let lateral = libm::hypot(change.x, change.y);
        let lateral_most = mission.lateral_acceleration_m_s2 * dt_s;
        if lateral > lateral_most {
            change.x *= lateral_most / lateral;
            change.y *= lateral_most / lateral;
        }
        let vertical_most = mission.acceleration_m_s2 * dt_s;
        change.z = change.z.clamp(-vertical_most, vertical_most);

        self.now.position += (self.now.velocity + change * 0.5) * dt_s;
        self.now.velocity += change;
        self.now.acceleration = if dt_s > 0.0 { change / dt_s } else { Vec3::zeros() };
        self.window[self.cursor] = self.now;
        self.cursor = (self.cursor + 1) % WINDOW;
    }

    fn target(&self, mission: &Mission) -> Vec3 {
        self.rest_ned_m + Vec3::new(mission.target_north_east_m[0], mission.target_north_east_m[1], 0.0)
    }

    fn climb_speed(&self, mission: &Mission, phase: Phase) -> f64 {
        let a = mission.acceleration_m_s2;
        let height = self.height_m();
        match phase {
            Phase::Ascent | Phase::Hover => {
                let up = mission.hover_height_m - height;
                let limit = if up > 0.0 { mission.ascent_speed_m_s } else { mission.descent_speed_m_s };
                approach_speed(up.abs(), a, limit).copysign(up)
            }
            Phase::Descent | Phase::Terminal | Phase::AbortLand => {
                let v = TERMINAL_SHARE * mission.terminal_speed_m_s;
                // The smoothed reference is half a window late: at the terminal height it still has the
                // speed that the braking takes off in that time, so all of it begins that much higher.
                let late_m = (v + 0.5 * a * WINDOW_S) * WINDOW_S;
                let end_m = mission.terminal_height_m + TERMINAL_LEAD_M + late_m;
                let above = (height - end_m).max(0.0);
                -(v * v + 2.0 * a * above).sqrt().min(mission.descent_speed_m_s.max(v))
            }
            _ => 0.0,
        }
    }
}

/// Speed from which a constant braking `a` stops within `distance`, linear near the goal.
fn approach_speed(distance: f64, a: f64, limit: f64) -> f64 {
    let linear_m = a / (APPROACH_RATE_1_S * APPROACH_RATE_1_S);
    let speed = if distance < linear_m {
        APPROACH_RATE_1_S * distance
    } else {
        (2.0 * a * (distance - 0.5 * linear_m)).sqrt()
    };
    speed.min(limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    const REST: Vec3 = Vec3::new(0.0, 0.0, -0.741);

    #[test]
    fn climb_ends_at_the_hover_height_within_the_limits() {
        let mission = Mission::default();
        let mut generator = ReferenceGenerator::at_rest(REST, 0.0);
        let (mut previous, mut time_s) = (generator.reference(), 0.0);
        while !generator.is_at_hover(&mission) && time_s < 30.0 {
            generator.step(&mission, Phase::Ascent, 0.004);
            time_s += 0.004;
            let now = generator.reference();
            assert!(-now.velocity_ned_m_s.z <= 6.0 + 1e-9);
            assert!(now.acceleration_ned_m_s2.z.abs() <= 1.6 + 1e-9);
            // Consistent derivatives: the mean velocity of the step moves the position.
            let moved = now.position_ned_m.z - previous.position_ned_m.z;
            let mean = 0.5 * (now.velocity_ned_m_s.z + previous.velocity_ned_m_s.z);
            assert!((moved - mean * 0.004).abs() < 1e-9);
            previous = now;
        }
        // 6/1.6 s of each ramp, the rest at 6 m/s: 12.1 s; the linear end costs under 1 s.
        assert!(time_s > 12.0 && time_s < 13.2, "{time_s}");
        assert!(generator.height_m() <= mission.hover_height_m + 1e-9);
    }

    #[test]
    fn descent_reaches_the_terminal_speed_at_the_terminal_height() {
        let mission = Mission::default();
        let above = REST - Vec3::new(0.0, 0.0, 50.0);
        let mut generator =
            ReferenceGenerator::moving(REST, &Reference { position_ned_m: above, ..Reference::default() });
        while REST.z - generator.reference().position_ned_m.z > mission.terminal_height_m {
            generator.step(&mission, Phase::Descent, 0.004);
        }
        let speed = generator.reference().velocity_ned_m_s.z;
        assert!((speed - TERMINAL_SHARE * 0.8).abs() < 1e-3, "{speed}");
    }

    #[test]
    fn a_motion_under_way_is_braked_and_led_to_the_target() {
        let mission = Mission { target_north_east_m: [8.0, -3.0], ..Mission::default() };
        let start = REST + Vec3::new(-2.0, 1.0, -20.0);
        let velocity_ned_m_s = Vec3::new(-3.0, 2.0, 4.0);
        let under_way = Reference { position_ned_m: start, velocity_ned_m_s, ..Reference::default() };
        let mut generator = ReferenceGenerator::moving(REST, &under_way);
        assert!((generator.reference().position_ned_m - start).norm() < 1e-12);
        for _ in 0..6000 {
            generator.step(&mission, Phase::Hover, 0.004);
        }
        let end = generator.reference().position_ned_m - REST;
        assert!((end - Vec3::new(8.0, -3.0, -50.0)).norm() < 0.05, "{end}");
    }
}
