//! Tracking by the test rig (cameras or ultra-wide band): the pose from outside, late and noisy.

use nalgebra::UnitQuaternion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::input::Invalid;
use crate::noise::{self, Stream};
use crate::signal::TrackingSample;
use crate::time::SimTime;

use super::Schedule;
use super::truth::History;

/// The rig's tracking: the `[sensors.tracking]` table, each key of which may be absent. The defaults are
/// those of an optical system over a test stand.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrackingParameters {
    /// Sample rate, a divisor of 1000 (Hz).
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// From measurement to delivery (s).
    #[schemars(range(min = 0.0, max = 0.5))]
    pub delay_s: f64,
    /// White noise of position, each axis.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub position_noise_std_m: f64,
    /// White noise of velocity, each axis.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub velocity_noise_std_m_s: f64,
    /// White noise of attitude, about each body axis.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub attitude_noise_std_rad: f64,
    /// White noise of body rate, each axis.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub rate_noise_std_rad_s: f64,
}

impl Default for TrackingParameters {
    fn default() -> Self {
        Self {
            rate_hz: 50.0,
            delay_s: 0.02,
            position_noise_std_m: 0.005,
            velocity_noise_std_m_s: 0.02,
            attitude_noise_std_rad: 0.003,
            rate_noise_std_rad_s: 0.01,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Tracking {
    schedule: Schedule,
    delay: SimTime,
    parameters: TrackingParameters,
    stream: Stream,
}

impl Tracking {
    pub(super) fn new(parameters: &TrackingParameters, seed: u64) -> Result<Self, Invalid> {
        Ok(Self {
            schedule: Schedule::new(parameters.rate_hz)?,
            delay: SimTime::from_s(parameters.delay_s),
            parameters: parameters.clone(),
            stream: noise::stream(seed, "tracking"),
        })
    }

    pub(super) fn sample(&mut self, history: &History, time: SimTime) -> Option<TrackingSample> {
        self.schedule.due(time)?;
        let truth = history.at(time.since(self.delay));
        let p = &self.parameters;
        let position_ned_m = truth.position_ned_m + self.stream.normal3() * p.position_noise_std_m;
        let velocity_ned_m_s = truth.velocity_ned_m_s + self.stream.normal3() * p.velocity_noise_std_m_s;
        let tilt = UnitQuaternion::from_scaled_axis(self.stream.normal3() * p.attitude_noise_std_rad);
        let q = truth.q_ned_from_body * tilt;
        Some(TrackingSample {
            position_ned_m,
            velocity_ned_m_s,
            q_ned_from_body: [q.w, q.i, q.j, q.k],
            rate_body_rad_s: truth.rate_body_rad_s + self.stream.normal3() * p.rate_noise_std_rad_s,
        })
    }
}
