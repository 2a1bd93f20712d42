//! Tests of the suite as a whole, on the parameters of the reference vehicle.

use nalgebra::UnitQuaternion;

use super::*;
use crate::environment::wind::WindParameters;
use crate::environment::{Site, terrain::Terrain};
use crate::frame::{Vec3, frd_from_structural};

const G: f64 = 9.80665;
const STEP: SimTime = SimTime::from_us(1000);

#[derive(Deserialize)]
struct VehicleFile {
    site: Site,
    sensors: SensorParameters,
}

/// The tables of the reference vehicle, with positions in FRD.
fn reference() -> (SensorParameters, Environment) {
    let text = include_str!("../../scenarios/vehicles/reference.toml");
    let VehicleFile { site, sensors } = toml::from_str(text).unwrap();
    (sensors, Environment::new(&site, &WindParameters::default(), 1).unwrap())
}

/// The same instruments without any error, delay and range left as they are.
fn faultless() -> (SensorParameters, Environment) {
    let (mut p, environment) = reference();
    p.imu.accelerometer.noise_density_m_s2_sqrt_hz = 0.0;
    p.imu.accelerometer.bias_std_m_s2 = 0.0;
    p.imu.accelerometer.random_walk_m_s2_sqrt_s = 0.0;
    p.imu.gyroscope.noise_density_rad_s_sqrt_hz = 0.0;
    p.imu.gyroscope.bias_std_rad_s = 0.0;
    p.imu.gyroscope.random_walk_rad_s_sqrt_s = 0.0;
    p.gnss.plain = ReceiverParameters {
        horizontal_noise_std_m: 0.0,
        vertical_noise_std_m: 0.0,
        horizontal_drift_std_m: 0.0,
        vertical_drift_std_m: 0.0,
        horizontal_velocity_noise_std_m_s: 0.0,
        vertical_velocity_noise_std_m_s: 0.0,
        ..p.gnss.plain
    };
    p.barometer.noise_density_pa_sqrt_hz = 0.0;
    p.barometer.bias_std_pa = 0.0;
    p.barometer.random_walk_pa_sqrt_s = 0.0;
    p.magnetometer.noise_density_t_sqrt_hz = 0.0;
    p.magnetometer.bias_std_t = 0.0;
    p.altimeter.noise_std_m = 0.0;
    p.altimeter.noise_fraction = 0.0;
    p.altimeter.bias_std_m = 0.0;
    for transducer in &mut p.pressure_transducer {
        transducer.noise_std_pa = 0.0;
        transducer.bias_std_pa = 0.0;
    }
    p.tracking = TrackingParameters {
        position_noise_std_m: 0.0,
        velocity_noise_std_m_s: 0.0,
        attitude_noise_std_rad: 0.0,
        rate_noise_std_rad_s: 0.0,
        ..p.tracking
    };
    (p, environment)
}

/// At rest, upright on the pad.
fn at_rest(time: SimTime) -> Truth {
    Truth {
        position_ned_m: Vec3::new(0.0, 0.0, -0.741),
        velocity_ned_m_s: Vec3::zeros(),
        q_ned_from_body: UnitQuaternion::identity(),
        rate_body_rad_s: Vec3::zeros(),
        specific_force_integral_body_m_s: Vec3::new(0.0, 0.0, -G * time.s()),
        rate_integral_body_rad: Vec3::zeros(),
        wind_ned_m_s: Vec3::zeros(),
        tank_pa: 65e5,
        bottle_pa: 300e5,
        injector_inlet_pa: 101_325.0,
        chamber_pa: 101_325.0,
    }
}

/// All measurements of a run of `seconds`.
fn run(
    (parameters, environment): &(SensorParameters, Environment),
    seed: u64,
    seconds: f64,
    truth: impl Fn(SimTime) -> Truth,
) -> Vec<Measurement> {
    let setup =
        SensorSetup { environment, seed, step: STEP, initial: &truth(SimTime::ZERO), gnss_delay_s: None };
    let mut suite = SensorSuite::new(parameters, &setup).unwrap();
    let steps = SimTime::from_s(seconds).us() / STEP.us();
    (1..=steps)
        .filter_map(|k| {
            let time = SimTime::from_us(k * STEP.us());
            suite.sample(&truth(time), time)
        })
        .collect()
}

/// Mean and standard deviation.
fn statistics(x: impl Iterator<Item = f64>) -> (f64, f64, f64) {
    let x: Vec<f64> = x.collect();
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let variance = x.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
    (mean, variance.sqrt(), n)
}

#[test]
fn the_reference_file_is_valid() {
    let (parameters, environment) = reference();
    parameters.validate().unwrap();
    assert_eq!(environment.terrain, Terrain);
    assert_eq!(parameters.pressure_transducer.len(), 4);
    assert_eq!(parameters.altimeter.direction, [0.0, 0.0, -1.0], "down, in the structural frame");
    assert_eq!(parameters.tracking, TrackingParameters::default());
}

#[test]
fn every_sensor_keeps_its_rate_to_the_microsecond() {
    let seconds = 2.0;
    let measurements = run(&reference(), 1, seconds, at_rest);
    let times = |has: fn(&Measurement) -> bool| -> Vec<u64> {
        measurements.iter().filter(|m| has(m)).map(|m| m.time.us()).collect()
    };
    let every = |period: u64| (1..=2_000_000 / period).map(|k| k * period).collect::<Vec<_>>();
    assert_eq!(times(|m| m.imu.is_some()), every(4_000));
    assert_eq!(measurements.len(), 500);
    assert_eq!(times(|m| m.barometer.is_some()), every(20_000));
    assert_eq!(times(|m| m.magnetic_field_body_t.is_some()), every(20_000));
    assert_eq!(times(|m| m.altimeter.is_some()), every(20_000));
    assert_eq!(times(|m| m.tracking.is_some()), every(20_000));
    assert_eq!(times(|m| m.gnss.is_some()), every(100_000));
    assert_eq!(times(|m| m.pressures.bottle_pa.is_some()), every(20_000));
    // 200 Hz rides on 250 Hz: each sample waits for the next multiple of 4 ms.
    let waits = (1..=400_u64).map(|k| (5_000 * k).div_ceil(4_000) * 4_000).collect::<Vec<_>>();
    assert_eq!(times(|m| m.pressures.tank_pa.is_some()), waits);
}

#[test]
fn the_rate_of_the_inertial_unit_moves_no_other_sensor() {
    let mut fast = reference();
    fast.0.imu.rate_hz = 500.0;
    let pick = |measurements: Vec<Measurement>| -> Vec<_> {
        measurements
            .into_iter()
            .filter(|m| m.barometer.is_some())
            .map(|m| (m.time, m.gnss, m.barometer, m.magnetic_field_body_t, m.altimeter, m.tracking))
            .collect()
    };
    let usual = pick(run(&reference(), 5, 1.0, at_rest));
    assert_eq!(usual.len(), 50);
    assert_eq!(usual, pick(run(&fast, 5, 1.0, at_rest)));
}

#[test]
fn a_seed_repeats_bit_for_bit_and_another_differs() {
    let one = run(&reference(), 11, 1.0, at_rest);
    assert_eq!(one, run(&reference(), 11, 1.0, at_rest));
    let other = run(&reference(), 12, 1.0, at_rest);
    assert!(one.iter().zip(&other).all(|(a, b)| a.imu != b.imu));
}

#[test]
fn removing_a_sensor_moves_no_other() {
    let mut fewer = reference();
    fewer.0.pressure_transducer.remove(0);
    let (all, fewer) = (run(&reference(), 3, 1.0, at_rest), run(&fewer, 3, 1.0, at_rest));
    for (a, b) in all.iter().zip(&fewer) {
        let mut a = a.clone();
        a.pressures.tank_pa = None;
        assert_eq!(&a, b);
    }
}

/// Deviation s of n samples has standard error s/sqrt(2n); bound of five. The bias of this seed is part
/// of the mean, hence statistics about it; its walk adds rw² t/6 or so, 1e-6 of the variance here.
#[test]
fn white_noise_has_the_density_of_the_file() {
    let measurements = run(&reference(), 21, 200.0, at_rest);
    let check = |what: &str, samples: Vec<f64>, expected: f64| {
        let (_, std, n) = statistics(samples.into_iter());
        assert!((std / expected - 1.0).abs() < 5.0 / (2.0 * n).sqrt(), "{what}: {std} against {expected}");
    };
    for axis in 0..3 {
        let imu = |pick: fn(&crate::signal::ImuSample) -> Vec3| {
            measurements.iter().filter_map(|m| m.imu.as_ref()).map(|s| pick(s)[axis]).collect()
        };
        check("accelerometer", imu(|s| s.specific_force_body_m_s2), 1.5e-3 * 125.0_f64.sqrt());
        check("gyroscope", imu(|s| s.rate_body_rad_s), 1.4e-4 * 125.0_f64.sqrt());
        let field = measurements.iter().filter_map(|m| m.magnetic_field_body_t).map(|b| b[axis]).collect();
        check("magnetometer", field, 2.0e-7);
        let speed = measurements.iter().filter_map(|m| m.gnss).map(|g| g.velocity_ned_m_s[axis]).collect();
        check("gnss velocity", speed, if axis == 2 { 0.08 } else { 0.05 });
    }
    let range = measurements.iter().filter_map(|m| m.altimeter).filter_map(|a| a.range_m).collect();
    let true_m: f64 = 0.741 + 0.05;
    check("altimeter", range, (0.02_f64.powi(2) + (0.002 * true_m).powi(2)).sqrt());
    let tank = measurements.iter().filter_map(|m| m.pressures.tank_pa).collect();
    check("tank", tank, 5e3);
}

/// Over seeds, the mean of a second is the bias: normal, with the file's deviation, and its own standard
/// error over m runs is 1/sqrt(2m). White noise of the mean adds 1.5e-3 sqrt(1/2) m/s² to 0.05: 0.02 %.
#[test]
fn bias_is_drawn_once_per_run_and_at_rest_z_reads_minus_gravity() {
    let (parameters, environment) = reference();
    let biases: Vec<Vec3> = (0..400)
        .map(|seed| {
            let world = (parameters.clone(), environment.clone());
            let samples = run(&world, seed, 1.0, at_rest);
            let sum: Vec3 =
                samples.iter().filter_map(|m| m.imu.as_ref()).map(|s| s.specific_force_body_m_s2).sum();
            sum / samples.len() as f64 + Vec3::new(0.0, 0.0, G)
        })
        .collect();
    for axis in 0..3 {
        let (mean, std, n) = statistics(biases.iter().map(|b| b[axis]));
        assert!((std / 0.05 - 1.0).abs() < 5.0 / (2.0 * n).sqrt() + 1e-3, "{std}");
        assert!(mean.abs() < 5.0 * 0.05 / n.sqrt(), "{mean}");
    }
}

/// Faultless at rest: difference of integrals of up to 98 m/s over 4 ms, rounding 98 x 1e-16 / 4e-3.
#[test]
fn a_faultless_unit_at_rest_reads_minus_gravity_exactly() {
    for m in run(&faultless(), 1, 10.0, at_rest) {
        let imu = m.imu.unwrap();
        assert!((imu.specific_force_body_m_s2 - Vec3::new(0.0, 0.0, -G)).amax() < 1e-11);
        assert_eq!(imu.rate_body_rad_s, Vec3::zeros());
        assert_eq!(imu.interval_s, 0.004);
    }
}

/// An impact of 1 m/s in a single step lies between two samples: the sum of samples times their interval
/// still is the velocity gained. Tolerance: rounding.
#[test]
fn samples_are_means_so_no_impulse_is_lost() {
    let impact = |time: SimTime| {
        let mut truth = at_rest(time);
        if time.us() >= 502_000 {
            truth.specific_force_integral_body_m_s.z -= 0.5;
            truth.rate_integral_body_rad.y += 0.1;
        }
        truth
    };
    let samples = run(&faultless(), 1, 1.0, impact);
    let gained: Vec3 =
        samples.iter().filter_map(|m| m.imu).map(|s| s.specific_force_body_m_s2 * s.interval_s).sum();
    assert!((gained - Vec3::new(0.0, 0.0, -G - 0.5)).amax() < 1e-11);
    let hit = samples.iter().find(|m| m.time.us() == 504_000).unwrap().imu.unwrap();
    assert!((hit.specific_force_body_m_s2.z + G + 125.0).abs() < 1e-9);
    assert!((hit.rate_body_rad_s.y - 25.0).abs() < 1e-9);
}

#[test]
fn converters_clamp_at_their_range() {
    let violent = |time: SimTime| Truth {
        specific_force_integral_body_m_s: Vec3::new(1.0, -1.0, 0.0) * 1e4 * time.s(),
        rate_integral_body_rad: Vec3::new(0.0, 500.0, -500.0) * time.s(),
        tank_pa: 200e5,
        ..at_rest(time)
    };
    for m in run(&reference(), 1, 0.1, violent) {
        let imu = m.imu.unwrap();
        assert_eq!((imu.specific_force_body_m_s2.x, imu.specific_force_body_m_s2.y), (156.9, -156.9));
        assert_eq!((imu.rate_body_rad_s.y, imu.rate_body_rad_s.z), (34.9, -34.9));
        assert!(m.pressures.tank_pa.is_none_or(|p| p == 100e5));
    }
}

/// Climbing at 10 m/s: what is read tells the instant that it describes. Interpolation of a straight line
/// is exact; the rest is rounding, for a fix that of Earth-centred coordinates (nm).
#[test]
fn delays_are_exact() {
    let climb = |time: SimTime| Truth {
        position_ned_m: Vec3::new(0.0, 0.0, -1.0 - 10.0 * time.s()),
        velocity_ned_m_s: Vec3::new(0.0, 0.0, -10.0),
        ..at_rest(time)
    };
    let mut world = faultless();
    world.0.altimeter.delay_s = 0.0123; // no whole number of steps
    for m in run(&world, 1, 2.0, climb) {
        let t = m.time.s();
        if let Some(fix) = m.gnss {
            let seen_s = (fix.altitude_m - 3.0 - 1.0 - 1.32) / 10.0;
            assert!((seen_s - (t - 0.12).max(0.0)).abs() < 1e-8, "{t}: {seen_s}");
        }
        if let Some(altimeter) = m.altimeter {
            let seen_s = (altimeter.range_m.unwrap() - 1.0 - 0.05) / 10.0;
            assert!((seen_s - (t - 0.0123)).abs() < 1e-12, "{t}: {seen_s}");
        }
        if let Some(baro) = m.barometer {
            // The standard atmosphere stands on the pad, so its altitude is height above the pad.
            let seen_s = (baro.pressure_altitude_m - 1.0 - 1.25) / 10.0;
            assert!((seen_s - (t - 0.02)).abs() < 1e-9, "{t}: {seen_s}");
        }
        if let Some(pose) = m.tracking {
            let seen_s = (-pose.position_ned_m.z - 1.0) / 10.0;
            assert!((seen_s - (t - 0.02)).abs() < 1e-12, "{t}: {seen_s}");
        }
    }
}

#[test]
fn a_profile_may_replace_the_delay_of_satellite_navigation() {
    let (parameters, environment) = faultless();
    let climb =
        |time: SimTime| Truth { position_ned_m: Vec3::new(0.0, 0.0, -10.0 * time.s()), ..at_rest(time) };
    let initial = climb(SimTime::ZERO);
    let setup = SensorSetup {
        environment: &environment,
        seed: 1,
        step: STEP,
        initial: &initial,
        gnss_delay_s: Some(0.01),
    };
    let mut suite = SensorSuite::new(&parameters, &setup).unwrap();
    let fixes = (1..=200).filter_map(|k| {
        let time = SimTime::from_us(1000 * k);
        suite.sample(&climb(time), time)?.gnss
    });
    let altitudes: Vec<f64> = fixes.map(|fix| fix.altitude_m - 3.0 - 1.32).collect();
    assert!((altitudes[0] - 0.9).abs() < 1e-8 && (altitudes[1] - 1.9).abs() < 1e-8, "{altitudes:?}");
}

#[test]
fn a_delayed_inertial_unit_is_not_weightless_at_the_start() {
    let mut world = faultless();
    world.0.imu.delay_s = 0.010;
    let spin = |time: SimTime| Truth {
        rate_integral_body_rad: Vec3::new(0.0, 0.0, 0.5 * time.s() * time.s()),
        ..at_rest(time)
    };
    for m in run(&world, 1, 0.1, spin) {
        let imu = m.imu.unwrap();
        assert!((imu.specific_force_body_m_s2.z + G).abs() < 1e-11);
        // The mean of a rate of 1 rad/s² over an interval is the rate at its middle.
        let middle_s = (m.time.s() - 0.010).max(0.004) - 0.002;
        assert!((imu.rate_body_rad_s.z - middle_s).abs() < 1e-12);
    }
}

/// A steady spin about z carries the antenna around: lever arms in position and in velocity.
#[test]
fn the_antenna_moves_with_the_body() {
    let mut world = faultless();
    world.0.gnss.plain.delay_s = 0.0;
    world.0.gnss.antenna_position_m = [2.0, 0.0, 1.0];
    let spin = |time: SimTime| Truth {
        q_ned_from_body: UnitQuaternion::from_axis_angle(&Vec3::z_axis(), 3.0 * time.s()),
        rate_body_rad_s: Vec3::new(0.0, 0.0, 3.0),
        ..at_rest(time)
    };
    let datum = world.1.datum;
    for m in run(&world, 1, 1.0, spin) {
        let Some(fix) = m.gnss else { continue };
        let (s, c) = libm::sincos(3.0 * m.time.s());
        let place = crate::environment::geodesy::Geodetic {
            latitude_rad: fix.latitude_rad,
            longitude_rad: fix.longitude_rad,
            altitude_m: fix.altitude_m,
        };
        let expected = Vec3::new(2.0 * c, 2.0 * s, -1.741);
        assert!((datum.position_ned_m(&place) - expected).amax() < 1e-8);
        assert!((fix.velocity_ned_m_s - Vec3::new(-6.0 * s, 6.0 * c, 0.0)).amax() < 1e-12);
    }
}

/// Drift dominates a fix over a short run: its deviation over seeds is that of the file, white noise in
/// quadrature. Standard error 1/sqrt(2m); bound of five.
#[test]
fn plain_fixes_wander_by_a_metre_and_rtk_by_centimetres() {
    for (grade, horizontal_m, vertical_m) in [
        (GnssGrade::Plain, root_sum_square(0.15, 0.60), root_sum_square(0.30, 1.00)),
        (GnssGrade::Rtk, root_sum_square(0.010, 0.010), root_sum_square(0.015, 0.015)),
    ] {
        let mut world = reference();
        world.0.gnss.grade = grade;
        let antenna =
            at_rest(SimTime::ZERO).point_ned_m(&frd_from_structural(world.0.gnss.antenna_position_m));
        let errors: Vec<Vec3> = (0..1000)
            .map(|seed| {
                let fix = run(&world, seed, 0.1, at_rest).pop().unwrap().gnss.unwrap();
                assert_eq!(fix.fix_type, if grade == GnssGrade::Rtk { 6 } else { 3 });
                let place = crate::environment::geodesy::Geodetic {
                    latitude_rad: fix.latitude_rad,
                    longitude_rad: fix.longitude_rad,
                    altitude_m: fix.altitude_m,
                };
                world.1.datum.position_ned_m(&place) - antenna
            })
            .collect();
        for (axis, expected) in [(0, horizontal_m), (1, horizontal_m), (2, vertical_m)] {
            let (_, std, n) = statistics(errors.iter().map(|e| e[axis]));
            assert!((std / expected - 1.0).abs() < 5.0 / (2.0 * n).sqrt(), "{grade:?} {axis}: {std}");
        }
    }
}

fn root_sum_square(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}

#[test]
fn the_altimeter_reads_slant_range_or_nothing() {
    let tilted_at = |tilt_rad: f64, height_m: f64| {
        let truth = move |time: SimTime| Truth {
            position_ned_m: Vec3::new(0.0, 0.0, -height_m),
            q_ned_from_body: UnitQuaternion::from_axis_angle(&Vec3::x_axis(), tilt_rad),
            ..at_rest(time)
        };
        run(&faultless(), 1, 0.02, truth).pop().unwrap().altimeter.unwrap().range_m
    };
    // Tilted about x, the sensor at z = -0.05 stands 0.05 cos higher than the pivot.
    let cos = libm::cos(0.4);
    assert!((tilted_at(0.4, 10.0).unwrap() - (10.0 + 0.05 * cos) / cos).abs() < 1e-12);
    assert_eq!(tilted_at(0.53, 10.0), None);
    assert_eq!(tilted_at(3.0, 10.0), None);
    assert_eq!(tilted_at(0.0, 0.1), None);
    assert_eq!(tilted_at(0.0, 41.0), None);
}

#[test]
fn the_magnetometer_reads_the_field_in_body_axes() {
    let yawed = |time: SimTime| Truth {
        q_ned_from_body: UnitQuaternion::from_axis_angle(&Vec3::z_axis(), core::f64::consts::FRAC_PI_2),
        ..at_rest(time)
    };
    let world = faultless();
    let b = world.1.magnetic_field_ned_t;
    let read = run(&world, 1, 0.02, yawed).pop().unwrap().magnetic_field_body_t.unwrap();
    // Facing east: x reads east, y reads south.
    assert!((read - Vec3::new(b.y, -b.x, b.z)).amax() < 1e-18);
}

/// A quarter of dynamic pressure, q = 1.225/2 (10 - 4)² = 22.05 Pa.
#[test]
fn the_barometer_feels_dynamic_pressure_of_the_air_relative_velocity() {
    let mut world = faultless();
    let moving = |time: SimTime| Truth {
        velocity_ned_m_s: Vec3::new(10.0, 0.0, 0.0),
        wind_ned_m_s: Vec3::new(4.0, 0.0, 0.0),
        ..at_rest(time)
    };
    let pressure = |world: &_| run(world, 1, 0.02, moving).pop().unwrap().barometer.unwrap().pressure_pa;
    let still_pa = pressure(&world);
    world.0.barometer.dynamic_pressure_coefficient = 0.25;
    assert!((pressure(&world) - still_pa - 0.25 * 22.05).abs() < 1e-9);
}

/// A step through a first-order lag of 100 Hz, exact at every step for a held input.
#[test]
fn a_transducer_lags_by_its_bandwidth() {
    let mut world = faultless();
    world.0.imu.rate_hz = 1000.0;
    let step =
        |time: SimTime| Truth { chamber_pa: if time > SimTime::ZERO { 20e5 } else { 1e5 }, ..at_rest(time) };
    for m in run(&world, 1, 0.05, step) {
        if let Some(reading_pa) = m.pressures.chamber_pa {
            let expected_pa = 20e5 - 19e5 * libm::exp(-core::f64::consts::TAU * 100.0 * m.time.s());
            assert!((reading_pa - expected_pa).abs() < 1e-6, "{} {reading_pa}", m.time.s());
        }
    }
}

#[test]
fn no_two_consecutive_samples_are_alike() {
    let measurements = run(&reference(), 8, 5.0, at_rest);
    for pair in measurements.windows(2) {
        let (a, b) = (pair[0].imu.unwrap(), pair[1].imu.unwrap());
        assert_ne!(a.specific_force_body_m_s2, b.specific_force_body_m_s2);
        assert_ne!(a.rate_body_rad_s, b.rate_body_rad_s);
    }
    let pressures: Vec<f64> =
        measurements.iter().filter_map(|m| m.barometer).map(|b| b.pressure_pa).collect();
    assert!(pressures.windows(2).all(|p| p[0] != p[1]));
}

/// A plant of 20 ms steps: one sample per step, whose interval says so, and nothing lost.
#[test]
fn long_plant_steps_slow_the_unit_and_lose_nothing() {
    let (parameters, environment) = faultless();
    let step = SimTime::from_us(20_000);
    let setup = SensorSetup {
        environment: &environment,
        seed: 1,
        step,
        initial: &at_rest(SimTime::ZERO),
        gnss_delay_s: None,
    };
    let mut suite = SensorSuite::new(&parameters, &setup).unwrap();
    for k in 1..=50 {
        let time = SimTime::from_us(20_000 * k);
        let imu = suite.sample(&at_rest(time), time).unwrap().imu.unwrap();
        assert_eq!(imu.interval_s, 0.02);
        assert!((imu.specific_force_body_m_s2.z + G).abs() < 1e-12);
        assert_eq!(suite.sample(&at_rest(time), time), None, "the same instant again");
    }
}

#[test]
fn contradictions_are_named() {
    let refused_key = |change: fn(&mut SensorParameters)| {
        let (mut parameters, _) = reference();
        change(&mut parameters);
        parameters.validate().unwrap_err().key
    };
    assert_eq!(refused_key(|p| p.imu.rate_hz = 300.0), "imu.rate_hz");
    assert_eq!(refused_key(|p| p.gnss.rate_hz = 0.0), "gnss.rate_hz");
    assert_eq!(refused_key(|p| p.barometer.rate_hz = f64::NAN), "barometer.rate_hz");
    assert_eq!(refused_key(|p| p.magnetometer.rate_hz = 2000.0), "magnetometer.rate_hz");
    assert_eq!(refused_key(|p| p.altimeter.range_m = [5.0, 5.0]), "altimeter.range_m");
    assert_eq!(refused_key(|p| p.altimeter.direction = [0.0, 0.0, 0.5]), "altimeter.direction");
    assert_eq!(refused_key(|p| p.pressure_transducer[2].name = Tap::Tank), "pressure_transducer.2.name");
}
