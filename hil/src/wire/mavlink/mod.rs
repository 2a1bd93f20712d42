//! MAVLink: bytes <-> frames <-> signals, as pure functions of bytes.
//!
//! [`Decoder`] takes bytes as they come, cut anywhere, MAVLink 1 or 2, and gives whole frames whose checksum
//! holds; [`Encoder`] gives the bytes of messages. Wire units become SI in [`measurement`] and [`telemetry`]
//! and nowhere else. Message numbers, lengths and checksum seeds come from the `mavlink` crate.

mod address;
mod layout;

mod frame;

mod decoder;
mod encoder;

mod message;

pub mod measurement;
pub mod telemetry;

pub use ::mavlink::dialects::common::MavMessage;

pub use address::Address;
pub use decoder::{Counters, Decoder};
pub(crate) use decoder::{Piece, next_piece, sample_time_us};
pub use encoder::Encoder;
pub use frame::{
    AUTOPILOT_ARDUPILOT, AUTOPILOT_COMPONENT, AUTOPILOT_INVALID, AUTOPILOT_PX4, Command, ControlsFrame,
    Frame, FromFc, GUIDED_ENABLE, Heartbeat, INJECT_FAILURE, MODE_ARMED, MODE_HIL, PAUSE_CONTINUE,
    ParameterKey, REBOOT, RESULT_ACCEPTED, RESULT_DENIED, RESULT_UNSUPPORTED, SET_MESSAGE_INTERVAL,
};
pub(crate) use layout::{LONGEST_FRAME_BYTES, id};
pub use layout::{frame_bytes, is_hil};
pub use message::{
    Severity, actuator_controls, heartbeat, is_reboot, parameter_value, reboot, status_text, system_time,
};
