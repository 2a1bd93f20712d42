//! Barometer: static pressure at the sensor, plus the share of dynamic pressure that its port catches.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::environment::Environment;
use crate::environment::atmosphere::pressure_altitude_m;
use crate::frame::{Vec3, frd_from_structural};
use crate::input::Invalid;
use crate::noise::{self, ChannelError, Stream};
use crate::signal::BarometerSample;
use crate::time::SimTime;

use super::Schedule;
use super::truth::History;

/// Barometer: the `[sensors.barometer]` table.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BarometerParameters {
    /// Sample rate, a divisor of 1000 (Hz).
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// Where its port is, structural frame (m).
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub position_m: [f64; 3],
    /// From measurement to delivery (s).
    #[schemars(range(min = 0.0, max = 0.5))]
    pub delay_s: f64,
    /// White noise, one-sided; one sample has density times the root of half the rate.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub noise_density_pa_sqrt_hz: f64,
    /// Standard deviation of the bias, drawn once per run.
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub bias_std_pa: f64,
    /// Growth of the bias.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub random_walk_pa_sqrt_s: f64,
    /// Share of the dynamic pressure that is read as pressure; negative for a port in suction.
    #[schemars(range(min = -2.0, max = 2.0))]
    pub dynamic_pressure_coefficient: f64,
    /// Least and greatest reading; beyond it is clamped.
    #[schemars(inner(range(min = 0.0, max = 200000.0)))]
    pub range_pa: [f64; 2],
}

#[derive(Clone, Debug)]
pub(super) struct Barometer {
    schedule: Schedule,
    delay: SimTime,
    position_body_m: Vec3,
    dynamic_pressure_coefficient: f64,
    range_pa: [f64; 2],
    error: ChannelError,
    stream: Stream,
}

impl Barometer {
    pub(super) fn new(parameters: &BarometerParameters, seed: u64) -> Result<Self, Invalid> {
        let p = parameters;
        let mut stream = noise::stream(seed, "barometer");
        let white_std_pa = noise::sample_std(p.noise_density_pa_sqrt_hz, p.rate_hz);
        Ok(Self {
            schedule: Schedule::new(p.rate_hz)?,
            delay: SimTime::from_s(p.delay_s),
            position_body_m: frd_from_structural(p.position_m),
            dynamic_pressure_coefficient: p.dynamic_pressure_coefficient,
            range_pa: p.range_pa,
            error: ChannelError::new(white_std_pa, p.random_walk_pa_sqrt_s, p.bias_std_pa, &mut stream),
            stream,
        })
    }

    pub(super) fn sample(
        &mut self,
        history: &History,
        environment: &Environment,
        time: SimTime,
    ) -> Option<BarometerSample> {
        let elapsed = self.schedule.due(time)?;
        let truth = history.at(time.since(self.delay));
        let atmosphere = &environment.atmosphere;
        let height_m = -truth.point_ned_m(&self.position_body_m).z; // above the pad, the atmosphere's datum
        let airspeed2 = (truth.velocity_ned_m_s - truth.wind_ned_m_s).norm_squared(); // [m²/s²]
        let dynamic_pa = 0.5 * atmosphere.density_kg_m3 * airspeed2;
        let pressure_pa = (atmosphere.static_pressure_pa(height_m)
            + self.dynamic_pressure_coefficient * dynamic_pa
            + self.error.sample(elapsed.s(), &mut self.stream))
        .clamp(self.range_pa[0], self.range_pa[1]);
        Some(BarometerSample {
            pressure_pa,
            pressure_altitude_m: pressure_altitude_m(pressure_pa),
            temperature_k: atmosphere.temperature_k,
        })
    }
}
