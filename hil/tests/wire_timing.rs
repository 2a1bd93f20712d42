//! What a run says of its time: round trips by stamp and by echo, overruns that are all accounted for.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use hopbench::scenario::{Outcome, Scenario};
use hopbench::simulation::report::{LinkReport, Timing};
use hopbench::simulation::{Flight, Instrumentation, Source};
use hopbench::time::SimTime;
use hopbench_hil::bench::live::Live;
use hopbench_hil::bench::pilot::Pilot;
use hopbench_hil::bench::{Belief, Bench, Options};
use hopbench_hil::load;
use hopbench_hil::wire::link::Link;
use hopbench_hil::wire::mavlink::{ControlsFrame, Decoder, Encoder, MavMessage, actuator_controls};
use hopbench_hil::wire::profile::{GENERIC, Pacing};

fn scenario() -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/hover_5m.toml");
    load::scenario(&path, &[], None).unwrap()
}

fn options(pacing: Pacing) -> Options {
    Options {
        profile: &GENERIC,
        pacing,
        fast: pacing == Pacing::Lockstep,
        lockstep_timeout: Duration::from_millis(500),
        source: Source::Fc,
        baud: None,
    }
}

/// Runs a bench whose loop is held up by `burden` at each sample, until the controller `fc` has seen enough.
fn run(options: Options, burden: impl Fn() + Sync, fc: impl FnOnce(&mut Link)) -> (Timing, LinkReport) {
    let scenario = scenario();
    let (mut near, mut far) = Link::pair().unwrap();
    let stop = AtomicBool::new(false);
    let mut flight = Flight::new(&scenario, 1).unwrap();
    std::thread::scope(|threads| {
        let bench = threads.spawn(|| {
            // The bench asks what the other end believes once a sample: the place to be slow at.
            let belief = || -> Option<Belief> {
                burden();
                None
            };
            Bench::new(&mut flight, &mut near, options, Live::silent()).with_belief(&belief).run(&stop)
        });
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| fc(&mut far)));
        stop.store(true, Ordering::Relaxed);
        let figures = bench.join().unwrap();
        done.unwrap();
        figures
    })
}

/// Answers every HIL_SENSOR, until that of `until_us`, with the controls that `answer` makes of its number
/// and time.
fn answer_until(until_us: u64, link: &mut Link, answer: impl Fn(u64, u64) -> ControlsFrame) -> Vec<u64> {
    let (mut decoder, mut encoder) = (Decoder::default(), Encoder::new(1, 1));
    let (mut times, mut bytes) = (Vec::new(), Vec::new());
    let deadline = Instant::now() + Duration::from_secs(60);
    while times.last().is_none_or(|last| *last < until_us) {
        assert!(Instant::now() < deadline, "the bench goes on");
        link.wait(deadline);
        bytes.clear();
        link.receive(&mut bytes);
        decoder.push(&bytes);
        while let Some(frame) = decoder.next_frame() {
            if let Some(MavMessage::HIL_SENSOR(sample)) = frame.message() {
                let frame = answer(times.len() as u64, sample.time_usec);
                times.push(sample.time_usec);
                bytes.clear();
                encoder.encode(&actuator_controls(&frame), &mut bytes);
                link.send(&bytes);
            }
        }
    }
    times
}

fn controls(time_us: u64, echo: f64) -> ControlsFrame {
    let mut controls = [0.0; 16];
    controls[15] = echo;
    ControlsFrame { time_us, flags: 1, controls, mode: 1 }
}

fn echo_of(time_us: u64) -> f64 {
    let mut channels = [0.0; 16];
    scenario().vehicle.controls.set_echo(&mut channels, SimTime::from_us(time_us));
    channels[15]
}

#[test]
fn both_round_trips_agree_where_both_can_be_measured() {
    let (timing, _) = run(
        options(Pacing::Lockstep),
        || (),
        |link| {
            // The first answer has no time stamp, as the first echo has nothing before it to differ from.
            answer_until(2_500_000, link, |n, us| controls(if n == 0 { 0 } else { us }, echo_of(us)));
        },
    );
    let (stamp, echo) = (timing.round_trip_us.unwrap(), timing.echo_us.unwrap());
    // The same frames at the same moment.
    assert_eq!(stamp, echo);
    assert!(stamp.p50 > 0.0 && stamp.p50 <= stamp.p99 && stamp.p99 <= stamp.p999 && stamp.p999 <= stamp.max);
}

#[test]
fn the_echo_measures_a_board_that_has_a_clock_of_its_own() {
    let began = Instant::now();
    let board_us = |n: u64| 1_700_000_000_123_457 + 4001 * n;
    let (timing, link) = run(
        options(Pacing::RealTime),
        || (),
        |link| {
            answer_until(1_200_000, link, |n, us| controls(board_us(n), echo_of(us)));
        },
    );
    assert_eq!(timing.round_trip_us, None);
    let echo = timing.echo_us.unwrap();
    assert!(echo.p50 > 0.0 && echo.max < began.elapsed().as_secs_f64() * 1e6);
    // Silences are longer than the step, and none is longer than the run.
    let longest_ms = link.longest_gap_ms.unwrap();
    assert!((1.0..began.elapsed().as_secs_f64() * 1e3).contains(&longest_ms), "{longest_ms} ms");
}

#[test]
fn a_channel_that_echoes_nothing_is_no_round_trip() {
    for constant in [0.0, 0.5, 0.123_45, f64::NAN] {
        let (timing, _) = run(
            options(Pacing::Lockstep),
            || (),
            |link| {
                answer_until(1_200_000, link, |_, us| controls(us, constant));
            },
        );
        assert_eq!(timing.echo_us, None, "{constant}");
        assert!(timing.round_trip_us.is_some());
    }
}

/// Every overrun has its end, every nanosecond its place, and another clock than the pacing's agrees.
fn balanced(timing: &Timing) {
    let ended = timing.overruns_caught_up + timing.overruns_slipped + timing.overruns_open;
    assert_eq!(timing.overruns, ended, "{timing:?}");
    assert_eq!(timing.unaccounted_us, Some(0.0), "{timing:?}");
    let beyond_s = timing.wall_s - timing.simulated_s - timing.slipped_s;
    // What is late at the end has not slipped yet: at most 50 ms; the rest is the way into the loop and out
    // of it.
    assert!((-0.001..0.5).contains(&beyond_s), "{beyond_s} s in {timing:?}");
}

#[test]
fn a_loop_that_is_held_up_catches_up_and_leaves_no_sample_out() {
    let samples = AtomicU64::new(0);
    let burden = || {
        if samples.fetch_add(1, Ordering::Relaxed) % 50 == 49 {
            std::thread::sleep(Duration::from_millis(25));
        }
    };
    let mut times = Vec::new();
    let (timing, _) = run(options(Pacing::RealTime), burden, |link| {
        times = answer_until(1_400_000, link, |_, us| controls(us, 0.0));
    });
    assert!(times.windows(2).all(|pair| pair[1] == pair[0] + 4000), "{times:?}");
    balanced(&timing);
    // Seven times at least: 350 samples. A machine that adds 25 ms of its own makes a slip of it.
    let spells = timing.worst_overruns.iter().filter(|spell| spell.late_ms >= 20.0).count();
    assert!(spells >= 6, "{timing:?}");
    assert!(timing.overruns_caught_up > 0 || timing.slips >= 6);
}

#[test]
fn beyond_fifty_milliseconds_the_slip_is_counted_with_its_length() {
    const HELD_UP_MS: u64 = 100;
    let samples = AtomicU64::new(0);
    let burden = || {
        if samples.fetch_add(1, Ordering::Relaxed) % 15 == 14 {
            std::thread::sleep(Duration::from_millis(HELD_UP_MS));
        }
    };
    let (timing, link) = run(options(Pacing::RealTime), burden, |link| {
        answer_until(1_200_000, link, |_, us| controls(us, 0.0));
    });
    balanced(&timing);
    // 300 samples, each fifteenth: 20 times 100 ms, less the step that was due meanwhile.
    assert!(timing.slips >= 19, "{timing:?}");
    assert!(timing.slipped_s >= 19.0 * (HELD_UP_MS - 1) as f64 * 1e-3, "{timing:?}");
    assert!(timing.worst_overruns[0].slipped_ms.is_some_and(|ms| ms >= (HELD_UP_MS - 1) as f64));
    // Controls came no more often than samples went: as many gaps of more than a tenth of 200 ms.
    assert!(link.gaps >= 18, "{link:?}");
}

#[test]
fn the_built_in_autopilot_hops_at_500_samples_a_second() {
    let scenario = scenario();
    let (mut near, mut far) = Link::pair().unwrap();
    let (stop, done) = (AtomicBool::new(false), AtomicBool::new(false));
    let instruments = Instrumentation { imu_rate_hz: Some(500.0), gnss_delay_s: None };
    let mut flight = Flight::with(&scenario, 1, &instruments).unwrap();
    let timing = std::thread::scope(|threads| {
        threads.spawn(|| {
            let mut pilot = Pilot::for_scenario(&scenario, &instruments, GENERIC.throttle).unwrap();
            pilot.serve(&mut far, || done.load(Ordering::Relaxed), |_| ());
        });
        let bench = Bench::new(&mut flight, &mut near, options(Pacing::Lockstep), Live::silent());
        let (timing, _) = bench.run(&stop);
        done.store(true, Ordering::Relaxed);
        timing
    });
    assert_eq!(flight.outcome(), Some(Outcome::Landed));
    assert!(timing.steps as f64 > timing.plant_hz * (timing.simulated_s - 0.001));
    // The pilot echoes what it answers.
    assert!(timing.echo_us.is_some());
    assert_eq!(timing.unaccounted_us, None);
}
