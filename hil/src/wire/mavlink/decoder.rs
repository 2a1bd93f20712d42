//! Bytes to frames: cut anywhere, damaged, MAVLink 1 or 2.
//!
//! After damage it resumes at the next frame: nothing but the damaged frame is lost, since a candidate that
//! fails gives up one byte, not its claimed length, and a candidate whose end has not arrived does not hold
//! up a whole frame behind it.

use ::mavlink::dialects::common::MavMessage;
use ::mavlink::{MavlinkVersion, Message};

use super::address::Address;
use super::frame::{Frame, Payload};
use super::layout::{MAGIC_1, MAGIC_2, SIGNATURE_BYTES, SIGNED, id};

/// Bytes to frames.
#[derive(Debug, Default)]
pub struct Decoder {
    buffer: Vec<u8>,
    start: usize,
    senders: Vec<Sender>,
    counters: Counters,
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

/// The counter of one sender.
#[derive(Debug)]
struct Sender {
    address: Address,
    last: u8,
    /// Bit `n`: the frame `n` before the last has come.
    arrived: u32,
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

    /// The same; `raw` sees the bytes of every whole frame with its message number, those of unknown messages
    /// too.
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
                sender: Address { system: raw[5], component: raw[6] },
                message_id: message_id_2(raw),
                version: MavlinkVersion::V2,
                payload: raw[10..10 + payload_length].to_vec(),
            }
        } else {
            Frame {
                sequence: raw[2],
                sender: Address { system: raw[3], component: raw[4] },
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

    /// Counts what is missing between this frame and the last of the same sender, and what came late or
    /// twice.
    fn follow(&mut self, frame: &Frame) {
        let address = frame.sender;
        let Some(sender) = self.senders.iter_mut().find(|sender| sender.address == address) else {
            // A flight controller has a handful of components; noise that looks like more is not followed.
            if self.senders.len() < 32 {
                self.senders.push(Sender { address, last: frame.sequence, arrived: 1 });
            }
            return;
        };
        let ahead = frame.sequence.wrapping_sub(sender.last);
        let behind = sender.last.wrapping_sub(frame.sequence);
        match (ahead, behind) {
            (1..=127, _) => {
                self.counters.lost += u64::from(ahead) - 1;
                sender.arrived = sender.arrived.checked_shl(ahead.into()).unwrap_or(0) | 1;
                sender.last = frame.sequence;
            }
            (_, 0..32) if sender.arrived & (1 << behind) != 0 => self.counters.duplicates += 1,
            (_, 0..32) if self.counters.lost > 0 => {
                // It was taken for lost.
                sender.arrived |= 1 << behind;
                self.counters.out_of_order += 1;
                self.counters.lost -= 1;
            }
            // A sender that began anew.
            _ => (sender.last, sender.arrived) = (frame.sequence, 1),
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
pub(crate) enum Piece {
    /// A whole frame of this length.
    Frame(usize),
    /// So many bytes that belong to none.
    Noise(usize),
}

/// The first piece of a stream, cut as [`Decoder`] reads it; `None` until more bytes come.
pub(crate) fn next_piece(bytes: &[u8]) -> Option<Piece> {
    if bytes.is_empty() {
        return None;
    }
    match candidate(bytes) {
        Candidate::Whole { length } | Candidate::Unknown { length } => Some(Piece::Frame(length)),
        Candidate::Damaged | Candidate::Nothing => Some(Piece::Noise(1)),
        Candidate::Partial => whole_behind(bytes).map(Piece::Noise),
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

#[cfg(test)]
mod tests {
    use ::mavlink::{MAVLinkV1MessageRaw, MavHeader};

    use super::*;
    use crate::wire::mavlink::{
        ControlsFrame, Encoder, FromFc, Heartbeat, SET_MESSAGE_INTERVAL, actuator_controls,
    };

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
        let mut raw = MAVLinkV1MessageRaw::new();
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
}
