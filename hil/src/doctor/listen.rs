//! Listening on a link, and saying just enough that a flight controller answers: heartbeats as its profile
//! wants them, and the samples of a vehicle that rests. Nothing is ever armed or commanded.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hopbench::controls::CHANNEL_COUNT;
use hopbench::frame::Vec3;
use hopbench::noise::{Stream, stream};
use hopbench::signal::{AltimeterSample, BarometerSample, GnssFix, ImuSample, Measurement};
use hopbench::time::SimTime;

use super::observation::{ControlsStatistics, Sender, Traffic};
use crate::wire::link::{Link, Notice};
use crate::wire::mavlink::{ControlsFrame, Decoder, Frame, FromFc, MODE_ARMED, MODE_HIL};
use crate::wire::profile::{Heartbeat, Profile, SensorRates};
use crate::wire::stream::Streams;

/// A jump of the controller's clock ahead of this machine's: more than any queue on the way explains (s).
const CLOCK_JUMP_S: f64 = 0.5;
/// Bytes kept to show what speaks.
const FIRST_BYTES: usize = 256;
/// Senders that are told apart; noise that looks like more is not followed.
const MOST_SENDERS: usize = 32;

/// Listens for `time`, or until `stop`.
pub fn listen(
    link: &mut Link,
    profile: &'static Profile,
    rates: &SensorRates,
    time: Duration,
    stop: &AtomicBool,
) -> Traffic {
    let start = Instant::now();
    let mut receiver =
        Receiver { start, traffic: Traffic::default(), decoder: Decoder::default(), last: Vec::new() };
    let mut transmitter = Transmitter::new(profile, rates, start);
    let mut bytes = Vec::new();
    while start.elapsed() < time && !stop.load(Ordering::Relaxed) {
        let wake = transmitter.send_due(link, &mut receiver.traffic).min(start + time);
        link.wait(wake);
        bytes.clear();
        link.receive(&mut bytes);
        receiver.traffic.had_peer |= link.has_peer();
        for notice in link.take_notices() {
            match notice {
                Notice::Connected(_) => receiver.decoder.forget_senders(),
                Notice::Disconnected(why) => receiver.traffic.losses.push(why),
                Notice::Refused(who) => receiver.traffic.refused_peers.push(who),
            }
        }
        receiver.receive(&bytes);
    }
    receiver.traffic.listened_s = start.elapsed().as_secs_f64();
    receiver.traffic.counters = receiver.decoder.counters();
    receiver.traffic
}

/// What arrives, and what is known of it.
struct Receiver {
    start: Instant,
    traffic: Traffic,
    decoder: Decoder,
    /// What the last frame of each sender said, in the order of `traffic.senders`.
    last: Vec<LastFrame>,
}

/// The last frame of a sender.
struct LastFrame {
    sequence: u8,
    /// The sender's time and this machine's at its last controls (s).
    clock: Option<(f64, f64)>,
}

impl Receiver {
    fn receive(&mut self, bytes: &[u8]) {
        let traffic = &mut self.traffic;
        traffic.bytes += bytes.len() as u64;
        let room = FIRST_BYTES - traffic.first_bytes.len();
        traffic.first_bytes.extend_from_slice(&bytes[..bytes.len().min(room)]);
        self.decoder.push(bytes);
        while let Some(frame) = self.decoder.next_frame() {
            self.receive_frame(&frame);
        }
    }

    fn receive_frame(&mut self, frame: &Frame) {
        let address = frame.sender;
        self.traffic.version_1 += u64::from(frame.is_version_1());
        let senders = &mut self.traffic.senders;
        let place = match senders.iter().position(|sender| sender.address == address) {
            Some(place) => place,
            None if senders.len() < MOST_SENDERS => {
                senders.push(Sender { address, ..Default::default() });
                self.last.push(LastFrame { sequence: frame.sequence.wrapping_sub(1), clock: None });
                senders.len() - 1
            }
            None => return,
        };
        let (sender, last) = (&mut senders[place], &mut self.last[place]);
        sender.frames += 1;
        // Half the circle or more is a step back.
        sender.backward += u64::from(frame.sequence.wrapping_sub(last.sequence).wrapping_sub(1) >= 128);
        last.sequence = frame.sequence;
        match frame.from_fc() {
            FromFc::Heartbeat(beat) => {
                sender.heartbeats += 1;
                sender.autopilot = beat.autopilot;
                sender.hil = beat.base_mode & MODE_HIL != 0;
                sender.armed |= beat.base_mode & MODE_ARMED != 0;
            }
            FromFc::Controls(controls) => {
                sender.armed |= controls.armed();
                sender.controls.add(&controls, self.start.elapsed().as_secs_f64(), &mut last.clock);
            }
            _ => {}
        }
    }
}

impl ControlsStatistics {
    /// Takes one frame in. `clock`: the controller's time and this machine's at its last frame (s).
    fn add(&mut self, frame: &ControlsFrame, now_s: f64, clock: &mut Option<(f64, f64)>) {
        if self.frames == 0 {
            self.first_s = now_s;
        }
        self.frames += 1;
        self.last_s = now_s;
        for channel in 0..CHANNEL_COUNT {
            let value = frame.controls[channel];
            if value.is_finite() {
                self.least[channel] = self.least[channel].min(value);
                self.greatest[channel] = self.greatest[channel].max(value);
            } else {
                self.not_finite[channel] = true;
            }
        }
        // 0: a controller that has no clock to show.
        if frame.time_us == 0 {
            return;
        }
        let its_s = frame.time_us as f64 * 1e-6;
        if let Some((its_last_s, last_s)) = *clock {
            let back = its_s < its_last_s;
            let ahead_s = (its_s - its_last_s) - (now_s - last_s);
            // A clock that seems to stand still is a frame that was late.
            if back || ahead_s > CLOCK_JUMP_S {
                self.jumps += 1;
                let jump_s = if back { its_s - its_last_s } else { ahead_s };
                if jump_s.abs() > self.worst_jump_s.abs() {
                    self.worst_jump_s = jump_s;
                }
            }
        }
        *clock = Some((its_s, now_s));
    }
}

/// What goes out.
struct Transmitter {
    profile: &'static Profile,
    rates: SensorRates,
    streams: Streams,
    start: Instant,
    noise: Stream,
    /// HIL_SENSOR samples made so far, and when the next heartbeat before them is due.
    samples: u64,
    next_heartbeat: Instant,
}

impl Transmitter {
    fn new(profile: &'static Profile, rates: &SensorRates, start: Instant) -> Self {
        Self {
            profile,
            rates: *rates,
            streams: Streams::new(profile),
            start,
            noise: stream(1, "doctor"),
            samples: 0,
            next_heartbeat: start,
        }
    }

    /// Sends what is due; returns when the next is.
    fn send_due(&mut self, link: &mut Link, traffic: &mut Traffic) -> Instant {
        let now = Instant::now();
        let fc = traffic.flight_controller();
        if !link.has_peer() {
            return now + Duration::from_millis(20);
        }
        if self.profile.needs_hil_flag && !fc.is_some_and(|fc| fc.heartbeats > 0 && fc.hil) {
            // Its outputs may be live: heartbeats and nothing else.
            if now >= self.next_heartbeat {
                let eager = self.profile.heartbeat == Heartbeat::EagerUntilAnswered && fc.is_none();
                self.next_heartbeat = now + Duration::from_millis(if eager { 100 } else { 1000 });
                self.streams.put_heartbeat();
                self.send(link, traffic);
            }
            return now + Duration::from_millis(20);
        }
        // What a busy machine missed is not made up for.
        let reached = (self.start.elapsed().as_secs_f64() * self.rates.imu_hz) as u64;
        if reached > self.samples {
            self.samples = reached;
            let measurement = self.at_rest();
            self.streams.put_measurement(&measurement);
            traffic.sensors_sent += 1;
            self.send(link, traffic);
        }
        self.start + Duration::from_secs_f64((self.samples + 1) as f64 / self.rates.imu_hz)
    }

    fn send(&mut self, link: &mut Link, traffic: &mut Traffic) {
        traffic.writes_not_taken += u64::from(!link.send(self.streams.bytes()));
        self.streams.bytes().clear();
    }

    /// A vehicle upright on its legs near 48° N, 9° E, every channel with noise beyond what a controller's
    /// checks take for stuck.
    fn at_rest(&mut self) -> Measurement {
        let period_us = (1e6 / self.rates.imu_hz).round() as u64;
        let every = |hz: f64| {
            let samples = (self.rates.imu_hz / hz.min(self.rates.imu_hz)).round() as u64;
            hz > 0.0 && self.samples.is_multiple_of(samples.max(1))
        };
        let (slow, fix, ground) = (every(50.0), every(self.rates.gnss_hz), every(self.rates.altimeter_hz));
        let noise = &mut self.noise;
        Measurement {
            time: SimTime::from_us(self.samples * period_us),
            imu: Some(ImuSample {
                specific_force_body_m_s2: Vec3::new(0.0, 0.0, -9.81) + 0.02 * noise.normal3(),
                rate_body_rad_s: 2e-3 * noise.normal3(),
                interval_s: 1.0 / self.rates.imu_hz,
                temperature_k: 293.15,
            }),
            magnetic_field_body_t: slow.then(|| Vec3::new(21e-6, 1e-6, 43e-6) + 2e-7 * noise.normal3()),
            barometer: slow.then(|| BarometerSample {
                pressure_pa: 95_461.0 + 3.0 * noise.normal(),
                pressure_altitude_m: 500.0,
                temperature_k: 293.15,
            }),
            gnss: fix.then(|| GnssFix {
                latitude_rad: 48f64.to_radians(),
                longitude_rad: 9f64.to_radians(),
                altitude_m: 500.0 + 0.1 * noise.normal(),
                velocity_ned_m_s: 0.03 * noise.normal3(),
                horizontal_accuracy_m: 0.9,
                vertical_accuracy_m: 1.5,
                fix_type: 3,
                satellites: 14,
            }),
            altimeter: ground.then(|| AltimeterSample {
                range_m: Some(0.79 + 0.01 * noise.normal()),
                minimum_m: 0.2,
                maximum_m: 40.0,
            }),
            ..Measurement::default()
        }
    }
}
