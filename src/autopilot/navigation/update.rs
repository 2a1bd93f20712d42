//! Measurements of the filter: what each sensor should have said, how that depends on the error, how far to trust it.
//!
//! A measurement is one or more [`Scalar`]s, all of the state before it; they are taken in one after the other, each
//! less what those before it have already explained.

use super::{BARO, DRIFT, GroundState, HEADING, Nominal, P, Row, STATES, TH, V};
use super::{Navigation, Vec3};
use crate::environment::geodesy::Geodetic;
use crate::frame::skew;
use crate::signal::{AltimeterSample, BarometerSample, GnssFix};
use crate::time::SimTime;
use nalgebra::UnitQuaternion;

/// Where an innovation comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Position of a satellite fix.
    GnssPosition,
    /// Velocity of a satellite fix.
    GnssVelocity,
    /// Pressure altitude.
    Barometer,
    /// Heading from the magnetic field.
    Magnetometer,
    /// Range to the ground.
    Altimeter,
    /// Standing still.
    Rest,
}

impl Source {
    /// How many there are.
    pub const COUNT: usize = 6;
}

/// Innovations against their expected variance: an honest filter has a mean of one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InnovationTally {
    /// Scalars seen, refused ones included.
    pub count: u64,
    /// Sum of the squares, each over its variance; what is refused counts as its gate.
    pub normalised_squares: f64,
}

/// One scalar: `innovation = row · error + noise`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scalar {
    pub(super) source: Source,
    pub(super) row: Row,
    pub(super) innovation: f64,
    pub(super) variance: f64,
    /// Refused beyond so many standard deviations.
    pub(super) gate: f64,
}

impl Navigation {
    /// Takes in the scalars of one measurement; gives whether none was refused.
    fn fuse_all(&mut self, scalars: &[Scalar]) -> bool {
        let mut explained = Row::zeros();
        let mut all = true;
        for scalar in scalars {
            let innovation = scalar.innovation - scalar.row.dot(&explained);
            match self.fuse(&Scalar { innovation, ..*scalar }) {
                Some(correction) => explained += correction,
                None => all = false,
            }
        }
        all
    }

    /// The correction that one scalar made, unless its gate refused it.
    fn fuse(&mut self, scalar: &Scalar) -> Option<Row> {
        let Scalar { source, row, innovation, variance, gate } = scalar;
        let ph = self.covariance * row;
        let s = row.dot(&ph) + variance;
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
        self.correct(&correction);
        Some(correction)
    }

    fn correct(&mut self, error: &Row) {
        let block = |at: usize| Vec3::new(error[at], error[at + 1], error[at + 2]);
        self.now.add(error);
        self.corrected_position_m += block(P);
        self.corrected_velocity_m_s += block(V);
    }

    pub(super) fn zero_velocity_update(&mut self, standing: GroundState) {
        if standing == GroundState::No {
            self.standing_for = 0;
            return;
        }
        self.standing_for = self.standing_for.wrapping_add(1);
        // Ten times in a quarter second is plenty; the legs' give is in the noise.
        if !self.standing_for.is_multiple_of(10) {
            return;
        }
        let still = self.still_scalars();
        self.fuse_all(&still);
        if standing == GroundState::OnPad {
            let here = self.pad_scalars();
            self.fuse_all(&here);
        }
    }

    /// Not moving.
    fn still_scalars(&self) -> [Scalar; 3] {
        core::array::from_fn(|i| {
            let mut row = Row::zeros();
            row[V + i] = 1.0;
            let innovation = -self.now.velocity_ned_m_s[i];
            Scalar { source: Source::Rest, row, innovation, variance: square(0.03), gate: 10.0 }
        })
    }

    /// Here: the pivot is pinned, the unit above it moves with the tilt.
    pub(super) fn pad_scalars(&self) -> [Scalar; 3] {
        let arm_ned = self.now.q_ned_from_body * self.parameters.imu_body_m;
        let here = self.parameters.rest_ned_m + arm_ned;
        let arm = skew(arm_ned);
        core::array::from_fn(|i| {
            let mut row = Row::zeros();
            row[P + i] = 1.0;
            for j in 0..3 {
                row[TH + j] = arm[(i, j)];
            }
            let innovation = here[i] - self.now.position_ned_m[i];
            Scalar { source: Source::Rest, row, innovation, variance: square(0.005), gate: 10.0 }
        })
    }

    pub(super) fn use_gnss(&mut self, fix: &GnssFix, time: SimTime) {
        if fix.fix_type < 3 {
            return;
        }
        let Some(scalars) = self.gnss_scalars(fix, time) else { return };
        if self.fuse_all(&scalars) {
            self.sight.gnss_refused = 0;
            self.sight.gnss_silence_s = 0.0;
            self.gnss_contradictions = 0;
            return;
        }
        self.sight.gnss_refused = self.sight.gnss_refused.saturating_add(1);
        self.gnss_contradictions += 1;
        if self.gnss_contradictions >= 20 {
            // Two seconds of contradiction: it is the filter that is wrong.
            self.inflate_covariance();
        }
    }

    /// Position and velocity of the antenna, axis by axis.
    pub(super) fn gnss_scalars(&self, fix: &GnssFix, time: SimTime) -> Option<[Scalar; 6]> {
        let datum = self.datum.as_ref()?;
        let p = &self.parameters.gnss;
        let past = self.recall(time, p.delay_s);
        let lever = p.antenna_body_m - self.parameters.imu_body_m;
        let arm_ned = past.q_ned_from_body * lever;
        let swing_ned = past.q_ned_from_body * past.rate_body_rad_s.cross(&lever);
        let position = past.position_ned_m + arm_ned + self.now.gnss_drift_ned_m;
        let velocity = past.velocity_ned_m_s + swing_ned;
        let measured = datum.position_ned_m(&Geodetic {
            latitude_rad: fix.latitude_rad,
            longitude_rad: fix.longitude_rad,
            altitude_m: fix.altitude_m,
        });
        let f_ned = self.now.q_ned_from_body * self.specific_force_body_m_s2;
        // Tilt turns the arms, and what the fix is late by has been flown under the wrong tilt; the gyroscope's bias
        // swings the antenna.
        let (arm, late) = (-skew(arm_ned), skew(f_ned) * p.delay_s - skew(swing_ned));
        let swing = self.now.q_ned_from_body.to_rotation_matrix().matrix() * skew(lever);
        Some(core::array::from_fn(|k| {
            let i = k / 2;
            let which = usize::from(i == 2);
            let mut row = Row::zeros();
            if k % 2 == 0 {
                row[P + i] = 1.0;
                row[V + i] = -p.delay_s;
                row[DRIFT + i] = 1.0;
                for j in 0..3 {
                    row[TH + j] = arm[(i, j)];
                }
                let variance = square(p.position_std_m[which]) + 2.5e-5;
                let innovation = measured[i] - position[i];
                return Scalar { source: Source::GnssPosition, row, innovation, variance, gate: 5.0 };
            }
            row[V + i] = 1.0;
            for j in 0..3 {
                row[TH + j] = late[(i, j)];
                row[super::BG + j] = swing[(i, j)];
            }
            let variance = square(p.velocity_std_m_s[which]) + 1e-4;
            let innovation = fix.velocity_ned_m_s[i] - velocity[i];
            Scalar { source: Source::GnssVelocity, row, innovation, variance, gate: 5.0 }
        }))
    }

    pub(super) fn use_barometer(&mut self, baro: &BarometerSample, time: SimTime) {
        let scalar = self.barometer_scalar(baro, time);
        self.fuse_all(&[scalar]);
    }

    pub(super) fn barometer_scalar(&self, baro: &BarometerSample, time: SimTime) -> Scalar {
        let past = self.recall(time, self.parameters.barometer_delay_s);
        let expected = -past.position_ned_m.z + self.now.baro_offset_m;
        let mut row = Row::zeros();
        row[P + 2] = -1.0;
        row[V + 2] = self.parameters.barometer_delay_s;
        row[BARO] = 1.0;
        Scalar {
            source: Source::Barometer,
            row,
            innovation: baro.pressure_altitude_m - expected,
            variance: square(1.3 * self.parameters.barometer_m[0]),
            gate: 5.0,
        }
    }

    pub(super) fn use_magnetometer(&mut self, field_body_t: &Vec3) {
        if let Some(scalar) = self.magnetometer_scalar(field_body_t) {
            self.fuse_all(&[scalar]);
        }
    }

    /// Heading only. A wrong tilt turns the dipping field's shadow too, but hard iron that turns with the body would
    /// pass for tilt: the heading bias, prior and walk, carries both.
    pub(super) fn magnetometer_scalar(&self, field_body_t: &Vec3) -> Option<Scalar> {
        let reference = self.parameters.magnetic_field_ned_t?;
        let m = self.now.q_ned_from_body * field_body_t;
        if m.x * m.x + m.y * m.y < 1e-12 {
            return None;
        }
        let angle = libm::atan2(reference.y * m.x - reference.x * m.y, reference.x * m.x + reference.y * m.y);
        let mut row = Row::zeros();
        row[TH + 2] = 1.0;
        row[HEADING] = 1.0;
        Some(Scalar {
            source: Source::Magnetometer,
            row,
            innovation: angle - self.now.heading_bias_rad,
            variance: square(1.3 * self.heading_std_rad(0)),
            gate: 5.0,
        })
    }

    /// Range that the altimeter should see over flat ground (m).
    pub(super) fn expected_range_m(&self, imu_ned_m: Vec3, q: &UnitQuaternion<f64>) -> f64 {
        let lever = self.parameters.altimeter_body_m - self.parameters.imu_body_m;
        let height = -(imu_ned_m + q * lever).z;
        let cosine = (q * Vec3::z()).z;
        height / cosine.max(0.5)
    }

    pub(super) fn use_altimeter(&mut self, sample: &AltimeterSample, time: SimTime) {
        let Some(scalar) = self.altimeter_scalar(sample, time) else { return };
        if self.fuse_all(&[scalar]) {
            self.altimeter_refused = 0;
            self.sight.altimeter_silence_s = 0.0;
        } else {
            self.altimeter_refused += 1;
            if self.altimeter_refused >= 50 {
                // A second of contradiction from a laser near the ground: believe the laser.
                self.altimeter_refused = 0;
                self.covariance[(P + 2, P + 2)] += 4.0;
            }
        }
    }

    /// Tilt is left out of the sensitivity on purpose: a millimetre of offset or slope would be taken for milliradians
    /// of tilt, and its real effect is within the centimetre added to the noise.
    pub(super) fn altimeter_scalar(&self, sample: &AltimeterSample, time: SimTime) -> Option<Scalar> {
        let range_m = sample.range_m?;
        if range_m < sample.minimum_m || range_m > sample.maximum_m {
            return None;
        }
        let p = &self.parameters;
        let past = self.recall(time, p.altimeter_delay_s);
        let cosine = (past.q_ned_from_body * Vec3::z()).z;
        if cosine < 0.85 {
            return None;
        }
        let expected =
            self.expected_range_m(past.position_ned_m, &past.q_ned_from_body) + self.altimeter_offset_m;
        let mut row = Row::zeros();
        row[P + 2] = -1.0 / cosine;
        row[V + 2] = p.altimeter_delay_s / cosine;
        Some(Scalar {
            source: Source::Altimeter,
            row,
            innovation: range_m - expected,
            variance: square(p.altimeter[0]) + square(p.altimeter[1] * range_m) + 1e-4,
            gate: 6.0,
        })
    }
}

impl Nominal {
    /// The state with an error added.
    pub(super) fn add(&mut self, error: &Row) {
        let block = |at: usize| Vec3::new(error[at], error[at + 1], error[at + 2]);
        self.position_ned_m += block(P);
        self.velocity_ned_m_s += block(V);
        self.q_ned_from_body = UnitQuaternion::from_scaled_axis(block(TH)) * self.q_ned_from_body;
        self.gyro_bias_rad_s += block(super::BG);
        self.accel_bias_m_s2 += block(super::BA);
        self.baro_offset_m += error[BARO];
        self.gnss_drift_ned_m += block(DRIFT);
        self.heading_bias_rad += error[HEADING];
    }
}

fn square(x: f64) -> f64 {
    x * x
}
