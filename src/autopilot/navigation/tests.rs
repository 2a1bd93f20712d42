//! Derivatives of the filter against central differences, and what its covariance must keep.

use super::update::Scalar;
use super::*;
use crate::signal::{AltimeterSample, BarometerSample, GnssFix, ImuSample};

const DT_S: f64 = 0.004;
/// Step of the central differences: round-off 1e-13 of 1e2 over 1e-4, truncation of third derivatives 1e-8.
const STEP: f64 = 1e-4;

/// A filter in flight: tilted, turning, moving, biased. Measurements without delay, process without noise.
fn in_flight() -> Navigation {
    let mut navigation = Navigation::new(NavigationParameters {
        imu_body_m: Vec3::new(0.02, 0.01, -1.25),
        accelerometer: [0.0; 3],
        gyroscope: [0.0; 3],
        gnss: GnssParameters {
            delay_s: 0.0,
            antenna_body_m: Vec3::new(0.3, -0.2, -1.5),
            position_std_m: [0.15, 0.3],
            drift_std_m: [0.0; 2],
            drift_time_s: 200.0,
            velocity_std_m_s: [0.05, 0.08],
        },
        barometer_m: [0.21, 0.0],
        barometer_delay_s: 0.0,
        altimeter: [0.02, 0.002],
        altimeter_body_m: Vec3::new(0.15, 0.0, -0.05),
        altimeter_delay_s: 0.0,
        magnetic_field_ned_t: Some(Vec3::new(2.39e-5, -2.6e-6, 3.86e-5)),
        magnetometer_t: [2e-7, 5e-7],
        rest_heading_rad: 0.0,
        rest_ned_m: Vec3::new(0.0, 0.0, -0.741),
        gravity_m_s2: 9.80665,
    });
    navigation.datum = Some(Datum::new(0.497, -1.406, 3.0));
    navigation.aligned = true;
    navigation.now = Nominal {
        position_ned_m: Vec3::new(3.0, -2.0, -20.0),
        velocity_ned_m_s: Vec3::new(0.4, 0.2, 3.0),
        q_ned_from_body: UnitQuaternion::from_euler_angles(0.12, -0.08, 1.1),
        gyro_bias_rad_s: Vec3::new(1e-3, -2e-3, 3e-3),
        accel_bias_m_s2: Vec3::new(0.05, -0.03, 0.02),
        baro_offset_m: 4.0,
        gnss_drift_ned_m: Vec3::new(0.5, -0.4, 0.8),
        heading_bias_rad: 0.02,
    };
    navigation.specific_force_body_m_s2 = MEASURED_FORCE - navigation.now.accel_bias_m_s2;
    navigation.rate_body_rad_s = MEASURED_RATE - navigation.now.gyro_bias_rad_s;
    navigation.remember(SimTime::from_s(1.0));
    navigation
}

const MEASURED_FORCE: Vec3 = Vec3::new(0.3, -0.2, -10.5);
const MEASURED_RATE: Vec3 = Vec3::new(0.2, -0.3, 0.1);

/// The same with an error added, as if it had been there all along.
fn disturbed(navigation: &Navigation, state: usize, size: f64) -> Navigation {
    let mut other = navigation.clone();
    let mut error = Row::zeros();
    error[state] = size;
    other.now.add(&error);
    other.rate_body_rad_s = MEASURED_RATE - other.now.gyro_bias_rad_s;
    other.specific_force_body_m_s2 = MEASURED_FORCE - other.now.accel_bias_m_s2;
    other.remember(SimTime::from_s(1.0));
    other
}

/// Error of `a` against `b`.
fn difference(a: &Nominal, b: &Nominal) -> Row {
    let mut error = Row::zeros();
    let turn = (a.q_ned_from_body * b.q_ned_from_body.inverse()).scaled_axis();
    let blocks = [
        (P, a.position_ned_m - b.position_ned_m),
        (V, a.velocity_ned_m_s - b.velocity_ned_m_s),
        (TH, turn),
        (BG, a.gyro_bias_rad_s - b.gyro_bias_rad_s),
        (BA, a.accel_bias_m_s2 - b.accel_bias_m_s2),
        (DRIFT, a.gnss_drift_ned_m - b.gnss_drift_ned_m),
    ];
    for (at, block) in blocks {
        error.fixed_rows_mut::<3>(at).copy_from(&block);
    }
    error[BARO] = a.baro_offset_m - b.baro_offset_m;
    error[HEADING] = a.heading_bias_rad - b.heading_bias_rad;
    error
}

fn predicted(navigation: &Navigation) -> Navigation {
    let mut next = navigation.clone();
    let (f, w) = (MEASURED_FORCE - next.now.accel_bias_m_s2, MEASURED_RATE - next.now.gyro_bias_rad_s);
    next.predict(f, w, DT_S);
    next
}

#[test]
fn the_transition_is_the_derivative_of_the_prediction() {
    let mut navigation = in_flight();
    for state in 0..STATES {
        let [low, high] = [-STEP, STEP].map(|size| predicted(&disturbed(&navigation, state, size)).now);
        let numeric = difference(&high, &low) / (2.0 * STEP);
        // Out of certainty but for one state comes φ φᵀ with φ that state's column, whose own entry is one.
        navigation.covariance = Covariance::zeros();
        navigation.covariance[(state, state)] = 1.0;
        let after = predicted(&navigation).covariance;
        let mut column = after.column(state).into_owned();
        if state == HEADING {
            column[HEADING] -= HEADING_WALK_RAD_SQRT_S * HEADING_WALK_RAD_SQRT_S * DT_S;
        }
        let error = (column - numeric).amax();
        assert!(error < 1e-6, "state {state}: {error}");
    }
}

/// Largest difference between the rows of a measurement and the derivative of what it expects, but for `left_out`.
fn worst_row(scalars: impl Fn(&Navigation) -> Vec<Scalar>, left_out: &[usize]) -> f64 {
    let navigation = in_flight();
    let rows = scalars(&navigation);
    let mut worst = 0.0f64;
    for state in (0..STATES).filter(|state| !left_out.contains(state)) {
        let [low, high] = [-STEP, STEP].map(|size| scalars(&disturbed(&navigation, state, size)));
        for (i, scalar) in rows.iter().enumerate() {
            // What is expected grows as the innovation falls.
            let numeric = (low[i].innovation - high[i].innovation) / (2.0 * STEP);
            worst = worst.max((scalar.row[state] - numeric).abs());
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
    let field = in_flight().now.q_ned_from_body.inverse() * Vec3::new(2.39e-5, -2.6e-6, 3.86e-5);
    let heading = worst_row(|n| vec![n.magnetometer_scalar(&field).unwrap()], &[TH, TH + 1]);
    assert!(heading < 1e-6, "{heading}");
    let range = AltimeterSample { range_m: Some(19.0), minimum_m: 0.2, maximum_m: 40.0 };
    let range = worst_row(|n| vec![n.altimeter_scalar(&range, time).unwrap()], &[TH, TH + 1, TH + 2]);
    assert!(range < 1e-6, "{range}");

    let pad = worst_row(|n| n.pad_scalars().to_vec(), &[]);
    assert!(pad < 1e-6, "{pad}");
}

/// The update takes K s Kᵀ away. Joseph's form, (1 - K h) C (1 - K h)ᵀ + K r Kᵀ, is the same for the optimal gain, and
/// neither loses symmetry or positive definiteness over a flight's worth of updates.
#[test]
fn the_update_is_joseph_s_and_the_covariance_stays_one() {
    let mut navigation = in_flight();
    navigation.parameters.accelerometer = [0.017, 0.05, 3e-4];
    navigation.parameters.gyroscope = [1.6e-3, 8.7e-4, 2e-5];
    navigation.covariance = navigation.initial_covariance(30.0);
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
        navigation.step(&m, GroundState::No);
        // What is measured is what is expected: the covariance does not look at the values.
        let field = navigation.now.q_ned_from_body.inverse() * Vec3::new(2.39e-5, -2.6e-6, 3.86e-5);
        if step % 5 == 0 {
            let scalar = navigation.magnetometer_scalar(&field).unwrap();
            let before = navigation.covariance;
            navigation.use_magnetometer(&field);
            let gain = before * scalar.row / (scalar.row.dot(&(before * scalar.row)) + scalar.variance);
            let keep = Covariance::identity() - gain * scalar.row.transpose();
            let joseph = keep * before * keep.transpose() + gain * scalar.variance * gain.transpose();
            worst = worst.max((joseph - navigation.covariance).amax() / before.amax());
        }
        if step % 25 == 0 {
            let lever = navigation.parameters.gnss.antenna_body_m - navigation.parameters.imu_body_m;
            let antenna = navigation.now.position_ned_m + navigation.now.q_ned_from_body * lever;
            let p = antenna + navigation.now.gnss_drift_ned_m;
            let place = Datum::new(0.497, -1.406, 3.0).geodetic(&p);
            let fix = GnssFix {
                latitude_rad: place.latitude_rad,
                longitude_rad: place.longitude_rad,
                altitude_m: place.altitude_m,
                velocity_ned_m_s: navigation.now.velocity_ned_m_s,
                horizontal_accuracy_m: 1.0,
                vertical_accuracy_m: 1.0,
                fix_type: 3,
                satellites: 12,
            };
            navigation.use_gnss(&fix, time);
        }
        assert_eq!(navigation.covariance, navigation.covariance.transpose(), "step {step}");
        assert!(navigation.covariance.cholesky().is_some(), "step {step}");
    }
    // Round-off of twenty terms.
    assert!(worst < 1e-13, "{worst}");
    assert_eq!(navigation.health.resets, 0);
}
