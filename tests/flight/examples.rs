//! The examples in memory do what they say: a law of one's own lands the vehicle, a Monte Carlo of the
//! built-in autopilot passes whatever it draws.

#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // the examples read files and print

#[allow(dead_code, unreachable_pub)] // a program of its own
#[path = "../../examples/monte_carlo.rs"]
mod monte_carlo;
#[allow(dead_code, unreachable_pub)] // a program of its own
#[path = "../../examples/own_guidance.rs"]
mod own_guidance;

use hopbench::scenario::Outcome;
use hopbench::simulation::Source;

#[test]
fn own_guidance_lands_softly_near_the_pad() {
    let report = own_guidance::hop().unwrap();
    assert_eq!(report.outcome, Outcome::Landed);
    assert_eq!(report.flown_by.iter().map(|span| span.source).collect::<Vec<_>>(), [Source::Fc]);
    assert!((report.max_altitude_m - 20.0).abs() < 1.0, "{} m", report.max_altitude_m);
    let touchdown = report.touchdown.unwrap();
    assert!(touchdown.vertical_speed_m_s < 1.0, "{touchdown:?}");
    assert!(touchdown.lateral_speed_m_s < 0.3 && touchdown.position_error_m < 0.5, "{touchdown:?}");
}

#[test]
fn monte_carlo_passes_in_the_order_of_its_seeds() {
    let reports = monte_carlo::flights(4).unwrap();
    assert_eq!(reports.iter().map(|report| report.seed).collect::<Vec<_>>(), [1, 2, 3, 4]);
    assert!(reports.iter().all(|report| report.expect.passed));
    let hashes: std::collections::BTreeSet<_> = reports.iter().map(|report| &report.state_hash).collect();
    assert_eq!(hashes.len(), 4, "every seed flies another flight");
}
