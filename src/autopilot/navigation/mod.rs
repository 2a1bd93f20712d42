//! Navigation: error-state Kalman filter over inertial, satellite, pressure, magnetic and laser
//! measurements.
//!
//! The point navigated is the inertial unit itself, so that neither angular acceleration nor the moving
//! centre of mass enter the prediction; pivot and centre of mass follow by lever arm. Twenty error states:
//! position, velocity, attitude (turned in NED axes), gyroscope and accelerometer bias, barometer offset,
//! drift of the satellite position since the alignment, and the heading error of the magnetometer.
//! Each measurement is a scalar, gated at 5 σ, compared with the state of the instant it was taken (a
//! history holds the last half second) and applied to the present. While the vehicle certainly stands,
//! "here, and not moving" is a measurement too: it fixes the drift, and tells tilt from accelerometer
//! bias as far as that can be told.
//!
//! Equations: J. Solà, "Quaternion kinematics for the error-state Kalman filter", 2017, with the attitude
//! error on the world side. Flat, non-turning Earth: valid for flights of a minute within a kilometre.

mod update;

#[cfg(test)]
mod tests;

use super::alignment::{Aligned, Alignment};
use crate::environment::geodesy::Datum;
use crate::frame::{Vec3, skew};
use crate::signal::Measurement;
use crate::time::SimTime;
use nalgebra::{SMatrix, SVector, UnitQuaternion};
pub use update::{InnovationTally, Source};

/// Number of error states.
pub const STATES: usize = 20;
const P: usize = 0;
const V: usize = 3;
const TH: usize = 6;
const BG: usize = 9;
const BA: usize = 12;
const BARO: usize = 15;
const DRIFT: usize = 16;
const HEADING: usize = 19;

/// Walk of the magnetometer's heading error as the body tilts (rad per √s).
const HEADING_WALK_RAD_SQRT_S: f64 = 1e-3;

type Covariance = SMatrix<f64, STATES, STATES>;
type Row = SVector<f64, STATES>;

/// Satellite receiver as the flight computer knows it.
#[derive(Clone, Debug, PartialEq)]
pub struct GnssParameters {
    /// From the instant of the fix to its delivery (s).
    pub delay_s: f64,
    /// Antenna, body FRD from the pivot (m).
    pub antenna_body_m: Vec3,
    /// White noise of position, horizontal and vertical (m).
    pub position_std_m: [f64; 2],
    /// Slow drift of position, horizontal and vertical (m).
    pub drift_std_m: [f64; 2],
    /// Its correlation time (s).
    pub drift_time_s: f64,
    /// White noise of velocity, horizontal and vertical (m/s).
    pub velocity_std_m_s: [f64; 2],
}

/// Everything the filter has to know. Noise figures are of one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct NavigationParameters {
    /// Inertial unit, body FRD from the pivot (m).
    pub imu_body_m: Vec3,
    /// Accelerometer noise (m/s²), bias (m/s²), bias random walk (m/s² per √s).
    pub accelerometer: [f64; 3],
    /// Gyroscope noise (rad/s), bias after alignment (rad/s), bias random walk (rad/s per √s).
    pub gyroscope: [f64; 3],
    /// Satellite navigation.
    pub gnss: GnssParameters,
    /// Barometer noise (m), random walk (m per √s).
    pub barometer_m: [f64; 2],
    /// Its delay (s).
    pub barometer_delay_s: f64,
    /// Altimeter noise (m) and share of range.
    pub altimeter: [f64; 2],
    /// Altimeter, body FRD from the pivot (m); it looks along +z.
    pub altimeter_body_m: Vec3,
    /// Its delay (s).
    pub altimeter_delay_s: f64,
    /// Magnetic field at the site from a field model, NED (T). `None`: the heading on the pad is `rest_heading_rad`.
    pub magnetic_field_ned_t: Option<Vec3>,
    /// Magnetometer noise and hard iron left after calibration (T).
    pub magnetometer_t: [f64; 2],
    /// Heading on the pad where no field is known (rad).
    pub rest_heading_rad: f64,
    /// Pivot at rest, from the local origin on the pad surface (m).
    pub rest_ned_m: Vec3,
    /// Gravity at the site (m/s²).
    pub gravity_m_s2: f64,
}

/// Nominal state.
#[derive(Clone, Copy, Debug)]
struct Nominal {
    position_ned_m: Vec3,
    velocity_ned_m_s: Vec3,
    q_ned_from_body: UnitQuaternion<f64>,
    gyro_bias_rad_s: Vec3,
    accel_bias_m_s2: Vec3,
    baro_offset_m: f64,
    gnss_drift_ned_m: Vec3,
    heading_bias_rad: f64,
}

impl Nominal {
    fn is_finite(&self) -> bool {
        let vectors = [
            self.position_ned_m,
            self.velocity_ned_m_s,
            self.gyro_bias_rad_s,
            self.accel_bias_m_s2,
            self.gnss_drift_ned_m,
        ];
        vectors.iter().all(|v| v.iter().all(|x| x.is_finite()))
            && self.q_ned_from_body.coords.iter().all(|x| x.is_finite())
            && self.baro_offset_m.is_finite()
            && self.heading_bias_rad.is_finite()
    }
}

/// One past state, for measurements that come late.
#[derive(Clone, Copy, Debug)]
struct Past {
    time: SimTime,
    position_ned_m: Vec3,
    velocity_ned_m_s: Vec3,
    q_ned_from_body: UnitQuaternion<f64>,
    rate_body_rad_s: Vec3,
    corrected_position_m: Vec3,
    corrected_velocity_m_s: Vec3,
}

/// Entries of the history: half a second at 250 Hz.
const HISTORY: usize = 128;
/// Least time between two of them: a sample at 250 Hz, a little less for clocks that are not round.
const HISTORY_SPACING: SimTime = SimTime::from_us(3_900);

/// Whether the vehicle is known to stand still.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundState {
    /// Where it was aligned.
    OnPad,
    /// Somewhere on the ground.
    Landed,
    /// Not known to stand.
    No,
}

/// Counters for the curious.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NavigationHealth {
    /// Measurements refused by a gate or because they were no numbers.
    pub rejected: u64,
    /// Times the covariance had to be rebuilt.
    pub resets: u64,
}

/// How long the filter has been flying blind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AidingStatus {
    /// Satellite fixes refused, in part or whole, in succession.
    pub gnss_refused: u32,
    /// Time since the last fix that was used whole (s).
    pub gnss_silence_s: f64,
    /// Time since the last range that was used (s).
    pub altimeter_silence_s: f64,
}

/// The filter.
#[derive(Clone, Debug)]
pub struct Navigation {
    parameters: NavigationParameters,
    alignment: Alignment,
    aligned: bool,
    now: Nominal,
    covariance: Covariance,
    history: [Past; HISTORY],
    newest: usize,
    corrected_position_m: Vec3,
    corrected_velocity_m_s: Vec3,
    rate_body_rad_s: Vec3,
    specific_force_body_m_s2: Vec3,
    time: Option<SimTime>,
    datum: Option<Datum>,
    altimeter_offset_m: f64,
    sight: AidingStatus,
    gnss_contradictions: u32,
    altimeter_refused: u32,
    standing_for: u32,
    health: NavigationHealth,
    tallies: [InnovationTally; Source::COUNT],
}

impl Navigation {
    /// Before alignment: upright at the rest position.
    pub fn new(parameters: NavigationParameters) -> Self {
        let now = Nominal {
            position_ned_m: parameters.rest_ned_m + parameters.imu_body_m,
            velocity_ned_m_s: Vec3::zeros(),
            q_ned_from_body: UnitQuaternion::identity(),
            gyro_bias_rad_s: Vec3::zeros(),
            accel_bias_m_s2: Vec3::zeros(),
            baro_offset_m: 0.0,
            gnss_drift_ned_m: Vec3::zeros(),
            heading_bias_rad: 0.0,
        };
        let past = Past {
            time: SimTime::ZERO,
            position_ned_m: now.position_ned_m,
            velocity_ned_m_s: Vec3::zeros(),
            q_ned_from_body: now.q_ned_from_body,
            rate_body_rad_s: Vec3::zeros(),
            corrected_position_m: Vec3::zeros(),
            corrected_velocity_m_s: Vec3::zeros(),
        };
        let mut navigation = Self {
            parameters,
            alignment: Alignment::default(),
            aligned: false,
            now,
            covariance: Covariance::zeros(),
            history: [past; HISTORY],
            newest: 0,
            corrected_position_m: Vec3::zeros(),
            corrected_velocity_m_s: Vec3::zeros(),
            rate_body_rad_s: Vec3::zeros(),
            specific_force_body_m_s2: Vec3::zeros(),
            time: None,
            datum: None,
            altimeter_offset_m: 0.0,
            sight: AidingStatus::default(),
            gnss_contradictions: 0,
            altimeter_refused: 0,
            standing_for: 0,
            health: NavigationHealth::default(),
            tallies: [InnovationTally::default(); Source::COUNT],
        };
        navigation.covariance = navigation.initial_covariance(1.0);
        navigation
    }

    /// The local origin and all biases are known.
    pub const fn is_aligned(&self) -> bool {
        self.aligned
    }

    /// Averages at rest until `duration_s` is reached and satellite navigation has answered; then the
    /// filter starts. With `duration_s` zero it starts from whatever there is.
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
        if let Some(aligned) = self.alignment.result()
            && aligned.fixes >= 3.0
        {
            self.start(&aligned);
        }
    }

    fn start(&mut self, a: &Aligned) {
        let p = &self.parameters;
        let q = attitude_at_rest(a, p);
        self.now.q_ned_from_body = q;
        self.now.position_ned_m = p.rest_ned_m + q * p.imu_body_m;
        self.now.velocity_ned_m_s = Vec3::zeros();
        self.now.gyro_bias_rad_s = a.rate_body_rad_s;
        // Along gravity the accelerometer's error is its bias; across it, tilt and bias look the same.
        let up = a.specific_force_body_m_s2.normalize();
        self.now.accel_bias_m_s2 = up * (a.specific_force_body_m_s2.norm() - p.gravity_m_s2);
        self.now.baro_offset_m = a.pressure_altitude_m.map_or(0.0, |h| h + self.now.position_ned_m.z);
        self.now.heading_bias_rad = 0.0;
        self.now.gnss_drift_ned_m = Vec3::zeros();
        if let Some(range) = a.range_m {
            let expected = self.expected_range_m(self.now.position_ned_m, &q);
            // More than a decimetre is not the sensor's offset but a pad that is not where it should be.
            self.altimeter_offset_m = (range - expected).clamp(-0.1, 0.1);
        }
        if let Some(fix) = a.fix {
            // Origin so that the mean fix is the antenna where it stands.
            let antenna = p.rest_ned_m + q * p.gnss.antenna_body_m;
            let origin = Datum::new(fix.x, fix.y, fix.z).geodetic(&-antenna);
            self.datum = Some(Datum::new(origin.latitude_rad, origin.longitude_rad, origin.altitude_m));
        }
        self.covariance = self.initial_covariance(a.fixes.max(1.0));
        self.aligned = true;
    }

    fn initial_covariance(&self, fixes: f64) -> Covariance {
        let p = &self.parameters;
        let mut c = Covariance::zeros();
        let mut set = |at: usize, n: usize, std: f64| {
            for i in at..at + n {
                c[(i, i)] = std * std;
            }
        };
        set(P, 3, 0.005);
        set(V, 3, 0.02);
        set(BG, 3, 0.2 * p.gyroscope[1]);
        set(BA, 3, p.accelerometer[1]);
        set(BARO, 1, 0.1);
        set(DRIFT, 2, p.gnss.position_std_m[0] / fixes.sqrt() + 0.1 * p.gnss.drift_std_m[0]);
        set(DRIFT + 2, 1, p.gnss.position_std_m[1] / fixes.sqrt() + 0.1 * p.gnss.drift_std_m[1]);
        let dip = p.magnetic_field_ned_t.map_or(0.0, |b| b.z / libm::hypot(b.x, b.y).max(1e-6));
        let levelling = dip * p.accelerometer[1] / p.gravity_m_s2;
        let heading_bias = libm::hypot(self.heading_std_rad(1), levelling);
        set(HEADING, 1, heading_bias.max(1e-4));
        set(TH, 3, 2e-3);
        c[(TH + 2, TH + 2)] = heading_bias * heading_bias + 1e-4;
        c[(TH + 2, HEADING)] = -heading_bias * heading_bias;
        c[(HEADING, TH + 2)] = -heading_bias * heading_bias;
        // Levelling mistakes bias for tilt: with specific force (0, 0, -g) in NED, θx = by/g and θy = -bx/g.
        let r = *self.now.q_ned_from_body.to_rotation_matrix().matrix();
        let g = p.gravity_m_s2;
        let mut tilt_from_bias = SMatrix::<f64, 3, 3>::zeros();
        for j in 0..3 {
            tilt_from_bias[(0, j)] = r[(1, j)] / g;
            tilt_from_bias[(1, j)] = -r[(0, j)] / g;
        }
        let bias = SMatrix::<f64, 3, 3>::identity() * (p.accelerometer[1] * p.accelerometer[1]);
        let cross = tilt_from_bias * bias;
        let tilt = cross * tilt_from_bias.transpose();
        for i in 0..3 {
            for j in 0..3 {
                c[(TH + i, TH + j)] += tilt[(i, j)];
                c[(TH + i, BA + j)] = cross[(i, j)];
                c[(BA + j, TH + i)] = cross[(i, j)];
            }
        }
        // The pivot stands where it stands: a wrong tilt displaces the unit above it, and the antenna, whose
        // mean fix was taken for the origin, by as much as the drift then has to make up for.
        let q = self.now.q_ned_from_body;
        displace(&mut c, P, -skew(q * p.imu_body_m));
        displace(&mut c, DRIFT, skew(q * p.gnss.antenna_body_m));
        c
    }

    /// Error of the heading from one magnetometer reading: `which` 0 its noise, 1 its hard iron (rad).
    fn heading_std_rad(&self, which: usize) -> f64 {
        let field = self.parameters.magnetic_field_ned_t.unwrap_or(Vec3::new(2.0e-5, 0.0, 0.0));
        self.parameters.magnetometer_t[which] / libm::hypot(field.x, field.y).max(1e-6)
    }

    /// One measurement: prediction with the inertial sample, then whatever else came.
    pub fn step(&mut self, m: &Measurement, standing: GroundState) {
        let before = self.now;
        if let Some(imu) = &m.imu {
            let gap_s = self.time.map_or(imu.interval_s, |t| m.time.since(t).s());
            // A sample that stands for a lost one too covers the gap; a clock that stands still does not stop us.
            let dt_s = if gap_s > 0.5 * imu.interval_s { gap_s } else { imu.interval_s }.clamp(0.0, 0.1);
            let f = imu.specific_force_body_m_s2;
            let w = imu.rate_body_rad_s;
            if f.iter().chain(w.iter()).all(|x| x.is_finite()) {
                self.predict(f - self.now.accel_bias_m_s2, w - self.now.gyro_bias_rad_s, dt_s);
            } else {
                self.health.rejected += 1;
                self.predict(self.specific_force_body_m_s2, self.rate_body_rad_s, dt_s);
            }
            self.sight.gnss_silence_s += dt_s;
            self.sight.altimeter_silence_s += dt_s;
            self.time = Some(m.time);
            self.remember(m.time);
            self.zero_velocity_update(standing);
        }
        if let Some(fix) = &m.gnss {
            self.use_gnss(fix, m.time);
        }
        if let Some(baro) = &m.barometer {
            self.use_barometer(baro, m.time);
        }
        if let Some(field) = &m.magnetic_field_body_t {
            self.use_magnetometer(field);
        }
        if let Some(altimeter) = &m.altimeter {
            self.use_altimeter(altimeter, m.time);
        }
        self.guard(&before);
    }

    fn predict(&mut self, f: Vec3, w: Vec3, dt_s: f64) {
        let p = &self.parameters;
        let n = &mut self.now;
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

        let r = *q_middle.to_rotation_matrix().matrix();
        let velocity_from_tilt = -skew(f_ned) * dt_s;
        let c = &mut self.covariance;
        // Transition of the error, the half steps of the state in it. F P, row blocks from the top, so that every block still reads old rows below it; then (F P) Fᵀ.
        for j in 0..STATES {
            let mut column = c.column_mut(j);
            let (th, bg, ba) = (
                Vec3::new(column[TH], column[TH + 1], column[TH + 2]),
                Vec3::new(column[BG], column[BG + 1], column[BG + 2]),
                Vec3::new(column[BA], column[BA + 1], column[BA + 2]),
            );
            let dth = -(r * bg) * dt_s;
            let dv = velocity_from_tilt * (th + dth * 0.5) - r * ba * dt_s;
            for i in 0..3 {
                column[P + i] += dt_s * (column[V + i] + 0.5 * dv[i]);
                column[V + i] += dv[i];
                column[TH + i] += dth[i];
            }
        }
        for j in 0..STATES {
            let mut row = c.row_mut(j);
            let (th, bg, ba) = (
                Vec3::new(row[TH], row[TH + 1], row[TH + 2]),
                Vec3::new(row[BG], row[BG + 1], row[BG + 2]),
                Vec3::new(row[BA], row[BA + 1], row[BA + 2]),
            );
            let dth = -(r * bg) * dt_s;
            let dv = velocity_from_tilt * (th + dth * 0.5) - r * ba * dt_s;
            for i in 0..3 {
                row[P + i] += dt_s * (row[V + i] + 0.5 * dv[i]);
                row[V + i] += dv[i];
                row[TH + i] += dth[i];
            }
        }
        // Rounding must not tear the halves apart.
        for j in 0..STATES {
            for i in j + 1..STATES {
                c[(j, i)] = c[(i, j)];
            }
        }
        // White noise of a sample, half as much again for vibration and integration; walks of the slow states.
        let (velocity, angle) = (1.5 * p.accelerometer[0] * dt_s, 1.5 * p.gyroscope[0] * dt_s);
        let drift = |std: f64| 2.0 * std * std / p.gnss.drift_time_s.max(1.0) * dt_s;
        for i in 0..3 {
            c[(V + i, V + i)] += velocity * velocity;
            c[(TH + i, TH + i)] += angle * angle;
            c[(BG + i, BG + i)] += p.gyroscope[2] * p.gyroscope[2] * dt_s;
            c[(BA + i, BA + i)] += p.accelerometer[2] * p.accelerometer[2] * dt_s;
            c[(DRIFT + i, DRIFT + i)] += drift(p.gnss.drift_std_m[usize::from(i == 2)]);
        }
        c[(HEADING, HEADING)] += HEADING_WALK_RAD_SQRT_S * HEADING_WALK_RAD_SQRT_S * dt_s;
        c[(BARO, BARO)] += p.barometer_m[1] * p.barometer_m[1] * dt_s;
    }

    fn remember(&mut self, time: SimTime) {
        // A faster unit does not shorten the memory: the newest entry moves along until it is far enough from the one before.
        let before = &self.history[(self.newest + HISTORY - 1) % HISTORY];
        if self.history[self.newest].time.since(before.time) >= HISTORY_SPACING {
            self.newest = (self.newest + 1) % HISTORY;
        }
        self.history[self.newest] = Past {
            time,
            position_ned_m: self.now.position_ned_m,
            velocity_ned_m_s: self.now.velocity_ned_m_s,
            q_ned_from_body: self.now.q_ned_from_body,
            rate_body_rad_s: self.rate_body_rad_s,
            corrected_position_m: self.corrected_position_m,
            corrected_velocity_m_s: self.corrected_velocity_m_s,
        };
    }

    /// State `delay_s` before `time`, with what has been learnt since.
    fn recall(&self, time: SimTime, delay_s: f64) -> Past {
        let wanted = time.since(SimTime::from_s(delay_s));
        let mut later = self.newest;
        let mut earlier = self.newest;
        for back in 0..HISTORY {
            earlier = (self.newest + HISTORY - back) % HISTORY;
            if self.history[earlier].time <= wanted || self.history[earlier].time == SimTime::ZERO {
                break;
            }
            later = earlier;
        }
        let (a, b) = (&self.history[earlier], &self.history[later]);
        let corrected = |past: &Past| {
            (
                past.position_ned_m + self.corrected_position_m - past.corrected_position_m,
                past.velocity_ned_m_s + self.corrected_velocity_m_s - past.corrected_velocity_m_s,
            )
        };
        let span_s = b.time.since(a.time).s();
        let u = if span_s > 0.0 && a.time <= wanted { wanted.since(a.time).s() / span_s } else { 1.0 };
        let u = u.clamp(0.0, 1.0);
        let ((pa, va), (pb, vb)) = (corrected(a), corrected(b));
        Past { time: wanted, position_ned_m: pa + (pb - pa) * u, velocity_ned_m_s: va + (vb - va) * u, ..*b }
    }

    /// Position and velocity become uncertain again, so that the next fixes pull them in.
    fn inflate_covariance(&mut self) {
        for i in 0..3 {
            self.covariance[(P + i, P + i)] += 4.0;
            self.covariance[(V + i, V + i)] += 0.25;
        }
        self.gnss_contradictions = 0;
        self.health.resets += 1;
    }

    /// Nothing that is no number survives a step.
    fn guard(&mut self, before: &Nominal) {
        let sound = self.now.is_finite()
            && (0..STATES).all(|i| self.covariance[(i, i)].is_finite() && self.covariance[(i, i)] >= 0.0);
        if !sound {
            self.now = *before;
            self.covariance = self.initial_covariance(1.0);
            self.inflate_covariance();
        }
    }

    /// Attitude.
    pub const fn q_ned_from_body(&self) -> UnitQuaternion<f64> {
        self.now.q_ned_from_body
    }

    /// Body rate, bias removed (rad/s).
    pub const fn rate_body_rad_s(&self) -> Vec3 {
        self.rate_body_rad_s
    }

    /// Specific force at the inertial unit, bias removed (m/s²).
    pub const fn specific_force_body_m_s2(&self) -> Vec3 {
        self.specific_force_body_m_s2
    }

    /// Gyroscope bias (rad/s), accelerometer bias (m/s²), barometer offset (m).
    pub const fn biases(&self) -> (Vec3, Vec3, f64) {
        (self.now.gyro_bias_rad_s, self.now.accel_bias_m_s2, self.now.baro_offset_m)
    }

    /// Position and velocity of the point `body_m` of the vehicle (FRD from the pivot).
    pub fn point(&self, body_m: Vec3) -> (Vec3, Vec3) {
        let lever = body_m - self.parameters.imu_body_m;
        let n = &self.now;
        (
            n.position_ned_m + n.q_ned_from_body * lever,
            n.velocity_ned_m_s + n.q_ned_from_body * self.rate_body_rad_s.cross(&lever),
        )
    }

    /// Standard deviations of position (m), velocity (m/s) and attitude (rad), NED axes.
    pub fn standard_deviations(&self) -> [Vec3; 3] {
        let block = |at: usize| Vec3::from_fn(|i, _| self.covariance[(at + i, at + i)].max(0.0).sqrt());
        [block(P), block(V), block(TH)]
    }

    /// Covariance of position, velocity and attitude, for consistency tests.
    pub fn motion_covariance(&self) -> SMatrix<f64, 9, 9> {
        self.covariance.fixed_view::<9, 9>(0, 0).into_owned()
    }

    /// How long satellites and altimeter have been silent.
    pub const fn sight(&self) -> AidingStatus {
        self.sight
    }

    /// Innovations of a source against what the filter expected of them.
    pub const fn tally(&self, source: Source) -> InnovationTally {
        self.tallies[source as usize]
    }

    /// Counters.
    pub const fn health(&self) -> NavigationHealth {
        self.health
    }
}

/// Adds `from_tilt · θ` to the three error states at `at` of a covariance: both sides of `T C Tᵀ`.
fn displace(c: &mut Covariance, at: usize, from_tilt: SMatrix<f64, 3, 3>) {
    for j in 0..STATES {
        let moved = from_tilt * Vec3::new(c[(TH, j)], c[(TH + 1, j)], c[(TH + 2, j)]);
        for i in 0..3 {
            c[(at + i, j)] += moved[i];
        }
    }
    for j in 0..STATES {
        let moved = from_tilt * Vec3::new(c[(j, TH)], c[(j, TH + 1)], c[(j, TH + 2)]);
        for i in 0..3 {
            c[(j, at + i)] += moved[i];
        }
    }
}

/// Level from the accelerometer, heading from the magnetometer where the field is known.
fn attitude_at_rest(a: &Aligned, p: &NavigationParameters) -> UnitQuaternion<f64> {
    let down = -a.specific_force_body_m_s2;
    let level = UnitQuaternion::rotation_between(&down, &Vec3::z()).unwrap_or(UnitQuaternion::identity());
    // Heading of body x after levelling, then turned to what the magnetometer says.
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
