//! Laser altimeter: distance to the ground along its beam.
//!
//! Over flat ground that is the height of the sensor over the cosine of the beam's tilt. There is no
//! reading outside the range or tilted beyond the angle at which too little light comes back.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::environment::Environment;
use crate::frame::{Vec3, frd_from_structural};
use crate::input::Invalid;
use crate::noise::{self, Stream};
use crate::signal::AltimeterSample;
use crate::time::SimTime;

use super::Schedule;
use super::truth::History;

/// Laser altimeter: the `[sensors.altimeter]` table.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AltimeterParameters {
    /// Sample rate, a divisor of 1000 (Hz).
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// Where it sits, structural frame (m).
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub position_m: [f64; 3],
    /// Direction of the beam, a unit vector in the structural frame.
    #[schemars(inner(range(min = -1.0, max = 1.0)))]
    pub direction: [f64; 3],
    /// From measurement to delivery (s).
    #[schemars(range(min = 0.0, max = 0.5))]
    pub delay_s: f64,
    /// White noise of one sample.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub noise_std_m: f64,
    /// White noise of one sample as a share of the range, added in quadrature.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub noise_fraction: f64,
    /// Standard deviation of the bias, drawn once per run.
    #[schemars(range(min = 0.0, max = 10.0))]
    pub bias_std_m: f64,
    /// Least and greatest distance that it reads.
    #[schemars(inner(range(min = 0.0, max = 10000.0)))]
    pub range_m: [f64; 2],
    /// Greatest angle of the beam from the vertical with a reading (rad).
    #[schemars(range(min = 0.0, max = 1.5))]
    pub maximum_tilt_rad: f64,
}

impl AltimeterParameters {
    pub(super) fn validate(&self) -> Result<(), Invalid> {
        let length = Vec3::from(self.direction).norm();
        if (length - 1.0).abs() < 1e-3 {
            Ok(())
        } else {
            Err(Invalid::new("altimeter.direction", format!("has length {length}, not 1")))
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Altimeter {
    schedule: Schedule,
    delay: SimTime,
    position_body_m: Vec3,
    direction_body: Vec3,
    noise_std_m: f64,
    noise_fraction: f64,
    range_m: [f64; 2],
    least_cos_tilt: f64,
    bias_m: f64,
    stream: Stream,
}

impl Altimeter {
    pub(super) fn new(parameters: &AltimeterParameters, seed: u64) -> Result<Self, Invalid> {
        let p = parameters;
        let mut stream = noise::stream(seed, "altimeter");
        Ok(Self {
            schedule: Schedule::new(p.rate_hz)?,
            delay: SimTime::from_s(p.delay_s),
            position_body_m: frd_from_structural(p.position_m),
            direction_body: frd_from_structural(p.direction).normalize(),
            noise_std_m: p.noise_std_m,
            noise_fraction: p.noise_fraction,
            range_m: p.range_m,
            least_cos_tilt: libm::cos(p.maximum_tilt_rad),
            bias_m: p.bias_std_m * stream.normal(),
            stream,
        })
    }

    pub(super) fn sample(
        &mut self,
        history: &History,
        environment: &Environment,
        time: SimTime,
    ) -> Option<AltimeterSample> {
        self.schedule.due(time)?;
        let deviate = self.stream.normal(); // drawn whether or not there is a reading
        let truth = history.at(time.since(self.delay));
        let direction_ned = truth.q_ned_from_body * self.direction_body;
        let position_ned_m = truth.point_ned_m(&self.position_body_m);
        let [minimum_m, maximum_m] = self.range_m;
        let reading_m = environment
            .terrain
            .slant_range_m(&position_ned_m, &direction_ned)
            .filter(|_| direction_ned.z >= self.least_cos_tilt)
            .map(|true_m| true_m + self.bias_m + deviate * self.noise_m(true_m))
            .filter(|reading_m| (minimum_m..=maximum_m).contains(reading_m));
        Some(AltimeterSample { range_m: reading_m, minimum_m, maximum_m })
    }

    /// Standard deviation of the white noise at a distance (m).
    fn noise_m(&self, range_m: f64) -> f64 {
        let proportional_m = self.noise_fraction * range_m;
        (self.noise_std_m * self.noise_std_m + proportional_m * proportional_m).sqrt()
    }
}
