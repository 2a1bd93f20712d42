//! The flight controller's end of the wire: bytes in become controls, status and inquiries, and what goes out
//! passes a bad wire, if it is one.

use std::time::Instant;

use hopbench::fault::wire::WireEffect;
use hopbench::simulation::report::LinkReport;
use hopbench::time::SimTime;

use crate::wire::disruption::{Disruption, Sample};
use crate::wire::link::{Hold, Link, Notice};
use crate::wire::mavlink::{
    AUTOPILOT_COMPONENT, AUTOPILOT_INVALID, AUTOPILOT_PX4, Address, Decoder, Frame, FromFc, MODE_HIL,
};
use crate::wire::profile::Profile;
use crate::wire::request::{ControlsInput, Inquiry, Request, Status, inquiry};
use crate::wire::stream::{self, Streams};

/// What a flight controller says.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum FcMessage {
    Controls(ControlsInput),
    Status(Status),
    Inquiry(Inquiry),
}

/// The link to the flight controller, with what stands between bytes and signals.
pub(crate) struct FcLink<'a> {
    link: &'a mut Link,
    profile: &'static Profile,
    decoder: Decoder,
    /// What goes out, before it is sent.
    pub(crate) streams: Streams,
    disruption: Disruption,
    /// Who sends controls.
    controller: Option<Address>,
    frames: FrameCounts,
    /// When a heartbeat is due by the wall clock (ns).
    next_heartbeat_ns: u64,
    received: Vec<u8>,
}

/// Frames to the flight controller.
#[derive(Debug, Default)]
struct FrameCounts {
    /// Encoded before what waits now.
    encoded: u64,
    /// Taken by the link.
    taken: u64,
    /// Thrown away.
    dropped: u64,
}

impl FrameCounts {
    fn count(&mut self, frames: u64, taken: bool) {
        *(if taken { &mut self.taken } else { &mut self.dropped }) += frames;
    }
}

impl<'a> FcLink<'a> {
    pub(crate) fn new(link: &'a mut Link, profile: &'static Profile, seed: u32) -> Self {
        Self {
            link,
            profile,
            decoder: Decoder::default(),
            streams: Streams::new(profile),
            disruption: Disruption::new(u64::from(seed)),
            controller: None,
            frames: FrameCounts::default(),
            next_heartbeat_ns: 0,
            received: Vec::with_capacity(64 * 1024),
        }
    }

    pub(crate) fn address(&self) -> &str {
        self.link.address()
    }

    pub(crate) fn has_peer(&self) -> bool {
        self.link.has_peer()
    }

    /// Returns when something may have arrived, at the deadline at the latest.
    pub(crate) fn wait(&mut self, deadline: Instant) {
        self.link.wait(deadline);
    }

    /// Whether bytes pass as they are.
    pub(crate) fn is_sound(&self) -> bool {
        self.disruption.is_clear()
    }

    /// Bytes have come, and there is no MAVLink in them.
    pub(crate) fn hears_nonsense(&self) -> bool {
        self.received_bytes() > 0 && self.decoder.counters().frames == 0
    }

    pub(crate) fn received_bytes(&self) -> u64 {
        self.link.counters().received_bytes
    }

    /// Takes what has arrived at `now`, for [`Self::next_message`]; who came and went. `answer` hears of each
    /// answer as it is put on a bad wire.
    pub(crate) fn receive(&mut self, hold: Hold, now: SimTime, answer: impl FnMut(Sample)) -> Vec<Notice> {
        self.link.keep_peer(hold);
        self.received.clear();
        self.link.receive(&mut self.received);
        let notices = self.link.take_notices();
        for notice in &notices {
            match notice {
                Notice::Connected(_) => self.decoder.forget_senders(),
                Notice::Disconnected(_) => {
                    self.decoder.forget_senders();
                    self.controller = None;
                    self.disruption.forget_tails();
                }
                Notice::Refused(_) => {}
            }
        }
        if !self.disruption.is_clear() {
            self.disruption.carry_from_fc(&mut self.received, now, answer);
        }
        self.decoder.push(&self.received);
        notices
    }

    /// The next message that concerns the bench; `pass` sees every whole frame on the way, with its message
    /// number.
    pub(crate) fn next_message(&mut self, mut pass: impl FnMut(u32, &[u8])) -> Option<FcMessage> {
        loop {
            let frame = self.decoder.next_frame_raw(&mut pass)?;
            if let Some(message) = self.read(&frame) {
                return Some(message);
            }
        }
    }

    fn read(&mut self, frame: &Frame) -> Option<FcMessage> {
        match frame.from_fc() {
            FromFc::Controls(controls) => {
                self.controller = Some(frame.sender);
                Some(FcMessage::Controls(ControlsInput {
                    time_us: controls.time_us,
                    sequence: frame.sequence,
                    armed: controls.armed(),
                    channels: controls.controls,
                }))
            }
            // Gimbals, cameras and ground stations have heartbeats too; the flight controller's is the one
            // from whoever sends controls, and until then from the component that autopilots are by
            // convention.
            FromFc::Heartbeat(beat) => {
                let ours = match self.controller {
                    Some(known) => frame.sender == known,
                    None => frame.sender.component == AUTOPILOT_COMPONENT,
                };
                let status = Status {
                    in_the_loop: beat.base_mode & MODE_HIL != 0,
                    is_px4: beat.autopilot == AUTOPILOT_PX4,
                };
                (ours && beat.autopilot != AUTOPILOT_INVALID).then_some(FcMessage::Status(status))
            }
            other => {
                let inquiry = inquiry(other)?;
                if !frame.target().reaches(stream::ADDRESS) {
                    return None;
                }
                match inquiry {
                    inquiry if self.profile.answers => Some(FcMessage::Inquiry(inquiry)),
                    // It gets no answers, but may say how often messages come.
                    Inquiry::Command { request: Ok(request @ Request::Interval { .. }), .. } => {
                        Some(FcMessage::Inquiry(Inquiry::Command { request: Ok(request), receipt: None }))
                    }
                    _ => None,
                }
            }
        }
    }

    /// A heartbeat by the wall clock, at most every `interval_ns`.
    pub(crate) fn beat(&mut self, now_ns: u64, interval_ns: u64) {
        if now_ns >= self.next_heartbeat_ns && self.link.has_peer() {
            self.next_heartbeat_ns = now_ns + interval_ns;
            self.streams.put_heartbeat();
        }
    }

    /// Sends what waits, whatever is broken.
    pub(crate) fn send(&mut self) {
        let taken = self.link.send(self.streams.bytes());
        self.streams.bytes().clear();
        let frames = self.streams.frames() - self.frames.encoded;
        self.frames.encoded += frames;
        self.frames.count(frames, taken);
    }

    /// Puts what waits on a bad wire, and sends what has come through by now; the newest sample among that.
    pub(crate) fn send_through_disruption(&mut self, now: SimTime) -> Option<Sample> {
        let bytes = self.streams.bytes();
        let (frames, newest) = self.disruption.carry_to_fc(bytes, now);
        let taken = self.link.send(bytes);
        bytes.clear();
        self.frames.encoded = self.streams.frames();
        self.frames.count(frames, taken);
        newest
    }

    /// What is broken from now on. True when the flight controller is to be told to boot anew.
    #[must_use]
    pub(crate) fn set_effect(&mut self, effect: &WireEffect) -> bool {
        self.disruption.set(effect)
    }

    /// Tells the flight controller to boot anew: straight, a bad wire is another matter.
    pub(crate) fn send_reboot(&mut self) {
        let by_convention = Address { system: 1, component: AUTOPILOT_COMPONENT };
        self.streams.put_reboot(self.controller.unwrap_or(by_convention));
        self.send();
    }

    /// Another flight begins: nothing of the last is under way.
    pub(crate) fn begin_again(&mut self, seed: u32) {
        self.disruption = Disruption::new(u64::from(seed));
    }

    /// What has passed in `streamed_s`, on a line of `baud` symbols a second, ten to a byte.
    pub(crate) fn report(&self, streamed_s: f64, baud: Option<u32>) -> LinkReport {
        let (heard, moved) = (self.decoder.counters(), self.link.counters());
        let each_s = |count: u64| if streamed_s > 0.0 { count as f64 / streamed_s } else { 0.0 };
        let load = |bytes| baud.map(|baud| each_s(bytes) * 10.0 / f64::from(baud) * 100.0);
        LinkReport {
            sent: self.frames.taken,
            dropped: self.frames.dropped,
            received: heard.frames,
            crc_errors: heard.crc_errors,
            lost: heard.lost,
            duplicates: heard.duplicates,
            out_of_order: heard.out_of_order,
            skipped_bytes: heard.skipped_bytes,
            refused: moved.refused,
            disrupted: self.disruption.report(),
            sent_bytes: moved.sent_bytes,
            received_bytes: moved.received_bytes,
            rate_out_hz: each_s(self.frames.taken),
            rate_in_hz: each_s(heard.frames),
            wire_load_percent: load(moved.sent_bytes),
            wire_load_in_percent: load(moved.received_bytes),
            // The rest is known to who flies, not to the wire.
            ..LinkReport::default()
        }
    }
}
