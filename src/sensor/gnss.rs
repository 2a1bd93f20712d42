//! Satellite navigation: position and velocity of the antenna, late by the receiver's delay.
//!
//! A fix delivered at t describes t minus the delay. Position has a slowly wandering part (ephemeris,
//! ionosphere, multipath), a first-order Gauss-Markov process, and a white part; velocity has white noise.
//! Which of the two receivers is fitted, plain or RTK, is a choice of the vehicle or the scenario; the
//! same streams drive both.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::environment::Environment;
use crate::frame::{Vec3, frd_from_structural};
use crate::input::Invalid;
use crate::noise::{self, GaussMarkov, Stream};
use crate::signal::GnssFix;
use crate::time::SimTime;

use super::Schedule;
use super::truth::History;

/// Satellite navigation: the `[sensors.gnss]` table.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GnssParameters {
    /// Which receiver is fitted.
    pub grade: GnssGrade,
    /// Rate of fixes, a divisor of 1000 (Hz).
    #[schemars(range(min = 1.0, max = 100.0))]
    pub rate_hz: f64,
    /// Phase centre of the antenna, structural frame (m).
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub antenna_position_m: [f64; 3],
    /// Satellites in use, as reported.
    #[schemars(range(min = 0, max = 100))]
    pub satellites: u8,
    /// Receiver without corrections.
    pub plain: ReceiverParameters,
    /// Receiver with corrections from a base station.
    pub rtk: ReceiverParameters,
}

/// Kind of receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GnssGrade {
    /// Metre class.
    Plain,
    /// Centimetre class.
    Rtk,
}

/// One receiver: the tables `[sensors.gnss.plain]` and `[sensors.gnss.rtk]`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReceiverParameters {
    /// From measurement to delivery (s).
    #[schemars(range(min = 0.0, max = 2.0))]
    pub delay_s: f64,
    /// White noise of position, north and east each.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub horizontal_noise_std_m: f64,
    /// White noise of height.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub vertical_noise_std_m: f64,
    /// Standard deviation of the wandering part, north and east each.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub horizontal_drift_std_m: f64,
    /// Standard deviation of the wandering part of height.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub vertical_drift_std_m: f64,
    /// Time in which the wandering part forgets.
    #[schemars(range(min = 0.1, max = 100000.0))]
    pub drift_time_constant_s: f64,
    /// White noise of velocity, north and east each.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub horizontal_velocity_noise_std_m_s: f64,
    /// White noise of vertical velocity.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub vertical_velocity_noise_std_m_s: f64,
    /// Horizontal accuracy that the receiver claims.
    #[schemars(range(min = 0.0, max = 600.0))]
    pub reported_horizontal_accuracy_m: f64,
    /// Vertical accuracy that the receiver claims.
    #[schemars(range(min = 0.0, max = 600.0))]
    pub reported_vertical_accuracy_m: f64,
    /// Kind of fix it claims: 3 three-dimensional, 6 RTK fixed.
    #[schemars(range(min = 0, max = 8))]
    pub fix_type: u8,
}

impl GnssParameters {
    /// The receiver of the chosen grade.
    pub fn receiver(&self) -> &ReceiverParameters {
        match self.grade {
            GnssGrade::Plain => &self.plain,
            GnssGrade::Rtk => &self.rtk,
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Gnss {
    schedule: Schedule,
    pub(super) delay: SimTime,
    antenna_body_m: Vec3,
    satellites: u8,
    receiver: ReceiverParameters,
    drift_ned_m: [GaussMarkov; 3],
    drift_stream: Stream,
    position_stream: Stream,
    velocity_stream: Stream,
}

impl Gnss {
    pub(super) fn new(
        parameters: &GnssParameters,
        delay_override_s: Option<f64>,
        seed: u64,
    ) -> Result<Self, Invalid> {
        let receiver = parameters.receiver().clone();
        let mut drift_stream = noise::stream(seed, "gnss.drift");
        let r = &receiver;
        let drift_ned_m = [r.horizontal_drift_std_m, r.horizontal_drift_std_m, r.vertical_drift_std_m]
            .map(|std_m| GaussMarkov::new(std_m, r.drift_time_constant_s, &mut drift_stream));
        Ok(Self {
            schedule: Schedule::new(parameters.rate_hz)?,
            delay: SimTime::from_s(delay_override_s.unwrap_or(r.delay_s)),
            antenna_body_m: frd_from_structural(parameters.antenna_position_m),
            satellites: parameters.satellites,
            receiver,
            drift_ned_m,
            drift_stream,
            position_stream: noise::stream(seed, "gnss.position"),
            velocity_stream: noise::stream(seed, "gnss.velocity"),
        })
    }

    pub(super) fn sample(
        &mut self,
        history: &History,
        environment: &Environment,
        time: SimTime,
    ) -> Option<GnssFix> {
        let elapsed_s = self.schedule.due(time)?.s();
        let truth = history.at(time.since(self.delay));
        let r = &self.receiver;

        let [north, east, down] = &mut self.drift_ned_m;
        let drift_m = Vec3::new(
            north.sample(elapsed_s, &mut self.drift_stream),
            east.sample(elapsed_s, &mut self.drift_stream),
            down.sample(elapsed_s, &mut self.drift_stream),
        );
        let (h, v) = (r.horizontal_noise_std_m, r.vertical_noise_std_m);
        let white_m = self.position_stream.normal3().component_mul(&Vec3::new(h, h, v));
        let position_ned_m = truth.point_ned_m(&self.antenna_body_m) + drift_m + white_m;
        let place = environment.datum.geodetic(&position_ned_m);

        let (h, v) = (r.horizontal_velocity_noise_std_m_s, r.vertical_velocity_noise_std_m_s);
        let white_m_s = self.velocity_stream.normal3().component_mul(&Vec3::new(h, h, v));
        Some(GnssFix {
            latitude_rad: place.latitude_rad,
            longitude_rad: place.longitude_rad,
            altitude_m: place.altitude_m,
            velocity_ned_m_s: truth.point_velocity_ned_m_s(&self.antenna_body_m) + white_m_s,
            horizontal_accuracy_m: r.reported_horizontal_accuracy_m,
            vertical_accuracy_m: r.reported_vertical_accuracy_m,
            fix_type: r.fix_type,
            satellites: self.satellites,
        })
    }
}
