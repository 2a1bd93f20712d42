//! MAVLink: bytes <-> frames <-> signals, as pure functions of bytes.
//!
//! [`Decoder`] takes bytes as they come, cut anywhere, MAVLink 1 or 2, and gives whole frames whose
//! checksum holds. After damage it resumes at the next frame: nothing but the damaged frame is lost, since
//! a candidate that fails gives up one byte, not its claimed length, and a candidate whose end has not
//! arrived does not hold up a whole frame behind it. Wire units become SI here and nowhere else.
//!
//! Message layouts and checksum seeds come from the `mavlink` crate. The few messages a flight controller
//! sends are read tolerantly: an enumerator that the crate does not know costs no frame.

use ::mavlink::dialects::common as dialect;
pub use ::mavlink::dialects::common::MavMessage;
use ::mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, Message};
use hopbench::controls::CHANNEL_COUNT;

pub mod measurement;
pub mod telemetry;

const MAGIC_1: u8 = 0xFE;
const MAGIC_2: u8 = 0xFD;
const SIGNED: u8 = 0x01;
const SIGNATURE_BYTES: usize = 13;

/// Message numbers that are read without the crate's enumerations.
mod id {
    pub const HEARTBEAT: u32 = 0;
    pub const PARAM_REQUEST_READ: u32 = 20;
    pub const PARAM_REQUEST_LIST: u32 = 21;
    pub const PARAM_SET: u32 = 23;
    pub const COMMAND_INT: u32 = 75;
    pub const COMMAND_LONG: u32 = 76;
    pub const COMMAND_ACK: u32 = 77;
    pub const HIL_ACTUATOR_CONTROLS: u32 = 93;
    pub const HIL_SENSOR: u32 = 107;
    /// HIL_STATE, HIL_CONTROLS, HIL_RC_INPUTS_RAW, HIL_ACTUATOR_CONTROLS, HIL_SENSOR, HIL_GPS, HIL_OPTICAL_FLOW and
    /// HIL_STATE_QUATERNION.
    pub const HIL: [u32; 8] = [90, 91, 92, HIL_ACTUATOR_CONTROLS, HIL_SENSOR, 113, 114, 115];
}

/// One frame whose checksum held.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Sender's system.
    pub system_id: u8,
    /// Sender's component.
    pub component_id: u8,
    /// Sender's counter.
    pub sequence: u8,
    /// Message number.
    pub message_id: u32,
    version: MavlinkVersion,
    payload: Vec<u8>,
}

/// What a flight controller says, as far as the bench understands it.
#[derive(Clone, Debug, PartialEq)]
pub enum FromFc {
    /// HIL_ACTUATOR_CONTROLS
    Controls(ControlsFrame),
    /// HEARTBEAT
    Heartbeat(Heartbeat),
    /// COMMAND_LONG or COMMAND_INT
    Command(Command),
    /// PARAM_REQUEST_LIST, to this system and component.
    ParameterList(Address),
    /// PARAM_REQUEST_READ
    ParameterRead(Address, Which),
    /// PARAM_SET
    ParameterSet(Address, String, f32),
    /// Anything else.
    Other(u32),
}

/// HIL_ACTUATOR_CONTROLS
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlsFrame {
    /// In lockstep the time of the HIL_SENSOR it answers; 0: any.
    pub time_us: u64,
    /// Bit 0: lockstep (SITL), or the outputs that are motors (HITL).
    pub flags: u64,
    /// Output channels.
    pub controls: [f64; CHANNEL_COUNT],
    /// Base mode, bit 7: armed.
    pub mode: u8,
}

/// HEARTBEAT
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heartbeat {
    /// Make of autopilot, 12: PX4.
    pub autopilot: u8,
    /// Bit 7: armed, bit 5: hardware in the loop.
    pub base_mode: u8,
}

/// System and component; 0 is any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// System.
    pub system: u8,
    /// Component.
    pub component: u8,
}

impl Address {
    /// Whether a message to this address is for `own` too.
    pub fn reaches(self, own: Self) -> bool {
        (self.system == 0 || self.system == own.system)
            && (self.component == 0 || self.component == own.component)
    }
}

/// How a parameter is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Which {
    /// By its place in the list.
    Index(u16),
    /// By its name.
    Name(String),
}

/// COMMAND_LONG, or a COMMAND_INT as far as its first four parameters go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Number of the command.
    pub command: u16,
    /// Its parameters; those left out are NaN.
    pub parameters: [f32; 7],
    /// Whom it is for.
    pub to: Address,
    /// Whom to answer.
    pub from: (u8, u8),
}

/// MAV_MODE_FLAG_SAFETY_ARMED
pub const MODE_ARMED: u8 = 0x80;
/// MAV_MODE_FLAG_HIL_ENABLED
pub const MODE_HIL: u8 = 0x20;
/// MAV_CMD_SET_MESSAGE_INTERVAL
pub const SET_MESSAGE_INTERVAL: u16 = 511;
/// MAV_CMD_NAV_GUIDED_ENABLE
pub const GUIDED_ENABLE: u16 = 92;
/// MAV_CMD_DO_PAUSE_CONTINUE
pub const PAUSE_CONTINUE: u16 = 193;
/// MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
pub const REBOOT: u16 = 246;
/// MAV_CMD_INJECT_FAILURE
pub const INJECT_FAILURE: u16 = 420;
/// MAV_RESULT_ACCEPTED
pub const RESULT_ACCEPTED: u8 = 0;
/// MAV_RESULT_DENIED
pub const RESULT_DENIED: u8 = 2;
/// MAV_RESULT_UNSUPPORTED
pub const RESULT_UNSUPPORTED: u8 = 3;

impl ControlsFrame {
    /// Whether the controls are to be obeyed.
    pub fn armed(&self) -> bool {
        self.mode & MODE_ARMED != 0
    }
}

/// What a decoder has met.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames whose checksum held.
    pub frames: u64,
    /// Frames of a known message whose checksum did not hold.
    pub crc_errors: u64,
    /// Frames of a message that `common` does not have; whole, but of no use.
    pub unknown: u64,
    /// Frames missing by the gaps in the senders' counters.
    pub lost: u64,
    /// Frames that came twice by the senders' counters.
    pub duplicates: u64,
    /// Frames that came after a later one of the same sender.
    pub out_of_order: u64,
    /// Bytes that belonged to no frame.
    pub skipped_bytes: u64,
}

/// Bytes to frames.
#[derive(Debug, Default)]
pub struct Decoder {
    buffer: Vec<u8>,
    start: usize,
    senders: Vec<Sender>,
    counters: Counters,
}

/// The counter of one system and component.
#[derive(Debug)]
struct Sender {
    id: (u8, u8),
    last: u8,
    /// Bit `n`: the frame `n` before the last has come.
    seen: u32,
}

/// What stands at one place of the buffer.
enum Candidate {
    Whole {
        length: usize,
    },
    Unknown {
        length: usize,
    },
    Damaged,
    /// No frame can start here.
    Nothing,
    /// Its end has not arrived.
    Partial,
}

impl Decoder {
    /// Takes bytes as they came.
    pub fn push(&mut self, bytes: &[u8]) {
        if self.start > 0 && self.start == self.buffer.len() {
            self.buffer.clear();
            self.start = 0;
        } else if self.start > 4096 {
            self.buffer.drain(..self.start);
            self.start = 0;
        }
        self.buffer.extend_from_slice(bytes);
    }

    /// What has been met so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The next whole frame, `None` until more bytes come.
    pub fn next_frame(&mut self) -> Option<Frame> {
        self.next_frame_raw(|_, _| {})
    }

    /// The same; `raw` sees the bytes of every whole frame with its message number, those of unknown messages too.
    pub fn next_frame_raw(&mut self, mut raw: impl FnMut(u32, &[u8])) -> Option<Frame> {
        loop {
            let rest = &self.buffer[self.start..];
            if rest.is_empty() {
                return None;
            }
            match candidate(rest) {
                Candidate::Whole { length } => {
                    raw(message_id(rest), &rest[..length]);
                    return Some(self.take(length));
                }
                Candidate::Unknown { length } => {
                    raw(message_id(rest), &rest[..length]);
                    self.counters.unknown += 1;
                    self.start += length;
                }
                Candidate::Damaged => {
                    self.counters.crc_errors += 1;
                    self.skip(1);
                }
                Candidate::Nothing => self.skip(1),
                Candidate::Partial => {
                    // A damaged length may claim bytes that never come, and the other side may be waiting
                    // for an answer to the whole frame that stands behind it.
                    let behind = whole_behind(rest)?;
                    self.counters.crc_errors += 1;
                    self.skip(behind);
                }
            }
        }
    }

    /// Somebody else may speak from here on: no gap to what was before.
    pub fn forget_senders(&mut self) {
        self.senders.clear();
    }

    fn skip(&mut self, length: usize) {
        self.counters.skipped_bytes += length as u64;
        self.start += length;
    }

    fn take(&mut self, length: usize) -> Frame {
        let raw = &self.buffer[self.start..self.start + length];
        let payload_length = usize::from(raw[1]);
        let frame = if raw[0] == MAGIC_2 {
            Frame {
                sequence: raw[4],
                system_id: raw[5],
                component_id: raw[6],
                message_id: message_id_2(raw),
                version: MavlinkVersion::V2,
                payload: raw[10..10 + payload_length].to_vec(),
            }
        } else {
            Frame {
                sequence: raw[2],
                system_id: raw[3],
                component_id: raw[4],
                message_id: raw[5].into(),
                version: MavlinkVersion::V1,
                payload: raw[6..6 + payload_length].to_vec(),
            }
        };
        self.start += length;
        self.counters.frames += 1;
        self.follow(&frame);
        frame
    }

    /// Counts what is missing between this frame and the last of the same sender, and what came late or twice.
    fn follow(&mut self, frame: &Frame) {
        let id = (frame.system_id, frame.component_id);
        let Some(sender) = self.senders.iter_mut().find(|sender| sender.id == id) else {
            // A flight controller has a handful of components; noise that looks like more is not followed.
            if self.senders.len() < 32 {
                self.senders.push(Sender { id, last: frame.sequence, seen: 1 });
            }
            return;
        };
        let ahead = frame.sequence.wrapping_sub(sender.last);
        let behind = sender.last.wrapping_sub(frame.sequence);
        match (ahead, behind) {
            (1..=127, _) => {
                self.counters.lost += u64::from(ahead) - 1;
                sender.seen = sender.seen.checked_shl(ahead.into()).unwrap_or(0) | 1;
                sender.last = frame.sequence;
            }
            (_, 0..32) if sender.seen & (1 << behind) != 0 => self.counters.duplicates += 1,
            (_, 0..32) if self.counters.lost > 0 => {
                // It was taken for lost.
                sender.seen |= 1 << behind;
                self.counters.out_of_order += 1;
                self.counters.lost -= 1;
            }
            // A sender that began anew.
            _ => (sender.last, sender.seen) = (frame.sequence, 1),
        }
    }
}

/// Message number of a frame whose head is there.
fn message_id(raw: &[u8]) -> u32 {
    if raw[0] == MAGIC_2 { message_id_2(raw) } else { raw[5].into() }
}

fn message_id_2(raw: &[u8]) -> u32 {
    u32::from_le_bytes([raw[7], raw[8], raw[9], 0])
}

/// Start of CRC-16/MCRF4XX, the checksum of MAVLink.
const CRC_START: u16 = 0xFFFF;

/// One byte further. The seed is the last byte of a checksum, so all seeds share the work of the body.
fn accumulate(crc: u16, byte: u8) -> u16 {
    let t = byte ^ crc as u8;
    let t = t ^ (t << 4);
    (crc >> 8) ^ (u16::from(t) << 8) ^ (u16::from(t) << 3) ^ (u16::from(t) >> 4)
}

fn candidate(bytes: &[u8]) -> Candidate {
    let (header, flags) = match bytes[0] {
        MAGIC_1 => (6, 0),
        MAGIC_2 => (10, bytes.get(2).copied().unwrap_or(0)),
        _ => return Candidate::Nothing,
    };
    // An unknown incompatibility flag means that the frame cannot be read.
    if flags & !SIGNED != 0 {
        return Candidate::Nothing;
    }
    if bytes.len() < header {
        return Candidate::Partial;
    }
    let payload_end = header + usize::from(bytes[1]);
    let length = payload_end + 2 + if flags & SIGNED != 0 { SIGNATURE_BYTES } else { 0 };
    let id = message_id(bytes);
    let known = MavMessage::default_message_from_id(id).is_some();
    if bytes.len() < length {
        return Candidate::Partial;
    }
    let sent = u16::from_le_bytes([bytes[payload_end], bytes[payload_end + 1]]);
    let body = &bytes[1..payload_end];
    if known {
        let whole = sent == ::mavlink::calculate_crc(body, MavMessage::extra_crc(id));
        return if whole { Candidate::Whole { length } } else { Candidate::Damaged };
    }
    // The seed of an unknown message is unknown too: is there one that fits? By chance once in 256, so what
    // follows has to look like a frame as well.
    let follows = bytes.get(length).is_none_or(|b| matches!(*b, MAGIC_1 | MAGIC_2));
    let fits = follows && {
        let crc = body.iter().fold(CRC_START, |crc, byte| accumulate(crc, *byte));
        (0..=u8::MAX).any(|seed| sent == accumulate(crc, seed))
    };
    if fits { Candidate::Unknown { length } } else { Candidate::Nothing }
}

/// Where a whole frame stands behind one whose end has not arrived.
fn whole_behind(bytes: &[u8]) -> Option<usize> {
    (1..bytes.len()).find(|&i| match candidate(&bytes[i..]) {
        Candidate::Whole { length } => bytes.get(i + length).is_none_or(|b| matches!(*b, MAGIC_1 | MAGIC_2)),
        _ => false,
    })
}

/// The next piece of a stream of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cut {
    /// A whole frame of this length.
    Frame(usize),
    /// So many bytes that belong to none.
    Noise(usize),
}

/// Cuts a stream as [`Decoder`] reads it; `None` until more bytes come.
pub(crate) fn cut(bytes: &[u8]) -> Option<Cut> {
    if bytes.is_empty() {
        return None;
    }
    match candidate(bytes) {
        Candidate::Whole { length } | Candidate::Unknown { length } => Some(Cut::Frame(length)),
        Candidate::Damaged | Candidate::Nothing => Some(Cut::Noise(1)),
        Candidate::Partial => whole_behind(bytes).map(Cut::Noise),
    }
}

/// Time of the sample that a whole frame is, if it is a HIL_SENSOR, or answers, if it is a
/// HIL_ACTUATOR_CONTROLS (us).
pub(crate) fn sample_time_us(frame: &[u8]) -> Option<u64> {
    let (id, payload) = match frame[0] {
        MAGIC_2 => (message_id_2(frame), &frame[10..10 + usize::from(frame[1])]),
        _ => (frame[5].into(), &frame[6..6 + usize::from(frame[1])]),
    };
    matches!(id, id::HIL_SENSOR | id::HIL_ACTUATOR_CONTROLS)
        .then(|| u64::from_le_bytes(Payload(payload).bytes(0)))
}

impl Frame {
    /// Whether it came as MAVLink 1.
    pub fn is_version_1(&self) -> bool {
        self.version == MavlinkVersion::V1
    }

    /// As a message of the crate; `None` when it holds an enumerator that the crate does not know.
    pub fn message(&self) -> Option<MavMessage> {
        MavMessage::parse(self.version, self.message_id, &self.payload).ok()
    }

    /// As what a flight controller says.
    pub fn from_fc(&self) -> FromFc {
        let field = Payload(&self.payload);
        match self.message_id {
            id::HIL_ACTUATOR_CONTROLS => FromFc::Controls(ControlsFrame {
                time_us: u64::from_le_bytes(field.bytes(0)),
                flags: u64::from_le_bytes(field.bytes(8)),
                controls: std::array::from_fn(|i| f32::from_le_bytes(field.bytes(16 + 4 * i)).into()),
                mode: field.bytes::<1>(80)[0],
            }),
            id::HEARTBEAT => FromFc::Heartbeat(Heartbeat {
                autopilot: field.bytes::<1>(5)[0],
                base_mode: field.bytes::<1>(6)[0],
            }),
            id::COMMAND_LONG => self.command(|i| f32::from_le_bytes(field.bytes(4 * i))),
            // Parameters 5 and 6 are scaled by what the command is; none that is obeyed here has them.
            id::COMMAND_INT => self.command(|i| match i {
                0..4 => f32::from_le_bytes(field.bytes(4 * i)),
                _ => f32::NAN,
            }),
            id::PARAM_REQUEST_LIST => FromFc::ParameterList(field.address(0)),
            id::PARAM_REQUEST_READ => {
                let which = match i16::from_le_bytes(field.bytes(0)) {
                    0.. => Which::Index(u16::from_le_bytes(field.bytes(0))),
                    _ => Which::Name(field.name(4)),
                };
                FromFc::ParameterRead(field.address(2), which)
            }
            id::PARAM_SET => {
                FromFc::ParameterSet(field.address(4), field.name(6), f32::from_le_bytes(field.bytes(0)))
            }
            other => FromFc::Other(other),
        }
    }

    fn command(&self, parameter: impl FnMut(usize) -> f32) -> FromFc {
        let field = Payload(&self.payload);
        FromFc::Command(Command {
            parameters: std::array::from_fn(parameter),
            command: u16::from_le_bytes(field.bytes(28)),
            to: field.address(30),
            from: (self.system_id, self.component_id),
        })
    }

    /// Whom the message names as its target; any, where it names none.
    pub fn target(&self) -> Address {
        let field = Payload(&self.payload);
        match self.message_id {
            id::COMMAND_LONG | id::COMMAND_INT => field.address(30),
            id::PARAM_REQUEST_LIST => field.address(0),
            id::PARAM_REQUEST_READ => field.address(2),
            id::PARAM_SET => field.address(4),
            _ => {
                let message = self.message();
                let of = |id: fn(&MavMessage) -> Option<u8>| message.as_ref().and_then(id).unwrap_or(0);
                Address { system: of(|m| m.target_system_id()), component: of(|m| m.target_component_id()) }
            }
        }
    }
}

/// Whether a message belongs to the loop between plant and flight controller and to nobody else.
pub fn is_hil(message_id: u32) -> bool {
    id::HIL.contains(&message_id)
}

/// A payload whose trailing zeros the sender may have cut.
struct Payload<'a>(&'a [u8]);

impl Payload<'_> {
    fn bytes<const N: usize>(&self, offset: usize) -> [u8; N] {
        std::array::from_fn(|i| self.0.get(offset + i).copied().unwrap_or(0))
    }

    fn address(&self, offset: usize) -> Address {
        let [system, component] = self.bytes(offset);
        Address { system, component }
    }

    /// Name of a parameter: up to a zero, 16 bytes at most.
    fn name(&self, offset: usize) -> String {
        let bytes: [u8; 16] = self.bytes(offset);
        let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
        String::from_utf8_lossy(&bytes[..end]).into_owned()
    }
}

/// Messages to bytes, MAVLink 2, with a counter of its own.
#[derive(Clone, Copy, Debug)]
pub struct Encoder {
    system_id: u8,
    component_id: u8,
    sequence: u8,
    frames: u64,
}

impl Encoder {
    /// Speaks as this system and component.
    pub fn new(system_id: u8, component_id: u8) -> Self {
        Self { system_id, component_id, sequence: 0, frames: 0 }
    }

    /// Frames encoded so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Appends the frame of `message` to `bytes`.
    pub fn encode(&mut self, message: &MavMessage, bytes: &mut Vec<u8>) {
        let mut raw = MAVLinkV2MessageRaw::new();
        let header = MavHeader {
            system_id: self.system_id.into(),
            component_id: self.component_id,
            sequence: self.next_sequence(),
        };
        raw.serialize_message(header, message);
        bytes.extend_from_slice(raw.raw_bytes());
    }

    /// COMMAND_ACK, also for commands whose number the crate does not know.
    pub fn encode_ack(&mut self, command: &Command, result: u8, bytes: &mut Vec<u8>) {
        let [low, high] = command.command.to_le_bytes();
        let payload = [low, high, result, 0, 0, 0, 0, 0, command.from.0, command.from.1];
        // MAVLink 2 cuts trailing zeros but keeps one byte.
        let length = payload.iter().rposition(|b| *b != 0).map_or(1, |last| last + 1);
        let start = bytes.len();
        let [id_0, id_1, id_2, _] = id::COMMAND_ACK.to_le_bytes();
        let sequence = self.next_sequence();
        let head =
            [MAGIC_2, length as u8, 0, 0, sequence, self.system_id, self.component_id, id_0, id_1, id_2];
        bytes.extend_from_slice(&head);
        bytes.extend_from_slice(&payload[..length]);
        let crc = ::mavlink::calculate_crc(&bytes[start + 1..], MavMessage::extra_crc(id::COMMAND_ACK));
        bytes.extend_from_slice(&crc.to_le_bytes());
    }

    fn next_sequence(&mut self) -> u8 {
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        self.frames += 1;
        sequence
    }
}

/// HIL_ACTUATOR_CONTROLS as a flight controller sends it.
pub fn actuator_controls(frame: &ControlsFrame) -> MavMessage {
    MavMessage::HIL_ACTUATOR_CONTROLS(dialect::HIL_ACTUATOR_CONTROLS_DATA {
        time_usec: frame.time_us,
        flags: dialect::HilActuatorControlsFlags::from_bits_retain(frame.flags),
        controls: frame.controls.map(|c| c as f32),
        mode: dialect::MavModeFlag::from_bits_retain(frame.mode),
    })
}

/// HEARTBEAT of a simulator (`base_mode` 0) or of the built-in autopilot.
pub fn heartbeat(base_mode: u8) -> MavMessage {
    MavMessage::HEARTBEAT(dialect::HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: if base_mode == 0 {
            dialect::MavType::MAV_TYPE_GENERIC
        } else {
            dialect::MavType::MAV_TYPE_ROCKET
        },
        autopilot: if base_mode == 0 {
            dialect::MavAutopilot::MAV_AUTOPILOT_INVALID
        } else {
            dialect::MavAutopilot::MAV_AUTOPILOT_GENERIC
        },
        base_mode: dialect::MavModeFlag::from_bits_retain(base_mode),
        system_status: dialect::MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// COMMAND_LONG that tells a system and component to boot anew.
pub fn reboot(to: (u8, u8)) -> MavMessage {
    MavMessage::COMMAND_LONG(dialect::COMMAND_LONG_DATA {
        param1: 1.0, // 1: the autopilot
        command: dialect::MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
        target_system: to.0,
        target_component: to.1,
        ..Default::default()
    })
}

/// Whether a message tells this system and component to boot anew.
pub fn is_reboot(message: &MavMessage, own: (u8, u8)) -> bool {
    let MavMessage::COMMAND_LONG(data) = message else { return false };
    let reaches = |target: u8, own: u8| target == 0 || target == own;
    data.command == dialect::MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
        && data.param1 == 1.0
        && reaches(data.target_system, own.0)
        && reaches(data.target_component, own.1)
}

/// SYSTEM_TIME; the Unix time is unknown to a simulated clock, hence 0.
pub fn system_time(time_us: u64) -> MavMessage {
    MavMessage::SYSTEM_TIME(dialect::SYSTEM_TIME_DATA {
        time_unix_usec: 0,
        time_boot_ms: milliseconds(time_us),
    })
}

/// PARAM_VALUE, always as a 32-bit float, so that nobody has to guess how an integer is packed.
pub fn parameter_value(name: &str, value: f64, index: u16, count: u16) -> MavMessage {
    MavMessage::PARAM_VALUE(dialect::PARAM_VALUE_DATA {
        param_value: value as f32,
        param_count: count,
        param_index: index,
        param_id: name.into(),
        param_type: dialect::MavParamType::MAV_PARAM_TYPE_REAL32,
    })
}

/// How grave a text is.
pub use dialect::MavSeverity as Severity;

/// STATUSTEXT, in as many pieces of 50 bytes as it takes; `id` ties them together and is not 0.
pub fn status_text(severity: Severity, text: &str, id: u16) -> Vec<MavMessage> {
    // The field holds bytes; what is not ASCII would be cut in the middle of a letter.
    let text: String = text.chars().map(|c| if c.is_ascii() { c } else { '?' }).collect();
    let pieces: Vec<&[u8]> = text.as_bytes().chunks(TEXT_BYTES).collect();
    let id = if pieces.len() > 1 { id.max(1) } else { 0 };
    let message = |(i, piece): (usize, &&[u8])| {
        MavMessage::STATUSTEXT(dialect::STATUSTEXT_DATA {
            severity,
            text: String::from_utf8_lossy(piece).as_ref().into(),
            id,
            chunk_seq: u8::try_from(i).unwrap_or(u8::MAX),
        })
    };
    pieces.iter().take(usize::from(u8::MAX)).enumerate().map(message).collect()
}

/// Text of one STATUSTEXT.
const TEXT_BYTES: usize = 50;

/// Milliseconds of a 32-bit field, which wraps after 49 days as the protocol has it.
pub(crate) fn milliseconds(time_us: u64) -> u32 {
    (time_us / 1000) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unhex(hex: &str) -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect()
    }

    fn decode(bytes: &[u8]) -> (Vec<Frame>, Counters) {
        let mut decoder = Decoder::default();
        decoder.push(bytes);
        let frames = std::iter::from_fn(|| decoder.next_frame()).collect();
        (frames, decoder.counters())
    }

    /// Bytes that an unmodified PX4 1.16.1 in software sends before the first sensor message.
    const PX4_INTERVAL: &str =
        "fd1e00000001014c00000000e64200409c450000000000000000000000000000000000000000ff011904";
    const PX4_HEARTBEAT: &str = "fd09000001010100000000000000000c0000039158";

    fn px4_disarmed() -> Vec<u8> {
        unhex(&format!("fd5100000201015d0000409002000000000001{}01a185", "00".repeat(71)))
    }

    #[test]
    fn the_first_words_of_a_px4_decode_as_observed() {
        let bytes = [unhex(PX4_INTERVAL), unhex(PX4_HEARTBEAT), px4_disarmed()].concat();
        let (frames, counters) = decode(&bytes);
        assert_eq!(counters, Counters { frames: 3, ..Default::default() });
        let FromFc::Command(command) = frames[0].from_fc() else { panic!("{frames:?}") };
        assert_eq!(command.command, SET_MESSAGE_INTERVAL);
        assert_eq!(command.parameters[..2], [115.0, 5000.0]);
        assert_eq!(frames[1].from_fc(), FromFc::Heartbeat(Heartbeat { autopilot: 12, base_mode: 0 }));
        let FromFc::Controls(controls) = frames[2].from_fc() else { panic!("{frames:?}") };
        assert_eq!((controls.time_us, controls.flags, controls.mode), (168_000, 1, 1));
        assert!(!controls.armed());
        assert_eq!(controls.controls, [0.0; 16]);
        // The crate reads the same.
        assert_eq!(frames[2].message().unwrap(), actuator_controls(&controls));
    }

    fn controls(time_us: u64, value: f64) -> ControlsFrame {
        ControlsFrame { time_us, flags: 1, controls: [value; 16], mode: 129 }
    }

    fn stream(count: u64) -> (Vec<u8>, Vec<usize>) {
        let mut encoder = Encoder::new(1, 1);
        let (mut bytes, mut ends) = (Vec::new(), Vec::new());
        for i in 0..count {
            encoder.encode(
                &actuator_controls(&controls(4000 * (i + 1), (i % 1000) as f64 / 1024.0)),
                &mut bytes,
            );
            ends.push(bytes.len());
        }
        (bytes, ends)
    }

    #[test]
    fn bytes_cut_anywhere_give_the_same_frames() {
        let (bytes, _) = stream(50);
        let whole = decode(&bytes);
        for size in [1, 2, 7, 92, 93, 94, 280] {
            let mut decoder = Decoder::default();
            let mut frames = Vec::new();
            for part in bytes.chunks(size) {
                decoder.push(part);
                frames.extend(std::iter::from_fn(|| decoder.next_frame()));
            }
            assert_eq!((frames, decoder.counters()), whole, "pieces of {size}");
        }
    }

    #[test]
    fn a_damaged_byte_costs_its_own_frame_and_no_other() {
        let (clean, ends) = stream(400);
        // One byte in about 1000, spread over all places within a frame; the ends stay whole, for their gaps
        // could not be seen.
        let mut bytes = clean.clone();
        let mut hit = std::collections::BTreeSet::new();
        for place in (150..bytes.len() - 93).step_by(997) {
            bytes[place] ^= 0x55;
            hit.insert(ends.partition_point(|end| *end <= place));
        }
        let (frames, counters) = decode(&bytes);
        let expected: Vec<u64> =
            (0..400).filter(|i| !hit.contains(&(*i as usize))).map(|i| 4000 * (i + 1)).collect();
        let got: Vec<u64> = frames
            .iter()
            .map(|f| match f.from_fc() {
                FromFc::Controls(c) => c.time_us,
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(got, expected);
        assert_eq!(counters.lost, hit.len() as u64);
        assert!(counters.crc_errors + counters.unknown <= 2 * hit.len() as u64, "{counters:?}");
    }

    #[test]
    fn frames_that_come_twice_late_or_never_are_told_apart() {
        let (bytes, ends) = stream(300);
        let frame = |i: usize| bytes[if i == 0 { 0 } else { ends[i - 1] }..ends[i]].to_vec();
        let counted = |order: &[usize]| {
            let (frames, counters) = decode(&order.iter().flat_map(|i| frame(*i)).collect::<Vec<_>>());
            assert_eq!(frames.len(), order.len());
            (counters.lost, counters.duplicates, counters.out_of_order)
        };
        assert_eq!(counted(&[0, 1, 1, 2, 3, 3, 3]), (0, 3, 0));
        assert_eq!(counted(&[0, 2, 1, 3, 7, 6, 5, 8]), (1, 0, 3));
        assert_eq!(counted(&[0, 2, 1, 1, 0, 3]), (0, 2, 1));
        assert_eq!(counted(&[0, 40, 41]), (39, 0, 0));
        // The counter has 256 values; a frame from far behind is a sender that began anew.
        assert_eq!(counted(&[254, 256, 255, 257]), (0, 0, 1));
        assert_eq!(counted(&[100, 101, 0, 1, 2]), (0, 0, 0));
    }

    #[test]
    fn a_damaged_length_does_not_hold_up_the_answer_behind_it() {
        let (mut bytes, ends) = stream(2);
        bytes[1] = 255; // claims 174 bytes more than there are
        let (frames, counters) = decode(&bytes);
        assert_eq!(frames.len(), 1, "{ends:?}");
        assert_eq!(counters.crc_errors, 1);
    }

    #[test]
    fn an_unknown_message_is_whole_and_counted_once() {
        let (good, _) = stream(1);
        // Message 0xABCDEF, seed 77, full of bytes that look like the start of a frame.
        let mut unknown = vec![MAGIC_2, 30, 0, 0, 9, 3, 4, 0xEF, 0xCD, 0xAB];
        unknown.extend([MAGIC_2; 30]);
        let crc = ::mavlink::calculate_crc(&unknown[1..], 77);
        unknown.extend(crc.to_le_bytes());
        let (frames, counters) = decode(&[unknown, good].concat());
        assert_eq!((frames.len(), counters.unknown, counters.crc_errors), (1, 1, 0));
    }

    #[test]
    fn mavlink_1_is_understood() {
        let mut raw = ::mavlink::MAVLinkV1MessageRaw::new();
        let header = MavHeader { system_id: 1, component_id: 1, sequence: 7 };
        raw.serialize_message(header, &actuator_controls(&controls(4000, 0.5)));
        let (frames, _) = decode(raw.raw_bytes());
        assert_eq!(frames[0].from_fc(), FromFc::Controls(controls(4000, 0.5)));
    }

    #[test]
    fn unknown_enumerators_cost_no_frame() {
        let mut payload = [0u8; 9];
        (payload[4], payload[5], payload[6], payload[8]) = (200, 250, 0xA0, 3); // no such type, no such autopilot
        let mut bytes = vec![MAGIC_2, 9, 0, 0, 0, 1, 1, 0, 0, 0];
        bytes.extend(payload);
        let crc = ::mavlink::calculate_crc(&bytes[1..], MavMessage::extra_crc(0));
        bytes.extend(crc.to_le_bytes());
        let (frames, _) = decode(&bytes);
        assert_eq!(frames[0].from_fc(), FromFc::Heartbeat(Heartbeat { autopilot: 250, base_mode: 0xA0 }));
    }

    #[test]
    fn an_acknowledgement_is_what_the_crate_reads() {
        let command = Command {
            command: SET_MESSAGE_INTERVAL,
            parameters: [0.0; 7],
            to: Address { system: 1, component: 200 },
            from: (1, 1),
        };
        let mut bytes = Vec::new();
        Encoder::new(1, 200).encode_ack(&command, RESULT_UNSUPPORTED, &mut bytes);
        let (frames, _) = decode(&bytes);
        let Some(MavMessage::COMMAND_ACK(ack)) = frames[0].message() else { panic!("{frames:?}") };
        assert_eq!(ack.command, dialect::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL);
        assert_eq!(ack.result, dialect::MavResult::MAV_RESULT_UNSUPPORTED);
        assert_eq!((ack.target_system, ack.target_component), (1, 1));
    }
}
