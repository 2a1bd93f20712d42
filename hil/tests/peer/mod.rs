//! A scripted flight controller at the other end of a link in memory, and the bench around it.
#![allow(dead_code, reason = "each test file uses its share")]

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hopbench::scenario::Scenario;
use hopbench::simulation::{Flight, Instrumentation, Report, Source};
use hopbench_hil::bench::live::Live;
use hopbench_hil::bench::pilot::Pilot;
use hopbench_hil::bench::{Belief, Bench, Options};
use hopbench_hil::load;
use hopbench_hil::wire::link::Link;
use hopbench_hil::wire::mavlink::{ControlsFrame, Decoder, Encoder, MavMessage, actuator_controls};
use hopbench_hil::wire::profile::{Pacing, Profile};

pub fn scenario(overrides: &[&str]) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/hover_5m.toml");
    let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
    load::scenario(&path, &overrides, None).unwrap()
}

pub fn lockstep(profile: &'static Profile) -> Options {
    Options {
        profile,
        pacing: Pacing::Lockstep,
        fast: true,
        lockstep_timeout: Duration::from_millis(50),
        source: Source::Fc,
        baud: None,
    }
}

/// Runs a bench while `fc` plays the other end; when `fc` returns, the run is stopped unless it asks to be
/// left to its own end.
pub fn run(scenario: &Scenario, options: Options, fc: impl FnOnce(&mut Fc) -> Then) -> Report {
    let (mut near, far) = Link::pair().unwrap();
    let stop = AtomicBool::new(false);
    let instruments = Instrumentation { imu_rate_hz: None, gnss_delay_s: options.profile.gnss_delay_s };
    let mut flight = Flight::with(scenario, 1, &instruments).unwrap();
    std::thread::scope(|threads| {
        let bench = threads.spawn(|| {
            let (timing, link) = Bench::new(&mut flight, &mut near, options, Live::silent()).run(&stop);
            let mut report = flight.report();
            report.require_fc();
            (report.timing, report.link) = (timing, Some(link));
            report
        });
        let mut other_end = Fc::new(far);
        // A failed assertion in `fc` must end the run too, or the scope would wait for ever.
        let then = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| fc(&mut other_end)));
        if !matches!(then, Ok(Then::RunOn)) {
            stop.store(true, Ordering::Relaxed);
        }
        let report = bench.join().unwrap();
        if let Err(failure) = then {
            std::panic::resume_unwind(failure);
        }
        report
    })
}

/// What happens to a run when its controller has nothing more to say.
pub enum Then {
    Stop,
    RunOn,
}

/// A scripted flight controller.
pub struct Fc {
    pub link: Link,
    pub decoder: Decoder,
    pub encoder: Encoder,
    received: Vec<u8>,
}

impl Fc {
    pub fn new(link: Link) -> Self {
        Self { link, decoder: Decoder::default(), encoder: Encoder::new(1, 1), received: Vec::new() }
    }

    /// The next message, `None` when none comes within `patience`.
    pub fn next_within(&mut self, patience: Duration) -> Option<MavMessage> {
        let deadline = Instant::now() + patience;
        loop {
            while let Some(frame) = self.decoder.next_frame() {
                if let Some(message) = frame.message() {
                    return Some(message);
                }
            }
            if Instant::now() >= deadline {
                return None;
            }
            self.link.wait(deadline);
            self.received.clear();
            self.link.receive(&mut self.received);
            self.decoder.push(&self.received);
        }
    }

    /// Time of the next HIL_SENSOR (us).
    pub fn sensor_within(&mut self, patience: Duration) -> Option<u64> {
        let deadline = Instant::now() + patience;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            if let MavMessage::HIL_SENSOR(data) = self.next_within(left)? {
                return Some(data.time_usec);
            }
        }
    }

    pub fn sensor(&mut self) -> u64 {
        self.sensor_within(Duration::from_secs(5)).expect("the bench goes on")
    }

    pub fn send(&mut self, message: &MavMessage) {
        let mut bytes = Vec::new();
        self.encoder.encode(message, &mut bytes);
        self.link.send(&bytes);
    }

    pub fn controls(&mut self, time_us: u64, armed: bool, first: [f64; 4]) {
        let mut controls = [0.0; 16];
        controls[..4].copy_from_slice(&first);
        let mode = if armed { 129 } else { 1 };
        self.send(&actuator_controls(&ControlsFrame { time_us, flags: 1, controls, mode }));
    }

    /// Answers disarmed until the sample of `time_us`, that one included.
    pub fn idle_until(&mut self, time_us: u64) {
        loop {
            let now_us = self.sensor();
            self.controls(now_us, false, [0.0; 4]);
            if now_us >= time_us {
                return;
            }
        }
    }
}

/// Lets the built-in autopilot fly through the link until `silent` says so of what it believes, then say nothing more.
pub fn flown(overrides: &[&str], options: Options, silent: impl Fn(&Belief) -> bool) -> Report {
    let scenario = scenario(overrides);
    let throttle = options.profile.throttle;
    run(&scenario, options, |fc| {
        let mut pilot = Pilot::for_scenario(&scenario, &Instrumentation::default(), throttle).unwrap();
        let done = AtomicBool::new(false);
        let tell = |belief: Belief| done.store(silent(&belief), Ordering::Relaxed);
        pilot.serve(&mut fc.link, || done.load(Ordering::Relaxed), tell);
        // Holds the link open: silence, not a hang-up.
        while fc.sensor_within(Duration::from_millis(500)).is_some() {}
        Then::RunOn
    })
}
