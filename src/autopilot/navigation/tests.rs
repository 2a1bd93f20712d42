//! Derivatives of the filter against central differences, and what its covariance must keep.

use super::covariance::HEADING_WALK_RAD_SQRT_S;
use super::state::{ACCEL_BIAS, ATTITUDE, BARO_OFFSET, GNSS_DRIFT, GYRO_BIAS, HEADING_BIAS};
use super::*;
use crate::signal::ImuSample;

const DT_S: f64 = 0.004;
/// Step of the central differences: round-off 1e-13 of 1e2 over 1e-4, truncation of third derivatives 1e-8.
const STEP: f64 = 1e-4;

/// A filter in flight: tilted, turning, moving, biased. Measurements without delay, process without noise.
fn in_flight() -> Navigation {
    let mut navigation = Navigation::new(NavigationParameters {
        imu_body_m: Vec3::new(0.02, 0.01, -1.25),
        accelerometer: AccelerometerNoise::default(),
        gyroscope: GyroscopeNoise::default(),
        gnss: GnssParameters {
            delay_s: 0.0,
            antenna_body_m: Vec3::new(0.3, -0.2, -1.5),
            position_std_m: HorizontalVertical { horizontal: 0.15, vertical: 0.3 },
            drift_std_m: HorizontalVertical::default(),
            drift_time_s: 200.0,
            velocity_std_m_s: HorizontalVertical { horizontal: 0.05, vertical: 0.08 },
        },
        barometer: BarometerNoise { noise_std_m: 0.21, random_walk_m_sqrt_s: 0.0 },
        barometer_delay_s: 0.0,
        altimeter: AltimeterNoise { noise_std_m: 0.02, noise_fraction: 0.002 },
        altimeter_body_m: Vec3::new(0.15, 0.0, -0.05),
        altimeter_delay_s: 0.0,
        magnetic_field_ned_t: Some(Vec3::new(2.39e-5, -2.6e-6, 3.86e-5)),
        magnetometer: MagnetometerNoise { noise_std_t: 2e-7, hard_iron_std_t: 5e-7 },
        rest_heading_rad: 0.0,
        rest_ned_m: Vec3::new(0.0, 0.0, -0.741),
        gravity_m_s2: 9.80665,
    });
    navigation.datum = Some(Datum::new(0.497, -1.406, 3.0));
    navigation.aligned = true;
    navigation.state = NominalState {
        position_ned_m: Vec3::new(3.0, -2.0, -20.0),
        velocity_ned_m_s: Vec3::new(0.4, 0.2, 3.0),
        q_ned_from_body: UnitQuaternion::from_euler_angles(0.12, -0.08, 1.1),
        gyro_bias_rad_s: Vec3::new(1e-3, -2e-3, 3e-3),
        accel_bias_m_s2: Vec3::new(0.05, -0.03, 0.02),
        baro_offset_m: 4.0,
        gnss_drift_ned_m: Vec3::new(0.5, -0.4, 0.8),
        heading_bias_rad: 0.02,
    };
    navigation.specific_force_body_m_s2 = MEASURED_FORCE - navigation.state.accel_bias_m_s2;
    navigation.rate_body_rad_s = MEASURED_RATE - navigation.state.gyro_bias_rad_s;
    remember(&mut navigation);
    navigation
}

fn remember(navigation: &mut Navigation) {
    navigation.history.push(SimTime::from_s(1.0), &navigation.state, navigation.rate_body_rad_s);
}

const MEASURED_FORCE: Vec3 = Vec3::new(0.3, -0.2, -10.5);
const MEASURED_RATE: Vec3 = Vec3::new(0.2, -0.3, 0.1);

/// The same with an error added, as if it had been there all along.
fn disturbed(navigation: &Navigation, state: usize, size: f64) -> Navigation {
    let mut other = navigation.clone();
    let mut error = ErrorVector::zeros();
    error[state] = size;
    other.state.add(&error);
    other.rate_body_rad_s = MEASURED_RATE - other.state.gyro_bias_rad_s;
    other.specific_force_body_m_s2 = MEASURED_FORCE - other.state.accel_bias_m_s2;
    remember(&mut other);
    other
}

/// Error of `a` against `b`.
fn difference(a: &NominalState, b: &NominalState) -> ErrorVector {
    let mut error = ErrorVector::zeros();
    let turn = (a.q_ned_from_body * b.q_ned_from_body.inverse()).scaled_axis();
    let blocks = [
        (POSITION, a.position_ned_m - b.position_ned_m),
        (VELOCITY, a.velocity_ned_m_s - b.velocity_ned_m_s),
        (ATTITUDE, turn),
        (GYRO_BIAS, a.gyro_bias_rad_s - b.gyro_bias_rad_s),
        (ACCEL_BIAS, a.accel_bias_m_s2 - b.accel_bias_m_s2),
        (GNSS_DRIFT, a.gnss_drift_ned_m - b.gnss_drift_ned_m),
    ];
    for (at, block) in blocks {
        error.fixed_rows_mut::<3>(at).copy_from(&block);
    }
    error[BARO_OFFSET] = a.baro_offset_m - b.baro_offset_m;
    error[HEADING_BIAS] = a.heading_bias_rad - b.heading_bias_rad;
    error
}

fn predicted(navigation: &Navigation) -> Navigation {
    let mut next = navigation.clone();
    let (f, w) = (MEASURED_FORCE - next.state.accel_bias_m_s2, MEASURED_RATE - next.state.gyro_bias_rad_s);
    next.predict(f, w, DT_S);
    next
}

#[test]
fn the_transition_is_the_derivative_of_the_prediction() {
    let mut navigation = in_flight();
    for state in 0..STATES {
        let [low, high] = [-STEP, STEP].map(|size| predicted(&disturbed(&navigation, state, size)).state);
        let numeric = difference(&high, &low) / (2.0 * STEP);
        // Out of certainty but for one state comes φ φᵀ with φ that state's column, whose own entry is one.
        navigation.covariance = Covariance::zeros();
        navigation.covariance[(state, state)] = 1.0;
        let after = predicted(&navigation).covariance;
        let mut column = after.column(state).into_owned();
        if state == HEADING_BIAS {
            column[HEADING_BIAS] -= HEADING_WALK_RAD_SQRT_S * HEADING_WALK_RAD_SQRT_S * DT_S;
        }
        let error = (column - numeric).amax();
        assert!(error < 1e-6, "state {state}: {error}");
    }
}

fn magnetometer_scalar(navigation: &Navigation, field_body_t: &Vec3) -> Scalar {
    measurement::magnetometer(&navigation.parameters, &navigation.state, field_body_t).unwrap()
}

/// Largest difference between the rows of a measurement and the derivative of what it expects, but for
/// `left_out`.
fn worst_row(scalars: impl Fn(&Navigation) -> Vec<Scalar>, left_out: &[usize]) -> f64 {
    let navigation = in_flight();
    let rows = scalars(&navigation);
    let mut worst = 0.0f64;
    for state in (0..STATES).filter(|state| !left_out.contains(state)) {
        let [low, high] = [-STEP, STEP].map(|size| scalars(&disturbed(&navigation, state, size)));
        for (i, scalar) in rows.iter().enumerate() {
            // What is expected grows as the innovation falls.
            let numeric = (low[i].innovation - high[i].innovation) / (2.0 * STEP);
            worst = worst.max((scalar.sensitivity[state] - numeric).abs());
        }
    }
    worst
}

#[test]
fn the_rows_are_the_derivatives_of_the_measurements() {
    let time = SimTime::from_s(1.0);
    let place = Datum::new(0.497, -1.406, 3.0).geodetic(&Vec3::new(3.5, -2.4, -20.0));
    let fix = GnssFix {
        latitude_rad: place.latitude_rad,
        longitude_rad: place.longitude_rad,
        altitude_m: place.altitude_m,
        velocity_ned_m_s: Vec3::new(0.3, 0.1, 3.2),
        horizontal_accuracy_m: 1.0,
        vertical_accuracy_m: 1.0,
        fix_type: 3,
        satellites: 12,
    };
    let gnss = worst_row(|n| n.gnss_scalars(&fix, time).unwrap().to_vec(), &[]);
    assert!(gnss < 1e-6, "{gnss}");

    let baro = BarometerSample { pressure_pa: 1e5, pressure_altitude_m: 24.2, temperature_k: 288.0 };
    let baro = worst_row(|n| vec![n.barometer_scalar(&baro, time)], &[]);
    assert!(baro < 1e-6, "{baro}");

    // Tilt is left out of these two, and said why: the rest must be right.
    let field = in_flight().state.q_ned_from_body.inverse() * Vec3::new(2.39e-5, -2.6e-6, 3.86e-5);
    let heading = worst_row(|n| vec![magnetometer_scalar(n, &field)], &[ATTITUDE, ATTITUDE + 1]);
    assert!(heading < 1e-6, "{heading}");
    let range = AltimeterSample { range_m: Some(19.0), minimum_m: 0.2, maximum_m: 40.0 };
    let range = worst_row(
        |n| vec![n.altimeter_scalar(&range, time).unwrap()],
        &[ATTITUDE, ATTITUDE + 1, ATTITUDE + 2],
    );
    assert!(range < 1e-6, "{range}");

    let pad = worst_row(|n| measurement::pad_position(&n.parameters, &n.state).to_vec(), &[]);
    assert!(pad < 1e-6, "{pad}");
}

/// The update takes K s Kᵀ away. Joseph's form, (1 - K h) C (1 - K h)ᵀ + K r Kᵀ, is the same for the optimal
/// gain, and neither loses symmetry or positive definiteness over a flight's worth of updates.
#[test]
fn the_update_is_joseph_s_and_the_covariance_stays_one() {
    let mut navigation = in_flight();
    navigation.parameters.accelerometer =
        AccelerometerNoise { noise_std_m_s2: 0.017, bias_std_m_s2: 0.05, random_walk_m_s2_sqrt_s: 3e-4 };
    navigation.parameters.gyroscope =
        GyroscopeNoise { noise_std_rad_s: 1.6e-3, bias_std_rad_s: 8.7e-4, random_walk_rad_s_sqrt_s: 2e-5 };
    navigation.covariance =
        covariance::initial(&navigation.parameters, navigation.state.q_ned_from_body, 30.0);
    let imu = |_| ImuSample {
        specific_force_body_m_s2: MEASURED_FORCE,
        rate_body_rad_s: Vec3::zeros(),
        interval_s: DT_S,
        temperature_k: 290.0,
    };
    let mut worst = 0.0f64;
    for step in 0..15_000u64 {
        let time = SimTime::from_us(1_000_000 + 4000 * (step + 1));
        let m = Measurement { time, imu: Some(imu(step)), ..Measurement::default() };
        navigation.step(&m, GroundState::Unknown);
        // What is measured is what is expected: the covariance does not look at the values.
        let field = navigation.state.q_ned_from_body.inverse() * Vec3::new(2.39e-5, -2.6e-6, 3.86e-5);
        if step % 5 == 0 {
            let scalar = magnetometer_scalar(&navigation, &field);
            let before = navigation.covariance;
            navigation.magnetometer_update(&field);
            let gain = before * scalar.sensitivity
                / (scalar.sensitivity.dot(&(before * scalar.sensitivity)) + scalar.variance);
            let keep = Covariance::identity() - gain * scalar.sensitivity.transpose();
            let joseph = keep * before * keep.transpose() + gain * scalar.variance * gain.transpose();
            worst = worst.max((joseph - navigation.covariance).amax() / before.amax());
        }
        if step % 25 == 0 {
            let lever = navigation.parameters.gnss.antenna_body_m - navigation.parameters.imu_body_m;
            let antenna = navigation.state.position_ned_m + navigation.state.q_ned_from_body * lever;
            let p = antenna + navigation.state.gnss_drift_ned_m;
            let place = Datum::new(0.497, -1.406, 3.0).geodetic(&p);
            let fix = GnssFix {
                latitude_rad: place.latitude_rad,
                longitude_rad: place.longitude_rad,
                altitude_m: place.altitude_m,
                velocity_ned_m_s: navigation.state.velocity_ned_m_s,
                horizontal_accuracy_m: 1.0,
                vertical_accuracy_m: 1.0,
                fix_type: 3,
                satellites: 12,
            };
            navigation.gnss_update(&fix, time);
        }
        assert_eq!(navigation.covariance, navigation.covariance.transpose(), "step {step}");
        assert!(navigation.covariance.cholesky().is_some(), "step {step}");
    }
    // Round-off of twenty terms.
    assert!(worst < 1e-13, "{worst}");
    assert_eq!(navigation.health.resets, 0);
}
