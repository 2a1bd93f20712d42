//! Faults of sensors, their triggers and their injection: two vehicles stand on the pad under one seed, one
//! sound, one with a fault, and the difference of what they measure is the fault; then flights, in which the
//! autopilot meets it.

use crate::fixture::files::{scenario, try_scenario};
use hopbench::event::{EventKind, Phase};
use hopbench::fault::{Component, Fault, Mode, catalogue, row};
use hopbench::scenario::{Outcome, Scenario};
use hopbench::signal::{ActuatorCommand, Measurement};
use hopbench::simulation::{Flight, Report, Source};

/// Time on the pad (s).
const WATCH_S: f64 = 10.0;
/// Half a unit in the last place of a longitude in radians is 1 nm on the ground; a few of those.
const ROUNDING_M: f64 = 1e-8;

fn sensors() -> impl Iterator<Item = Component> {
    Component::ALL.into_iter().filter(|component| component.is_sensor())
}

/// Sensors that have the mode, each with it.
fn all(mode: Mode) -> Vec<Fault> {
    sensors().filter(|&c| row(c, mode).is_some()).map(|c| Fault::new(c, mode)).collect()
}

fn default_value(component: Component, mode: Mode) -> f64 {
    row(component, mode).unwrap().value.unwrap().default
}

/// What a vehicle measures, disarmed on the pad.
fn on_the_pad(faults: Vec<Fault>) -> Vec<Measurement> {
    let mut scenario = scenario("hover_5m", &[]);
    scenario.file.fault = faults;
    let mut flight = Flight::new(&scenario, 7).unwrap();
    let mut seen = Vec::new();
    while flight.time().s() < WATCH_S {
        flight.step(&ActuatorCommand::SAFE);
        seen.extend(flight.measurement().cloned());
    }
    seen
}

/// The sample of one sensor, whole, for comparison.
fn sample(component: Component, m: &Measurement) -> Option<String> {
    match component {
        Component::Barometer => m.barometer.map(|s| format!("{s:?}")),
        Component::Gnss => m.gnss.map(|s| format!("{s:?}")),
        Component::Altimeter => m.altimeter.map(|s| format!("{s:?}")),
        Component::Tracking => m.tracking.map(|s| format!("{s:?}")),
        _ => reading(component, m).map(|s| format!("{s:?}")),
    }
}

/// What a sensor reads: a vector, a position north, east, down (m), or a number in the first place.
fn reading(component: Component, m: &Measurement) -> Option<[f64; 3]> {
    let number = |x: f64| [x, 0.0, 0.0];
    let (force, rate) = match (&m.imu, &m.broken_imu) {
        (Some(imu), _) => (Some(imu.specific_force_body_m_s2), Some(imu.rate_body_rad_s)),
        (None, Some(unit)) => (unit.specific_force_body_m_s2, unit.rate_body_rad_s),
        (None, None) => (None, None),
    };
    match component {
        Component::Accelerometer => force.map(Into::into),
        Component::Gyroscope => rate.map(Into::into),
        Component::Magnetometer => m.magnetic_field_body_t.map(Into::into),
        Component::Barometer => m.barometer.map(|s| number(s.pressure_pa)),
        Component::Gnss => m.gnss.map(|fix| {
            // Radii of curvature of WGS 84, at the latitude to a milliradian: the same for shifted fixes.
            let (a, e2) = (6_378_137.0, 6.694_379_99e-3);
            let (sin, cos) = libm::sincos((fix.latitude_rad * 1e3).round() * 1e-3);
            let w2 = 1.0 - e2 * sin * sin;
            let (meridian_m, normal_m) = (a * (1.0 - e2) / (w2 * w2.sqrt()), a / w2.sqrt());
            let parallel_m = normal_m * cos;
            [fix.latitude_rad * meridian_m, fix.longitude_rad * parallel_m, -fix.altitude_m]
        }),
        Component::Altimeter => m.altimeter.and_then(|s| s.range_m).map(number),
        Component::Tracking => m.tracking.map(|s| s.position_ned_m.into()),
        Component::PressureTank => m.pressures.tank_pa.map(number),
        Component::PressureBottle => m.pressures.bottle_pa.map(number),
        Component::PressureInjectorInlet => m.pressures.injector_inlet_pa.map(number),
        Component::PressureChamber => m.pressures.chamber_pa.map(number),
        _ => None,
    }
}

/// Errors of a sensor with a fault against the sound one: time (s) and the differences on its axes.
fn errors(component: Component, sound: &[Measurement], faulty: &[Measurement]) -> Vec<(f64, Vec<f64>)> {
    let axes = if row(component, Mode::Noise).unwrap().axes { 3 } else { 1 };
    assert_eq!(sound.len(), faulty.len(), "the beat goes on");
    let pairs = sound.iter().zip(faulty);
    let errors: Vec<_> = pairs
        .filter_map(|(a, b)| Some((a.time.s(), reading(component, a)?, reading(component, b)?)))
        .map(|(time_s, a, b)| (time_s, (0..axes).map(|i| b[i] - a[i]).collect()))
        .collect();
    // The slowest sensor is satellite navigation, ten times a second.
    assert!(errors.len() >= 95, "{component:?}: {} samples", errors.len());
    errors
}

/// A shift of a position is good to 0.6 % by the sphere; other sums to rounding of the largest reading, 2e7
/// Pa.
fn close(component: Component, error: f64, expected: f64) -> bool {
    let bound = if component == Component::Gnss { 6e-3 * expected.abs() + ROUNDING_M } else { 1e-8 };
    (error - expected).abs() <= bound
}

#[test]
fn sensor_off() {
    let (sound, faulty) = (on_the_pad(Vec::new()), on_the_pad(all(Mode::Off)));
    for component in sensors() {
        assert!(sound.iter().any(|m| sample(component, m).is_some()), "{component:?} exists");
        assert!(faulty.iter().all(|m| sample(component, m).is_none()), "{component:?} is off");
    }
    // A dead unit keeps its beat, on which everything else rides.
    assert_eq!(sound.len(), faulty.len());
    assert!(faulty.iter().all(|m| m.imu.is_none() && m.broken_imu.is_some()));
    // With one half dead the other half is what it was.
    let half = on_the_pad(vec![Fault::new(Component::Gyroscope, Mode::Off)]);
    for (m, sound) in half.iter().zip(&sound) {
        let unit = m.broken_imu.unwrap();
        assert_eq!(unit.specific_force_body_m_s2, sound.imu.map(|imu| imu.specific_force_body_m_s2));
        assert!(m.imu.is_none() && unit.rate_body_rad_s.is_none());
        assert_eq!((m.gnss, m.barometer), (sound.gnss, sound.barometer));
    }
}

#[test]
fn sensor_stuck() {
    let (sound, mut faults) = (on_the_pad(Vec::new()), all(Mode::Stuck));
    faults.iter_mut().for_each(|fault| fault.after_s = 5.0);
    let faulty = on_the_pad(faults);
    for component in sensors() {
        let mut held = None;
        for (m, sound) in faulty.iter().zip(&sound) {
            let (now, right) = (sample(component, m), sample(component, sound));
            assert_eq!(now.is_some(), right.is_some(), "{component:?} keeps its rate");
            // From 5 s on, when the step that ends later begins, the first sample repeats.
            if m.time.s() > 5.0 && now.is_some() {
                assert_eq!(held.get_or_insert(right), &now, "{component:?} at {}", m.time.s());
            } else {
                assert_eq!(now, right);
            }
        }
        assert!(held.is_some());
    }
}

#[test]
fn sensor_delay() {
    let (sound, faulty) = (on_the_pad(Vec::new()), on_the_pad(all(Mode::Delay)));
    // Half a second is 125 beats of the inertial unit, on which all samples ride.
    for component in sensors() {
        assert_eq!(default_value(component, Mode::Delay), 0.5);
        let times = |all: &[Measurement]| -> Vec<(u64, String)> {
            all.iter().filter_map(|m| Some((m.time.us(), sample(component, m)?))).collect()
        };
        let late: Vec<_> = times(&sound)
            .into_iter()
            .map(|(us, sample)| (us + 500_000, sample))
            .filter(|(us, _)| *us <= 10_000_000)
            .collect();
        assert_eq!(times(&faulty), late, "{component:?}");
    }
}

#[test]
fn sensor_intermittent() {
    let (sound, faulty) = (on_the_pad(Vec::new()), on_the_pad(all(Mode::Intermittent)));
    for component in sensors() {
        let (mut kept, mut all) = (0.0_f64, 0.0_f64);
        for (m, sound) in faulty.iter().zip(&sound) {
            let now = sample(component, m);
            all += f64::from(u8::from(sample(component, sound).is_some()));
            kept += f64::from(u8::from(now.is_some()));
            assert!(now.is_none() || now == sample(component, sound), "{component:?}: what comes is right");
        }
        // A coin for each sample: five standard deviations.
        assert!((kept - 0.5 * all).abs() < 5.0 * (0.25 * all).sqrt(), "{component:?}: {kept} of {all}");
    }
}

#[test]
fn sensor_scale() {
    let (sound, faulty) = (on_the_pad(Vec::new()), on_the_pad(all(Mode::Scale)));
    for component in sensors().filter(|&c| row(c, Mode::Scale).is_some()) {
        for (m, sound) in faulty.iter().zip(&sound) {
            let (Some(now), Some(right)) = (reading(component, m), reading(component, sound)) else {
                continue;
            };
            assert_eq!(now, right.map(|x| x * 1.1), "{component:?}");
        }
    }
}

#[test]
fn sensor_bias() {
    let (sound, faulty) = (on_the_pad(Vec::new()), on_the_pad(all(Mode::Bias)));
    for component in sensors().filter(|&c| row(c, Mode::Bias).is_some()) {
        let bias = default_value(component, Mode::Bias);
        for (_, error) in errors(component, &sound, &faulty) {
            assert!(error.iter().all(|&e| close(component, e, bias)), "{component:?}: {error:?}");
        }
    }
    // The altitude that goes with the pressure follows it: 100 Pa are 8.3 m at sea level, 9.2 m at 1000 m.
    let altitude_m = |m: &Measurement| m.barometer.map(|s| s.pressure_altitude_m);
    let lower_m = sound.iter().zip(&faulty).find_map(|(a, b)| Some(altitude_m(a)? - altitude_m(b)?)).unwrap();
    assert!((8.0..9.2).contains(&lower_m), "{lower_m}");
    // Along one axis alone.
    let z =
        Fault { axis: Some(hopbench::fault::Axis::Z), ..Fault::new(Component::Accelerometer, Mode::Bias) };
    for (_, error) in errors(Component::Accelerometer, &sound, &on_the_pad(vec![z])) {
        assert!(error[0] == 0.0 && error[1] == 0.0 && (error[2] - 0.5).abs() < 1e-12, "{error:?}");
    }
}

#[test]
fn sensor_jump() {
    let (sound, mut faults) = (on_the_pad(Vec::new()), all(Mode::Jump));
    assert_eq!(faults.len(), 2);
    faults.iter_mut().for_each(|fault| (fault.after_s, fault.duration_s) = (4.0, Some(3.0)));
    let faulty = on_the_pad(faults);
    for component in [Component::Gnss, Component::Tracking] {
        for (time_s, error) in errors(component, &sound, &faulty) {
            let expected = if time_s > 4.0 && time_s <= 7.0 { 5.0 } else { 0.0 };
            assert!(
                error.iter().all(|&e| close(component, e, expected)),
                "{component:?} {time_s}: {error:?}"
            );
        }
    }
    // A receiver that jumps claims to be as good as before.
    for (a, b) in sound.iter().zip(&faulty).filter_map(|(a, b)| Some((a.gnss?, b.gnss?))) {
        assert_eq!(a.velocity_ned_m_s, b.velocity_ned_m_s);
        assert_eq!(a.horizontal_accuracy_m, b.horizontal_accuracy_m);
    }
}

#[test]
fn sensor_drift() {
    let (sound, faulty) = (on_the_pad(Vec::new()), on_the_pad(all(Mode::Drift)));
    for component in sensors() {
        let rate = default_value(component, Mode::Drift);
        for (time_s, error) in errors(component, &sound, &faulty) {
            assert!(error.iter().all(|&e| close(component, e, rate * time_s)), "{component:?}: {error:?}");
        }
    }
}

#[test]
fn sensor_noise() {
    let (sound, faulty) = (on_the_pad(Vec::new()), on_the_pad(all(Mode::Noise)));
    for component in sensors() {
        if component == Component::Altimeter {
            continue; // on its legs half of the ranges would be below its least: looked at below
        }
        let std = default_value(component, Mode::Noise);
        let errors: Vec<f64> =
            errors(component, &sound, &faulty).into_iter().flat_map(|(_, error)| error).collect();
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let variance = errors.iter().map(|e| e * e).sum::<f64>() / n;
        // Five standard deviations of the mean and of the variance of n normal deviates, 1 % for the sphere.
        assert!(mean.abs() < 5.0 * std / n.sqrt(), "{component:?}: mean {mean} of {std}");
        let share = variance / (std * std);
        assert!((share - 1.0).abs() < 5.0 * (2.0 / n).sqrt() + 0.012, "{component:?}: variance {share}");
    }
    let quiet = Fault { value: Some(0.01), ..Fault::new(Component::Altimeter, Mode::Noise) };
    let errors = errors(Component::Altimeter, &sound, &on_the_pad(vec![quiet]));
    let variance = errors.iter().map(|(_, e)| e[0] * e[0]).sum::<f64>() / errors.len() as f64;
    assert!((variance / 1e-4 - 1.0).abs() < 5.0 * (2.0 / errors.len() as f64).sqrt(), "{variance}");
}

#[test]
fn sensor_garbage() {
    let (sound, faulty) = (on_the_pad(Vec::new()), on_the_pad(all(Mode::Garbage)));
    for component in sensors() {
        let most = default_value(component, Mode::Garbage);
        let two_sided = row(component, Mode::Garbage).unwrap().axes;
        let readings: Vec<f64> = match component {
            // Positions are garbage about the right one.
            Component::Gnss | Component::Tracking => {
                errors(component, &sound, &faulty).into_iter().flat_map(|(_, error)| error).collect()
            }
            _ if two_sided => faulty.iter().filter_map(|m| reading(component, m)).flatten().collect(),
            _ => faulty.iter().filter_map(|m| Some(reading(component, m)?[0])).collect(),
        };
        // An altimeter reports no range under its least.
        let limits = sound.iter().find_map(|m| m.altimeter).unwrap();
        let (least, most) = match component {
            Component::Altimeter => (limits.minimum_m, most.min(limits.maximum_m)),
            _ if two_sided => (-most, most),
            _ => (0.0, most),
        };
        assert!(readings.iter().all(|&x| x >= 1.01 * least && x <= 1.01 * most), "{component:?}");
        // Uniform: the mean lies in the middle, within five of its standard deviations.
        let (n, width, middle) = (readings.len() as f64, most - least, 0.5 * (least + most));
        let off = readings.iter().sum::<f64>() / n - middle;
        assert!(n > 95.0 && off.abs() < 5.0 * width / (12.0 * n).sqrt(), "{component:?}: {off} of {width}");
        // Its variance about the middle is width²/12; the fourth moment is width⁴/80, so the square of a
        // deviate has the variance (1/80 - 1/144) width⁴ = width⁴/180, sqrt(0.8) of its mean. 1.2 % for the
        // sphere, as for noise.
        let variance = readings.iter().map(|x| (x - middle) * (x - middle)).sum::<f64>() / n;
        let share = variance / (width * width / 12.0);
        assert!((share - 1.0).abs() < 5.0 * (0.8 / n).sqrt() + 0.012, "{component:?}: variance {share}");
    }
}

/// A flight in memory under the autopilot; `each_step` sees it after every step, and may break it.
fn flown(scenario: &Scenario, mut each_step: impl FnMut(&mut Flight)) -> Flight {
    let mut flight = Flight::new(scenario, scenario.file.seed).unwrap();
    flight.set_source(Source::Autopilot);
    let mut command = ActuatorCommand::SAFE;
    while flight.outcome().is_none() && flight.time().s() < 120.0 {
        flight.step(&command);
        each_step(&mut flight);
        if let Some(next) = flight.autopilot_command() {
            command = next;
            flight.plan_in_place();
        }
    }
    flight
}

fn hover(faults: Vec<Fault>) -> Scenario {
    let mut scenario = scenario("hover_5m", &[]);
    scenario.file.fault = faults;
    scenario
}

fn time_of(report: &Report, event: &str) -> Option<f64> {
    report.events.iter().find(|e| e.kind.name() == event).map(|e| e.time_s)
}

fn aborts(report: &Report) -> Vec<String> {
    report.events.iter().filter(|e| e.kind.is_abort()).map(|e| e.kind.name().replace("abort:", "")).collect()
}

fn landed_softly(report: &Report) {
    assert_eq!((report.outcome, aborts(report)), (Outcome::Landed, vec![]));
    let t = report.touchdown.unwrap();
    assert!(t.vertical_speed_m_s <= 1.0 && t.lateral_speed_m_s <= 0.5 && t.tilt_deg <= 5.0, "{t:?}");
}

/// Below 3 m with the engine burning half of the readings are missing and the others too short; the filter
/// refuses those and lands.
#[test]
fn altimeter_plume() {
    let scenario = hover(vec![Fault::new(Component::Altimeter, Mode::Plume)]);
    let (mut missing, mut short, mut right) = ([0_u32; 2], [0_u32; 2], [0_u32; 2]);
    let flight = flown(&scenario, |flight| {
        let Some(altimeter) = flight.measurement().and_then(|m| m.altimeter) else { return };
        let now = flight.snapshot();
        // The altimeter is late and its noise and lever arm are some centimetres; the step before decides on
        // the plume.
        let clear_of_the_edge = (now.height_m - 3.0).abs() > 0.1;
        if !now.lit || !clear_of_the_edge || now.height_m < 0.5 {
            return;
        }
        let near = usize::from(now.height_m < 3.0);
        match altimeter.range_m {
            None => missing[near] += 1,
            Some(range_m) if range_m < now.height_m + 0.3 => short[near] += 1,
            Some(_) => right[near] += 1,
        }
    });
    assert_eq!((missing[0], short[0]), (0, 0), "above the plume");
    assert!(right[0] > 100, "{right:?}");
    let n = f64::from(missing[1] + short[1] + right[1]);
    // Half missing, to five standard deviations.
    assert!((f64::from(missing[1]) - 0.5 * n).abs() < 5.0 * (0.25 * n).sqrt(), "{missing:?} of {n}");
    assert!(short[1] > right[1], "{short:?} {right:?}");
    landed_softly(&flight.report());
}

/// -300 Pa for each kN, falling by e with each metre: at the pad 650 N would be -195 Pa, at 5 m -1.3 Pa.
#[test]
fn barometer_plume() {
    let mut sound = Vec::new();
    flown(&hover(Vec::new()), |f| sound.extend(f.measurement().and_then(|m| Some((f.time(), m.barometer?)))));
    let (mut sound, mut seen, mut lifted) = (sound.into_iter(), 0, false);
    let mut before = (0.0, 0.0);
    let flight = flown(&hover(vec![Fault::new(Component::Barometer, Mode::Plume)]), |f| {
        let (height_m, thrust_n) = before;
        before = (f.snapshot().height_m, f.snapshot().thrust_n);
        lifted |= height_m > 0.05;
        let Some(barometer) = f.measurement().and_then(|m| m.barometer) else { return };
        let Some((time, right)) = sound.next().filter(|_| !lifted) else { return };
        // Until they lift both vehicles do the same. The plume is that of the begin of the step.
        assert_eq!(time, f.time());
        let expected_pa = -0.3 * thrust_n * libm::exp(-height_m.max(0.0));
        seen += u32::from(thrust_n > 100.0);
        let error_pa = barometer.pressure_pa - right.pressure_pa;
        // A centimetre between the two vehicles would be 0.12 Pa.
        assert!((error_pa - expected_pa).abs() < 0.12, "{error_pa} Pa, not {expected_pa} Pa at {thrust_n} N");
    });
    assert!(seen > 5, "{seen}");
    landed_softly(&flight.report());
}

#[test]
fn a_gap_in_the_fixes_begins_with_the_hover_and_ends() {
    let gap = Fault {
        name: "gap".to_owned(),
        at_event: Some(EventKind::Phase(Phase::Hover)),
        after_s: 0.5,
        duration_s: Some(2.0),
        ..Fault::new(Component::Gnss, Mode::Off)
    };
    let mut fixes = Vec::new();
    let flight = flown(&hover(vec![gap]), |f| {
        fixes.extend(f.measurement().filter(|m| m.gnss.is_some()).map(|m| m.time.s()));
    });
    let report = flight.report();
    let hover_s = time_of(&report, "phase:hover").unwrap();
    let (from_s, to_s) =
        (time_of(&report, "fault:gap").unwrap(), time_of(&report, "fault_over:gap").unwrap());
    // An event of one step is heard at the next.
    assert!(
        (from_s - hover_s - 0.5).abs() <= 0.0011 && (to_s - from_s - 2.0).abs() < 1e-9,
        "{from_s} {to_s}"
    );
    assert!(!fixes.iter().any(|t| *t > from_s && *t <= to_s));
    // Ten a second but for the gap.
    let longest = fixes.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
    assert!((1.9..=2.2).contains(&longest), "{longest}");
    landed_softly(&report);
    assert!(report.modified.is_empty() && report.faults_idle.is_empty());
}

#[test]
fn a_dead_gyroscope_cuts_the_engine_by_its_name() {
    let dead = Fault { above_m: Some(4.0), ..Fault::new(Component::Gyroscope, Mode::Off) };
    let report = flown(&hover(vec![dead]), |_| {}).report();
    let lost_s = time_of(&report, "fault:gyroscope_off").unwrap();
    let cut_s = time_of(&report, "abort:inertial").unwrap();
    // [mission.abort] inertial_silence_s = 0.5, judged at the beat of the unit, 4 ms.
    assert!((lost_s + 0.49..lost_s + 0.52).contains(&cut_s), "lost {lost_s} s, cut {cut_s} s");
    assert_ne!(report.outcome, Outcome::Landed);
}

/// Fixes that jump by 100 m are refused; the altimeter has ground below it, so the hover goes on and the
/// vehicle lands.
#[test]
fn fixes_that_jump_are_refused() {
    let jump = Fault {
        value: Some(100.0),
        axis: Some(hopbench::fault::Axis::X),
        at_event: Some(EventKind::Phase(Phase::Hover)),
        duration_s: Some(2.0),
        ..Fault::new(Component::Gnss, Mode::Jump)
    };
    let (mut astray, mut worst_m, mut pad_m) = (0, 0.0_f64, None);
    let flight = flown(&hover(vec![jump]), |f| {
        if let Some(fix_m) = f.measurement().and_then(|m| reading(Component::Gnss, m)) {
            // North of the first fix, which came on the pad; the wander is metres.
            let north_m = fix_m[0] - *pad_m.get_or_insert(fix_m[0]);
            astray += u32::from((north_m - f.snapshot().position_ned_m.x).abs() > 50.0);
        }
        let off = f.estimate().position_ned_m - f.snapshot().position_ned_m;
        worst_m = worst_m.max(libm::hypot(off.x, off.y));
    });
    // Ten a second for two seconds; what the estimate is off is the wander of plain fixes.
    assert_eq!(astray, 20);
    assert!(worst_m < 2.0, "{worst_m}");
    landed_softly(&flight.report());
}

/// Each trigger at its time, by the height of the vehicle at every step.
#[test]
fn triggers_come_when_they_say() {
    let mild = |name: &str, fault: Fault| Fault { name: name.to_owned(), value: Some(1.0), ..fault };
    let new = || Fault::new(Component::PressureInjectorInlet, Mode::Bias);
    let faults = vec![
        mild("start", new()),
        mild("late", Fault { after_s: 2.0, ..new() }),
        mild("time", Fault { at_s: Some(3.0), ..new() }),
        mild("time_late", Fault { at_s: Some(3.0), after_s: 1.5, ..new() }),
        mild("up", Fault { above_m: Some(2.0), ..new() }),
        mild("down", Fault { below_m: Some(2.0), ..new() }),
        mild("lift", Fault { at_event: Some(EventKind::Liftoff), ..new() }),
        mild("chain", Fault { at_event: Some(EventKind::Fault("up".to_owned())), after_s: 1.0, ..new() }),
        mild("never", Fault { above_m: Some(50.0), ..new() }),
    ];
    let mut heights = Vec::new();
    let report = flown(&hover(faults), |f| heights.push((f.time().s(), f.snapshot().height_m))).report();
    let at = |name: &str| time_of(&report, &format!("fault:{name}")).unwrap_or_else(|| panic!("{name}"));
    let event = |name: &str| time_of(&report, name).unwrap();
    let ignition_s = event("ignition");
    let up_s = heights.iter().find(|(_, h)| *h > 2.0).unwrap().0;
    let down_s = heights.iter().rev().find(|(_, h)| *h >= 2.0).unwrap().0 + 0.001;
    for (name, expected_s) in [
        ("start", 0.0),
        ("late", 2.0),
        ("time", ignition_s + 3.0),
        ("time_late", ignition_s + 4.5),
        ("up", up_s),
        ("down", down_s),
        ("lift", event("liftoff")),
        ("chain", at("up") + 1.0),
    ] {
        // A step either way: an event is heard at the step after it.
        assert!((at(name) - expected_s).abs() <= 0.0011, "{name}: {} s, not {expected_s} s", at(name));
    }
    assert!(time_of(&report, "fault:never").is_none());
    assert_eq!(report.faults_idle, ["never"]);
    landed_softly(&report);
}

#[test]
fn what_is_injected_acts_at_once_replaces_its_like_and_marks_the_run() {
    let mut steps = 0;
    let flight = flown(&hover(Vec::new()), |f| {
        steps += 1;
        let bias = |value| Fault { value: Some(value), ..Fault::new(Component::Barometer, Mode::Bias) };
        match steps {
            1000 => f.inject(&bias(100.0)).unwrap(),
            2000 => f.inject(&bias(50.0)).unwrap(),
            2500 => assert_eq!(f.faults().map(|a| a.value).collect::<Vec<_>>(), [50.0]),
            3000 => assert_eq!(f.clear_fault(Component::Barometer, None), 1),
            3500 => {
                assert_eq!(f.faults().count(), 0);
                assert_eq!(f.clear_fault(Component::Barometer, None), 0);
                assert_eq!(f.inject(&bias(1e9)).unwrap_err().key, "value");
                assert_eq!(f.inject(&Fault::new(Component::Gnss, Mode::Leak)).unwrap_err().key, "mode");
            }
            _ => {}
        }
    });
    let report = flight.report();
    assert_eq!(
        report.modified,
        [
            "1.000 s: fault barometer bias 100 (Pa)",
            "2.000 s: fault barometer bias 50 (Pa)",
            "3.000 s: mended barometer bias 50 (Pa)"
        ]
    );
    let names: Vec<_> = report.events.iter().filter(|e| e.time_s <= 3.0).map(|e| e.kind.name()).collect();
    let expected = [
        "modified",
        "fault:barometer_bias",
        "modified",
        "fault:barometer_bias",
        "modified",
        "fault_over:barometer_bias",
    ];
    let injected: Vec<_> = names.into_iter().filter(|n| n.starts_with("fault") || n == "modified").collect();
    assert_eq!(injected, expected);
}

/// Faults that add noise are the same under one seed, and adding another moves none of it.
#[test]
fn a_named_fault_keeps_its_noise() {
    let noisy = || Fault::new(Component::Gyroscope, Mode::Noise);
    let other = Fault::new(Component::Barometer, Mode::Noise);
    let (one, two) = (on_the_pad(vec![noisy()]), on_the_pad(vec![other, noisy()]));
    assert!(one.iter().zip(&two).all(|(a, b)| a.imu == b.imu));
    let sound = on_the_pad(Vec::new());
    assert!(one.iter().zip(&sound).all(|(a, b)| a.imu != b.imu));
}

/// No value in the catalogue's ranges makes a number that is none.
#[test]
fn extreme_values_stay_finite() {
    for end in [|(least, _): (f64, f64)| least, |(_, greatest): (f64, f64)| greatest] {
        let extreme = |row: hopbench::fault::Row| {
            let value = row.value.map(|q| end((q.least, q.greatest)));
            Fault { value, ..Fault::new(row.component, row.mode) }
        };
        let faults = catalogue().filter(|row| row.component.is_sensor() && row.mode != Mode::Off);
        let faults: Vec<_> = faults.map(extreme).collect();
        for m in on_the_pad(faults) {
            for component in sensors() {
                assert!(reading(component, &m).is_none_or(|r| r.iter().all(|x| x.is_finite())), "{m:?}");
            }
        }
    }
}

#[test]
fn a_mistake_is_named_with_its_key_and_range() {
    let mistake = |toml: &str| try_scenario("hover_5m", &[("fault", toml)]).unwrap_err().to_string();
    for (toml, expected) in [
        (
            "[{component = 'combustion', mode = 'efficiency_drop', value = 3.0}]",
            "fault.0.value: 3 is out of range for combustion efficiency_drop; allowed 0 to 0.9 (share)",
        ),
        (
            "[{component = 'combustion', mode = 'stuck'}]",
            "fault.0.mode: combustion has no fault stuck; allowed efficiency_drop",
        ),
        (
            "[{component = 'gnss', mode = 'off', value = 1.0}]",
            "fault.0.value: 1 means nothing for gnss off: leave it out",
        ),
        (
            "[{component = 'barometer', mode = 'bias', axis = 'x'}]",
            "fault.0.axis: barometer bias has no axes: leave it out",
        ),
        (
            "[{component = 'gnss', mode = 'off', at_s = 1.0, above_m = 2.0}]",
            "fault.0.above_m: a second trigger beside at_s",
        ),
        ("[{component = 'gnss', mode = 'off', duration_s = 0.0}]", "fault.0.duration_s: 0 breaks nothing"),
        (
            "[{component = 'gnss', mode = 'off', at_event = 'phase:hoover'}]",
            "fault.0.at_event: \"phase:hoover\" never happens; allowed armed,",
        ),
        (
            "[{component = 'gnss', mode = 'off'}, {component = 'gnss', mode = 'off'}]",
            "fault.1.name: entry 0 is named \"gnss_off\" too",
        ),
        ("[{component = 'gnss', mode = 'jump', value = nan}]", "fault.0.value: NaN is out of range"),
        ("[{component = 'gnss', mode = 'jump', valeu = 1.0}]", "valeu"),
        ("[{component = 'gns', mode = 'jump'}]", "fault.0.component"),
    ] {
        let said = mistake(toml);
        assert!(said.contains(expected), "{said}\nshould say {expected}");
    }
}
