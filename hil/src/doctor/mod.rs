//! What is wrong with this bench: looks at the machine, listens on a link, and names causes.
//!
//! Looking and judging are apart. [`machine::look`] and [`listen::listen`] gather a [`Machine`] and an
//! [`Observation`]; [`diagnose_machine`] and [`diagnose`] are pure functions of those, and every
//! [`Finding`] says what was seen, why it happens and what to do.

use std::io::ErrorKind;

use hopbench::controls::{CHANNEL_COUNT, Controls};
use hopbench::scenario::SequenceSource;

use crate::wire::link::{LinkSpec, OpenFailure};
use crate::wire::mavlink::Counters as DecoderCounters;
use crate::wire::port::{Holder, Port};
use crate::wire::profile::{Budget, Profile, SensorRates};

mod finding;
pub mod listen;
pub mod machine;

pub use finding::{Explanation, Finding, Severity};
pub use machine::Machine;

/// Bytes of one HIL_ACTUATOR_CONTROLS on the wire, and how often PX4 is asked for it (Hz).
const CONTROLS_BYTES: f64 = 93.0;
const CONTROLS_HZ: f64 = 200.0;
/// Slowest stream of controls that keeps a lander upright: the rate of the built-in guidance (Hz).
const CONTROLS_LEAST_HZ: f64 = 50.0;
/// PX4 sends no controls on a link set to this rate or less (byte/s).
const PX4_GATE_BYTES_PER_S: f64 = 5000.0;
/// Longest MAVLink frame: what a listener that comes in half-way may lose of the first.
const FRAME_BYTES: u64 = 280;
/// MAV_AUTOPILOT_INVALID: a component that is no flight controller.
const AUTOPILOT_INVALID: u8 = 8;
/// MAV_COMP_ID_AUTOPILOT1
const AUTOPILOT_COMPONENT: u8 = 1;
/// Who the bench speaks as.
const OWN_SENDER: (u8, u8) = (crate::wire::stream::ADDRESS.system, crate::wire::stream::ADDRESS.component);

/// All that was seen on one link.
#[derive(Clone, Debug)]
pub struct Observation {
    /// The link as it was asked for.
    pub link: LinkSpec,
    /// What the flight controller was expected to be.
    pub profile: &'static Profile,
    /// How often the sensors speak.
    pub rates: SensorRates,
    /// What the vehicle's channels mean; `None`: no vehicle was named.
    pub map: Option<Vec<Mapped>>,
    /// Why the link could not be opened; then nothing below was seen.
    pub failure: Option<OpenFailure>,
    /// Who else has the port open.
    pub holders: Vec<Holder>,
    /// Serial ports of this machine.
    pub ports: Vec<Port>,
    /// What was heard.
    pub heard: Heard,
}

/// What was heard, and what was sent meanwhile.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heard {
    /// For how long (s).
    pub listened_s: f64,
    /// Somebody was at the other end, at least for a while.
    pub met: bool,
    /// Bytes received.
    pub bytes: u64,
    /// The first of them, 256 at most.
    pub first_bytes: Vec<u8>,
    /// Frames, damage, gaps.
    pub decoded: DecoderCounters,
    /// Frames of MAVLink 1.
    pub version_1: u64,
    /// Whoever spoke, in the order of appearance.
    pub senders: Vec<Sender>,
    /// The link was lost, and why.
    pub lost: Vec<String>,
    /// Who was turned away.
    pub refused: Vec<String>,
    /// HIL_SENSOR frames sent.
    pub sensors_sent: u64,
    /// Writes that the other end did not take.
    pub not_taken: u64,
}

/// One system and component.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sender {
    /// System and component.
    pub id: (u8, u8),
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
    pub controls: ControlsSeen,
}

/// The HIL_ACTUATOR_CONTROLS of one sender.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlsSeen {
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

impl Default for ControlsSeen {
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

impl ControlsSeen {
    /// Frames a second between the first and the last (Hz).
    pub fn rate_hz(&self) -> Option<f64> {
        let span_s = self.last_s - self.first_s;
        (self.frames > 1 && span_s > 0.0).then(|| (self.frames - 1) as f64 / span_s)
    }

    fn moved(&self, channel: usize) -> bool {
        self.least[channel] < self.greatest[channel]
    }
}

impl Sender {
    fn is_autopilot(&self) -> bool {
        self.heartbeats > 0 && self.id.1 == AUTOPILOT_COMPONENT && self.autopilot != AUTOPILOT_INVALID
    }
}

impl Heard {
    /// The flight controller: whoever sends controls, else the component that autopilots are by convention.
    pub fn flight_controller(&self) -> Option<&Sender> {
        let controls = self.senders.iter().find(|sender| sender.controls.frames > 0);
        controls.or_else(|| self.senders.iter().find(|sender| sender.is_autopilot()))
    }
}

/// What is wrong on a link, worst first.
pub fn diagnose(seen: &Observation) -> Vec<Finding> {
    let mut findings = Vec::new();
    wire_budget(seen, &mut findings);
    if let Some(failure) = &seen.failure {
        findings.push(not_opened(seen, failure));
    } else {
        if !seen.holders.is_empty() {
            findings.push(Finding::PortShared { holders: seen.holders.clone() });
        }
        bytes(seen, &mut findings);
        senders(seen, &mut findings);
        flight_controller(seen, &mut findings);
    }
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity()));
    findings
}

/// What is wrong with this machine, worst first.
pub fn diagnose_machine(machine: &Machine) -> Vec<Finding> {
    let mut findings = machine.findings();
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity()));
    findings
}

fn not_opened(seen: &Observation, failure: &OpenFailure) -> Finding {
    let path = match &seen.link {
        LinkSpec::Serial { path, .. } => path.clone(),
        other => other.to_string(),
    };
    let serial = matches!(seen.link, LinkSpec::Serial { .. });
    match failure.kind {
        ErrorKind::NotFound if serial => {
            let present = seen.ports.iter().map(|port| port.path.display().to_string()).collect();
            Finding::NoPort { path, present }
        }
        ErrorKind::PermissionDenied => {
            Finding::PermissionDenied { group: crate::wire::port::group_of(path.as_ref()), path }
        }
        ErrorKind::ResourceBusy => Finding::PortBusy { path, cause: failure.cause.clone() },
        ErrorKind::AddrInUse => Finding::AddressInUse { link: path },
        _ => Finding::CannotOpen { link: path, cause: failure.cause.clone() },
    }
}

/// Both directions of a serial line.
fn wire_budget(seen: &Observation, findings: &mut Vec<Finding>) {
    let LinkSpec::Serial { baud, .. } = seen.link else { return };
    let back_percent = CONTROLS_BYTES * CONTROLS_HZ / (f64::from(baud) / 10.0) * 100.0;
    let (out_percent, fitting_hz, refused) = match seen.profile.budget(&seen.rates, baud) {
        Budget::Fits { load_percent } => (load_percent, None, false),
        Budget::Tight { load_percent } => (load_percent, None, false),
        Budget::Refused { load_percent, fitting_hz } => (load_percent, fitting_hz, true),
    };
    if out_percent >= 70.0 || back_percent >= 70.0 {
        let sensor_hz = seen.rates.imu_hz;
        findings.push(Finding::WireOverload {
            baud,
            sensor_hz,
            out_percent,
            back_percent,
            fitting_hz,
            refused,
        });
    }
}

/// Whether anybody speaks, whether it is MAVLink, and whether it arrives whole.
fn bytes(seen: &Observation, findings: &mut Vec<Finding>) {
    let heard = &seen.heard;
    if !heard.lost.is_empty() {
        findings.push(Finding::LinkLost { whys: heard.lost.clone() });
    }
    if !heard.refused.is_empty() {
        findings.push(Finding::SecondClient { names: heard.refused.clone() });
    }
    if heard.not_taken > 0 {
        findings.push(Finding::NotTaken { writes: heard.not_taken });
    }
    let (bytes, listened_s) = (heard.bytes, heard.listened_s);
    if !heard.met {
        findings.push(Finding::NobodyThere { link: seen.link.to_string(), listened_s });
    } else if bytes == 0 {
        findings.push(Finding::NoBytes { link: seen.link.to_string(), listened_s });
    } else if heard.decoded.frames == 0 {
        let text = printable(&heard.first_bytes);
        findings.push(match (&seen.link, text) {
            (LinkSpec::Serial { baud, .. }, None) => Finding::WrongBaud { bytes, baud: *baud },
            (_, text) => Finding::NoMavlink { bytes, text },
        });
    } else {
        let counters = &heard.decoded;
        // Who comes in half-way hears the end of a frame.
        if counters.crc_errors > 1 || counters.skipped_bytes > FRAME_BYTES {
            findings.push(Finding::Damaged { counters: *counters });
        }
        if counters.lost > 0 {
            findings.push(Finding::SequenceGaps { lost: counters.lost, frames: counters.frames });
        }
        if heard.version_1 > 0 {
            findings.push(Finding::Mavlink1 { frames: heard.version_1, of: counters.frames });
        }
    }
}

/// The bytes as text, when they are text: a console, a satellite receiver.
fn printable(bytes: &[u8]) -> Option<String> {
    let text = |byte: &&u8| matches!(**byte, b' '..=b'~' | b'\r' | b'\n' | b'\t' | 0x1B);
    let share = bytes.iter().filter(text).count() * 10;
    (share >= bytes.len() * 9).then(|| String::from_utf8_lossy(&bytes[..bytes.len().min(40)]).into_owned())
}

/// Who speaks under which name.
fn senders(seen: &Observation, findings: &mut Vec<Finding>) {
    let senders = &seen.heard.senders;
    if let Some(twin) = senders.iter().find(|sender| sender.id == OWN_SENDER) {
        findings.push(Finding::OurSystemId { id: OWN_SENDER, frames: twin.frames });
    }
    let commanding: Vec<_> = senders.iter().filter(|s| s.controls.frames > 0).map(|s| s.id).collect();
    let autopilots: Vec<_> = senders.iter().filter(|s| s.is_autopilot()).map(|s| s.id).collect();
    if commanding.len() > 1 {
        findings.push(Finding::TwoControllers { ids: commanding });
    } else if autopilots.len() > 1 {
        findings.push(Finding::TwoControllers { ids: autopilots });
    }
    for sender in senders {
        // A reboot sets one counter back; two programs under one name do so all the time.
        if sender.backward > 3 && sender.backward * 10 > sender.frames {
            findings.push(Finding::SharedSystemId {
                id: sender.id,
                backward: sender.backward,
                frames: sender.frames,
            });
        }
    }
}

/// Whether the flight controller is in the loop, and what its channels do.
fn flight_controller(seen: &Observation, findings: &mut Vec<Finding>) {
    let heard = &seen.heard;
    let Some(fc) = heard.flight_controller() else {
        if heard.decoded.frames > 0 {
            let ids = heard.senders.iter().map(|sender| sender.id).collect();
            findings.push(Finding::NoFlightController { ids });
        }
        return;
    };
    if seen.profile.needs_hil_flag {
        if fc.heartbeats == 0 {
            findings.push(Finding::NoHeartbeat { id: fc.id });
        } else if !fc.hil {
            findings.push(Finding::HilFlagMissing { id: fc.id, heartbeats: fc.heartbeats });
        }
    }
    if fc.armed {
        findings.push(Finding::ArmedAlready { id: fc.id });
    }
    let bytes_per_s = heard.bytes as f64 / heard.listened_s.max(1e-3);
    match fc.controls.rate_hz() {
        None if fc.controls.frames == 0 => {
            findings.push(Finding::NoControls {
                id: fc.id,
                autopilot: fc.autopilot,
                heartbeats: fc.heartbeats,
                sensors_sent: heard.sensors_sent,
                profile: seen.profile.name,
            });
            if seen.profile.needs_hil_flag && fc.hil && bytes_per_s < PX4_GATE_BYTES_PER_S {
                findings.push(Finding::DataRateTooLow { controls_hz: 0.0, bytes_per_s });
            }
        }
        Some(controls_hz) if controls_hz < CONTROLS_LEAST_HZ.min(0.8 * seen.rates.imu_hz) => {
            findings.push(Finding::DataRateTooLow { controls_hz, bytes_per_s });
        }
        Some(controls_hz) => findings.push(Finding::Heard {
            id: fc.id,
            hil: fc.hil,
            heartbeats: fc.heartbeats,
            controls_hz,
            sensors_sent: heard.sensors_sent,
        }),
        None => findings.push(Finding::DataRateTooLow { controls_hz: 0.0, bytes_per_s }),
    }
    if fc.controls.jumps > 0 {
        let (jumps, worst_s) = (fc.controls.jumps, fc.controls.worst_jump_s);
        findings.push(Finding::ClockJumps { jumps, worst_s });
    }
    if let (Some(map), true) = (&seen.map, fc.controls.frames > 0) {
        channels(&fc.controls, map, findings);
    }
}

/// Whether what moves is read, and what is read moves and stays in its range.
fn channels(seen: &ControlsSeen, map: &[Mapped], findings: &mut Vec<Finding>) {
    let moving: Vec<usize> = (0..CHANNEL_COUNT).filter(|channel| seen.moved(*channel)).collect();
    let unread: Vec<String> = moving
        .iter()
        .filter_map(|channel| match map.iter().find(|mapped| mapped.index == *channel) {
            None => Some(channel.to_string()),
            Some(mapped) if mapped.role == Role::Ignored => Some(format!("{channel} ({})", mapped.name)),
            Some(_) => None,
        })
        .collect();
    if !unread.is_empty() {
        findings.push(Finding::ChannelsUnread { channels: unread });
    }
    let still: Vec<String> = map
        .iter()
        .filter(|mapped| mapped.role == Role::Moves && !seen.moved(mapped.index))
        .map(|mapped| format!("{} ({})", mapped.index, mapped.name))
        .collect();
    if moving.is_empty() {
        findings.push(Finding::ControlsStill { frames: seen.frames });
    } else if !still.is_empty() {
        findings.push(Finding::ChannelsStill { channels: still });
    }
    for mapped in map.iter().filter(|mapped| mapped.role != Role::Ignored) {
        let (name, index, range) = (mapped.name, mapped.index, mapped.range);
        let (least, greatest) = (seen.least[index], seen.greatest[index]);
        // A tenth of the range beyond its end is rounding and trim.
        let margin = 0.1 * (range[1] - range[0]);
        if seen.not_finite[index] {
            findings.push(Finding::NotANumber { name, index });
        } else if mapped.role == Role::Moves && (least < range[0] - margin || greatest > range[1] + margin) {
            findings.push(Finding::OutOfRange { name, index, least, greatest, range });
        }
    }
}

/// One channel of a vehicle, as far as a listener can judge it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mapped {
    /// Its key in `[controls.channels]`.
    pub name: &'static str,
    /// Place in `controls[16]`.
    pub index: usize,
    /// What the flight controller should send.
    pub range: [f64; 2],
    /// What is expected of it.
    pub role: Role,
}

/// What is expected of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Steers: a controller that flies moves it all the time.
    Moves,
    /// Is read, and may stand still.
    Read,
    /// Nobody reads it in this scenario.
    Ignored,
}

/// The channels of a vehicle; the switches are read only when the sequence comes from the controls.
pub fn mapped(controls: &Controls, source: SequenceSource) -> Vec<Mapped> {
    let c = &controls.channels;
    let steering = [
        ("throttle", Some(c.throttle), Role::Moves),
        ("gimbal_x", Some(c.gimbal_x), Role::Moves),
        ("gimbal_y", Some(c.gimbal_y), Role::Moves),
        ("rcs_roll", Some(c.rcs_roll), Role::Moves),
        ("rcs_roll_negative", c.rcs_roll_negative, Role::Moves),
        ("echo", c.echo, Role::Read),
    ];
    let role = if source == SequenceSource::Controls { Role::Read } else { Role::Ignored };
    let switches = [
        ("igniter", c.igniter),
        ("oxidizer_isolation", c.oxidizer_isolation),
        ("vent", c.vent),
        ("hold_down_release", c.hold_down_release),
    ];
    let steering = steering.into_iter().filter_map(|(name, channel, role)| {
        channel.map(|c| Mapped { name, index: c.index, range: c.range, role })
    });
    let switches = switches
        .into_iter()
        .filter_map(|(name, switch)| switch.map(|s| Mapped { name, index: s.index, range: s.range, role }));
    steering.chain(switches).collect()
}
