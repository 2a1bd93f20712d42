//! What the vehicle's instruments make of the truth: late, biased, noisy, limited in range and rate.
//!
//! [`SensorSuite::sample`] is called once after every plant step. Each sensor keeps its own integer
//! schedule; sample k is taken at k periods, the first at one period, never at 0. What a sensor
//! delivers waits until the next sample of the inertial unit, whose arrival makes a [`Measurement`].
//! Delays look back into a ring of past truths, linear between plant steps. Every sensor draws from
//! streams of its own name; the draws of one sample never depend on values.
//!
//! The parameter structs mirror the `[sensors.*]` tables of a vehicle file; positions (from the
//! gimbal pivot) and directions in them are in structural axes. Each sensor turns its own into body FRD when
//! it is built; the place of the inertial unit concerns the plant alone, which gives the motion there.

mod altimeter;
mod barometer;
mod gnss;
mod imu;
mod magnetometer;
mod tracking;
mod transducer;
mod truth;

pub use altimeter::AltimeterParameters;
pub use barometer::BarometerParameters;
pub use gnss::{GnssGrade, GnssParameters, ReceiverParameters};
pub use imu::{AccelerometerParameters, GyroscopeParameters, ImuParameters};
pub use magnetometer::MagnetometerParameters;
pub use tracking::TrackingParameters;
pub use transducer::{Tap, TransducerParameters};
pub use truth::Truth;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::environment::Environment;
use crate::input::Invalid;
use crate::signal::Measurement;
use crate::time::SimTime;

use altimeter::Altimeter;
use barometer::Barometer;
use gnss::Gnss;
use imu::Imu;
use magnetometer::Magnetometer;
use tracking::Tracking;
use transducer::Transducer;
use truth::History;

/// All instruments of a vehicle: the `[sensors]` table.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SensorParameters {
    /// Inertial measurement unit; its rate is the rate of measurements.
    pub imu: ImuParameters,
    /// Satellite navigation.
    pub gnss: GnssParameters,
    /// Static pressure.
    pub barometer: BarometerParameters,
    /// Magnetic field.
    pub magnetometer: MagnetometerParameters,
    /// Laser range to the ground.
    pub altimeter: AltimeterParameters,
    /// Pressures of the propulsion system, at most one for each place.
    #[serde(default)]
    pub pressure_transducer: Vec<TransducerParameters>,
    /// Pose from the test rig's own tracking; belongs to the rig rather than the vehicle.
    #[serde(default)]
    pub tracking: TrackingParameters,
}

impl SensorParameters {
    /// # Errors
    /// When a rate does not divide 1 kHz, a range is empty, a direction is no unit vector, or two
    /// transducers measure at the same place.
    pub fn validate(&self) -> Result<(), Invalid> {
        period("imu.rate_hz", self.imu.rate_hz)?;
        period("gnss.rate_hz", self.gnss.rate_hz)?;
        period("barometer.rate_hz", self.barometer.rate_hz)?;
        not_empty("barometer.range_pa", self.barometer.range_pa)?;
        period("magnetometer.rate_hz", self.magnetometer.rate_hz)?;
        period("altimeter.rate_hz", self.altimeter.rate_hz)?;
        not_empty("altimeter.range_m", self.altimeter.range_m)?;
        self.altimeter.validate()?;
        period("tracking.rate_hz", self.tracking.rate_hz)?;
        for (index, transducer) in self.pressure_transducer.iter().enumerate() {
            let key = |name: &str| format!("pressure_transducer.{index}.{name}");
            period(&key("rate_hz"), transducer.rate_hz)?;
            not_empty(&key("range_pa"), transducer.range_pa)?;
            if self.pressure_transducer[..index].iter().any(|earlier| earlier.name == transducer.name) {
                return Err(Invalid::new(key("name"), format!("{:?} is measured already", transducer.name)));
            }
        }
        Ok(())
    }
}

/// Sample period of a rate; only rates that divide 1 kHz have one.
fn period(key: &str, rate_hz: f64) -> Result<SimTime, Invalid> {
    let period_ms = 1e3 / rate_hz;
    if rate_hz > 0.0 && period_ms >= 1.0 && (period_ms - period_ms.round()).abs() < 1e-9 * period_ms {
        Ok(SimTime::from_us(1000 * period_ms.round() as u64))
    } else {
        Err(Invalid::new(key, format!("{rate_hz} does not divide 1000, the rate of the plant in Hz")))
    }
}

fn not_empty(key: &str, [least, greatest]: [f64; 2]) -> Result<(), Invalid> {
    if least < greatest {
        Ok(())
    } else {
        Err(Invalid::new(key, format!("the lower limit {least} is not below the upper limit {greatest}")))
    }
}

/// What a suite needs besides its parameters.
#[derive(Clone, Debug)]
pub struct SensorSetup<'a> {
    /// The world, for field, pressure, ground and coordinates.
    pub environment: &'a Environment,
    /// Seed of the run.
    pub seed: u64,
    /// Plant step, the interval between calls of [`SensorSuite::sample`].
    pub step: SimTime,
    /// State of the vehicle at time 0, and before: a delayed sensor sees this until it sees the flight.
    pub initial: &'a Truth,
    /// Delay of satellite navigation that replaces the vehicle file's, as a profile or scenario may ask (s).
    pub gnss_delay_s: Option<f64>,
}

/// The instruments with their schedules, biases and memories.
#[derive(Clone, Debug)]
pub struct SensorSuite {
    imu: Imu,
    gnss: Gnss,
    barometer: Barometer,
    magnetometer: Magnetometer,
    altimeter: Altimeter,
    transducers: Vec<Transducer>,
    tracking: Tracking,
    environment: Environment,
    history: History,
    /// Delivered, and waiting for the inertial unit.
    pending: Measurement,
}

impl SensorSuite {
    /// Draws the biases of this run.
    ///
    /// # Errors
    /// As [`SensorParameters::validate`].
    pub fn new(parameters: &SensorParameters, setup: &SensorSetup<'_>) -> Result<Self, Invalid> {
        parameters.validate()?;
        let SensorSetup { environment, seed, step, initial, .. } = *setup;
        let gnss = Gnss::new(&parameters.gnss, setup.gnss_delay_s, seed)?;
        let imu = Imu::new(&parameters.imu, environment.atmosphere.temperature_k, seed)?;
        let delays_s = [
            parameters.imu.delay_s + 1.0 / parameters.imu.rate_hz, // the start of the interval
            gnss.delay.s(),
            parameters.barometer.delay_s,
            parameters.magnetometer.delay_s,
            parameters.altimeter.delay_s,
            parameters.tracking.delay_s,
        ];
        let longest = SimTime::from_s(delays_s.into_iter().fold(0.0, f64::max));
        Ok(Self {
            imu,
            gnss,
            barometer: Barometer::new(&parameters.barometer, seed)?,
            magnetometer: Magnetometer::new(&parameters.magnetometer, seed)?,
            altimeter: Altimeter::new(&parameters.altimeter, seed)?,
            transducers: parameters
                .pressure_transducer
                .iter()
                .map(|transducer| Transducer::new(transducer, step, initial, seed))
                .collect::<Result<_, _>>()?,
            tracking: Tracking::new(&parameters.tracking, seed)?,
            environment: environment.clone(),
            history: History::new(initial, longest, step),
            pending: Measurement::default(),
        })
    }

    /// Takes in the truth after one plant step, at the end of that step, and returns a measurement if
    /// the inertial unit has a sample. Times increase from call to call; a call that does not is ignored.
    /// Does not allocate.
    pub fn sample(&mut self, truth: &Truth, time: SimTime) -> Option<Measurement> {
        if time <= self.history.newest() {
            return None;
        }
        self.history.push(time, truth);
        for transducer in &mut self.transducers {
            transducer.sample(truth, time, &mut self.pending.pressures);
        }

        let (history, environment, pending) = (&self.history, &self.environment, &mut self.pending);
        // A sensor without a new sample leaves the one that still waits.
        pending.gnss = self.gnss.sample(history, environment, time).or(pending.gnss);
        pending.barometer = self.barometer.sample(history, environment, time).or(pending.barometer);
        pending.magnetic_field_body_t =
            self.magnetometer.sample(history, environment, time).or(pending.magnetic_field_body_t);
        pending.altimeter = self.altimeter.sample(history, environment, time).or(pending.altimeter);
        pending.tracking = self.tracking.sample(history, time).or(pending.tracking);

        let imu = self.imu.sample(history, time)?;
        Some(Measurement { time, imu: Some(imu), ..core::mem::take(pending) })
    }
}

/// When a sensor samples: at whole periods, the first at one period.
#[derive(Clone, Copy, Debug)]
struct Schedule {
    period: SimTime,
    next: SimTime,
    last: SimTime,
}

impl Schedule {
    fn new(rate_hz: f64) -> Result<Self, Invalid> {
        let period = period("rate_hz", rate_hz)?;
        Ok(Self { period, next: period, last: SimTime::ZERO })
    }

    /// The time since the last sample if one is due, `None` otherwise. Where plant steps are longer than
    /// the period, one sample stands for all that were due.
    fn due(&mut self, time: SimTime) -> Option<SimTime> {
        if time < self.next {
            return None;
        }
        let periods = time.us() / self.period.us();
        self.next = SimTime::from_us((periods + 1) * self.period.us());
        let elapsed = time.since(self.last);
        self.last = time;
        Some(elapsed)
    }
}

#[cfg(test)]
mod tests;
