//! Numbers and lengths of messages, as the dialect has them; numbers of commands stand in `frame.rs`.

use ::mavlink::MessageData;
use ::mavlink::dialects::common as dialect;

/// First byte of a frame of MAVLink 1.
pub(super) const MAGIC_1: u8 = 0xFE;
/// First byte of a frame of MAVLink 2.
pub(super) const MAGIC_2: u8 = 0xFD;
/// Incompatibility flag of MAVLink 2: a signature follows the checksum.
pub(super) const SIGNED: u8 = 0x01;
pub(super) const SIGNATURE_BYTES: usize = 13;
/// Head and checksum of a frame of MAVLink 2 without signature.
const FRAMING_BYTES: usize = 12;

/// The longest frame of MAVLink 2 (byte): 255 of payload, signed.
pub(crate) const LONGEST_FRAME_BYTES: usize = 255 + FRAMING_BYTES + SIGNATURE_BYTES;

/// Numbers of messages.
pub(crate) mod id {
    use super::{MessageData, dialect};

    pub(crate) const HEARTBEAT: u32 = dialect::HEARTBEAT_DATA::ID;
    pub(crate) const SYS_STATUS: u32 = dialect::SYS_STATUS_DATA::ID;
    pub(crate) const SYSTEM_TIME: u32 = dialect::SYSTEM_TIME_DATA::ID;
    pub(crate) const PARAM_REQUEST_READ: u32 = dialect::PARAM_REQUEST_READ_DATA::ID;
    pub(crate) const PARAM_REQUEST_LIST: u32 = dialect::PARAM_REQUEST_LIST_DATA::ID;
    pub(crate) const PARAM_SET: u32 = dialect::PARAM_SET_DATA::ID;
    pub(crate) const ATTITUDE_QUATERNION: u32 = dialect::ATTITUDE_QUATERNION_DATA::ID;
    pub(crate) const LOCAL_POSITION_NED: u32 = dialect::LOCAL_POSITION_NED_DATA::ID;
    pub(crate) const GLOBAL_POSITION_INT: u32 = dialect::GLOBAL_POSITION_INT_DATA::ID;
    pub(crate) const COMMAND_INT: u32 = dialect::COMMAND_INT_DATA::ID;
    pub(crate) const COMMAND_LONG: u32 = dialect::COMMAND_LONG_DATA::ID;
    pub(crate) const COMMAND_ACK: u32 = dialect::COMMAND_ACK_DATA::ID;
    pub(crate) const HIL_ACTUATOR_CONTROLS: u32 = dialect::HIL_ACTUATOR_CONTROLS_DATA::ID;
    pub(crate) const HIL_SENSOR: u32 = dialect::HIL_SENSOR_DATA::ID;
    pub(crate) const HIL_STATE_QUATERNION: u32 = dialect::HIL_STATE_QUATERNION_DATA::ID;
    pub(crate) const EXTENDED_SYS_STATE: u32 = dialect::EXTENDED_SYS_STATE_DATA::ID;
    pub(crate) const NAMED_VALUE_FLOAT: u32 = dialect::NAMED_VALUE_FLOAT_DATA::ID;
    pub(crate) const STATUSTEXT: u32 = dialect::STATUSTEXT_DATA::ID;
    pub(crate) const ODOMETRY: u32 = dialect::ODOMETRY_DATA::ID;
    pub(crate) const DEBUG_FLOAT_ARRAY: u32 = dialect::DEBUG_FLOAT_ARRAY_DATA::ID;

    /// What belongs to the loop between plant and flight controller.
    pub(super) const HIL: [u32; 8] = [
        90, // HIL_STATE, which the dialect calls deprecated
        dialect::HIL_CONTROLS_DATA::ID,
        dialect::HIL_RC_INPUTS_RAW_DATA::ID,
        HIL_ACTUATOR_CONTROLS,
        HIL_SENSOR,
        dialect::HIL_GPS_DATA::ID,
        dialect::HIL_OPTICAL_FLOW_DATA::ID,
        HIL_STATE_QUATERNION,
    ];
}

/// Lengths of whole frames, MAVLink 2, unsigned, without a trailing zero cut (byte).
pub mod frame_bytes {
    use super::{FRAMING_BYTES, MessageData, dialect};

    pub(crate) const HEARTBEAT: usize = of::<dialect::HEARTBEAT_DATA>();
    pub(crate) const SYS_STATUS: usize = of::<dialect::SYS_STATUS_DATA>();
    pub(crate) const SYSTEM_TIME: usize = of::<dialect::SYSTEM_TIME_DATA>();
    pub(crate) const ATTITUDE_QUATERNION: usize = of::<dialect::ATTITUDE_QUATERNION_DATA>();
    pub(crate) const LOCAL_POSITION_NED: usize = of::<dialect::LOCAL_POSITION_NED_DATA>();
    pub(crate) const GLOBAL_POSITION_INT: usize = of::<dialect::GLOBAL_POSITION_INT_DATA>();
    /// HIL_ACTUATOR_CONTROLS
    pub const HIL_ACTUATOR_CONTROLS: usize = of::<dialect::HIL_ACTUATOR_CONTROLS_DATA>();
    /// HIL_SENSOR
    pub const HIL_SENSOR: usize = of::<dialect::HIL_SENSOR_DATA>();
    pub(crate) const HIL_GPS: usize = of::<dialect::HIL_GPS_DATA>();
    pub(crate) const HIL_STATE_QUATERNION: usize = of::<dialect::HIL_STATE_QUATERNION_DATA>();
    pub(crate) const DISTANCE_SENSOR: usize = of::<dialect::DISTANCE_SENSOR_DATA>();
    pub(crate) const EXTENDED_SYS_STATE: usize = of::<dialect::EXTENDED_SYS_STATE_DATA>();
    pub(crate) const NAMED_VALUE_FLOAT: usize = of::<dialect::NAMED_VALUE_FLOAT_DATA>();
    pub(crate) const ODOMETRY: usize = of::<dialect::ODOMETRY_DATA>();
    pub(crate) const DEBUG_FLOAT_ARRAY: usize = of::<dialect::DEBUG_FLOAT_ARRAY_DATA>();

    const fn of<M: MessageData>() -> usize {
        M::ENCODED_LEN + FRAMING_BYTES
    }
}

/// Whether a message belongs to the loop between plant and flight controller and to nobody else.
pub fn is_hil(message_id: u32) -> bool {
    id::HIL.contains(&message_id)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers and lengths that the standard prints.
    #[test]
    fn the_dialect_has_the_numbers_of_the_standard() {
        assert_eq!(id::HIL, [90, 91, 92, 93, 107, 113, 114, 115]);
        assert_eq!((id::HEARTBEAT, id::STATUSTEXT, id::DEBUG_FLOAT_ARRAY), (0, 253, 350));
        assert_eq!((frame_bytes::HIL_SENSOR, frame_bytes::HIL_ACTUATOR_CONTROLS), (77, 93));
        assert_eq!((frame_bytes::ODOMETRY, frame_bytes::DEBUG_FLOAT_ARRAY), (245, 264));
        assert_eq!(LONGEST_FRAME_BYTES, 280);
    }
}
