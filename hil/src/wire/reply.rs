//! Replies: acknowledgements, parameters, texts. They wait their turn and keep within a budget of bytes, so
//! that no list of parameters delays a sample.

use std::collections::VecDeque;

use hopbench::event::Severity;

use crate::wire::mavlink::{
    self, Command, Encoder, MavMessage, RESULT_ACCEPTED, RESULT_DENIED, RESULT_UNSUPPORTED, parameter_value,
    status_text,
};
use crate::wire::request::{Answer, Receipt, Rejection};

/// Messages that wait; what comes on top is dropped and counted.
const QUEUE: usize = 256;
/// Rate of a socket (byte/s): no limit to anybody, but a bound.
const SOCKET_BYTES_S: f64 = 250e3;
/// What may be sent at once is what comes in so long a time (s): a sample is late by no more.
const BURST_S: f64 = 0.004;

/// Bytes a second that may be spent, by the wall clock.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ByteBudget {
    bytes_s: f64,
    left: f64,
    at_ns: u64,
}

impl ByteBudget {
    /// So many bytes a second.
    pub(crate) fn new(bytes_s: f64) -> Self {
        Self { bytes_s, left: 0.0, at_ns: 0 }
    }

    /// On a socket.
    pub(crate) fn socket() -> Self {
        Self::new(SOCKET_BYTES_S)
    }

    /// Bytes a second.
    pub(crate) fn bytes_s(&self) -> f64 {
        self.bytes_s
    }

    /// From now on so many bytes a second.
    pub(crate) fn set_rate(&mut self, bytes_s: f64) {
        self.bytes_s = bytes_s;
    }

    /// Whether one more frame may be sent now.
    pub(crate) fn is_open(&mut self, now_ns: u64) -> bool {
        let since_s = now_ns.saturating_sub(self.at_ns) as f64 * 1e-9;
        self.at_ns = now_ns;
        // At least one byte, or a slow line would never open.
        let most = (self.bytes_s * BURST_S).max(1.0);
        self.left = (self.left + since_s * self.bytes_s).min(most);
        self.left > 0.0
    }

    /// A frame of so many bytes was sent.
    pub(crate) fn spend(&mut self, bytes: usize) {
        self.left -= bytes as f64;
    }
}

/// One parameter and the value in force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ParameterValue<'a> {
    /// Its name.
    pub(crate) name: &'a str,
    /// In force.
    pub(crate) value: f64,
    /// Place in the list.
    pub(crate) index: u16,
    /// Length of the list.
    pub(crate) count: u16,
}

/// One reply.
#[derive(Clone, Debug)]
pub(crate) enum Reply {
    /// A message of the dialect.
    Message(Box<MavMessage>),
    /// COMMAND_ACK with its MAV_RESULT: the command may be one that the dialect does not have.
    Ack(Command, u8),
}

impl Reply {
    /// Appends its frame.
    pub(crate) fn encode(&self, encoder: &mut Encoder, bytes: &mut Vec<u8>) {
        match self {
            Self::Message(message) => encoder.encode(message, bytes),
            Self::Ack(command, result) => encoder.encode_ack(command, *result, bytes),
        }
    }
}

/// Replies to one other end that wait to be sent.
#[derive(Debug, Default)]
pub(crate) struct ReplyQueue {
    waiting: VecDeque<Reply>,
    /// Next entry of the list of parameters that was asked for.
    listing: Option<u16>,
    text_id: u16,
    dropped: u64,
}

impl ReplyQueue {
    /// The value of one parameter.
    pub(crate) fn tell_parameter(&mut self, parameter: &ParameterValue) {
        self.push(parameter_reply(parameter));
    }

    /// Acknowledges a command.
    pub(crate) fn acknowledge(&mut self, receipt: &Receipt, answer: &Answer) {
        let result = match answer {
            Ok(()) => RESULT_ACCEPTED,
            Err(Rejection::Denied(_)) => RESULT_DENIED,
            Err(Rejection::Unsupported(_)) => RESULT_UNSUPPORTED,
        };
        self.push(Reply::Ack(receipt.0, result));
    }

    fn push(&mut self, reply: Reply) {
        if self.waiting.len() < QUEUE {
            self.waiting.push_back(reply);
        } else {
            self.dropped += 1;
        }
    }

    /// A text, in pieces where it is long.
    pub(crate) fn tell(&mut self, severity: Severity, text: &str) {
        for piece in self.pieces(severity, text) {
            self.push(Reply::Message(Box::new(piece)));
        }
    }

    /// A text in pieces, for whoever sends it out of turn.
    pub(crate) fn pieces(&mut self, severity: Severity, text: &str) -> Vec<MavMessage> {
        let severity = match severity {
            Severity::Info => mavlink::Severity::MAV_SEVERITY_INFO,
            Severity::Notice => mavlink::Severity::MAV_SEVERITY_NOTICE,
            Severity::Warning => mavlink::Severity::MAV_SEVERITY_WARNING,
            Severity::Error => mavlink::Severity::MAV_SEVERITY_ERROR,
            Severity::Critical => mavlink::Severity::MAV_SEVERITY_CRITICAL,
        };
        self.text_id = self.text_id.wrapping_add(1);
        status_text(severity, text, self.text_id)
    }

    /// Begins the list of parameters, or begins it again.
    pub(crate) fn list_parameters(&mut self) {
        self.listing = Some(0);
    }

    /// What is to be sent next. `parameter` gives an entry of the list, `None` behind its end.
    pub(crate) fn next<'a>(
        &mut self,
        parameter: impl FnOnce(u16) -> Option<ParameterValue<'a>>,
    ) -> Option<Reply> {
        if let Some(reply) = self.waiting.pop_front() {
            return Some(reply);
        }
        let entry = parameter(self.listing?);
        self.listing = entry.and_then(|entry| entry.index.checked_add(1));
        entry.map(|entry| parameter_reply(&entry))
    }

    /// Messages that found no room.
    pub(crate) fn dropped(&self) -> u64 {
        self.dropped
    }
}

fn parameter_reply(parameter: &ParameterValue) -> Reply {
    let ParameterValue { name, value, index, count } = *parameter;
    Reply::Message(Box::new(parameter_value(name, value, index, count)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 9216 byte/s for a second, asked every millisecond, in frames of 37 bytes.
    #[test]
    fn a_budget_is_kept_to_a_frame_and_a_burst() {
        let mut budget = ByteBudget::new(9216.0);
        let mut spent = 0;
        for ms in 0..=1000 {
            while budget.is_open(ms * 1_000_000) {
                budget.spend(37);
                spent += 37;
            }
        }
        assert!((9216 - 37..=9216 + 37 + 37).contains(&spent), "{spent}");
        // A long rest gives no more than the burst: 36.9 bytes, so one frame, and a second one that it
        // begins.
        let mut frames = 0;
        while budget.is_open(60_000_000_000) {
            budget.spend(37);
            frames += 1;
        }
        assert!(frames <= 2, "{frames}");
    }

    #[test]
    fn a_list_comes_after_what_waits_and_ends() {
        let mut replies = ReplyQueue::default();
        replies.list_parameters();
        replies.tell(Severity::Info, "first");
        let entry = |index: u16| {
            (index < 3).then(|| ParameterValue { name: "X", value: f64::from(index), index, count: 3 })
        };
        let sent: Vec<_> = std::iter::from_fn(|| replies.next(entry)).collect();
        assert_eq!(sent.len(), 4);
        assert!(matches!(&sent[0], Reply::Message(m) if matches!(**m, MavMessage::STATUSTEXT(_))));
        let Reply::Message(last) = &sent[3] else { panic!("{:?}", sent[3]) };
        assert!(matches!(&**last, MavMessage::PARAM_VALUE(data) if data.param_index == 2));
    }

    #[test]
    fn what_finds_no_room_is_counted() {
        let mut replies = ReplyQueue::default();
        (0..300).for_each(|_| replies.tell(Severity::Info, "again"));
        assert_eq!(replies.dropped(), 300 - QUEUE as u64);
    }
}
