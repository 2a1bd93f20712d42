//! A pseudo-terminal that plays a serial port, and what a scripted flight controller says through it.
#![allow(dead_code, reason = "each test file uses its share")]

use std::io::{Read, Write};
use std::time::{Duration, Instant};

use hopbench_hil::wire::mavlink::{ControlsFrame, Decoder, Encoder, MavMessage, actuator_controls};

/// The master end; `path` is what a serial link opens. Dropped, the port is unplugged.
pub struct Terminal {
    master: std::fs::File,
    pub path: String,
}

impl Terminal {
    pub fn new() -> Self {
        use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        rustix::fs::fcntl_setfl(&master, rustix::fs::OFlags::NONBLOCK).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let path = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
        let mut raw = rustix::termios::tcgetattr(&master).unwrap();
        raw.make_raw();
        rustix::termios::tcsetattr(&master, rustix::termios::OptionalActions::Now, &raw).unwrap();
        Self { master: master.into(), path }
    }

    pub fn link(&self) -> String {
        format!("serial:{}:921600", self.path)
    }

    /// What does not fit is lost, as on a wire.
    pub fn write(&mut self, bytes: &[u8]) {
        let _ = self.master.write(bytes);
    }

    pub fn read(&mut self, bytes: &mut Vec<u8>) {
        let mut buffer = [0; 4096];
        while let Ok(length) = self.master.read(&mut buffer) {
            if length == 0 {
                return;
            }
            bytes.extend_from_slice(&buffer[..length]);
        }
    }
}

/// A scripted flight controller behind a port.
pub struct Board {
    pub port: Terminal,
    pub decoder: Decoder,
    pub encoder: Encoder,
}

impl Board {
    pub fn new() -> Self {
        Self { port: Terminal::new(), decoder: Decoder::default(), encoder: Encoder::new(1, 1) }
    }

    pub fn say(&mut self, message: &MavMessage) {
        let mut bytes = Vec::new();
        self.encoder.encode(message, &mut bytes);
        self.port.write(&bytes);
    }

    /// The next message that `wanted` picks, within five seconds.
    pub fn hear<T>(&mut self, mut wanted: impl FnMut(&MavMessage) -> Option<T>) -> Option<T> {
        let deadline = Instant::now() + Duration::from_secs(5);
        let mut bytes = Vec::new();
        while Instant::now() < deadline {
            while let Some(frame) = self.decoder.next_frame() {
                if let Some(found) = frame.message().as_ref().and_then(&mut wanted) {
                    return Some(found);
                }
            }
            bytes.clear();
            self.port.read(&mut bytes);
            self.decoder.push(&bytes);
            if bytes.is_empty() {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        None
    }

    /// Time of the next HIL_SENSOR (us).
    pub fn sensor_us(&mut self) -> u64 {
        let time_us = |message: &MavMessage| match message {
            MavMessage::HIL_SENSOR(data) => Some(data.time_usec),
            _ => None,
        };
        self.hear(time_us).expect("the bench goes on")
    }

    pub fn controls(&mut self, time_us: u64, mode: u8, first: [f64; 4]) {
        self.say(&controls(time_us, mode, first));
    }
}

pub fn controls(time_us: u64, mode: u8, first: [f64; 4]) -> MavMessage {
    let mut controls = [0.0; 16];
    controls[..4].copy_from_slice(&first);
    actuator_controls(&ControlsFrame { time_us, flags: 0, controls, mode })
}
