//! Whole hops of the built-in autopilot on a plant of the test's own, pad to pad.
//!
//! Limits at first contact are those of the landing gear: 1.0 m/s down, 0.5 m/s sideways, 5 degrees; the
//! control error (estimate against target) has to stay within 0.5 m.

#![allow(clippy::disallowed_macros)] // figures of a run are printed for the record

use crate::fixture::autopilot_plant;
use crate::fixture::autopilot_plant::{Conditions, Plant, Touchdown, parameters};
use hopbench::autopilot::{Autopilot, Mission, Phase};
use hopbench::frame::Vec3;
use hopbench::signal::{ActuatorCommand, Throttle};

#[allow(dead_code)] // printed when a limit is missed
#[derive(Debug)]
struct Flight {
    touchdown: Touchdown,
    control_error_m: f64,
    navigation_error_m: f64,
    airborne_s: f64,
    greatest_height_m: f64,
    hover_height_rms_m: f64,
    hover_lateral_rms_m: f64,
    greatest_tilt_rad: f64,
    greatest_gimbal_rad: f64,
    greatest_slosh_m: f64,
    greatest_terminal_speed_m_s: f64,
    mass_error_kg: f64,
    disarmed: bool,
}

fn fly(mission: Mission, conditions: Conditions) -> Flight {
    let mut autopilot = Autopilot::new(parameters(mission.clone(), conditions.rtk));
    let mut plant = Plant::new(conditions);
    let mut command = ActuatorCommand::SAFE;
    let target = Vec3::new(mission.target_north_east_m[0], mission.target_north_east_m[1], 0.0);
    let (mut greatest_height_m, mut greatest_tilt_rad, mut greatest_slosh_m) = (0.0f64, 0.0f64, 0.0f64);
    let (mut greatest_gimbal_rad, mut hover_n, mut hover_z2, mut hover_xy2) = (0.0f64, 0.0, 0.0, 0.0);
    let mut greatest_terminal_speed_m_s = 0.0f64;
    let mut errors = None;
    let mut phase = Phase::Align;
    while plant.time_s() < 90.0 {
        let m = plant.advance(&command);
        command = autopilot.update(&m);
        within_limits(&command);
        let e = autopilot.estimate();
        if autopilot.phase() != phase {
            phase = autopilot.phase();
        }
        greatest_height_m = greatest_height_m.max(plant.height_m());
        if plant.touchdown.is_none() && plant.lift_off_s.is_some() {
            greatest_tilt_rad = greatest_tilt_rad.max(hopbench::frame::tilt_rad(&plant.q));
            greatest_slosh_m = greatest_slosh_m.max(libm::hypot(plant.slosh_m[0], plant.slosh_m[1]));
            greatest_gimbal_rad =
                greatest_gimbal_rad.max(command.gimbal_x_rad.abs()).max(command.gimbal_y_rad.abs());
        }
        if plant.touchdown.is_none()
            && !(phase.is_before_lift_off() || matches!(phase, Phase::Ascent | Phase::Hover))
            && plant.height_m() < mission.terminal_height_m
        {
            greatest_terminal_speed_m_s = greatest_terminal_speed_m_s.max(plant.com_velocity().z);
        }
        if phase == Phase::Hover {
            hover_n += 1.0;
            hover_z2 += (e.height_m - mission.hover_height_m).powi(2);
            let d = e.position_ned_m - autopilot.reference().position_ned_m;
            hover_xy2 += d.x * d.x + d.y * d.y;
        }
        if let (Some(touchdown), None) = (plant.touchdown, &errors) {
            let control = e.position_ned_m - target;
            let navigation = e.position_ned_m - touchdown.position_ned_m;
            errors = Some((libm::hypot(control.x, control.y), libm::hypot(navigation.x, navigation.y)));
        }
        if phase == Phase::Done {
            break;
        }
    }
    let touchdown = plant.touchdown.unwrap_or_else(|| {
        panic!("no touchdown: {} at {:.2} m, seed {}", phase.name(), plant.height_m(), plant.conditions.seed)
    });
    let (control_error_m, navigation_error_m) = errors.expect("set with the touchdown");
    Flight {
        touchdown,
        control_error_m,
        navigation_error_m,
        airborne_s: touchdown.time_s - plant.lift_off_s.expect("before touchdown"),
        greatest_height_m,
        hover_height_rms_m: (hover_z2 / f64::max(hover_n, 1.0)).sqrt(),
        hover_lateral_rms_m: (hover_xy2 / f64::max(hover_n, 1.0)).sqrt(),
        greatest_tilt_rad,
        greatest_gimbal_rad,
        greatest_slosh_m,
        greatest_terminal_speed_m_s,
        mass_error_kg: autopilot.estimate().mass_kg - plant.mass_kg(),
        disarmed: phase == Phase::Done && !command.armed,
    }
}

fn within_limits(c: &ActuatorCommand) {
    let limit = 7f64.to_radians();
    assert!(c.gimbal_x_rad.abs() <= limit && c.gimbal_y_rad.abs() <= limit, "{c:?}");
    assert!(c.rcs_roll.abs() <= 1.0, "{c:?}");
    match c.throttle {
        Throttle::ThrustN(t) => assert!(t == 0.0 || (300.0..=1050.0).contains(&t), "{c:?}"),
        Throttle::ValveRad(a) => assert!((0.0..=0.55).contains(&a), "{c:?}"),
    }
}

fn judge(flight: &Flight, seed: u64) {
    let t = &flight.touchdown;
    assert!(t.vertical_speed_m_s <= 1.0, "seed {seed}: {flight:?}");
    assert!(t.lateral_speed_m_s <= 0.5, "seed {seed}: {flight:?}");
    assert!(t.tilt_rad <= 5f64.to_radians(), "seed {seed}: {flight:?}");
    assert!(flight.control_error_m <= 0.5, "seed {seed}: {flight:?}");
    assert!(flight.disarmed, "seed {seed}: {flight:?}");
}

fn hop_5m() -> Mission {
    Mission {
        hover_height_m: 5.0,
        ascent_speed_m_s: 2.0,
        descent_speed_m_s: 1.5,
        hover_time_s: 5.0,
        ..Mission::default()
    }
}

/// Worst figures of a set of flights, for the record.
#[derive(Default)]
struct Worst([f64; 9]);

impl Worst {
    fn add(&mut self, f: &Flight) {
        let now = [
            f.touchdown.vertical_speed_m_s,
            f.greatest_terminal_speed_m_s,
            f.touchdown.lateral_speed_m_s,
            f.touchdown.tilt_rad.to_degrees(),
            f.control_error_m,
            f.navigation_error_m,
            f.hover_height_rms_m,
            f.hover_lateral_rms_m,
            f.airborne_s,
        ];
        for (worst, now) in self.0.iter_mut().zip(now) {
            *worst = worst.max(now);
        }
    }

    fn report(&self, name: &str) {
        eprintln!(
            "{name}: worst vertical {:.3} (below terminal height {:.3}) lateral {:.3} m/s, tilt {:.2} deg, control {:.3} navigation {:.3} m, \
             hover rms height {:.3} lateral {:.3} m, airborne {:.2} s",
            self.0[0], self.0[1], self.0[2], self.0[3], self.0[4], self.0[5], self.0[6], self.0[7], self.0[8]
        );
    }
}

#[test]
fn hop_of_50_m_in_wind_lands_within_limits_on_every_seed() {
    let mut worst = Worst::default();
    for seed in 0..24 {
        let flight = fly(Mission::default(), Conditions::dispersed(seed));
        judge(&flight, seed);
        assert!(flight.airborne_s <= 38.0, "seed {seed}: {flight:?}");
        assert!(flight.greatest_terminal_speed_m_s <= 0.85, "seed {seed}: {flight:?}");
        assert!((flight.greatest_height_m - 50.0).abs() < 0.5, "seed {seed}: {flight:?}");
        worst.add(&flight);
    }
    worst.report("hop 50 m");
}

#[test]
fn hop_of_5_m_in_wind_lands_within_limits_on_every_seed() {
    let mut worst = Worst::default();
    for seed in 100..124 {
        let flight = fly(hop_5m(), Conditions::dispersed(seed));
        judge(&flight, seed);
        worst.add(&flight);
    }
    worst.report("hop 5 m");
}

#[test]
fn landing_beside_the_start_is_reached() {
    let mission = Mission { target_north_east_m: [8.0, -5.0], ..Mission::default() };
    for seed in 200..206 {
        judge(&fly(mission.clone(), Conditions::dispersed(seed)), seed);
    }
}

/// Corners of what the loops are not told: dead time, slow gimbal, undamped slosh, inertia.
#[test]
fn loops_have_margin_against_dead_time_slow_servos_and_undamped_slosh() {
    let nominal = |seed| Conditions::dispersed(seed);
    let corners: [(&str, Conditions); 6] = [
        ("servo dead time 30 ms", Conditions { servo_delay_s: 0.030, ..nominal(300) }),
        ("gimbal at 5 Hz", Conditions { gimbal_natural_frequency_rad_s: 31.4, ..nominal(301) }),
        ("slosh damping 0.3 %", Conditions { slosh_damping: 0.003, ..nominal(302) }),
        ("inertia +30 %", Conditions { inertia_factor: 1.3, ..nominal(303) }),
        ("inertia -30 %", Conditions { inertia_factor: 0.7, ..nominal(304) }),
        (
            "all at once",
            Conditions {
                servo_delay_s: 0.020,
                gimbal_natural_frequency_rad_s: 40.0,
                slosh_damping: 0.005,
                inertia_factor: 0.8,
                ..nominal(305)
            },
        ),
    ];
    for (name, conditions) in corners {
        let seed = conditions.seed;
        let flight = fly(Mission::default(), conditions);
        let mut worst = Worst::default();
        worst.add(&flight);
        worst.report(name);
        judge(&flight, seed);
        assert!(flight.greatest_tilt_rad < 8f64.to_radians(), "{name}: {flight:?}");
    }
}

/// Flies with `pilot` until `at_s` while another autopilot shadows, which then lands.
fn hand_over(mission: &Mission, conditions: Conditions, at_s: f64, valve: bool) -> (Phase, Option<Flight>) {
    let mut theirs = parameters(mission.clone(), conditions.rtk);
    if valve {
        theirs.actuators.throttle_output = hopbench::autopilot::allocation::ThrottleOutput::Valve;
    }
    let mut pilot = Autopilot::new(theirs);
    let mut shadow = Autopilot::new(parameters(mission.clone(), conditions.rtk));
    let mut plant = Plant::new(conditions);
    let mut command = ActuatorCommand::SAFE;
    while plant.time_s() < at_s {
        let m = plant.advance(&command);
        shadow.observe(&m, &command);
        command = pilot.update(&m);
    }
    let (thrust, gimbal) = (plant.thrust_n, [command.gimbal_x_rad, command.gimbal_y_rad]);
    shadow.take_over();
    let phase = shadow.phase();
    let mut first = true;
    let mut errors = None;
    while plant.time_s() < at_s + 60.0 && shadow.phase() != Phase::Done {
        let m = plant.advance(&command);
        command = shadow.update(&m);
        within_limits(&command);
        if first && phase.is_flight() {
            // Bumpless: the first command is near what was in force, a twentieth of the weight and half a
            // degree.
            let Throttle::ThrustN(next) = command.throttle else { panic!("{command:?}") };
            assert!((next - thrust).abs() < 60.0, "{phase:?}: {next} after {thrust}");
            assert!((command.gimbal_x_rad - gimbal[0]).abs() < 0.5f64.to_radians());
            assert!((command.gimbal_y_rad - gimbal[1]).abs() < 0.5f64.to_radians());
        }
        first = false;
        if let (Some(_), None) = (plant.touchdown, errors) {
            let e = shadow.estimate().position_ned_m;
            errors = Some(libm::hypot(e.x, e.y));
        }
    }
    let flight = plant.touchdown.map(|touchdown| Flight {
        touchdown,
        control_error_m: errors.unwrap_or(f64::NAN),
        navigation_error_m: 0.0,
        airborne_s: 0.0,
        greatest_height_m: 0.0,
        hover_height_rms_m: 0.0,
        hover_lateral_rms_m: 0.0,
        greatest_tilt_rad: 0.0,
        greatest_gimbal_rad: 0.0,
        greatest_slosh_m: 0.0,
        greatest_terminal_speed_m_s: 0.0,
        mass_error_kg: shadow.estimate().mass_kg - plant.mass_kg(),
        disarmed: shadow.phase() == Phase::Done && !command.armed,
    });
    (phase, flight)
}

#[test]
fn a_shadow_that_takes_over_in_any_phase_lands() {
    let cases = [
        (9.0, Phase::Ascent),
        (15.5, Phase::Ascent),
        (20.0, Phase::Hover),
        (26.5, Phase::Hover),
        (32.0, Phase::Descent),
        (39.5, Phase::Descent),
        (41.6, Phase::Terminal),
    ];
    for (k, (at_s, expected)) in cases.into_iter().enumerate() {
        for valve in [false, true] {
            let seed = 400 + k as u64;
            let (phase, flight) = hand_over(&Mission::default(), Conditions::dispersed(seed), at_s, valve);
            assert_eq!(phase, expected, "at {at_s} s");
            judge(&flight.expect("a touchdown"), seed);
        }
    }
}

#[test]
fn a_shadow_that_takes_over_on_the_pad_does_not_start() {
    for at_s in [1.0, 4.0, 5.2] {
        let (_, flight) = hand_over(&Mission::default(), Conditions::calm(7), at_s, false);
        assert!(flight.is_none(), "at {at_s} s");
    }
}

#[test]
fn any_one_sensor_may_be_missing() {
    let all = |seed| Conditions::dispersed(seed);
    let cases = [
        ("no chamber transducer", Conditions { chamber_transducer: false, ..all(500) }),
        ("no barometer", Conditions { barometer: false, ..all(501) }),
        ("no magnetometer", Conditions { magnetometer: false, ..all(502) }),
        ("no altimeter, plain GNSS", Conditions { altimeter: false, ..all(504) }),
        ("no altimeter, RTK", Conditions { altimeter: false, ..all(505) }),
        ("GNSS lost for 5 s in the climb", Conditions { gnss_outage_s: Some((9.0, 14.0)), ..all(506) }),
        ("GNSS lost for 5 s in the hover", Conditions { gnss_outage_s: Some((20.0, 25.0)), ..all(507) }),
        ("GNSS lost for 5 s before contact", Conditions { gnss_outage_s: Some((38.0, 43.0)), ..all(508) }),
    ];
    for (name, conditions) in cases {
        let seed = conditions.seed;
        let flight = fly(Mission::default(), conditions);
        eprintln!(
            "{name}: vertical {:.3}, lateral {:.3} m/s, control {:.3}, navigation {:.3} m",
            flight.touchdown.vertical_speed_m_s,
            flight.touchdown.lateral_speed_m_s,
            flight.control_error_m,
            flight.navigation_error_m
        );
        judge(&flight, seed);
        assert!(flight.navigation_error_m < 1.5, "{name}: {flight:?}");
    }
}

/// Lost inertial samples, samples that are no numbers, fixes and ranges from nowhere: it still lands, and
/// nothing that is no number leaves it.
#[test]
fn garbage_among_the_measurements_is_refused() {
    for seed in 600..604 {
        let mut autopilot = Autopilot::new(parameters(Mission::default(), seed % 2 == 1));
        let mut plant = Plant::new(Conditions::dispersed(seed));
        let mut dice = autopilot_plant::Noise::new(seed);
        let mut command = ActuatorCommand::SAFE;
        while plant.time_s() < 60.0 && autopilot.phase() != Phase::Done {
            let mut m = plant.advance(&command);
            if plant.time_s() > 5.0 {
                let roll = dice.uniform();
                if roll < 0.01 {
                    m.imu = None;
                } else if roll < 0.015 {
                    continue; // lost on the way
                } else if roll < 0.018 {
                    if let Some(imu) = &mut m.imu {
                        imu.specific_force_body_m_s2.x = f64::NAN;
                        imu.rate_body_rad_s.y = f64::INFINITY;
                    }
                } else if roll < 0.03 {
                    if let Some(fix) = &mut m.gnss {
                        fix.latitude_rad =
                            if dice.uniform() < 0.5 { f64::NAN } else { fix.latitude_rad + 1e-4 };
                    }
                    if let Some(a) = &mut m.altimeter {
                        a.range_m = Some(if dice.uniform() < 0.5 { f64::NAN } else { 0.3 });
                    }
                    if let Some(b) = &mut m.barometer {
                        b.pressure_altitude_m = f64::NEG_INFINITY;
                    }
                    m.magnetic_field_body_t = m.magnetic_field_body_t.map(|_| Vec3::new(f64::NAN, 0.0, 0.0));
                    m.pressures.chamber_pa = Some(f64::NAN);
                }
            }
            command = autopilot.update(&m);
            within_limits(&command);
            let e = autopilot.estimate();
            let all = [e.position_ned_m, e.velocity_ned_m_s, e.rate_body_rad_s, e.position_std_m];
            assert!(all.iter().all(|v| v.iter().all(|x| x.is_finite())), "seed {seed}: {e:?}");
        }
        let t = plant.touchdown.expect("a touchdown");
        assert!(t.vertical_speed_m_s < 1.0 && t.lateral_speed_m_s < 0.5, "seed {seed}: {t:?}");
    }
}

/// Normalised estimation error squared of position, velocity and attitude of the inertial unit, nine
/// degrees of freedom: nine is the mean of an honest filter. Before lift-off the standing still is used
/// with more noise than it has, so that less is expected there.
#[test]
fn filter_is_consistent_with_its_covariance() {
    const FLIGHTS: u64 = 50;
    let times_s = [4.4, 9.0, 14.0, 20.0, 26.0, 33.0, 40.0];
    // Two threads: this test alone would keep one core busy for a minute.
    let halves: Vec<[f64; 7]> = std::thread::scope(|threads| {
        let half = |first: u64| {
            threads.spawn(move || {
                (first..FLIGHTS).step_by(2).fold([0.0; 7], |sums, seed| {
                    let nees = normalized_errors(700 + seed, times_s);
                    std::array::from_fn(|k| sums[k] + nees[k])
                })
            })
        };
        [half(0), half(1)].into_iter().map(|half| half.join().unwrap()).collect()
    });
    let sums: [f64; 7] = std::array::from_fn(|k| (halves[0][k] + halves[1][k]) / FLIGHTS as f64);
    eprintln!("mean NEES of 9 at {times_s:?} s: {sums:.2?}");
    // 95 % of the mean of 50 chi-squares of 9: 9 ± 1.96 √(18/50) = 7.8..10.2; the lower side is left wide,
    // since the filter takes the inertial noise 1.5 times too large on purpose.
    for (nees, at_s) in sums.into_iter().zip(times_s) {
        assert!(nees > 2.0 && nees < 10.2, "{nees} at {at_s} s");
    }
}

/// Squares of the normalised error of motion (nine degrees of freedom) at times of a flight (s).
fn normalized_errors(seed: u64, times_s: [f64; 7]) -> [f64; 7] {
    let conditions = Conditions::dispersed(seed);
    let mut autopilot = Autopilot::new(parameters(Mission::default(), conditions.rtk));
    let mut plant = Plant::new(conditions);
    let mut command = ActuatorCommand::SAFE;
    times_s.map(|at_s| {
        while plant.time_s() < at_s {
            let m = plant.advance(&command);
            command = autopilot.update(&m);
        }
        let (estimate, filter) = (autopilot.estimate(), autopilot.navigation());
        let lever = autopilot_plant::IMU_BODY_M;
        let imu = filter.point(lever);
        let turn = (plant.q * estimate.q_ned_from_body.inverse()).scaled_axis();
        let mut error = nalgebra::SVector::<f64, 9>::zeros();
        let true_velocity = plant.velocity_ned_m_s + plant.q * plant.rate.cross(&lever);
        error
            .fixed_rows_mut::<3>(0)
            .copy_from(&(plant.position_ned_m + plant.q * lever - imu.position_ned_m));
        error.fixed_rows_mut::<3>(3).copy_from(&(true_velocity - imu.velocity_ned_m_s));
        error.fixed_rows_mut::<3>(6).copy_from(&turn);
        let inverse = filter.motion_covariance().try_inverse().expect("positive definite");
        (error.transpose() * inverse * error)[0]
    })
}

#[test]
fn alignment_finds_level_heading_and_gyroscope_bias() {
    for seed in 800..810 {
        let conditions = Conditions::dispersed(seed);
        let mut autopilot = Autopilot::new(parameters(Mission::default(), conditions.rtk));
        let mut plant = Plant::new(conditions);
        while plant.time_s() < 4.4 {
            let m = plant.advance(&ActuatorCommand::SAFE);
            autopilot.update(&m);
        }
        assert_eq!(autopilot.phase(), Phase::Ready);
        let e = autopilot.estimate();
        let turn = (plant.q * e.q_ned_from_body.inverse()).scaled_axis();
        // Tilt: 0.05 m/s² of accelerometer bias over gravity, at 4 σ. Heading: 5e-7 T over 2.4e-5 T, at 4 σ.
        assert!(libm::hypot(turn.x, turn.y) < 4.0 * 0.05 / 9.8 * 1.5, "seed {seed}: {turn}");
        assert!(turn.z.abs() < 4.0 * 0.021, "seed {seed}: {turn}");
        let bias = (plant.gyro_bias() - e.gyro_bias_rad_s).norm();
        // White noise of 750 samples: 1.6e-3/√750 = 5.8e-5 per axis, and the walk of 4 s: 4e-5.
        assert!(bias < 4.0 * 1.3e-4, "seed {seed}: {bias}");
    }
}
