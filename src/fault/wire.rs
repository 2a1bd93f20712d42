//! Faults of the wire and of the flight controller as plain values. `Default` is the sound link.

use super::{Acting, Component, Mode};

/// What is broken between bench and flight controller now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WireEffect {
    /// From the bench to the flight controller.
    pub to_fc: Direction,
    /// From the flight controller to the bench.
    pub from_fc: Direction,
    /// The flight controller itself.
    pub fc: FcEffect,
}

/// One direction of the wire, frame by frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Direction {
    /// Share of frames that are lost.
    pub drop_share: f64,
    /// Every frame is late by this much (s).
    pub delay_s: f64,
    /// And by up to this much more, each its own (s).
    pub jitter_s: f64,
    /// Share of frames that arrive twice.
    pub duplicate_share: f64,
    /// Share of frames in which a bit is flipped.
    pub corrupt_share: f64,
    /// Nothing passes.
    pub disconnected: bool,
}

/// The flight controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FcEffect {
    /// It is told to boot anew, once when this becomes true.
    pub reboots: bool,
    /// It has no power; it boots when this becomes false.
    pub brown_out: bool,
}

impl WireEffect {
    /// The effect with one more fault; faults of other groups change nothing.
    pub(super) fn add(&mut self, fault: &Acting) {
        match (fault.component, fault.mode) {
            (Component::WireToFc, _) => self.to_fc.add(fault),
            (Component::WireFromFc, _) => self.from_fc.add(fault),
            (Component::Fc, Mode::Reboot) => self.fc.reboots = true,
            (Component::Fc, Mode::BrownOut) => self.fc.brown_out = true,
            _ => {}
        }
    }
}

impl Direction {
    fn add(&mut self, fault: &Acting) {
        let either = |first: f64| 1.0 - (1.0 - first) * (1.0 - fault.value);
        match fault.mode {
            Mode::Drop => self.drop_share = either(self.drop_share),
            Mode::Delay => self.delay_s += fault.value,
            Mode::Jitter => self.jitter_s += fault.value,
            Mode::Duplicate => self.duplicate_share = either(self.duplicate_share),
            Mode::Corrupt => self.corrupt_share = either(self.corrupt_share),
            Mode::Disconnect => self.disconnected = true,
            _ => {}
        }
    }
}
