//! What was observed on a link: who spoke, what arrived, what was sent.

use hopbench::controls::CHANNEL_COUNT;

use super::channel::MappedChannel;
use crate::wire::link::{LinkSpec, OpenFailure};
use crate::wire::mavlink::{AUTOPILOT_COMPONENT, AUTOPILOT_INVALID, Address, Counters};
use crate::wire::port::{Holder, Port};
use crate::wire::profile::{Profile, SensorRates};

/// All that was observed on one link.
#[derive(Clone, Debug)]
pub struct Observation {
    /// The link as it was asked for.
    pub link: LinkSpec,
    /// What the flight controller was expected to be.
    pub profile: &'static Profile,
    /// How often the sensors speak.
    pub rates: SensorRates,
    /// What the vehicle's channels mean; `None`: no vehicle was named.
    pub map: Option<Vec<MappedChannel>>,
    /// Why the link could not be opened; then nothing below was observed.
    pub failure: Option<OpenFailure>,
    /// Who else has the port open.
    pub holders: Vec<Holder>,
    /// Serial ports of this machine.
    pub ports: Vec<Port>,
    /// What was received and sent.
    pub traffic: Traffic,
}

/// What was received on the link, and what was sent meanwhile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traffic {
    /// For how long (s).
    pub listened_s: f64,
    /// Somebody was at the other end, at least for a while.
    pub had_peer: bool,
    /// Bytes received.
    pub bytes: u64,
    /// The first of them, 256 at most.
    pub first_bytes: Vec<u8>,
    /// Frames, damage, gaps.
    pub counters: Counters,
    /// Frames of MAVLink 1.
    pub version_1: u64,
    /// Whoever spoke, in the order of appearance.
    pub senders: Vec<Sender>,
    /// Why the link was lost, once for each time.
    pub losses: Vec<String>,
    /// Who was turned away.
    pub refused_peers: Vec<String>,
    /// HIL_SENSOR frames sent.
    pub sensors_sent: u64,
    /// Writes that the other end did not take.
    pub writes_not_taken: u64,
}

/// One system and component, by what it sent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sender {
    /// System and component.
    pub address: Address,
    /// Frames from it.
    pub frames: u64,
    /// Of these, frames whose counter went back.
    pub backward: u64,
    /// HEARTBEAT frames.
    pub heartbeats: u64,
    /// Make of autopilot in the last HEARTBEAT.
    pub autopilot: u8,
    /// Whether the last HEARTBEAT had the HIL flag.
    pub hil: bool,
    /// Whether any HEARTBEAT or controls were armed.
    pub armed: bool,
    /// HIL_ACTUATOR_CONTROLS.
    pub controls: ControlsStatistics,
}

/// Statistics of one sender's HIL_ACTUATOR_CONTROLS.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlsStatistics {
    /// Frames.
    pub frames: u64,
    /// Arrival of the first and of the last (s).
    pub first_s: f64,
    /// See `first_s`.
    pub last_s: f64,
    /// Least and greatest finite value of each channel.
    pub least: [f64; CHANNEL_COUNT],
    /// See `least`.
    pub greatest: [f64; CHANNEL_COUNT],
    /// Channels that held no number at least once.
    pub not_finite: [bool; CHANNEL_COUNT],
    /// Jumps of `time_usec` against this machine's clock, and the greatest (s).
    pub jumps: u64,
    /// See `jumps`; negative: backward.
    pub worst_jump_s: f64,
}

impl Default for ControlsStatistics {
    fn default() -> Self {
        Self {
            frames: 0,
            first_s: 0.0,
            last_s: 0.0,
            least: [f64::INFINITY; CHANNEL_COUNT],
            greatest: [f64::NEG_INFINITY; CHANNEL_COUNT],
            not_finite: [false; CHANNEL_COUNT],
            jumps: 0,
            worst_jump_s: 0.0,
        }
    }
}

impl ControlsStatistics {
    /// Frames a second between the first and the last (Hz).
    pub fn rate_hz(&self) -> Option<f64> {
        let span_s = self.last_s - self.first_s;
        (self.frames > 1 && span_s > 0.0).then(|| (self.frames - 1) as f64 / span_s)
    }

    pub(super) fn moved(&self, channel: usize) -> bool {
        self.least[channel] < self.greatest[channel]
    }
}

impl Sender {
    pub(super) fn is_autopilot(&self) -> bool {
        self.heartbeats > 0
            && self.address.component == AUTOPILOT_COMPONENT
            && self.autopilot != AUTOPILOT_INVALID
    }
}

impl Traffic {
    /// The flight controller: whoever sends controls, else the component that autopilots are by convention.
    pub fn flight_controller(&self) -> Option<&Sender> {
        let controls = self.senders.iter().find(|sender| sender.controls.frames > 0);
        controls.or_else(|| self.senders.iter().find(|sender| sender.is_autopilot()))
    }
}
