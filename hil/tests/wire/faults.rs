//! Each fault of the wire and of the flight controller, by its effect; `component_mode` names the test.
//!
//! In lockstep a late frame holds nobody up, so times in the reports are exact; a lost one is waited for in
//! vain.

use std::cell::RefCell;
use std::collections::HashSet;
use std::time::{Duration, Instant};

use hopbench::event::Phase;
use hopbench::scenario::Outcome;
use hopbench::simulation::report::{Disrupted, DisruptedWay, Stalled};
use hopbench::simulation::{Instrumentation, Report, Source};
use hopbench_hil::bench::Options;
use hopbench_hil::bench::pilot::Pilot;
use hopbench_hil::wire::mavlink::{ControlsFrame, MavMessage, actuator_controls};
use hopbench_hil::wire::profile::{GENERIC, PX4_SITL, Pacing};

use crate::fixture::peer::{Fc, Then, flown, lockstep, run, scenario};

/// Rate of HIL_SENSOR is 250 Hz (us).
const SAMPLE_US: u64 = 4000;
/// Nobody waits for this long unless something is broken that should not be.
const LONG: Duration = Duration::from_secs(20);

/// A scenario's fault on one way, from step 0.
fn fault(component: &str, mode: &str, value: Option<f64>) -> String {
    let value = value.map_or(String::new(), |value| format!(", value = {value:?}"));
    format!("fault = [{{component = \"{component}\", mode = \"{mode}\"{value}}}]")
}

/// Lockstep that gives an answer up after `patience`.
fn patient(patience: Duration) -> Options {
    Options { lockstep_timeout: patience, ..lockstep(&PX4_SITL) }
}

/// What a controller that answers every sample sees until the first after `samples` periods.
#[derive(Default)]
struct Seen {
    times_us: Vec<u64>,
    /// What its decoder met.
    crc_errors: u64,
}

impl Seen {
    fn distinct(&self) -> u64 {
        self.times_us.iter().collect::<HashSet<_>>().len() as u64
    }

    /// Samples that never came, of those up to the newest.
    fn missing(&self) -> u64 {
        self.times_us.iter().max().unwrap() / SAMPLE_US - self.distinct()
    }
}

fn answer_all(overrides: &[&str], options: Options, samples: u64) -> (Report, Seen) {
    let mut seen = Seen::default();
    let report = run(&scenario(overrides), options, |fc| {
        let deadline = Instant::now() + LONG;
        while seen.times_us.last().is_none_or(|us| *us < samples * SAMPLE_US) {
            assert!(Instant::now() < deadline, "after {:?}", seen.times_us.last());
            if let Some(time_us) = fc.sensor_within(Duration::from_millis(100)) {
                seen.times_us.push(time_us);
                fc.controls(time_us, false, [0.0; 4]);
            }
        }
        seen.crc_errors = fc.decoder.counters().crc_errors;
        Then::Stop
    });
    (report, seen)
}

fn disrupted(report: &Report) -> Disrupted {
    report.link.unwrap().disrupted.expect("a fault of the wire acted")
}

fn stalled(report: &Report) -> Stalled {
    report.link.unwrap().stalled.expect("frames were lost")
}

/// Within five standard deviations of a binomial count.
fn assert_share(count: u64, of: u64, share: f64) {
    let (mean, variance) = (share * of as f64, share * (1.0 - share) * of as f64);
    assert!((count as f64 - mean).abs() <= 5.0 * variance.sqrt(), "{count} of {of}, share {share}");
}

#[test]
fn a_sound_wire_leaves_no_trace() {
    let (report, seen) = answer_all(&[], patient(Duration::from_secs(1)), 200);
    assert_eq!(seen.missing(), 0);
    assert_eq!(report.link.unwrap().disrupted, None);
    let text = serde_json::to_string(&report.link).unwrap();
    assert!(!text.contains("disrupted"), "{text}");
}

#[test]
fn wire_to_fc_drop() {
    let (report, seen) = answer_all(
        &[&fault("wire_to_fc", "drop", Some(0.1)), "fc_timeout_ms=10000"],
        patient(Duration::from_millis(5)),
        1000,
    );
    assert_share(seen.missing(), 1000, 0.1);
    // Each sample that did not arrive was waited for in vain, and only samples are waited for.
    assert_eq!(stalled(&report).lost_by_fault, seen.missing());
    assert!(disrupted(&report).to_fc.dropped >= seen.missing());
    assert_eq!(disrupted(&report).from_fc, DisruptedWay::default());
    assert!(report.events.iter().any(|event| event.kind.name() == "stall"), "{:?}", report.events);
}

#[test]
fn wire_from_fc_drop() {
    let (report, seen) = answer_all(
        &[&fault("wire_from_fc", "drop", Some(0.1)), "fc_timeout_ms=10000"],
        patient(Duration::from_millis(5)),
        1000,
    );
    assert_eq!(seen.missing(), 0);
    let (dropped, stalls) = (disrupted(&report).from_fc.dropped, stalled(&report));
    assert_share(dropped, 1000, 0.1);
    // One may be under way when the run is stopped; what came too late was not waited for.
    let spared = 1 + report.link.unwrap().stalls - stalls.lost_by_fault;
    assert!(
        (dropped - spared.min(dropped)..=dropped).contains(&stalls.lost_by_fault),
        "{dropped} {stalls:?}"
    );
    // The gaps in the controller's counter tell the same.
    assert!(report.link.unwrap().lost.abs_diff(dropped) <= 2, "{:?}", report.link);
}

/// Run time of the event `armed`, of which there must be one, when each sample from `armed_us` on is answered
/// armed (s).
fn armed_s(overrides: &[&str], armed_us: u64) -> (f64, Report) {
    let overrides = [overrides, &["fc_timeout_ms=10000"]].concat();
    let report = run(&scenario(&overrides), patient(Duration::from_secs(5)), |fc| {
        fc.idle_until(armed_us - SAMPLE_US);
        loop {
            let time_us = fc.sensor();
            fc.controls(time_us, time_us >= armed_us, [0.0; 4]);
            if time_us >= armed_us + 200_000 {
                return Then::Stop;
            }
        }
    });
    let armed: Vec<f64> =
        report.events.iter().filter(|e| e.kind.name() == "armed").map(|e| e.time_s).collect();
    let [time_s] = armed[..] else { panic!("{:#?}", report.events) };
    (time_s, report)
}

/// A frame that is late by `delay_s` of simulated time arms the vehicle so much later and costs no wall time.
fn delays(component: &str) -> Disrupted {
    let (sound_s, _) = armed_s(&[], 400_000);
    let (late_s, report) = armed_s(&[&fault(component, "delay", Some(0.03))], 400_000);
    // Both ends of a step.
    assert!((late_s - sound_s - 0.03).abs() < 1.5e-3, "{sound_s} {late_s}");
    assert_eq!(report.link.unwrap().stalls, 0);
    disrupted(&report)
}

#[test]
fn wire_to_fc_delay() {
    let disrupted = delays("wire_to_fc");
    assert!(disrupted.to_fc.delayed > 100 && disrupted.from_fc.delayed == 0, "{disrupted:?}");
}

#[test]
fn wire_from_fc_delay() {
    let disrupted = delays("wire_from_fc");
    assert!(disrupted.from_fc.delayed > 100 && disrupted.to_fc.delayed == 0, "{disrupted:?}");
}

/// In real time the round trip shows it. A bench that catches up lets simulated time run faster than the
/// wall's, so half of the delay is what a busy machine leaves for certain.
#[test]
fn a_delay_is_in_the_round_trip() {
    let options = Options { pacing: Pacing::RealTime, fast: false, ..lockstep(&PX4_SITL) };
    let (report, _) = answer_all(&[&fault("wire_to_fc", "delay", Some(0.05))], options, 250);
    let round_trip = report.timing.round_trip_us.unwrap();
    assert!(round_trip.p50 > 25_000.0, "{round_trip:?}");
}

#[test]
fn a_delay_beyond_the_timeout_is_a_loss_in_lockstep_too() {
    let report = flown(
        &["fault = [{component = \"wire_from_fc\", mode = \"delay\", value = 0.5, above_m = 3.0}]"],
        lockstep(&GENERIC),
        |_| false,
    );
    assert_handed_over_and_landed(&report);
}

#[test]
fn wire_to_fc_jitter() {
    let (report, seen) =
        answer_all(&[&fault("wire_to_fc", "jitter", Some(0.02))], patient(Duration::from_secs(1)), 500);
    let back = seen.times_us.windows(2).filter(|pair| pair[1] < pair[0]).count();
    assert!(back > 50, "{back} samples overtaken");
    assert_eq!(disrupted(&report).to_fc.dropped, 0);
    assert_eq!(report.link.unwrap().stalls, 0);
}

/// An answer that was overtaken is not obeyed: a controller that arms ten times arms ten times, though around
/// each change its frames come in any order.
#[test]
fn wire_from_fc_jitter() {
    const PERIOD_US: u64 = 100_000;
    let overrides = [&fault("wire_from_fc", "jitter", Some(0.02)), "fc_timeout_ms=10000"];
    let report = run(&scenario(&overrides), patient(Duration::from_secs(5)), |fc| {
        loop {
            let time_us = fc.sensor();
            fc.controls(time_us, time_us / PERIOD_US % 2 == 1, [0.0; 4]);
            if time_us >= 20 * PERIOD_US + 50_000 {
                return Then::Stop;
            }
        }
    });
    let armed: Vec<f64> =
        report.events.iter().filter(|e| e.kind.name() == "armed").map(|e| e.time_s).collect();
    assert_eq!(armed.len(), 10, "{armed:?}");
    // The first of the frames that say so is at most as late as each may be.
    let late = |i: usize| armed[i] - 1e-6 * (PERIOD_US * (2 * i as u64 + 1)) as f64;
    assert!((0..10).all(|i| (0.0..=0.02 + 1.5e-3).contains(&late(i))), "{armed:?}");
    assert!(disrupted(&report).from_fc.delayed > 400);
    assert_eq!(report.link.unwrap().stalls, 0);
}

#[test]
fn wire_to_fc_duplicate() {
    let (report, seen) =
        answer_all(&[&fault("wire_to_fc", "duplicate", Some(1.0))], patient(Duration::from_secs(1)), 200);
    // The second copy of the last may still be unread.
    assert!(2 * seen.distinct() - seen.times_us.len() as u64 <= 1, "{}", seen.times_us.len());
    assert!(disrupted(&report).to_fc.duplicated >= 200);
    assert_eq!(report.link.unwrap().stalls, 0);
}

/// The second copy of an answer is none to the next sample, with a time or without.
#[test]
fn wire_from_fc_duplicate() {
    let overrides = fault("wire_from_fc", "duplicate", Some(1.0));
    let report = run(&scenario(&[&overrides]), patient(Duration::from_secs(1)), |fc| {
        fc.idle_until(400_000);
        let mut last = fc.sensor();
        for i in 0..100 {
            fc.controls(if i % 2 == 0 { last } else { 0 }, false, [0.0; 4]);
            let now = fc.sensor();
            assert_eq!(now, last + SAMPLE_US);
            assert_eq!(fc.sensor_within(Duration::from_millis(2)), None);
            last = now;
        }
        Then::Stop
    });
    let counts = disrupted(&report).from_fc;
    assert!(counts.duplicated >= 200, "{counts:?}");
    assert!(report.link.unwrap().received >= 2 * 200);
}

/// A network may repeat an answer too, and later than a fault here does; without a time its counter tells.
#[test]
fn an_answer_that_comes_twice_is_one() {
    run(&scenario(&[]), patient(Duration::from_secs(1)), |fc| {
        fc.idle_until(400_000);
        let mut last = fc.sensor();
        for i in 0..100 {
            let mut frame = Vec::new();
            let controls = ControlsFrame { time_us: last * (i % 2), flags: 1, controls: [0.0; 16], mode: 1 };
            fc.encoder.encode(&actuator_controls(&controls), &mut frame);
            fc.link.send(&frame);
            let now = fc.sensor();
            assert_eq!(now, last + SAMPLE_US);
            fc.link.send(&frame);
            assert_eq!(fc.sensor_within(Duration::from_millis(2)), None);
            last = now;
        }
        Then::Stop
    });
}

#[test]
fn wire_to_fc_corrupt() {
    let (report, seen) = answer_all(
        &[&fault("wire_to_fc", "corrupt", Some(0.1)), "fc_timeout_ms=10000"],
        patient(Duration::from_millis(5)),
        1000,
    );
    assert_share(seen.missing(), 1000, 0.1);
    assert!(seen.crc_errors > 0);
    assert_eq!(stalled(&report).lost_by_fault, seen.missing());
}

#[test]
fn wire_from_fc_corrupt() {
    let (report, seen) = answer_all(
        &[&fault("wire_from_fc", "corrupt", Some(0.1)), "fc_timeout_ms=10000"],
        patient(Duration::from_millis(5)),
        1000,
    );
    let (link, corrupted) = (report.link.unwrap(), disrupted(&report).from_fc.corrupted);
    assert_share(corrupted, 1000, 0.1);
    // The checksum lets none of them pass, and nothing else is lost; the last few may be unread.
    let whole = seen.times_us.len() as u64 - corrupted;
    assert!(link.received <= whole && link.received + 2 >= whole, "{whole} {link:?}");
    assert!(link.crc_errors > 0 && link.skipped_bytes > 0);
    assert_eq!(seen.missing(), 0);
}

fn assert_handed_over_and_landed(report: &Report) {
    let named = |name: &str| report.events.iter().any(|event| event.kind.name() == name);
    assert!(named("fc_lost") && named("handover"), "{:#?}", report.events);
    assert_eq!(report.outcome, Outcome::Landed, "{:#?}", report.events);
    let sources: Vec<Source> = report.flown_by.iter().map(|span| span.source).collect();
    assert_eq!(sources, [Source::Fc, Source::Autopilot]);
}

fn disconnects(component: &str) -> Disrupted {
    let fault = format!("fault = [{{component = \"{component}\", mode = \"disconnect\", above_m = 3.0}}]");
    let report = flown(&[&fault], lockstep(&GENERIC), |_| false);
    assert_handed_over_and_landed(&report);
    disrupted(&report)
}

#[test]
fn wire_to_fc_disconnect() {
    let counts = disconnects("wire_to_fc");
    assert!(counts.to_fc.dropped > 100 && counts.from_fc.dropped == 0, "{counts:?}");
}

#[test]
fn wire_from_fc_disconnect() {
    let counts = disconnects("wire_from_fc");
    assert!(counts.from_fc.dropped > 0 && counts.to_fc.dropped == 0, "{counts:?}");
}

/// A flight of the built-in autopilot whose controller breaks, and the phases that it believed in, in order.
fn flown_by_one_that_restarts(overrides: &[&str]) -> (Report, Vec<Phase>) {
    let (scenario, phases) = (scenario(overrides), RefCell::new(Vec::new()));
    let report = run(&scenario, lockstep(&GENERIC), |fc: &mut Fc| {
        let mut pilot =
            Pilot::for_scenario(&scenario, &Instrumentation::default(), GENERIC.throttle).unwrap();
        pilot.serve(
            &mut fc.link,
            || false,
            |belief| {
                let mut phases = phases.borrow_mut();
                if phases.last() != Some(&belief.phase) {
                    phases.push(belief.phase);
                }
            },
        );
        Then::RunOn
    });
    (report, phases.into_inner())
}

/// Disarmed frames of a controller that has booted anew in the air cut nothing: the autopilot has taken over.
fn restarts_in_the_air(fault: &str) -> Report {
    let (report, phases) = flown_by_one_that_restarts(&[fault]);
    assert_handed_over_and_landed(&report);
    // It had got beyond where it began, and began again.
    assert!(phases.iter().skip(1).any(|phase| *phase == phases[0]), "{phases:?}");
    report
}

#[test]
fn fc_reboot() {
    restarts_in_the_air("fault = [{component = \"fc\", mode = \"reboot\", above_m = 3.0}]");
}

#[test]
fn fc_brown_out() {
    let report = restarts_in_the_air(
        "fault = [{component = \"fc\", mode = \"brown_out\", above_m = 3.0, duration_s = 0.5}]",
    );
    // Without power nothing is heard, and of what is sent nothing arrives.
    assert!(disrupted(&report).to_fc.dropped > 100, "{:?}", report.link);
}

#[test]
fn a_controller_that_boots_anew_on_the_pad_flies_the_mission() {
    let (report, phases) =
        flown_by_one_that_restarts(&["fault = [{component = \"fc\", mode = \"reboot\", after_s = 0.5}]"]);
    assert_eq!(report.outcome, Outcome::Landed, "{:#?}", report.events);
    assert_eq!(report.flown_by.len(), 1, "{phases:?}");
}

/// The same seed gives the same losses, and the controller sees the same flight bit for bit.
#[test]
fn a_bad_wire_repeats_itself() {
    let of = |way: &str| {
        [("drop", 0.02), ("duplicate", 0.1), ("delay", 0.003), ("jitter", 0.01)]
            .map(|(mode, value)| {
                format!("{{component = \"{way}\", mode = \"{mode}\", value = {value}, at_event = \"armed\"}}")
            })
            .join(", ")
    };
    let faults = format!("fault = [{}, {}]", of("wire_to_fc"), of("wire_from_fc"));
    let fly = || {
        let mut seen = Vec::new();
        let options = patient(Duration::from_millis(300));
        let report = run(&scenario(&[&faults, "fc_timeout_ms=10000"]), options, |fc| {
            let (deadline, mut newest_us) = (Instant::now() + LONG, 0);
            while newest_us < 1_200_000 {
                assert!(Instant::now() < deadline, "after {newest_us}");
                let message = fc.next_within(Duration::from_millis(100));
                let Some(MavMessage::HIL_SENSOR(sample)) = message else { continue };
                // What is old is left alone.
                if sample.time_usec > newest_us {
                    newest_us = sample.time_usec;
                    let gimbal = (newest_us % 97_000) as f64 / 97_000.0;
                    fc.controls(newest_us, newest_us > 400_000, [0.0, gimbal, -gimbal, 0.0]);
                }
                seen.push(sample);
            }
            Then::Stop
        });
        assert!(stalled(&report).lost_by_fault > 0);
        seen
    };
    let (first, second) = (fly(), fly());
    assert!(first.windows(2).any(|pair| pair[1].time_usec <= pair[0].time_usec), "nothing was overtaken");
    assert_eq!(first, second);
}
