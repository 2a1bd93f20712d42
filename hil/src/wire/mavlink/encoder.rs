//! Messages to bytes, MAVLink 2.

use ::mavlink::dialects::common::MavMessage;
use ::mavlink::{MAVLinkV2MessageRaw, MavHeader, Message};

use super::frame::Command;
use super::layout::{MAGIC_2, id};

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
        let payload = [low, high, result, 0, 0, 0, 0, 0, command.from.system, command.from.component];
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

#[cfg(test)]
mod tests {
    use ::mavlink::dialects::common as dialect;

    use super::*;
    use crate::wire::mavlink::{Address, Decoder, RESULT_UNSUPPORTED, SET_MESSAGE_INTERVAL};

    #[test]
    fn an_acknowledgement_is_what_the_crate_reads() {
        let command = Command {
            command: SET_MESSAGE_INTERVAL,
            parameters: [0.0; 7],
            to: Address { system: 1, component: 200 },
            from: Address { system: 1, component: 1 },
        };
        let mut bytes = Vec::new();
        Encoder::new(1, 200).encode_ack(&command, RESULT_UNSUPPORTED, &mut bytes);
        let mut decoder = Decoder::default();
        decoder.push(&bytes);
        let frame = decoder.next_frame().unwrap();
        let Some(MavMessage::COMMAND_ACK(ack)) = frame.message() else { panic!("{frame:?}") };
        assert_eq!(ack.command, dialect::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL);
        assert_eq!(ack.result, dialect::MavResult::MAV_RESULT_UNSUPPORTED);
        assert_eq!((ack.target_system, ack.target_component), (1, 1));
    }
}
