//! History of the motion, for measurements that arrive late.
//!
//! A late measurement is compared with the state of the instant it was taken, to which all corrections made
//! since are added: each entry holds the sum of the corrections so far.

use super::state::NominalState;
use crate::frame::Vec3;
use crate::time::SimTime;
use nalgebra::UnitQuaternion;

/// Entries: half a second at 250 Hz.
const LENGTH: usize = 128;
/// Least time between two of them: a sample at 250 Hz, a little less for clocks that are not round.
const SPACING: SimTime = SimTime::from_us(3_900);

/// Motion of the inertial unit at one past instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct PastMotion {
    pub(super) time: SimTime,
    pub(super) position_ned_m: Vec3,
    pub(super) velocity_ned_m_s: Vec3,
    pub(super) q_ned_from_body: UnitQuaternion<f64>,
    pub(super) rate_body_rad_s: Vec3,
    /// Sums of all corrections up to this instant.
    position_corrections_m: Vec3,
    velocity_corrections_m_s: Vec3,
}

/// The last half second.
#[derive(Clone, Debug)]
pub(super) struct History {
    entries: [PastMotion; LENGTH],
    newest: usize,
    position_corrections_m: Vec3,
    velocity_corrections_m_s: Vec3,
}

impl History {
    /// At rest, up to time zero.
    pub(super) fn at_rest(state: &NominalState) -> Self {
        let past = PastMotion {
            time: SimTime::ZERO,
            position_ned_m: state.position_ned_m,
            velocity_ned_m_s: Vec3::zeros(),
            q_ned_from_body: state.q_ned_from_body,
            rate_body_rad_s: Vec3::zeros(),
            position_corrections_m: Vec3::zeros(),
            velocity_corrections_m_s: Vec3::zeros(),
        };
        Self {
            entries: [past; LENGTH],
            newest: 0,
            position_corrections_m: Vec3::zeros(),
            velocity_corrections_m_s: Vec3::zeros(),
        }
    }

    /// Adds the present motion.
    pub(super) fn push(&mut self, time: SimTime, state: &NominalState, rate_body_rad_s: Vec3) {
        // A faster unit does not shorten the history: the newest entry moves along until it is far enough
        // from the one before.
        let before = &self.entries[(self.newest + LENGTH - 1) % LENGTH];
        if self.entries[self.newest].time.since(before.time) >= SPACING {
            self.newest = (self.newest + 1) % LENGTH;
        }
        self.entries[self.newest] = PastMotion {
            time,
            position_ned_m: state.position_ned_m,
            velocity_ned_m_s: state.velocity_ned_m_s,
            q_ned_from_body: state.q_ned_from_body,
            rate_body_rad_s,
            position_corrections_m: self.position_corrections_m,
            velocity_corrections_m_s: self.velocity_corrections_m_s,
        };
    }

    /// Notes a correction of the present state.
    pub(super) fn correct(&mut self, position_m: Vec3, velocity_m_s: Vec3) {
        self.position_corrections_m += position_m;
        self.velocity_corrections_m_s += velocity_m_s;
    }

    /// Motion `delay_s` before `time`, with all corrections made since.
    pub(super) fn recall(&self, time: SimTime, delay_s: f64) -> PastMotion {
        let wanted = time.since(SimTime::from_s(delay_s));
        let mut later = self.newest;
        let mut earlier = self.newest;
        for back in 0..LENGTH {
            earlier = (self.newest + LENGTH - back) % LENGTH;
            if self.entries[earlier].time <= wanted || self.entries[earlier].time == SimTime::ZERO {
                break;
            }
            later = earlier;
        }
        let (a, b) = (&self.entries[earlier], &self.entries[later]);
        let corrected = |past: &PastMotion| {
            (
                past.position_ned_m + self.position_corrections_m - past.position_corrections_m,
                past.velocity_ned_m_s + self.velocity_corrections_m_s - past.velocity_corrections_m_s,
            )
        };
        let span_s = b.time.since(a.time).s();
        let u = if span_s > 0.0 && a.time <= wanted { wanted.since(a.time).s() / span_s } else { 1.0 };
        let u = u.clamp(0.0, 1.0);
        let ((pa, va), (pb, vb)) = (corrected(a), corrected(b));
        PastMotion {
            time: wanted,
            position_ned_m: pa + (pb - pa) * u,
            velocity_ned_m_s: va + (vb - va) * u,
            ..*b
        }
    }
}
