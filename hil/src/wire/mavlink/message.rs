//! Messages that are put together here: controls, heartbeats, commands, parameters, texts.

use ::mavlink::dialects::common as dialect;
use ::mavlink::dialects::common::MavMessage;

use super::address::Address;
use super::frame::ControlsFrame;

/// How grave a text is.
pub use dialect::MavSeverity as Severity;

/// Text of one STATUSTEXT.
const TEXT_BYTES: usize = 50;

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
pub fn reboot(to: Address) -> MavMessage {
    MavMessage::COMMAND_LONG(dialect::COMMAND_LONG_DATA {
        param1: 1.0, // 1: the autopilot
        command: dialect::MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
        target_system: to.system,
        target_component: to.component,
        ..Default::default()
    })
}

/// Whether a message tells this system and component to boot anew.
pub fn is_reboot(message: &MavMessage, own: Address) -> bool {
    let MavMessage::COMMAND_LONG(data) = message else { return false };
    let to = Address { system: data.target_system, component: data.target_component };
    data.command == dialect::MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN
        && data.param1 == 1.0
        && to.reaches(own)
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

/// Milliseconds of a 32-bit field, which wraps after 49 days as the protocol has it.
pub(super) fn milliseconds(time_us: u64) -> u32 {
    (time_us / 1000) as u32
}
