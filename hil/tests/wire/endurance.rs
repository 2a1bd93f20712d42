//! Lockstep on a bad wire for a long time: it ends, no wait is for ever, and every stall is counted,
//! explained and named within a second.
//!
//! 50 000 steps, or as many as `HOPBENCH_LOCKSTEP_STEPS` says; one exchange a step.
#![allow(clippy::disallowed_methods, clippy::disallowed_macros)]

use crate::fixture::peer;
use std::collections::HashSet;
use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use hopbench::scenario::Outcome;
use hopbench::simulation::{Flight, Instrumentation};
use hopbench_hil::bench::live::Live;
use hopbench_hil::bench::{Bench, Options};
use hopbench_hil::wire::link::Link;
use hopbench_hil::wire::profile::{GENERIC, PX4_SITL};

use crate::fixture::peer::{Fc, flown, lockstep};

/// One step of the plant, and here one sample (us).
const STEP_US: u64 = 1000;
/// Frames lost, and frames doubled, in each direction.
const SHARE: f64 = 0.01;
/// Nothing heard for this long is a deadlock: a thousand times the longest wait for an answer.
const DEADLOCK: Duration = Duration::from_secs(10);

/// What a person would have read, and when.
#[derive(Clone, Default)]
struct Screen(Arc<Mutex<Vec<(Instant, String)>>>);

impl Write for Screen {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().push((Instant::now(), String::from_utf8_lossy(bytes).into_owned()));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Each of the stalls that a notice names, and when it did.
fn named(screen: &Screen) -> Vec<(Instant, u64)> {
    let pieces = screen.0.lock().unwrap();
    let count = |text: &str| match text.strip_prefix("stall: ")? {
        many if many.contains("since the last notice") => many.split(' ').next()?.parse().ok(),
        _ => Some(1),
    };
    pieces.iter().filter_map(|(at, text)| Some((*at, count(text)?))).collect()
}

/// What the other end has seen.
#[derive(Default)]
struct Seen {
    samples: HashSet<u64>,
    /// Samples that came more than once.
    again: u64,
    newest_us: u64,
}

#[test]
fn lockstep_outlives_loss_delay_and_duplication() {
    let steps: u64 = std::env::var("HOPBENCH_LOCKSTEP_STEPS").map_or(50_000, |text| text.parse().unwrap());
    let fault = |component: &str, mode: &str, value: f64| {
        format!("{{component = \"{component}\", mode = \"{mode}\", value = {value:?}}}")
    };
    let faults: Vec<String> = ["wire_to_fc", "wire_from_fc"]
        .iter()
        .flat_map(|way| {
            [fault(way, "drop", SHARE), fault(way, "duplicate", SHARE), fault(way, "delay", 2.0e-3)]
        })
        .collect();
    let scenario = peer::scenario(&[&format!("fault = [{}]", faults.join(", ")), "fc_timeout_ms=10000"]);
    let instruments = Instrumentation { imu_rate_hz: Some(1e6 / STEP_US as f64), gnss_delay_s: None };
    let options = Options { lockstep_timeout: Duration::from_millis(3), ..lockstep(&PX4_SITL) };

    let (mut near, far) = Link::pair().unwrap();
    let mut flight = Flight::with(&scenario, 1, &instruments).unwrap();
    let (stop, over, newest_us) = (AtomicBool::new(false), AtomicBool::new(false), AtomicU64::new(0));
    let screen = Screen::default();
    let live = Live::to(screen.clone(), false);
    let start = Instant::now();
    let (timing, link, seen) = std::thread::scope(|threads| {
        let bench = threads.spawn(|| Bench::new(&mut flight, &mut near, options, live).run(&stop));
        threads.spawn(|| watch(&newest_us, &over));
        let mut fc = Fc::new(far);
        let mut seen = Seen::default();
        while seen.newest_us < steps * STEP_US {
            let Some(time_us) = fc.sensor_within(Duration::from_millis(100)) else { continue };
            seen.again += u64::from(!seen.samples.insert(time_us));
            seen.newest_us = seen.newest_us.max(time_us);
            newest_us.store(time_us, Ordering::Relaxed);
            fc.controls(time_us, false, [0.0; 4]);
        }
        stop.store(true, Ordering::Relaxed);
        let (timing, link) = bench.join().unwrap();
        over.store(true, Ordering::Relaxed);
        (timing, link, seen)
    });

    let (stalled, disrupted) = (link.stalled.unwrap(), link.disrupted.unwrap());
    let missing = seen.newest_us / STEP_US - seen.samples.len() as u64;
    let answers_lost = disrupted.from_fc.dropped;
    println!(
        "{} steps in {:.1} s: {missing} samples and {answers_lost} answers lost, {} samples twice; \
         {} stalls, {} by the fault, {} answered late, longest {:.1} ms, {:.1} s in all",
        timing.steps,
        start.elapsed().as_secs_f64(),
        seen.again,
        link.stalls,
        stalled.lost_by_fault,
        stalled.answered_late,
        stalled.longest_ms,
        stalled.total_ms * 1e-3
    );
    assert!(timing.steps >= steps);
    assert!(disrupted.from_fc.delayed > steps / 2 && disrupted.to_fc.duplicated > 0);

    // Five standard deviations of a count.
    let about = |count: u64, share: f64, of: u64| {
        let mean = share * of as f64;
        assert!((count as f64 - mean).abs() < 5.0 * mean.sqrt(), "{count} of {of}");
    };
    about(missing, SHARE, steps);
    about(answers_lost, SHARE, steps);

    // Every sample lost is a stall, and so is every answer lost, unless the sample came twice and its other
    // answer passed. The last samples under way when the run is stopped are nobody's.
    let others = link.stalls - stalled.lost_by_fault;
    let rescued = 2.0 * SHARE * seen.again as f64;
    let spared = (rescued + 5.0 * rescued.sqrt()) as u64 + 5 + others;
    let lost = missing + answers_lost;
    assert!(stalled.lost_by_fault <= lost, "{} > {lost}", stalled.lost_by_fault);
    assert!(stalled.lost_by_fault + spared >= lost, "{} < {lost} - {spared}", stalled.lost_by_fault);
    // Where the machine was too slow to answer in time the answer came late, or was lost later still.
    assert!(others <= stalled.answered_late + spared - others, "{others} stalls unexplained");

    // Named: all of them, and none later than a second; a busy machine has another.
    let named = named(&screen);
    assert_eq!(named.iter().map(|(_, count)| count).sum::<u64>(), link.stalls);
    let times: Vec<Instant> = named.iter().map(|(at, _)| *at).collect();
    let longest = times.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or_default();
    assert!(longest < Duration::from_secs(2), "{longest:?}");
    assert!(named.len() as f64 <= start.elapsed().as_secs_f64() + 2.0, "{} notices", named.len());
}

/// Ends the process when nothing moves: a deadlock cannot be joined.
fn watch(newest_us: &AtomicU64, over: &AtomicBool) {
    let (mut last, mut since) = (0, Instant::now());
    while !over.load(Ordering::Relaxed) {
        let now = newest_us.load(Ordering::Relaxed);
        if now != last {
            (last, since) = (now, Instant::now());
        }
        if since.elapsed() > DEADLOCK {
            eprintln!("deadlock: no HIL_SENSOR after time_usec {last} for {} s", DEADLOCK.as_secs());
            std::process::abort();
        }
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// A hop of the built-in autopilot on the same wire: a stall holds the last command for one sample.
#[test]
fn the_hop_lands_on_a_wire_that_loses_and_doubles_one_frame_in_a_hundred() {
    let faults = "fault = [\
        {component = \"wire_to_fc\", mode = \"drop\", value = 0.01}, \
        {component = \"wire_from_fc\", mode = \"drop\", value = 0.01}, \
        {component = \"wire_to_fc\", mode = \"duplicate\", value = 0.01}, \
        {component = \"wire_from_fc\", mode = \"duplicate\", value = 0.01}, \
        {component = \"wire_to_fc\", mode = \"delay\", value = 0.004}, \
        {component = \"wire_from_fc\", mode = \"delay\", value = 0.004}]";
    let options = Options { lockstep_timeout: Duration::from_millis(10), ..lockstep(&GENERIC) };
    let report = flown(&[faults, "fc_timeout_ms=10000"], options, |_| false);
    assert_eq!(report.outcome, Outcome::Landed, "{:#?}", report.events);
    assert_eq!(report.flown_by.len(), 1);
    assert!(report.link.unwrap().stalled.unwrap().lost_by_fault > 0);
}
