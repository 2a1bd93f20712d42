//! The navigation filter in flight, on the plant of the tests' own: what it learns, what it expects, how it
//! coasts.

#![allow(clippy::disallowed_macros)] // figures of a run are printed for the record

use crate::fixture::autopilot_plant::{Conditions, IMU_BODY_M, Plant, parameters};
use hopbench::autopilot::navigation::{InnovationTally, Source};
use hopbench::autopilot::{Autopilot, Mission, Parameters};
use hopbench::signal::ActuatorCommand;

/// Flies until `until_s`; `each` sees plant and autopilot after every sample.
fn fly(told: Parameters, conditions: Conditions, until_s: f64, mut each: impl FnMut(&Plant, &Autopilot)) {
    let (mut autopilot, mut plant) = (Autopilot::new(told), Plant::new(conditions));
    let mut command = ActuatorCommand::SAFE;
    while plant.time_s() < until_s {
        let m = plant.advance(&command);
        command = autopilot.update(&m);
        each(&plant, &autopilot);
    }
}

fn told(conditions: &Conditions) -> Parameters {
    parameters(Mission::default(), conditions.rtk)
}

/// Mean of the squared innovations over their variance, by source, from hover to the last metres.
#[test]
fn innovations_are_as_large_as_the_filter_expects() {
    // What is expected is the noise, times what the filter takes it too large on purpose (1.3 for barometer
    // and magnetometer, 5 mm, 1 cm/s and 1 cm in quadrature for fixes and ranges), so that the mean lies
    // under one.
    let cases = [
        (Source::GnssPosition, 0.80),
        (Source::GnssVelocity, 0.85),
        (Source::Barometer, 1.0 / 1.69),
        (Source::Magnetometer, 1.0 / 1.69),
        (Source::Altimeter, 0.80),
    ];
    let mut sums = [InnovationTally::default(); 5];
    for seed in 0..12 {
        let conditions = Conditions::dispersed(900 + seed);
        let mut first = None;
        let mut last = None;
        fly(told(&conditions), conditions, 40.0, |plant, autopilot| {
            let now = cases.map(|(source, _)| autopilot.navigation().tally(source));
            if plant.time_s() > 15.0 {
                first.get_or_insert(now);
            }
            last = Some(now);
        });
        for ((sum, last), first) in sums.iter_mut().zip(last.unwrap()).zip(first.unwrap()) {
            sum.count += last.count - first.count;
            sum.normalised_squares += last.normalised_squares - first.normalised_squares;
        }
    }
    for ((source, expected), sum) in cases.into_iter().zip(sums) {
        let (n, mean) = (sum.count as f64, sum.normalised_squares / sum.count as f64);
        eprintln!("{source:?}: mean {mean:.3} of {n}, expected about {expected:.3}");
        // Chi-square of n scalars over n: 1 ± 1.96 √(2/n) in 95 %, doubled for the correlation that bias and
        // drift leave between one innovation and the next. Above is what counts: there the filter would be
        // too sure.
        let band = 2.0 * 1.96 * (2.0 / n).sqrt();
        assert!(n > 1000.0 && mean < 1.0 + band, "{source:?}: {mean} of {n}");
        assert!(mean > 0.75 * expected - band, "{source:?}: {mean} of {n}");
    }
}

#[test]
fn biases_are_learnt() {
    let flights = 10;
    let (mut gyro2, mut gyro_start2, mut accel2) = (0.0, 0.0, 0.0);
    for seed in 0..flights {
        let conditions = Conditions { rtk: true, ..Conditions::dispersed(920 + seed) };
        let mut end = [0.0; 3];
        fly(told(&conditions), conditions, 39.0, |plant, autopilot| {
            let e = autopilot.estimate();
            let truth = plant.accelerometer_bias();
            let gyro = (plant.gyro_bias() - e.gyro_bias_rad_s).norm_squared() / 3.0;
            if plant.time_s() < 4.5 {
                end[0] = gyro;
            }
            end[1] = gyro;
            end[2] = (truth.z - e.accel_bias_m_s2.z).powi(2);
        });
        gyro_start2 += end[0] / flights as f64;
        gyro2 += end[1] / flights as f64;
        accel2 += end[2] / flights as f64;
    }
    let [gyro, gyro_start, accel] = [gyro2, gyro_start2, accel2].map(f64::sqrt);
    eprintln!(
        "gyroscope bias {gyro:.2e} rad/s (aligned {gyro_start:.2e}), accelerometer bias {accel:.2e} m/s²"
    );
    // Turned on with 8.7e-4 rad/s and 0.05 m/s²; the walk of 40 s is 1.3e-4 rad/s and 1.9e-3 m/s². Gyroscope:
    // no worse than its walk since the alignment. Accelerometer along the thrust: a fifth of what it was
    // turned on with.
    assert!(gyro < 1.5 * 1.3e-4, "{gyro}");
    assert!(accel < 0.2 * 0.05, "{accel}");
}

#[test]
fn five_seconds_without_satellites_cost_less_than_a_metre_and_a_half() {
    let mut worst = 0.0f64;
    for seed in 0..20 {
        let conditions =
            Conditions { gnss_outage_s: Some((20.0, 25.0)), ..Conditions::dispersed(940 + seed) };
        // The error that grows: plain fixes carry a drift of their own, which is there before.
        let mut before = None;
        fly(told(&conditions), conditions, 25.0, |plant, autopilot| {
            let error = plant.position_ned_m + plant.q * IMU_BODY_M
                - autopilot.navigation().point(IMU_BODY_M).position_ned_m;
            let grown = error - *before.get_or_insert(error);
            if plant.time_s() < 20.0 {
                before = Some(error);
            } else {
                worst = worst.max(libm::hypot(grown.x, grown.y));
            }
        });
    }
    eprintln!("grown by up to {worst:.2} m in 5 s");
    assert!(worst < 1.5, "{worst}");
}

/// The same flights with a filter that takes late measurements for fresh ones.
#[test]
fn knowing_the_delays_is_worth_it() {
    let rms = |knows: fn(&mut Parameters)| {
        let (mut sum, mut count) = (0.0, 0.0);
        for seed in 0..6 {
            // RTK, where centimetres show; the climb and the way down, where a delay is a distance.
            let conditions = Conditions { rtk: true, ..Conditions::dispersed(960 + seed) };
            let mut told = told(&conditions);
            knows(&mut told);
            fly(told, conditions, 36.0, |plant, autopilot| {
                if plant.time_s() > 8.0 {
                    let e = plant.velocity_ned_m_s - autopilot.estimate().velocity_ned_m_s;
                    sum += e.norm_squared();
                    count += 1.0;
                }
            });
        }
        f64::sqrt(sum / count)
    };
    let with = rms(|_| {});
    let without = rms(|p| {
        p.navigation.gnss.delay_s = 0.0;
        p.navigation.barometer_delay_s = 0.0;
        p.navigation.altimeter_delay_s = 0.0;
    });
    eprintln!("velocity error {with:.3} m/s with delays known, {without:.3} m/s without");
    // 0.1 s at up to 1.6 m/s² of the ramps is 0.16 m/s while they last.
    assert!(without > 1.5 * with, "{with} {without}");
}
