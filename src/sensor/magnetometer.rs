//! Magnetometer: the field of the site in body axes, with bias (hard iron), its walk and white noise.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::environment::Environment;
use crate::frame::Vec3;
use crate::input::Invalid;
use crate::noise::{self, ChannelError};
use crate::time::SimTime;

use super::Schedule;
use super::imu::Triad;
use super::truth::History;

/// Magnetometer: the `[sensors.magnetometer]` table, the same for each axis.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MagnetometerParameters {
    /// Sample rate, a divisor of 1000 (Hz).
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// Where it sits, structural frame (m); the field is uniform, so this is for the record.
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub position_m: [f64; 3],
    /// From measurement to delivery (s).
    #[schemars(range(min = 0.0, max = 0.5))]
    pub delay_s: f64,
    /// White noise, one-sided; one sample has density times the root of half the rate.
    #[schemars(range(min = 0.0, max = 1e-3))]
    pub noise_density_t_sqrt_hz: f64,
    /// Standard deviation of the bias of each axis, drawn once per run: hard iron left by calibration.
    #[schemars(range(min = 0.0, max = 1e-3))]
    pub bias_std_t: f64,
    /// Growth of the bias.
    #[schemars(range(min = 0.0, max = 1e-3))]
    pub random_walk_t_sqrt_s: f64,
    /// Readings are clamped to plus and minus this.
    #[schemars(range(min = 1e-5, max = 1.0))]
    pub range_t: f64,
}

#[derive(Clone, Debug)]
pub(super) struct Magnetometer {
    schedule: Schedule,
    delay: SimTime,
    triad: Triad,
}

impl Magnetometer {
    pub(super) fn new(parameters: &MagnetometerParameters, seed: u64) -> Result<Self, Invalid> {
        let p = parameters;
        let mut stream = noise::stream(seed, "magnetometer");
        let white_std_t = noise::sample_std(p.noise_density_t_sqrt_hz, p.rate_hz);
        let errors = [(); 3]
            .map(|()| ChannelError::new(white_std_t, p.random_walk_t_sqrt_s, p.bias_std_t, &mut stream));
        Ok(Self {
            schedule: Schedule::new(p.rate_hz)?,
            delay: SimTime::from_s(p.delay_s),
            triad: Triad { errors, range: p.range_t, stream },
        })
    }

    pub(super) fn sample(
        &mut self,
        history: &History,
        environment: &Environment,
        time: SimTime,
    ) -> Option<Vec3> {
        let elapsed = self.schedule.due(time)?;
        let truth = history.at(time.since(self.delay));
        let field_body_t = truth.q_ned_from_body.inverse_transform_vector(&environment.magnetic_field_ned_t);
        Some(self.triad.sample(field_body_t, elapsed.s()))
    }
}
