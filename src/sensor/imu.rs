//! Inertial measurement unit: mean specific force and mean rate over each sample interval.
//!
//! The plant integrates both at the unit; a sample is the difference over the interval, as integrating
//! hardware delivers it, so an impact between two samples is not lost. Each axis then has a bias, its
//! walk, white noise and the range of the converter. Source of the error model: IEEE Std 952-1997,
//! annex C (rate noise density, bias, rate random walk).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::frame::Vec3;
use crate::input::Invalid;
use crate::noise::{self, ChannelError, Stream};
use crate::signal::ImuSample;
use crate::time::SimTime;

use super::Schedule;
use super::truth::History;

/// Inertial measurement unit: the `[sensors.imu]` table.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ImuParameters {
    /// Sample rate, a divisor of 1000 (Hz); one measurement per sample.
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// Where it sits, structural frame (m).
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub position_m: [f64; 3],
    /// From the end of the interval to delivery (s).
    #[schemars(range(min = 0.0, max = 0.5))]
    pub delay_s: f64,
    /// Specific force.
    pub accelerometer: AccelerometerParameters,
    /// Angular rate.
    pub gyroscope: GyroscopeParameters,
}

/// The `[sensors.imu.accelerometer]` table, the same for each axis.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AccelerometerParameters {
    /// White noise, one-sided; one sample has density times the root of half the rate.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub noise_density_m_s2_sqrt_hz: f64,
    /// Standard deviation of the bias, drawn once per run.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub bias_std_m_s2: f64,
    /// Growth of the bias.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub random_walk_m_s2_sqrt_s: f64,
    /// Readings are clamped to plus and minus this.
    #[schemars(range(min = 1.0, max = 10000.0))]
    pub range_m_s2: f64,
}

/// The `[sensors.imu.gyroscope]` table, the same for each axis.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GyroscopeParameters {
    /// White noise, one-sided; one sample has density times the root of half the rate.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub noise_density_rad_s_sqrt_hz: f64,
    /// Standard deviation of the bias, drawn once per run.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub bias_std_rad_s: f64,
    /// Growth of the bias.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub random_walk_rad_s_sqrt_s: f64,
    /// Readings are clamped to plus and minus this.
    #[schemars(range(min = 0.01, max = 1000.0))]
    pub range_rad_s: f64,
}

#[derive(Clone, Debug)]
pub(super) struct Imu {
    schedule: Schedule,
    delay: SimTime,
    temperature_k: f64,
    accelerometer: Triad,
    gyroscope: Triad,
}

impl Imu {
    pub(super) fn new(parameters: &ImuParameters, temperature_k: f64, seed: u64) -> Result<Self, Invalid> {
        let ImuParameters { rate_hz, delay_s, accelerometer: a, gyroscope: g, .. } = parameters;
        let error = |density, walk, bias_std, stream: &mut Stream| {
            [(); 3].map(|()| ChannelError::new(noise::sample_std(density, *rate_hz), walk, bias_std, stream))
        };
        let mut stream_a = noise::stream(seed, "imu.accelerometer");
        let mut stream_g = noise::stream(seed, "imu.gyroscope");
        Ok(Self {
            schedule: Schedule::new(*rate_hz)?,
            delay: SimTime::from_s(*delay_s),
            temperature_k,
            accelerometer: Triad {
                errors: error(
                    a.noise_density_m_s2_sqrt_hz,
                    a.random_walk_m_s2_sqrt_s,
                    a.bias_std_m_s2,
                    &mut stream_a,
                ),
                range: a.range_m_s2,
                stream: stream_a,
            },
            gyroscope: Triad {
                errors: error(
                    g.noise_density_rad_s_sqrt_hz,
                    g.random_walk_rad_s_sqrt_s,
                    g.bias_std_rad_s,
                    &mut stream_g,
                ),
                range: g.range_rad_s,
                stream: stream_g,
            },
        })
    }

    pub(super) fn sample(&mut self, history: &History, time: SimTime) -> Option<ImuSample> {
        let interval = self.schedule.due(time)?;
        // A delayed unit shows the first interval until it has seen a later one: nothing was
        // integrated before time 0, which is not the same as weightlessness.
        let end = time.since(self.delay).max(interval);
        let (from, to) = (history.at(end.since(interval)), history.at(end));
        let elapsed_s = interval.s();
        let mean = |from: Vec3, to: Vec3| (to - from) / elapsed_s;
        let specific_force = mean(from.specific_force_integral_body_m_s, to.specific_force_integral_body_m_s);
        let rate = mean(from.rate_integral_body_rad, to.rate_integral_body_rad);
        Some(ImuSample {
            specific_force_body_m_s2: self.accelerometer.sample(specific_force, elapsed_s),
            rate_body_rad_s: self.gyroscope.sample(rate, elapsed_s),
            interval_s: elapsed_s,
            temperature_k: self.temperature_k,
        })
    }
}

/// Three equal channels along the body axes.
#[derive(Clone, Debug)]
pub(super) struct Triad {
    pub(super) errors: [ChannelError; 3],
    /// Symmetric clamp.
    pub(super) range: f64,
    pub(super) stream: Stream,
}

impl Triad {
    /// One reading of `truth`, `elapsed_s` after the last.
    pub(super) fn sample(&mut self, truth: Vec3, elapsed_s: f64) -> Vec3 {
        let [x, y, z] = &mut self.errors;
        let error = Vec3::new(
            x.sample(elapsed_s, &mut self.stream),
            y.sample(elapsed_s, &mut self.stream),
            z.sample(elapsed_s, &mut self.stream),
        );
        (truth + error).map(|reading| reading.clamp(-self.range, self.range))
    }
}
