//! The rules of a run, shown by scripted flight controllers at the other end of a link in memory.

use std::time::{Duration, Instant};

use hopbench::event::Phase;
use hopbench::scenario::Outcome;
use hopbench::simulation::Source;
use hopbench_hil::bench::Options;
use hopbench_hil::wire::mavlink::{Encoder, MavMessage, heartbeat};
use hopbench_hil::wire::profile::{GENERIC, PX4_HITL, PX4_SITL, Pacing};

use crate::fixture::peer::{Then, flown, lockstep, run, scenario};

#[test]
fn each_sample_waits_for_the_answer_to_the_one_before() {
    let report = run(&scenario(&[]), lockstep(&PX4_SITL), |fc| {
        assert_eq!(fc.sensor(), 4000);
        // Before the first answer time runs by itself.
        assert_eq!(fc.sensor(), 8000);
        fc.controls(8000, false, [0.0; 4]);
        let mut last = fc.sensor();
        fc.controls(last, false, [0.0; 4]);
        for _ in 0..200 {
            let now = fc.sensor();
            assert_eq!(now, last + 4000);
            // Shorter than the stall's 50 ms.
            assert_eq!(fc.sensor_within(Duration::from_millis(1)), None);
            // An answer to the past is none; its own is, and so is one without a time.
            fc.controls(last, false, [0.0; 4]);
            fc.controls(if now % 8000 == 0 { now } else { 0 }, false, [0.0; 4]);
            last = now;
        }
        Then::Stop
    });
    let link = report.link.unwrap();
    assert_eq!((link.crc_errors, link.lost), (0, 0));
    assert!(report.timing.round_trip_us.is_some());
    assert!(report.events.iter().any(|e| e.kind.name() == "fc_first"));
}

#[test]
fn a_missing_answer_is_a_stall_that_is_counted_and_nothing_is_sent_twice() {
    let report = run(&scenario(&["fc_timeout_ms=10000"]), lockstep(&GENERIC), |fc| {
        fc.idle_until(400_000);
        let mut times = vec![fc.sensor()];
        let start = Instant::now();
        times.extend((0..3).map(|_| fc.sensor()));
        // Three waits of 50 ms went by.
        assert!(start.elapsed() >= Duration::from_millis(140));
        assert_eq!(times, [404_000, 408_000, 412_000, 416_000]);
        fc.controls(416_000, false, [0.0; 4]);
        assert_eq!(fc.sensor(), 420_000);
        Then::Stop
    });
    assert!(report.link.unwrap().stalls >= 3);
}

#[test]
fn time_on_the_wire_starts_at_one_period_and_keeps_its_grid() {
    for profile in [&GENERIC, &PX4_SITL] {
        run(&scenario(&[]), lockstep(profile), |fc| {
            for i in 1..=300 {
                assert_eq!(fc.sensor(), 4000 * i);
                fc.controls(4000 * i, false, [0.0; 4]);
            }
            Then::Stop
        });
    }
}

#[test]
fn a_wait_without_arming_ends_by_the_scenario() {
    let report = run(&scenario(&["arm_wait_s=2"]), lockstep(&GENERIC), |fc| {
        fc.idle_until(1_990_000);
        while let Some(time_us) = fc.sensor_within(Duration::from_millis(200)) {
            fc.controls(time_us, false, [1.0; 4]);
        }
        Then::RunOn
    });
    assert_eq!(report.outcome, Outcome::Timeout);
    assert_eq!(report.propellant.nitrous_used_kg, 0.0);
    assert!(!report.events.iter().any(|e| e.kind.name() == "armed"));
}

#[test]
fn controls_that_are_no_numbers_are_no_answer() {
    let report = run(&scenario(&[]), lockstep(&GENERIC), |fc| {
        fc.idle_until(400_000);
        let time_us = fc.sensor();
        for bad in [f64::NAN, f64::INFINITY] {
            fc.controls(time_us, true, [bad, 0.0, 0.0, 0.0]);
        }
        assert_eq!(fc.sensor_within(Duration::from_millis(5)), None);
        assert_eq!(fc.sensor(), time_us + 4000);
        Then::Stop
    });
    assert!(report.link.unwrap().stalls >= 1);
    assert!(!report.events.iter().any(|e| e.kind.name() == "armed"));
}

#[test]
fn a_board_without_the_hil_flag_gets_heartbeats_alone() {
    let options = Options { pacing: Pacing::RealTime, fast: false, ..lockstep(&PX4_HITL) };
    run(&scenario(&[]), options, |fc| {
        // Ten a second until it answers.
        let start = Instant::now();
        for _ in 0..5 {
            let message = fc.next_within(Duration::from_secs(1)).unwrap();
            assert!(matches!(message, MavMessage::HEARTBEAT(_)), "{message:?}");
        }
        assert!(start.elapsed() < Duration::from_secs(3));
        fc.send(&heartbeat(0x81));
        let until = Instant::now() + Duration::from_millis(300);
        while Instant::now() < until {
            if let Some(message) = fc.next_within(Duration::from_millis(50)) {
                assert!(matches!(message, MavMessage::HEARTBEAT(_)), "{message:?}");
            }
        }
        fc.send(&heartbeat(0xA1));
        assert!(fc.sensor() > 0);
        Then::Stop
    });
}

#[test]
fn the_built_in_autopilot_hops_over_the_wire() {
    let report = flown(&[], lockstep(&GENERIC), |_| false);
    assert_eq!(report.outcome, Outcome::Landed, "{:#?}", report.events);
    assert_eq!(report.link.unwrap().stalls, 0);
    assert_eq!(report.flown_by.len(), 1);
}

#[test]
fn a_controller_that_falls_silent_in_flight_is_replaced_and_the_verdict_says_so() {
    let report = flown(&[], lockstep(&GENERIC), |belief| belief.phase == Phase::Hover);
    let named = |name: &str| report.events.iter().find(|e| e.kind.name() == name);
    assert!(named("fc_lost").is_some() && named("handover").is_some(), "{:#?}", report.events);
    assert_eq!(report.outcome, Outcome::Landed);
    let sources: Vec<Source> = report.flown_by.iter().map(|span| span.source).collect();
    assert_eq!(sources, [Source::Fc, Source::Autopilot]);
    assert!(!report.expect.passed);
}

#[test]
fn a_loss_may_be_an_engine_cut() {
    let report = flown(&["on_fc_loss=\"cut\""], lockstep(&GENERIC), |belief| belief.phase == Phase::Hover);
    assert!(report.events.iter().any(|e| e.kind.name() == "fc_lost"));
    assert!(!report.events.iter().any(|e| e.kind.name() == "handover"));
    assert_ne!(report.outcome, Outcome::Landed);
    // Nobody else flew, and yet the controller did not fly to the end.
    let flown_by = report.expect.items.iter().find(|item| item.name == "flown_by").unwrap();
    assert!(!flown_by.passed, "{flown_by:?}");
}

#[test]
fn a_controller_that_repeats_an_old_answer_is_lost() {
    let scenario = scenario(&["fc_timeout_ms=300"]);
    let report = run(&scenario, lockstep(&GENERIC), |fc| {
        fc.idle_until(400_000);
        let time_us = fc.sensor();
        fc.controls(time_us, true, [0.0; 4]);
        let deadline = Instant::now() + Duration::from_secs(3);
        // After the loss time runs freely; until then a sample comes every 50 ms.
        let mut samples = 0;
        while samples < 100 && Instant::now() < deadline {
            samples += u32::from(fc.sensor_within(Duration::from_millis(10)).is_some());
            fc.controls(time_us, true, [0.0; 4]);
        }
        Then::Stop
    });
    assert!(report.events.iter().any(|e| e.kind.name() == "fc_lost"), "{:#?}", report.events);
}

#[test]
fn one_long_wait_outlasts_neither_the_timeout_nor_the_user() {
    let options = Options { lockstep_timeout: Duration::from_secs(60), ..lockstep(&GENERIC) };
    let report = run(&scenario(&["fc_timeout_ms=200"]), options.clone(), |fc| {
        fc.idle_until(400_000);
        let time_us = fc.sensor();
        fc.controls(time_us, true, [0.0; 4]);
        fc.sensor();
        let start = Instant::now();
        fc.sensor();
        assert!(start.elapsed() < Duration::from_secs(2));
        Then::Stop
    });
    assert!(report.events.iter().any(|e| e.kind.name() == "fc_lost"), "{:#?}", report.events);
    let start = Instant::now();
    run(&scenario(&[]), options, |fc| {
        fc.idle_until(400_000);
        fc.sensor();
        std::thread::sleep(Duration::from_millis(50));
        Then::Stop
    });
    assert!(start.elapsed() < Duration::from_secs(10));
}

#[test]
fn a_heartbeat_of_another_component_is_not_the_controllers() {
    let options = Options { pacing: Pacing::RealTime, fast: false, ..lockstep(&PX4_HITL) };
    run(&scenario(&[]), options, |fc| {
        let mut bytes = Vec::new();
        // A camera says that it is in the loop; so does a component that is no autopilot at all.
        Encoder::new(1, 100).encode(&heartbeat(0xA1), &mut bytes);
        let MavMessage::HEARTBEAT(mut no_autopilot) = heartbeat(0xA1) else { panic!() };
        no_autopilot.autopilot = ::mavlink::dialects::common::MavAutopilot::MAV_AUTOPILOT_INVALID;
        fc.encoder.encode(&MavMessage::HEARTBEAT(no_autopilot), &mut bytes);
        fc.link.send(&bytes);
        assert_eq!(fc.sensor_within(Duration::from_millis(300)), None);
        fc.send(&heartbeat(0xA1));
        assert!(fc.sensor() > 0);
        Then::Stop
    });
}

#[test]
fn controls_before_the_hil_flag_are_not_obeyed() {
    let options = Options { pacing: Pacing::RealTime, fast: false, ..lockstep(&PX4_HITL) };
    let report = run(&scenario(&[]), options, |fc| {
        for _ in 0..20 {
            fc.controls(0, true, [0.5, 0.0, 0.0, 0.0]);
            assert_eq!(fc.sensor_within(Duration::from_millis(10)), None);
        }
        fc.send(&heartbeat(0xA1));
        assert!(fc.sensor() > 0);
        Then::Stop
    });
    assert!(
        !report.events.iter().any(|e| e.kind.name() == "fc_first" || e.kind.name() == "armed"),
        "{:#?}",
        report.events
    );
}
