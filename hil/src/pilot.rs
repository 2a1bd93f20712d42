//! The built-in autopilot as a MAVLink flight controller: HIL messages in, HIL_ACTUATOR_CONTROLS out.
//!
//! It speaks through the same codec and links as any other controller and knows no more than they do.

use std::time::{Duration, Instant};

use hopbench::autopilot::Autopilot;
use hopbench::controls::{Controls, Scale};
use hopbench::signal::Measurement;
use hopbench::time::SimTime;

use crate::bench::Belief;
use crate::link::{Link, Notice};
use crate::mavlink::measurement::{Gatherer, is_reset};
use crate::mavlink::{ControlsFrame, Decoder, Encoder, MODE_ARMED, MODE_HIL, actuator_controls, heartbeat};
use crate::planner::Planner;

/// MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, as PX4 sets it.
const MODE_CUSTOM: u8 = 1;
/// HIL_ACTUATOR_CONTROLS flag: the answer carries the time of the sample.
const FLAG_LOCKSTEP: u64 = 1;
/// A plant that was there and is silent for this long has ended.
const PLANT_SILENCE: Duration = Duration::from_secs(3);

/// The built-in autopilot at the end of a link.
pub struct Pilot {
    fresh: Autopilot,
    autopilot: Autopilot,
    planner: Planner,
    controls: Controls,
    scale: Scale,
    gatherer: Gatherer,
    decoder: Decoder,
    encoder: Encoder,
    /// Frames that the link took.
    sent: u64,
    armed: bool,
    last: Option<SimTime>,
    next_heartbeat: Instant,
    out: Vec<u8>,
}

impl Pilot {
    /// A flight controller for a vehicle with these channels.
    ///
    /// # Errors
    /// When the system has no thread left to plan on.
    pub fn new(autopilot: Autopilot, controls: Controls, scale: Scale) -> std::io::Result<Self> {
        Ok(Self {
            fresh: autopilot.clone(),
            autopilot,
            planner: Planner::start()?,
            controls,
            scale,
            gatherer: Gatherer::default(),
            decoder: Decoder::default(),
            encoder: Encoder::new(1, 1),
            sent: 0,
            armed: false,
            last: None,
            next_heartbeat: Instant::now(),
            out: Vec::with_capacity(512),
        })
    }

    /// Flies until `stop` says so, or until the plant is gone. `tell` hears what is believed.
    pub fn serve(&mut self, link: &mut Link, stop: impl Fn() -> bool, mut tell: impl FnMut(Belief)) {
        let mut received = Vec::new();
        let mut fed = Instant::now();
        while !stop() {
            link.wait(Instant::now() + Duration::from_millis(50));
            received.clear();
            link.receive(&mut received);
            let hung_up = link.take_notices().iter().any(|n| matches!(n, Notice::Disconnected(_)));
            self.decoder.push(&received);
            while let Some(frame) = self.decoder.next_frame() {
                // Whoever speaks is there, though simulated time may stand.
                fed = Instant::now();
                let Some(message) = frame.message() else { continue };
                if is_reset(&message) {
                    self.forget();
                }
                if let Some(measurement) = self.gatherer.take(&message) {
                    self.answer(&measurement);
                    self.sent += u64::from(link.send(&self.out));
                    tell(self.belief());
                }
            }
            self.beat(link);
            if self.last.is_some() && (hung_up || fed.elapsed() > PLANT_SILENCE) {
                return;
            }
        }
    }

    /// Frames heard and sent so far.
    pub fn frames(&self) -> (u64, u64) {
        (self.decoder.counters().frames, self.sent)
    }

    /// Whether a plant has been heard.
    pub fn has_flown(&self) -> bool {
        self.last.is_some()
    }

    /// One HIL_SENSOR, one answer, in `out`.
    fn answer(&mut self, measurement: &Measurement) {
        if self.last.is_some_and(|last| measurement.time < last) {
            // Another flight on the same link.
            self.forget();
        }
        self.last = Some(measurement.time);
        self.planner.deliver(&mut self.autopilot, measurement.time);
        let command = self.autopilot.update(measurement);
        self.planner.take(&mut self.autopilot);
        self.armed = command.armed;
        let frame = ControlsFrame {
            time_us: measurement.time.us(),
            flags: FLAG_LOCKSTEP,
            controls: self.controls.encode(&command, &self.scale),
            mode: MODE_CUSTOM | if command.armed { MODE_ARMED } else { 0 },
        };
        self.out.clear();
        self.encoder.encode(&actuator_controls(&frame), &mut self.out);
    }

    /// Begins anew, as after a boot.
    fn forget(&mut self) {
        self.autopilot = self.fresh.clone();
        self.planner.forget();
        self.armed = false;
    }

    /// Once a second, and faster until the plant has spoken: whoever listens answers only who writes.
    fn beat(&mut self, link: &mut Link) {
        let now = Instant::now();
        if now < self.next_heartbeat {
            return;
        }
        self.next_heartbeat = now + Duration::from_millis(if self.last.is_some() { 1000 } else { 50 });
        self.out.clear();
        let mode = MODE_CUSTOM | MODE_HIL | if self.armed { MODE_ARMED } else { 0 };
        self.encoder.encode(&heartbeat(mode), &mut self.out);
        self.sent += u64::from(link.send(&self.out));
    }

    fn belief(&self) -> Belief {
        Belief {
            phase: self.autopilot.phase().name(),
            reference_ned_m: self.autopilot.reference().position_ned_m,
            estimate_ned_m: self.autopilot.estimate().position_ned_m,
            abort: self.autopilot.abort(),
            time: self.last.unwrap_or(SimTime::ZERO),
        }
    }
}
