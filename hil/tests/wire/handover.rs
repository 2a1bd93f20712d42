//! Hand-over: a controller that falls silent or talks nonsense in the air is replaced within its timeout and
//! without a bump, and comes back only on request.

use std::time::Duration;

use ::mavlink::dialects::common::{COMMAND_LONG_DATA, MavCmd, MavResult};
use hopbench::event::Phase;
use hopbench::scenario::Outcome;
use hopbench::simulation::report::Handover;
use hopbench::simulation::{Instrumentation, Source};
use hopbench_hil::bench::pilot::Pilot;
use hopbench_hil::wire::mavlink::MavMessage;
use hopbench_hil::wire::profile::GENERIC;

use crate::fixture::peer::{Fc, Then, flown, lockstep, run, scenario};

/// The pivot of the reference vehicle at rest (m).
const REST_NED_M: f64 = -0.74;

/// The change of hands of a flight whose controller falls silent in `phase`, above `height_m`.
fn handover_in(phase: Phase, height_m: f64) -> Handover {
    let report =
        flown(&[], lockstep(&GENERIC), |b| b.phase == phase && b.estimate_ned_m.z < REST_NED_M - height_m);
    assert_eq!(report.outcome, Outcome::Landed, "{phase:?}: {:#?}", report.events);
    let [handover] = report.handovers[..] else { panic!("{phase:?}: {:?}", report.handovers) };
    assert_eq!(handover.to, Some(Source::Autopilot));
    handover
}

/// The successor starts from the command in force, so its first one is within what predictive control may
/// change in one of its steps, 20 ms, after the four samples that went unanswered: 30 N and 0.5 deg. What
/// follows is a vehicle that goes on as it was: a hop leans by a degree or two of its own.
#[test]
fn the_autopilot_takes_over_without_a_bump() {
    for (phase, height_m) in
        [(Phase::Ascent, 2.5), (Phase::Hover, 0.0), (Phase::Descent, 2.5), (Phase::Terminal, 0.5)]
    {
        let h = handover_in(phase, height_m);
        // Four waits of 50 ms, a sample each, and the one that the successor sees.
        assert!(h.silence_ms <= 20.5, "{phase:?}: {h:?}");
        assert!(h.silence_wall_ms >= 190.0, "{phase:?}: {h:?}");
        assert!(h.thrust_step_n.abs() <= 35.0 && h.gimbal_step_deg <= 0.5, "{phase:?}: {h:?}");
        assert!(h.after.tilt_deg <= h.before.tilt_deg + 1.0, "{phase:?}: {h:?}");
        assert!(h.after.rate_deg_s <= 10.0, "{phase:?}: {h:?}");
    }
}

/// Asks for the controls back; what the bench answers.
fn ask_back(fc: &mut Fc) -> MavResult {
    fc.send(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_NAV_GUIDED_ENABLE,
        param1: 1.0,
        target_system: 1,
        target_component: 200,
        ..COMMAND_LONG_DATA::default()
    }));
    loop {
        let message = fc.next_within(Duration::from_secs(5)).expect("an answer");
        if let MavMessage::COMMAND_ACK(ack) = message {
            return ack.result;
        }
    }
}

#[test]
fn a_controller_comes_back_on_request_and_only_when_it_is_fit_to_fly() {
    let scenario = scenario(&[]);
    let options = lockstep(&GENERIC);
    let throttle = options.profile.throttle;
    let report = run(&scenario, options, |fc| {
        let mut pilot = Pilot::for_scenario(&scenario, &Instrumentation::default(), throttle).unwrap();
        let hovers = std::cell::Cell::new(false);
        pilot.serve(&mut fc.link, || hovers.get(), |belief| hovers.set(belief.phase == Phase::Hover));
        assert_eq!(ask_back(fc), MavResult::MAV_RESULT_DENIED, "it flies anyway");
        // Silence until the hand-over, and some time after it.
        for _ in 0..100 {
            fc.sensor();
        }
        assert_eq!(ask_back(fc), MavResult::MAV_RESULT_DENIED, "it is silent");
        for armed in [false, true] {
            for _ in 0..20 {
                let time_us = fc.sensor();
                fc.controls(time_us, armed, [0.45, 0.0, 0.0, 0.0]);
            }
            if !armed {
                assert_eq!(ask_back(fc), MavResult::MAV_RESULT_DENIED, "it is disarmed");
            }
        }
        assert_eq!(ask_back(fc), MavResult::MAV_RESULT_ACCEPTED);
        for _ in 0..20 {
            let time_us = fc.sensor();
            fc.controls(time_us, true, [0.45, 0.0, 0.0, 0.0]);
        }
        Then::Stop
    });
    let sources: Vec<Source> = report.flown_by.iter().map(|span| span.source).collect();
    assert_eq!(sources, [Source::Fc, Source::Autopilot, Source::Fc], "{:#?}", report.events);
    let to: Vec<_> = report.handovers.iter().map(|h| h.to).collect();
    assert_eq!(to, [Some(Source::Autopilot), Some(Source::Fc)]);
    assert!(report.events.iter().any(|e| e.kind.name() == "handback"));
    // Disarmed frames before it did not cut, nor did armed ones fly.
    assert!(!report.events.iter().any(|e| e.kind.name() == "shutdown"), "{:#?}", report.events);
}

#[test]
fn nonsense_is_silence() {
    for bad in [f64::NAN, f64::NEG_INFINITY] {
        let scenario = scenario(&[]);
        let report = run(&scenario, lockstep(&GENERIC), |fc| {
            let mut pilot =
                Pilot::for_scenario(&scenario, &Instrumentation::default(), GENERIC.throttle).unwrap();
            let hovers = std::cell::Cell::new(false);
            pilot.serve(&mut fc.link, || hovers.get(), |belief| hovers.set(belief.phase == Phase::Hover));
            while let Some(time_us) = fc.sensor_within(Duration::from_millis(500)) {
                fc.controls(time_us, true, [bad, 0.0, 0.0, 0.0]);
            }
            Then::RunOn
        });
        assert_eq!(report.outcome, Outcome::Landed, "{bad}: {:#?}", report.events);
        let lost = report.events.iter().find(|e| e.kind.name() == "fc_lost").expect("an event");
        assert!(lost.detail.contains("frames refused"), "{lost:?}");
        assert_eq!(report.handovers.len(), 1);
    }
}
