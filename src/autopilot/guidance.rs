//! Guidance: the trajectory in force, the clock along it, and the closed-form ramps of each phase.
//!
//! Ramps: the speed toward the goal follows `v = √(2 a d)` with a linear end, acceleration is bounded by
//! construction, and a moving average over 0.2 s makes the jerk finite. The average of a motion is itself a
//! motion with consistent derivatives, and it ends where the original ends.

use super::mission::Mission;
use super::phase::Phase;
use super::trajectory::{Node, Reference, Trajectory};
use crate::frame::Vec3;
use crate::time::SimTime;

/// The trajectory in force and the time on it.
#[derive(Clone, Debug)]
pub struct Guidance {
    trajectory: Trajectory,
    elapsed_s: f64,
}

/// Greatest share by which the trajectory clock runs fast or slow to meet the vehicle.
const CLOCK_SHARE: f64 = 0.2;
/// Rate at which the clock meets the vehicle (1/s).
const CLOCK_RATE_1_S: f64 = 1.0;
/// Speed of the reference below which the clock is not shifted (m/s).
const CLOCK_SPEED_M_S: f64 = 1.0;

impl Guidance {
    /// At rest at one position.
    pub fn at_rest(position_ned_m: Vec3, heading_rad: f64) -> Self {
        Self { trajectory: Trajectory::hold(SimTime::ZERO, position_ned_m, heading_rad), elapsed_s: 0.0 }
    }

    /// Follows a trajectory from now on, `elapsed_s` after its start.
    pub fn follow(&mut self, trajectory: Trajectory, elapsed_s: f64) {
        (self.trajectory, self.elapsed_s) = (trajectory, elapsed_s);
    }

    /// The trajectory in force.
    pub const fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// Time on the trajectory (s).
    pub const fn elapsed_s(&self) -> f64 {
        self.elapsed_s
    }

    /// The present reference.
    pub fn reference(&self) -> Reference {
        self.ahead(0.0)
    }

    /// The reference that many seconds from now.
    pub fn ahead(&self, seconds: f64) -> Reference {
        self.trajectory.after(self.elapsed_s + seconds)
    }

    /// Advances the clock. On a moving reference the clock meets the vehicle along the path: a timing error
    /// is not corrected with thrust.
    pub fn advance(&mut self, position_ned_m: Vec3, dt_s: f64) {
        let r = self.reference();
        let speed2 = r.velocity_ned_m_s.norm_squared();
        let late_s = if speed2 > CLOCK_SPEED_M_S * CLOCK_SPEED_M_S {
            r.velocity_ned_m_s.dot(&(position_ned_m - r.position_ned_m)) / speed2
        } else {
            0.0
        };
        let shift = (CLOCK_RATE_1_S * late_s).clamp(-CLOCK_SHARE, CLOCK_SHARE);
        self.elapsed_s += dt_s * if shift.is_finite() { 1.0 + shift } else { 1.0 };
    }
}

/// Samples in the moving average.
const WINDOW: usize = 10;
/// Step of the ramps (s).
const STEP_S: f64 = 0.02;
/// Length of the moving average (s).
const WINDOW_S: f64 = STEP_S * WINDOW as f64;
/// Greatest duration of a ramp; after it, the reference coasts (s).
const LONGEST_S: f64 = 400.0;
/// Slope of the linear end of the approach (1/s).
const APPROACH_RATE_1_S: f64 = 3.0;
/// Reference speed as a share of the terminal speed: the rest is a margin for the tracking error.
const TERMINAL_SHARE: f64 = 0.93;
/// The terminal speed is reached this much above the terminal height (m).
const TERMINAL_LEAD_M: f64 = 0.1;
/// Height above which the horizontal transfer may begin (m).
const LATERAL_HEIGHT_M: f64 = 3.0;

/// Unsmoothed motion at one step of a ramp.
#[derive(Clone, Copy, Debug)]
struct Motion {
    position: Vec3,
    velocity: Vec3,
    acceleration: Vec3,
}

/// Mission profile in the local frame: where each phase leads, and its ramps.
#[derive(Clone, Copy, Debug)]
pub struct MissionProfile<'a> {
    /// The mission.
    pub mission: &'a Mission,
    /// Position of the pivot at rest on the pad (m).
    pub rest_ned_m: Vec3,
}

impl MissionProfile<'_> {
    /// Hover position of the pivot, over the landing point (m).
    pub(crate) fn hover_ned_m(&self) -> Vec3 {
        self.landing_ned_m() - Vec3::new(0.0, 0.0, self.mission.hover_height_m)
    }

    /// Position of the pivot at rest on the landing point (m).
    fn landing_ned_m(&self) -> Vec3 {
        let [north, east] = self.mission.target_north_east_m;
        self.rest_ned_m + Vec3::new(north, east, 0.0)
    }

    /// The reference has reached the hover height.
    pub(crate) fn is_at_hover(&self, reference: &Reference) -> bool {
        (reference.position_ned_m.z - self.hover_ned_m().z).abs() < 0.05
            && reference.velocity_ned_m_s.z.abs() < 0.2
    }

    /// The reference is over the landing point.
    pub(crate) fn is_over_target(&self, reference: &Reference) -> bool {
        let d = self.landing_ned_m() - reference.position_ned_m;
        libm::hypot(d.x, d.y) < 0.1
    }

    /// Position at which the reference reaches the terminal speed (m).
    pub(crate) fn terminal_ned_m(&self) -> Vec3 {
        self.landing_ned_m() - Vec3::new(0.0, 0.0, self.mission.terminal_height_m + TERMINAL_LEAD_M)
    }

    /// Speed of the reference in the terminal phase (m/s).
    pub(crate) fn final_speed_m_s(&self) -> f64 {
        TERMINAL_SHARE * self.mission.terminal_speed_m_s
    }

    /// The ramps of a phase from the motion `from`, beginning at `start`.
    pub fn ramps(&self, phase: Phase, from: &Reference, start: SimTime) -> Trajectory {
        let mut ramp = Ramp::new(from);
        let mut nodes = vec![ramp.node(0.0)];
        // The average ends a window later than the unsmoothed motion.
        let mut steps_after_arrival = 0;
        while steps_after_arrival <= WINDOW && (nodes.len() as f64) * STEP_S < LONGEST_S {
            ramp.step(self, phase);
            nodes.push(ramp.node(nodes.len() as f64 * STEP_S));
            steps_after_arrival = if ramp.has_arrived(self, phase) { steps_after_arrival + 1 } else { 0 };
        }
        Trajectory::new(start, from.heading_rad, nodes)
    }

    fn height_m(&self, position_ned_m: Vec3) -> f64 {
        self.rest_ned_m.z - position_ned_m.z
    }

    fn climb_speed(&self, phase: Phase, height: f64) -> f64 {
        let mission = self.mission;
        let a = mission.acceleration_m_s2;
        match phase {
            Phase::Ascent | Phase::Hover => {
                let up = mission.hover_height_m - height;
                let limit = if up > 0.0 { mission.ascent_speed_m_s } else { mission.descent_speed_m_s };
                approach_speed(up.abs(), a, limit).copysign(up)
            }
            _ if phase.is_descent() => {
                let v = self.final_speed_m_s();
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

/// State of a ramp: the unsmoothed motion, and its last steps for the average.
#[derive(Clone, Debug)]
struct Ramp {
    now: Motion,
    window: [Motion; WINDOW],
    cursor: usize,
}

impl Ramp {
    /// The first average is the motion `from`.
    fn new(from: &Reference) -> Self {
        let (p, v, a) = (from.position_ned_m, from.velocity_ned_m_s, from.acceleration_ned_m_s2);
        let at =
            |t: f64| Motion { position: p + v * t + a * (0.5 * t * t), velocity: v + a * t, acceleration: a };
        // The mean of the window lies at its middle: the unsmoothed motion runs half a window ahead.
        let middle = 0.5 * (WINDOW - 1) as f64;
        let window = core::array::from_fn(|k| at((k as f64 - middle) * STEP_S));
        Self { now: at(middle * STEP_S), window, cursor: 0 }
    }

    /// Mean of the window, as a node.
    fn node(&self, time_s: f64) -> Node {
        let mean = |of: fn(&Motion) -> Vec3| self.window.iter().map(of).sum::<Vec3>() / WINDOW as f64;
        Node {
            time_s,
            position_ned_m: mean(|m| m.position),
            velocity_ned_m_s: mean(|m| m.velocity),
            acceleration_ned_m_s2: mean(|m| m.acceleration),
        }
    }

    /// The unsmoothed motion has reached its goal: it keeps its velocity.
    fn has_arrived(&self, profile: &MissionProfile, phase: Phase) -> bool {
        let (p, v) = (self.now.position, self.now.velocity);
        let offset = profile.landing_ned_m() - p;
        let over = libm::hypot(offset.x, offset.y) < 1e-3 && libm::hypot(v.x, v.y) < 3e-3;
        let vertical = match phase {
            Phase::Ascent | Phase::Hover => (profile.hover_ned_m().z - p.z).abs() < 1e-3 && v.z.abs() < 3e-3,
            _ if phase.is_descent() => (v.z - profile.final_speed_m_s()).abs() < 1e-9,
            _ => true,
        };
        over && vertical
    }

    fn step(&mut self, profile: &MissionProfile, phase: Phase) {
        let mission = profile.mission;
        let height = profile.height_m(self.now.position);
        let mut wanted = Vec3::zeros();
        if height > LATERAL_HEIGHT_M || phase.is_descent() {
            let to_target = profile.landing_ned_m() - self.now.position;
            let distance = libm::hypot(to_target.x, to_target.y);
            if distance > 1e-9 {
                let speed =
                    approach_speed(distance, mission.lateral_acceleration_m_s2, mission.lateral_speed_m_s);
                wanted.x = to_target.x / distance * speed;
                wanted.y = to_target.y / distance * speed;
            }
        }
        wanted.z = -profile.climb_speed(phase, height);

        let mut change = wanted - self.now.velocity;
        let lateral = libm::hypot(change.x, change.y);
        let lateral_most = mission.lateral_acceleration_m_s2 * STEP_S;
        if lateral > lateral_most {
            change.x *= lateral_most / lateral;
            change.y *= lateral_most / lateral;
        }
        let vertical_most = mission.acceleration_m_s2 * STEP_S;
        change.z = change.z.clamp(-vertical_most, vertical_most);

        self.now.position += (self.now.velocity + change * 0.5) * STEP_S;
        self.now.velocity += change;
        self.now.acceleration = change / STEP_S;
        self.window[self.cursor] = self.now;
        self.cursor = (self.cursor + 1) % WINDOW;
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

    fn at_rest(position_ned_m: Vec3) -> Reference {
        Reference { position_ned_m, ..Reference::default() }
    }

    #[test]
    fn climb_ends_at_the_hover_height_within_the_limits() {
        let mission = Mission::default();
        let profile = MissionProfile { mission: &mission, rest_ned_m: REST };
        let climb = profile.ramps(Phase::Ascent, &at_rest(REST), SimTime::ZERO);
        for pair in climb.nodes().windows(2) {
            let (a, b) = (&pair[0], &pair[1]);
            assert!(-b.velocity_ned_m_s.z <= 6.0 + 1e-9);
            assert!(b.acceleration_ned_m_s2.z.abs() <= 1.6 + 1e-9);
            // Consistent derivatives: the mean velocity of the step moves the position.
            let moved = b.position_ned_m.z - a.position_ned_m.z;
            let mean = 0.5 * (b.velocity_ned_m_s.z + a.velocity_ned_m_s.z);
            assert!((moved - mean * STEP_S).abs() < 1e-9);
        }
        let arrived =
            (0..).map(|i| 0.01 * f64::from(i)).find(|&t| profile.is_at_hover(&climb.after(t))).unwrap();
        // 6/1.6 s of each ramp, the rest at 6 m/s: 12.1 s; the linear end costs under 1 s.
        assert!(arrived > 12.0 && arrived < 13.2, "{arrived}");
        assert!((climb.last().position_ned_m - profile.hover_ned_m()).norm() < 2e-3);
    }

    #[test]
    fn descent_reaches_the_terminal_speed_at_the_terminal_height() {
        let mission = Mission::default();
        let profile = MissionProfile { mission: &mission, rest_ned_m: REST };
        let down = profile.ramps(Phase::Descent, &at_rest(profile.hover_ned_m()), SimTime::ZERO);
        let low = |t: &f64| REST.z - down.after(*t).position_ned_m.z <= mission.terminal_height_m;
        let time_s = (0..).map(|i| 0.004 * f64::from(i)).find(low).unwrap();
        let speed = down.after(time_s).velocity_ned_m_s.z;
        assert!((speed - TERMINAL_SHARE * 0.8).abs() < 1e-3, "{speed}");
        // And keeps it for good.
        assert!((down.after(time_s + 60.0).velocity_ned_m_s.z - speed).abs() < 1e-3);
    }

    #[test]
    fn a_motion_under_way_is_braked_and_led_to_the_target() {
        let mission = Mission { target_north_east_m: [8.0, -3.0], ..Mission::default() };
        let profile = MissionProfile { mission: &mission, rest_ned_m: REST };
        let under_way = Reference {
            position_ned_m: REST + Vec3::new(-2.0, 1.0, -20.0),
            velocity_ned_m_s: Vec3::new(-3.0, 2.0, 4.0),
            ..Reference::default()
        };
        let way = profile.ramps(Phase::Hover, &under_way, SimTime::ZERO);
        assert!((way.after(0.0).position_ned_m - under_way.position_ned_m).norm() < 1e-12);
        let end = way.last().position_ned_m - REST;
        assert!((end - Vec3::new(8.0, -3.0, -50.0)).norm() < 0.01, "{end}");
    }

    #[test]
    fn the_clock_meets_a_vehicle_that_is_late_and_leaves_one_that_is_beside_the_path() {
        let along = |at: f64, speed: f64| Node {
            time_s: at,
            position_ned_m: Vec3::new(0.0, 0.0, speed * at),
            velocity_ned_m_s: Vec3::new(0.0, 0.0, speed),
            acceleration_ned_m_s2: Vec3::zeros(),
        };
        let mut guidance = Guidance::at_rest(Vec3::zeros(), 0.0);
        guidance.follow(Trajectory::new(SimTime::ZERO, 0.0, vec![along(0.0, 4.0), along(20.0, 4.0)]), 0.0);
        // The vehicle flies the path half a second late, and a metre beside it.
        for i in 0..2500 {
            let t = 0.004 * f64::from(i);
            guidance.advance(Vec3::new(1.0, 0.0, 4.0 * (t - 0.5)), 0.004);
        }
        assert!((guidance.elapsed_s() - 9.5).abs() < 0.01, "{}", guidance.elapsed_s());
    }
}
