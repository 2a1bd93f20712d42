//! One frame, and what a flight controller or a ground station says with it.
//!
//! The few messages that they send are read tolerantly: an enumerator that the crate does not know costs no
//! frame.

use ::mavlink::dialects::common::MavMessage;
use ::mavlink::{MavlinkVersion, Message};
use hopbench::controls::CHANNEL_COUNT;

use super::address::Address;
use super::layout::id;

/// One frame whose checksum held.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Who sent it.
    pub sender: Address,
    /// Sender's counter.
    pub sequence: u8,
    /// Message number.
    pub message_id: u32,
    pub(super) version: MavlinkVersion,
    pub(super) payload: Vec<u8>,
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
    /// PARAM_REQUEST_LIST
    ParameterList(Address),
    /// PARAM_REQUEST_READ
    ParameterRead(Address, ParameterKey),
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

/// How a parameter is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ParameterKey {
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
    pub from: Address,
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
/// MAV_COMP_ID_AUTOPILOT1
pub const AUTOPILOT_COMPONENT: u8 = 1;
/// MAV_AUTOPILOT_ARDUPILOTMEGA
pub const AUTOPILOT_ARDUPILOT: u8 = 3;
/// MAV_AUTOPILOT_PX4
pub const AUTOPILOT_PX4: u8 = 12;
/// MAV_AUTOPILOT_INVALID: a component that is no flight controller.
pub const AUTOPILOT_INVALID: u8 = 8;

impl ControlsFrame {
    /// Whether the controls are to be obeyed.
    pub fn armed(&self) -> bool {
        self.mode & MODE_ARMED != 0
    }
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
                    0.. => ParameterKey::Index(u16::from_le_bytes(field.bytes(0))),
                    _ => ParameterKey::Name(field.name(4)),
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
            from: self.sender,
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

/// A payload whose trailing zeros the sender may have cut.
pub(super) struct Payload<'a>(pub(super) &'a [u8]);

impl Payload<'_> {
    pub(super) fn bytes<const N: usize>(&self, offset: usize) -> [u8; N] {
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
