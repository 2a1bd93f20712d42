//! The referee: watches the truth, notes what happened, and says when and how a flight ended.

use crate::frame::Vec3;
use crate::plant::Snapshot;
use crate::scenario::Outcome;

use super::report::{Hover, Touchdown};

/// Height above rest at which the vehicle counts as airborne (m): contact after it is a touchdown, a
/// leg that leaves the pad unevenly below it is not.
const AIRBORNE_M: f64 = 0.30;
/// At rest: speed of the centre of mass below this (m/s), for [`REST_S`].
const REST_SPEED_M_S: f64 = 0.1;
/// At rest: tilt below this (rad).
const REST_TILT_RAD: f64 = 10.0 * core::f64::consts::PI / 180.0;
/// Time at rest that counts as landed (s).
const REST_S: f64 = 2.0;
/// Pads that must be down.
const REST_PADS: u32 = 3;
/// A tilt on the ground from which no leg brings the vehicle back (rad): the centre of mass, 1.15 m over
/// the ground and 0.75 m from the pads, passes over a pad at 33 degrees; over an edge between two earlier.
const TIPPED_TILT_RAD: f64 = 45.0 * core::f64::consts::PI / 180.0;
/// After first contact everything must be over by then (s).
const AFTER_CONTACT_S: f64 = 10.0;
/// Throttle without a flame for so long is no ignition (s).
const NO_IGNITION_S: f64 = 10.0;

/// What a flight is judged by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rules {
    /// Landing target, NED from the pad (m).
    pub(super) target_ned_m: Vec3,
    /// What the legs can take (m).
    pub(super) stroke_m: f64,
    /// Longest mission time (s).
    pub(super) timeout_s: f64,
    /// There is ground.
    pub(super) has_ground: bool,
    /// A schedule flies: only its duration, a crash or a fall ends the run.
    pub(super) scheduled: bool,
}

/// Watches one flight.
#[derive(Clone, Debug)]
pub(super) struct Referee {
    rules: Rules,
    pub(super) max_altitude_m: f64,
    pub(super) liftoff_s: Option<f64>,
    pub(super) peak_tilt_rad: Option<f64>,
    airborne: bool,
    pub(super) touchdown: Option<Touchdown>,
    touchdown_ned_m: Option<Vec3>,
    rest_since_s: Option<f64>,
    throttle_since_s: Option<f64>,
    hover: Option<HoverSums>,
    outcome: Option<Outcome>,
}

#[derive(Clone, Copy, Debug, Default)]
struct HoverSums {
    truth: Squares,
    control: Squares,
    duration_s: f64,
}

/// Sums of squares of a position's error.
#[derive(Clone, Copy, Debug, Default)]
struct Squares {
    samples: f64,
    altitude_m2: f64,
    lateral_m2: f64,
}

impl Squares {
    fn add(&mut self, off: Vec3) {
        self.samples += 1.0;
        self.altitude_m2 += off.z * off.z;
        self.lateral_m2 += off.x * off.x + off.y * off.y;
    }

    /// Root mean squares of height and horizontal distance (m), once there is a sample.
    fn rms_m(&self) -> Option<[f64; 2]> {
        (self.samples > 0.0)
            .then(|| [(self.altitude_m2 / self.samples).sqrt(), (self.lateral_m2 / self.samples).sqrt()])
    }
}

/// What the referee is told beside the truth.
#[derive(Clone, Copy, Debug)]
pub(super) struct Circumstances {
    /// Whoever flies has it armed.
    pub(super) armed: bool,
    /// Whoever flies has given the mission up.
    pub(super) aborted: bool,
    /// Whoever flies asks for thrust.
    pub(super) throttle: bool,
    /// Time since the first flame (s).
    pub(super) mission_s: Option<f64>,
    /// Reference of the hover phase, NED of the pivot, while in it.
    pub(super) hover_reference_ned_m: Option<Vec3>,
    /// The flying autopilot's estimate less its reference in the hover phase (m), when it has a new one.
    pub(super) hover_control_error_ned_m: Option<Vec3>,
    /// Time of this step (s).
    pub(super) dt_s: f64,
}

/// What a step reached, each once in a flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Milestones {
    /// All pads have left the ground.
    pub(super) liftoff: bool,
    /// First contact after being airborne.
    pub(super) touchdown: bool,
}

impl Referee {
    /// For one flight.
    pub(super) fn new(rules: Rules) -> Self {
        Self {
            rules,
            max_altitude_m: 0.0,
            liftoff_s: None,
            peak_tilt_rad: None,
            airborne: false,
            touchdown: None,
            touchdown_ned_m: None,
            rest_since_s: None,
            throttle_since_s: None,
            hover: None,
            outcome: None,
        }
    }

    /// How the flight ended, once it has.
    pub(super) fn outcome(&self) -> Option<Outcome> {
        self.outcome
    }

    /// The hover phase, if there was one.
    pub(super) fn hover(&self) -> Option<Hover> {
        let sums = self.hover?;
        let [altitude_rms_m, lateral_rms_m] = sums.truth.rms_m()?;
        let control = sums.control.rms_m();
        Some(Hover {
            duration_s: sums.duration_s,
            altitude_rms_m,
            lateral_rms_m,
            altitude_control_rms_m: control.map(|[altitude_m, _]| altitude_m),
            lateral_control_rms_m: control.map(|[_, lateral_m]| lateral_m),
        })
    }

    /// Where the pivot was at first contact.
    pub(super) fn position_at_touchdown_ned_m(&self) -> Option<Vec3> {
        self.touchdown_ned_m
    }

    /// Ends the flight from outside, unless it has ended.
    pub(super) fn end(&mut self, outcome: Outcome) {
        self.outcome.get_or_insert(outcome);
    }

    /// Takes in one step.
    pub(super) fn watch(&mut self, now: &Snapshot, is: &Circumstances) -> Milestones {
        let mut reached = Milestones::default();
        let time_s = now.time.s();
        self.max_altitude_m = self.max_altitude_m.max(now.height_m);
        if let Some(reference) = is.hover_reference_ned_m {
            let sums = self.hover.get_or_insert_default();
            sums.truth.add(now.position_ned_m - reference);
            sums.duration_s += is.dt_s;
            if let Some(off) = is.hover_control_error_ned_m {
                sums.control.add(off);
            }
        }
        if self.rules.has_ground {
            reached = self.watch_ground(now, is, time_s);
        }
        if now.singular {
            self.end(Outcome::Aborted);
        }
        if self.rules.scheduled {
            return reached;
        }
        // From the first throttle on; only a flame ends the wait, not a controller that gives up.
        if now.lit || self.liftoff_s.is_some() {
            self.throttle_since_s = None;
        } else if is.mission_s.is_none() {
            if is.throttle {
                self.throttle_since_s.get_or_insert(time_s);
            }
            if self.throttle_since_s.is_some_and(|since| time_s - since >= NO_IGNITION_S) {
                self.end(Outcome::NoIgnition);
            }
        }
        if is.mission_s.is_some_and(|mission_s| mission_s >= self.rules.timeout_s) {
            self.end(Outcome::Timeout);
        }
        reached
    }

    fn watch_ground(&mut self, now: &Snapshot, is: &Circumstances, time_s: f64) -> Milestones {
        let mut reached = Milestones::default();
        let on_ground = now.pads_down > 0 || now.hull_contact;
        if self.liftoff_s.is_none() && !on_ground {
            self.liftoff_s = Some(time_s);
            reached.liftoff = true;
        }
        if self.liftoff_s.is_some() && self.touchdown.is_none() && !on_ground {
            self.peak_tilt_rad = Some(self.peak_tilt_rad.unwrap_or(0.0).max(now.tilt_rad()));
        }
        self.airborne |= self.liftoff_s.is_some() && now.height_m > AIRBORNE_M;
        if self.airborne && on_ground && self.touchdown.is_none() {
            let v = now.com_velocity_ned_m_s;
            let off = now.position_ned_m - self.rules.target_ned_m;
            self.touchdown_ned_m = Some(now.position_ned_m);
            self.touchdown = Some(Touchdown {
                time_s,
                vertical_speed_m_s: v.z,
                lateral_speed_m_s: libm::hypot(v.x, v.y),
                tilt_deg: now.tilt_rad().to_degrees(),
                position_error_m: libm::hypot(off.x, off.y),
                control_error_m: None,
                navigation_error_m: None,
            });
            reached.touchdown = true;
        }
        if now.hull_contact || now.leg_deflection_m > self.rules.stroke_m {
            self.end(Outcome::Crashed);
        }
        if on_ground && now.tilt_rad() > TIPPED_TILT_RAD {
            self.end(Outcome::Tipped);
        }
        let resting = now.pads_down >= REST_PADS
            && now.com_velocity_ned_m_s.norm() < REST_SPEED_M_S
            && now.tilt_rad() < REST_TILT_RAD
            && now.thrust_n == 0.0;
        let rested_s = if resting { time_s - *self.rest_since_s.get_or_insert(time_s) } else { 0.0 };
        if !resting {
            self.rest_since_s = None;
        }
        let at_rest = rested_s >= REST_S && !is.armed;
        let Some(contact) = self.touchdown else {
            // Lit, never lifted, shut down and disarmed: nothing more will come.
            if at_rest && is.mission_s.is_some() {
                self.end(Outcome::Aborted);
            }
            return reached;
        };
        let down = if is.aborted { Outcome::Aborted } else { Outcome::Landed };
        if at_rest {
            self.end(down);
        }
        if time_s - contact.time_s >= AFTER_CONTACT_S && !self.rules.scheduled {
            self.end(if rested_s >= REST_S { down } else { Outcome::Timeout });
        }
        reached
    }
}
