//! Navigation: error-state Kalman filter over inertial, satellite, pressure, magnetic and laser
//! measurements.
//!
//! The filter estimates the motion of the inertial unit itself, so that neither angular acceleration nor the
//! moving centre of mass enter the prediction; pivot and centre of mass follow by lever arm. Twenty error
//! states: position, velocity, attitude (a rotation about NED axes), gyroscope and accelerometer bias,
//! barometer offset, drift of the satellite position since the alignment, and the heading error of the
//! magnetometer. Measurements are scalars, gated at 5 σ. Each is compared with the state of the instant it
//! was taken (a history holds the last half second) and corrects the present state. While the vehicle
//! certainly stands on the ground, zero velocity and, on the pad, the known position are measurements too:
//! they fix the drift, and separate tilt from accelerometer bias as far as they can be separated.
//!
//! Equations: J. Solà, "Quaternion kinematics for the error-state Kalman filter", 2017, with the attitude
//! error on the world side. Flat, non-turning Earth: valid for flights of a minute within a kilometre.

mod parameters;
mod state;
mod status;

mod covariance;
mod history;

mod measurement;

#[cfg(test)]
mod tests;

use super::alignment::{Alignment, AlignmentResult};
use crate::environment::geodesy::Datum;
use crate::frame::Vec3;
use crate::signal::{AltimeterSample, BarometerSample, GnssFix, Measurement};
use crate::time::SimTime;
use history::History;
pub use measurement::Source;
use measurement::{Scalar, expected_range_m};
use nalgebra::{SMatrix, UnitQuaternion};
pub use parameters::{
    AccelerometerNoise, AltimeterNoise, BarometerNoise, GnssParameters, GyroscopeNoise, HorizontalVertical,
    MagnetometerNoise, NavigationParameters,
};
use state::{Covariance, ErrorVector, NominalState, POSITION, STATES, VELOCITY, block};
pub use status::{AidingStatus, InnovationTally, NavigationHealth, SensorBiases};

/// Whether the vehicle is known to stand on the ground.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundState {
    /// At rest on the pad, where it was aligned.
    OnPad,
    /// At rest somewhere on the ground.
    Landed,
    /// In flight, or not known to be at rest.
    Unknown,
}

/// Position and velocity of one point of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointMotion {
    /// Position (m).
    pub position_ned_m: Vec3,
    /// Velocity (m/s).
    pub velocity_ned_m_s: Vec3,
}

/// The filter.
#[derive(Clone, Debug)]
pub struct Navigation {
    parameters: NavigationParameters,
    alignment: Alignment,
    aligned: bool,
    state: NominalState,
    covariance: Covariance,
    history: History,
    rate_body_rad_s: Vec3,
    specific_force_body_m_s2: Vec3,
    time: Option<SimTime>,
    datum: Option<Datum>,
    altimeter_offset_m: f64,
    aiding: AidingStatus,
    /// Fixes refused since the last one that was accepted, or since the covariance was inflated.
    gnss_contradictions: u32,
    altimeter_refused: u32,
    /// Inertial samples at rest.
    samples_at_rest: u32,
    health: NavigationHealth,
    tallies: [InnovationTally; Source::COUNT],
}

/// Inertial samples at rest from one zero-velocity update to the next: 25 a second are plenty.
const ZERO_VELOCITY_INTERVAL: u32 = 10;
/// Fixes refused in succession that show that the filter is wrong: two seconds.
const GNSS_CONTRADICTIONS_MAX: u32 = 20;
/// Ranges refused in succession that show that the filter is wrong: a second.
const ALTIMETER_REFUSED_MAX: u32 = 50;

impl Navigation {
    /// Before alignment: upright at the rest position.
    pub fn new(parameters: NavigationParameters) -> Self {
        let state = NominalState::at_rest(parameters.rest_ned_m + parameters.imu_body_m);
        Self {
            alignment: Alignment::default(),
            aligned: false,
            state,
            covariance: covariance::initial(&parameters, state.q_ned_from_body, 1.0),
            history: History::at_rest(&state),
            rate_body_rad_s: Vec3::zeros(),
            specific_force_body_m_s2: Vec3::zeros(),
            time: None,
            datum: None,
            altimeter_offset_m: 0.0,
            aiding: AidingStatus::default(),
            gnss_contradictions: 0,
            altimeter_refused: 0,
            samples_at_rest: 0,
            health: NavigationHealth::default(),
            tallies: [InnovationTally::default(); Source::COUNT],
            parameters,
        }
    }

    /// The alignment is complete: attitude, biases and the local origin are known.
    pub const fn is_aligned(&self) -> bool {
        self.aligned
    }

    /// Averages at rest until `duration_s` is reached and satellite navigation has answered; then the
    /// filter starts. With `duration_s` zero it starts from the averages so far.
    pub fn align(&mut self, m: &Measurement, duration_s: f64) {
        self.alignment.add(m, self.parameters.gravity_m_s2);
        self.time = Some(m.time);
        if let Some(imu) = &m.imu {
            self.rate_body_rad_s = imu.rate_body_rad_s;
            self.specific_force_body_m_s2 = imu.specific_force_body_m_s2;
        }
        if self.alignment.duration_s < duration_s {
            return;
        }
        if let Some(result) = self.alignment.result()
            && result.fixes >= 3.0
        {
            self.start(&result);
        }
    }

    fn start(&mut self, a: &AlignmentResult) {
        let p = &self.parameters;
        let q = attitude_at_rest(a, p);
        // Along gravity the accelerometer's error is its bias; across it, tilt and bias look the same.
        let up = a.specific_force_body_m_s2.normalize();
        let position_ned_m = p.rest_ned_m + q * p.imu_body_m;
        self.state = NominalState {
            q_ned_from_body: q,
            gyro_bias_rad_s: a.rate_body_rad_s,
            accel_bias_m_s2: up * (a.specific_force_body_m_s2.norm() - p.gravity_m_s2),
            baro_offset_m: a.pressure_altitude_m.map_or(0.0, |h| h + position_ned_m.z),
            ..NominalState::at_rest(position_ned_m)
        };
        if let Some(range) = a.range_m {
            let expected = expected_range_m(p, position_ned_m, &q);
            // More than a decimetre is not the sensor's offset but a pad that is not where it should be.
            self.altimeter_offset_m = (range - expected).clamp(-0.1, 0.1);
        }
        if let Some(fix) = a.fix {
            // The origin for which the mean fix is the position of the antenna.
            let antenna = p.rest_ned_m + q * p.gnss.antenna_body_m;
            let origin = Datum::new(fix.latitude_rad, fix.longitude_rad, fix.altitude_m).geodetic(&-antenna);
            self.datum = Some(Datum::new(origin.latitude_rad, origin.longitude_rad, origin.altitude_m));
        }
        self.covariance = covariance::initial(p, q, a.fixes.max(1.0));
        self.aligned = true;
    }

    /// One measurement: prediction with the inertial sample, then updates with whatever else came.
    pub fn step(&mut self, m: &Measurement, ground: GroundState) {
        let before = self.state;
        if let Some(imu) = &m.imu {
            let gap_s = self.time.map_or(imu.interval_s, |t| m.time.since(t).s());
            // A sample after a lost one covers the gap too; a clock that stands still does not stop the
            // filter.
            let dt_s = if gap_s > 0.5 * imu.interval_s { gap_s } else { imu.interval_s }.clamp(0.0, 0.1);
            let f = imu.specific_force_body_m_s2;
            let w = imu.rate_body_rad_s;
            if f.iter().chain(w.iter()).all(|x| x.is_finite()) {
                self.predict(f - self.state.accel_bias_m_s2, w - self.state.gyro_bias_rad_s, dt_s);
            } else {
                self.health.rejected += 1;
                self.predict(self.specific_force_body_m_s2, self.rate_body_rad_s, dt_s);
            }
            self.aiding.gnss_silence_s += dt_s;
            self.aiding.altimeter_silence_s += dt_s;
            self.time = Some(m.time);
            self.history.push(m.time, &self.state, self.rate_body_rad_s);
            self.zero_velocity_update(ground);
        }
        if let Some(fix) = &m.gnss {
            self.gnss_update(fix, m.time);
        }
        if let Some(sample) = &m.barometer {
            self.fuse_all(&[self.barometer_scalar(sample, m.time)]);
        }
        if let Some(field) = &m.magnetic_field_body_t {
            self.magnetometer_update(field);
        }
        if let Some(sample) = &m.altimeter {
            self.altimeter_update(sample, m.time);
        }
        self.restore_if_not_finite(&before);
    }

    fn predict(&mut self, f: Vec3, w: Vec3, dt_s: f64) {
        let p = &self.parameters;
        let n = &mut self.state;
        // The sample is a mean over the interval: it acts at the attitude of its middle.
        let q_middle = n.q_ned_from_body * UnitQuaternion::from_scaled_axis(w * (0.5 * dt_s));
        let f_ned = q_middle * f;
        let change = (f_ned + Vec3::new(0.0, 0.0, p.gravity_m_s2)) * dt_s;
        n.position_ned_m += (n.velocity_ned_m_s + change * 0.5) * dt_s;
        n.velocity_ned_m_s += change;
        n.q_ned_from_body = q_middle * UnitQuaternion::from_scaled_axis(w * (0.5 * dt_s));
        n.q_ned_from_body.renormalize();
        self.specific_force_body_m_s2 = f;
        self.rate_body_rad_s = w;
        covariance::predict(&mut self.covariance, p, q_middle.to_rotation_matrix().matrix(), f_ned, dt_s);
    }

    fn zero_velocity_update(&mut self, ground: GroundState) {
        if ground == GroundState::Unknown {
            self.samples_at_rest = 0;
            return;
        }
        self.samples_at_rest = self.samples_at_rest.wrapping_add(1);
        if !self.samples_at_rest.is_multiple_of(ZERO_VELOCITY_INTERVAL) {
            return;
        }
        self.fuse_all(&measurement::zero_velocity(&self.state));
        if ground == GroundState::OnPad {
            self.fuse_all(&measurement::pad_position(&self.parameters, &self.state));
        }
    }

    fn gnss_update(&mut self, fix: &GnssFix, time: SimTime) {
        if fix.fix_type < 3 {
            return;
        }
        let Some(scalars) = self.gnss_scalars(fix, time) else { return };
        if self.fuse_all(&scalars) {
            self.aiding.gnss_refused = 0;
            self.aiding.gnss_silence_s = 0.0;
            self.gnss_contradictions = 0;
            return;
        }
        self.aiding.gnss_refused = self.aiding.gnss_refused.saturating_add(1);
        self.gnss_contradictions += 1;
        if self.gnss_contradictions >= GNSS_CONTRADICTIONS_MAX {
            self.inflate_covariance();
        }
    }

    fn magnetometer_update(&mut self, field_body_t: &Vec3) {
        if let Some(scalar) = measurement::magnetometer(&self.parameters, &self.state, field_body_t) {
            self.fuse_all(&[scalar]);
        }
    }

    fn altimeter_update(&mut self, sample: &AltimeterSample, time: SimTime) {
        let Some(scalar) = self.altimeter_scalar(sample, time) else { return };
        if self.fuse_all(&[scalar]) {
            self.altimeter_refused = 0;
            self.aiding.altimeter_silence_s = 0.0;
        } else {
            self.altimeter_refused += 1;
            if self.altimeter_refused >= ALTIMETER_REFUSED_MAX {
                self.altimeter_refused = 0;
                self.covariance[(POSITION + 2, POSITION + 2)] += 4.0;
            }
        }
    }

    /// `None` without a local origin.
    fn gnss_scalars(&self, fix: &GnssFix, time: SimTime) -> Option<[Scalar; 6]> {
        let datum = self.datum.as_ref()?;
        let past = self.history.recall(time, self.parameters.gnss.delay_s);
        let force = self.specific_force_body_m_s2;
        Some(measurement::gnss(&self.parameters, &self.state, &past, force, datum, fix))
    }

    fn barometer_scalar(&self, sample: &BarometerSample, time: SimTime) -> Scalar {
        let past = self.history.recall(time, self.parameters.barometer_delay_s);
        measurement::barometer(&self.parameters, &self.state, &past, sample)
    }

    fn altimeter_scalar(&self, sample: &AltimeterSample, time: SimTime) -> Option<Scalar> {
        let past = self.history.recall(time, self.parameters.altimeter_delay_s);
        measurement::altimeter(&self.parameters, &past, self.altimeter_offset_m, sample)
    }

    /// Fuses the scalars of one measurement, each less what those before it have already explained; returns
    /// whether all were accepted.
    fn fuse_all(&mut self, scalars: &[Scalar]) -> bool {
        let mut explained = ErrorVector::zeros();
        let mut all = true;
        for scalar in scalars {
            let innovation = scalar.innovation - scalar.sensitivity.dot(&explained);
            match self.fuse(&Scalar { innovation, ..*scalar }) {
                Some(correction) => explained += correction,
                None => all = false,
            }
        }
        all
    }

    /// Fuses one scalar; returns the correction, `None` if the gate refused it.
    fn fuse(&mut self, scalar: &Scalar) -> Option<ErrorVector> {
        let Scalar { source, sensitivity, innovation, variance, gate } = scalar;
        let ph = self.covariance * sensitivity;
        let s = sensitivity.dot(&ph) + variance;
        let square = innovation * innovation / s;
        let sound = innovation.is_finite() && s.is_finite() && s > 0.0;
        let tally = &mut self.tallies[*source as usize];
        tally.count += 1;
        tally.normalised_squares += if sound { square.min(gate * gate) } else { gate * gate };
        if !sound || square > gate * gate {
            self.health.rejected += 1;
            return None;
        }
        let gain = ph / s;
        // The optimal gain makes K s Kᵀ the whole decrease; one half is computed, so that symmetry is exact.
        for j in 0..STATES {
            for i in j..STATES {
                let value = self.covariance[(i, j)] - gain[i] * ph[j];
                self.covariance[(i, j)] = value;
                self.covariance[(j, i)] = value;
            }
        }
        for i in 0..STATES {
            // A variance cannot fall below what round-off of the largest leaves of it.
            if self.covariance[(i, i)] < 1e-14 {
                self.covariance[(i, i)] = 1e-14;
            }
        }
        let correction = gain * *innovation;
        self.state.add(&correction);
        self.history.correct(block(&correction, POSITION), block(&correction, VELOCITY));
        Some(correction)
    }

    /// Makes position and velocity uncertain again, so that the next fixes are accepted.
    fn inflate_covariance(&mut self) {
        for i in 0..3 {
            self.covariance[(POSITION + i, POSITION + i)] += 4.0;
            self.covariance[(VELOCITY + i, VELOCITY + i)] += 0.25;
        }
        self.gnss_contradictions = 0;
        self.health.resets += 1;
    }

    /// Restores the state before the step, with a new covariance, if a number is no longer finite.
    fn restore_if_not_finite(&mut self, before: &NominalState) {
        let sound = self.state.is_finite()
            && (0..STATES).all(|i| self.covariance[(i, i)].is_finite() && self.covariance[(i, i)] >= 0.0);
        if !sound {
            self.state = *before;
            self.covariance = covariance::initial(&self.parameters, before.q_ned_from_body, 1.0);
            self.inflate_covariance();
        }
    }

    /// Attitude.
    pub const fn q_ned_from_body(&self) -> UnitQuaternion<f64> {
        self.state.q_ned_from_body
    }

    /// Body rate, bias removed (rad/s).
    pub const fn rate_body_rad_s(&self) -> Vec3 {
        self.rate_body_rad_s
    }

    /// Specific force at the inertial unit, bias removed (m/s²).
    pub const fn specific_force_body_m_s2(&self) -> Vec3 {
        self.specific_force_body_m_s2
    }

    /// Biases of the sensors.
    pub const fn biases(&self) -> SensorBiases {
        SensorBiases {
            gyro_rad_s: self.state.gyro_bias_rad_s,
            accel_m_s2: self.state.accel_bias_m_s2,
            baro_m: self.state.baro_offset_m,
        }
    }

    /// Motion of the pivot.
    pub fn pivot(&self) -> PointMotion {
        self.point(Vec3::zeros())
    }

    /// Motion of the point `body_m` of the vehicle (FRD from the pivot).
    pub fn point(&self, body_m: Vec3) -> PointMotion {
        let lever = body_m - self.parameters.imu_body_m;
        let n = &self.state;
        PointMotion {
            position_ned_m: n.position_ned_m + n.q_ned_from_body * lever,
            velocity_ned_m_s: n.velocity_ned_m_s + n.q_ned_from_body * self.rate_body_rad_s.cross(&lever),
        }
    }

    /// Standard deviation of position, NED axes (m).
    pub fn position_std_m(&self) -> Vec3 {
        Vec3::from_fn(|i, _| self.covariance[(POSITION + i, POSITION + i)].max(0.0).sqrt())
    }

    /// Covariance of position, velocity and attitude, for consistency tests.
    pub fn motion_covariance(&self) -> SMatrix<f64, 9, 9> {
        self.covariance.fixed_view::<9, 9>(0, 0).into_owned()
    }

    /// How recently satellite navigation and the altimeter have aided the filter.
    pub(crate) const fn aiding(&self) -> AidingStatus {
        self.aiding
    }

    /// Innovations of a source relative to their expected variance.
    pub const fn tally(&self, source: Source) -> InnovationTally {
        self.tallies[source as usize]
    }

    /// Counters.
    pub const fn health(&self) -> NavigationHealth {
        self.health
    }
}

/// Level from the accelerometer, heading from the magnetometer where the field is known.
fn attitude_at_rest(a: &AlignmentResult, p: &NavigationParameters) -> UnitQuaternion<f64> {
    let down = -a.specific_force_body_m_s2;
    let level = UnitQuaternion::rotation_between(&down, &Vec3::z()).unwrap_or(UnitQuaternion::identity());
    // Heading of body x after levelling, then corrected by the magnetometer.
    let forward = level * Vec3::x();
    let own = libm::atan2(forward.y, forward.x);
    let heading = match (a.field_body_t, p.magnetic_field_ned_t) {
        (Some(field), Some(reference)) => {
            let m = level * field;
            own + libm::atan2(reference.y, reference.x) - libm::atan2(m.y, m.x)
        }
        _ => p.rest_heading_rad,
    };
    UnitQuaternion::from_axis_angle(&Vec3::z_axis(), heading - own) * level
}
