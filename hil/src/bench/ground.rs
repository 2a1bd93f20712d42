//! The ground station's link: telemetry of the true vehicle, answers, and the flight controller's traffic
//! both ways.
//!
//! The bench speaks here as system 250, a rocket in simulation that is no autopilot, and every text begins
//! with SIMULATED, so that nobody takes it for the flight controller or for a real vehicle. The controller's
//! frames pass as they came, byte for byte, unknown and signed ones too; messages of the simulation loop
//! (HIL_*) never pass, in either direction. Telemetry is for people: it follows the wall clock, and goes on
//! while simulated time stands.

use std::collections::VecDeque;

use hopbench::environment::geodesy::Datum;
use hopbench::event::Severity;
use hopbench::fault::Component;
use hopbench::simulation::Flight;
use hopbench::simulation::report::GroundReport;
use hopbench::time::SimTime;

use crate::wire::link::{Link, Notice};
use crate::wire::mavlink::telemetry::{
    Sensor, attitude, extended_state, global_position, local_position, plant_array, system_status,
    vehicle_heartbeat,
};
use crate::wire::mavlink::{
    Address, Decoder, Encoder, LONGEST_FRAME_BYTES, MavMessage, frame_bytes, id, is_hil,
};
use crate::wire::reply::{ByteBudget, ParameterValue, Reply, ReplyQueue};
use crate::wire::request::{Inquiry, inquiry};
use crate::wire::stream::{Refusal, Timer};

/// Who the bench is to a ground station.
pub const GROUND_ADDRESS: Address = Address { system: 250, component: 1 };
/// Frames of the flight controller that wait; what comes on top is dropped and counted.
const QUEUE: usize = 256;
/// A datagram is sent when it holds this much, which passes any network whole.
const DATAGRAM_BYTES: usize = 1200;
/// Share of a serial line that is used.
const SHARE: f64 = 0.9;

/// Telemetry, how often it comes by default (us), and its frame on the wire (byte). The plant's floats come
/// last: they need the most room.
const TELEMETRY: [(u32, u64, usize); 6] = [
    (id::ATTITUDE_QUATERNION, 100_000, frame_bytes::ATTITUDE_QUATERNION),
    (id::LOCAL_POSITION_NED, 100_000, frame_bytes::LOCAL_POSITION_NED),
    (id::GLOBAL_POSITION_INT, 100_000, frame_bytes::GLOBAL_POSITION_INT),
    (id::EXTENDED_SYS_STATE, 500_000, frame_bytes::EXTENDED_SYS_STATE),
    (id::SYS_STATUS, 1_000_000, frame_bytes::SYS_STATUS),
    (id::DEBUG_FLOAT_ARRAY, 100_000, frame_bytes::DEBUG_FLOAT_ARRAY),
];

/// The link and who speaks on it.
pub struct Ground {
    link: Link,
    decoder: Decoder,
    encoder: Encoder,
    /// Answers and texts.
    pub(super) replies: ReplyQueue,
    budget: ByteBudget,
    heartbeat: Timer,
    banner: Timer,
    telemetry: [(u32, Option<Timer>); TELEMETRY.len()],
    /// After a text of the flight controller, which does not say that it is of a simulation.
    contradiction: Timer,
    from_fc: VecDeque<(u32, Vec<u8>)>,
    out: Vec<u8>,
    counts: GroundReport,
}

/// What came from the ground.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum FromGround {
    /// For the bench.
    Inquiry(Inquiry),
    /// For the flight controller, as it came.
    Forward(Vec<u8>),
}

/// What telemetry is made of.
pub(super) struct View<'a> {
    /// The flight.
    pub(super) flight: &'a Flight,
    /// Where its pad is.
    pub(super) datum: &'a Datum,
    /// Time on the wire (us).
    pub(super) time_us: u64,
    /// Whether the vehicle obeys its controls.
    pub(super) is_armed: bool,
}

impl Ground {
    /// On an open link, with so many symbols a second where it has such a rate.
    pub fn new(link: Link, baud: Option<u32>) -> Self {
        let bytes_s = |baud: u32| f64::from(baud) / 10.0 * SHARE; // ten symbols to a byte
        let Address { system, component } = GROUND_ADDRESS;
        Self {
            link,
            decoder: Decoder::default(),
            encoder: Encoder::new(system, component),
            replies: ReplyQueue::default(),
            budget: baud.map_or_else(ByteBudget::socket, |baud| ByteBudget::new(bytes_s(baud))),
            heartbeat: Timer::every_us(1_000_000),
            banner: Timer::every_us(10_000_000),
            contradiction: Timer::every_us(1_000_000),
            telemetry: TELEMETRY.map(|(id, interval_us, _)| (id, Some(Timer::every_us(interval_us)))),
            from_fc: VecDeque::new(),
            out: Vec::with_capacity(2 * DATAGRAM_BYTES),
            counts: GroundReport::default(),
        }
    }

    /// The link with the address actually bound.
    pub fn address(&self) -> &str {
        self.link.address()
    }

    /// Whether somebody is there to be told.
    pub(super) fn has_listener(&self) -> bool {
        self.link.has_peer()
    }

    /// Everything that has arrived, and who came and went.
    pub(super) fn receive(&mut self) -> (Vec<FromGround>, Vec<Notice>) {
        let (mut bytes, mut heard) = (Vec::new(), Vec::new());
        self.link.receive(&mut bytes);
        let notices = self.link.take_notices();
        if notices.iter().any(|notice| matches!(notice, Notice::Connected(_))) {
            self.decoder.forget_senders();
            self.banner = Timer::every_us(10_000_000);
        }
        if bytes.is_empty() {
            return (heard, notices);
        }
        self.decoder.push(&bytes);
        loop {
            let mut whole = Vec::new();
            let frame = self.decoder.next_frame_raw(|id, raw| whole.push((id, raw.to_vec())));
            // Before it came only messages that the dialect does not have.
            let own = if frame.is_some() { whole.pop() } else { None };
            heard.extend(whole.into_iter().map(|(_, raw)| FromGround::Forward(raw)));
            let (Some(frame), Some((id, raw))) = (frame, own) else { break };
            let target = frame.target().system;
            if !is_hil(id) && target != GROUND_ADDRESS.system {
                heard.push(FromGround::Forward(raw));
            }
            let inquiry = inquiry(frame.from_fc());
            // What is for everybody is the flight controller's to answer, but for the list of parameters.
            if target == GROUND_ADDRESS.system || (target == 0 && inquiry == Some(Inquiry::ParameterList)) {
                heard.extend(inquiry.map(FromGround::Inquiry));
            }
        }
        (heard, notices)
    }

    /// A frame of the flight controller, to be sent when there is room.
    pub(super) fn forward(&mut self, message_id: u32, raw: &[u8]) {
        if is_hil(message_id) || !self.link.has_peer() {
            return;
        }
        if self.from_fc.len() < QUEUE {
            self.from_fc.push_back((message_id, raw.to_vec()));
        } else {
            self.counts.dropped += 1;
        }
    }

    /// How often a message comes (us): `None` never, 0 its default. More than the line carries is not taken.
    ///
    /// # Errors
    /// When the message's rate is not in the bench's hand, or does not fit the line.
    pub fn set_interval(&mut self, message_id: u32, interval_us: Option<u64>) -> Result<(), Refusal> {
        let place = TELEMETRY.iter().position(|(id, ..)| *id == message_id).ok_or(Refusal::NotAdjustable)?;
        let default_us = TELEMETRY[place].1;
        let timer = interval_us.map(|us| Timer::every_us(if us == 0 { default_us } else { us }));
        let before = std::mem::replace(&mut self.telemetry[place].1, timer);
        let bytes_s =
            |timer: Option<Timer>| timer.map_or(0.0, |timer| timer.hz() * TELEMETRY[place].2 as f64);
        let (taken_bytes_s, left_bytes_s) = (self.telemetry_bytes_s(), self.budget.bytes_s());
        // What asks for less always fits.
        if bytes_s(timer) > bytes_s(before) && taken_bytes_s > left_bytes_s {
            self.telemetry[place].1 = before;
            return Err(Refusal::NoRoom { taken_bytes_s, left_bytes_s });
        }
        Ok(())
    }

    /// Bytes a second of heartbeat and telemetry.
    fn telemetry_bytes_s(&self) -> f64 {
        let each = self.telemetry.iter().zip(TELEMETRY);
        let asked: f64 =
            each.map(|((_, timer), (.., bytes))| timer.map_or(0.0, |t| t.hz() * bytes as f64)).sum();
        asked + frame_bytes::HEARTBEAT as f64
    }

    /// Sends what is due and fits: heartbeat, answers, telemetry, the flight controller's frames, the plant's
    /// floats.
    pub(super) fn speak<'a>(
        &mut self,
        now_ns: u64,
        view: &View,
        parameter: impl Fn(u16) -> Option<ParameterValue<'a>>,
    ) {
        if !self.link.has_peer() {
            self.from_fc.clear();
            self.out.clear();
            return;
        }
        let now = SimTime::from_us(now_ns / 1000);
        if self.heartbeat.fires(now) {
            self.put(&vehicle_heartbeat(view.is_armed));
        }
        if self.banner.fires(now) {
            self.replies.tell(Severity::Notice, &banner(view.flight));
        }
        while self.budget.is_open(now_ns)
            && let Some(reply) = self.replies.next(&parameter)
        {
            self.put_reply(&reply);
        }
        let last = self.telemetry.len() - 1;
        for i in 0..last {
            self.report(i, now_ns, view);
        }
        while self.budget.is_open(now_ns)
            && let Some((id, raw)) = self.from_fc.pop_front()
        {
            self.room_for(raw.len());
            self.budget.spend(raw.len());
            self.out.extend_from_slice(&raw);
            self.counts.forwarded_from_fc += 1;
            if id == id::STATUSTEXT && self.contradiction.fires(now) {
                for piece in self.replies.pieces(Severity::Notice, &banner(view.flight)) {
                    self.put(&piece);
                }
            }
        }
        self.report(last, now_ns, view);
        self.flush();
    }

    /// One kind of telemetry, if it is due and fits; what does not fit comes as soon as it does.
    fn report(&mut self, place: usize, now_ns: u64, view: &View) {
        let (id, timer) = &mut self.telemetry[place];
        let id = *id;
        let Some(timer) = timer else { return };
        if !self.budget.is_open(now_ns) || !timer.fires(SimTime::from_us(now_ns / 1000)) {
            return;
        }
        let (now, time_us) = (view.flight.snapshot(), view.time_us);
        let message = match id {
            id::ATTITUDE_QUATERNION => attitude(now, time_us),
            id::LOCAL_POSITION_NED => local_position(now, time_us),
            id::GLOBAL_POSITION_INT => global_position(now, view.datum, time_us),
            id::EXTENDED_SYS_STATE => extended_state(now),
            id::DEBUG_FLOAT_ARRAY => plant_array(now, time_us),
            _ => system_status(&faulty(view.flight)),
        };
        self.put(&message);
    }

    fn put(&mut self, message: &MavMessage) {
        self.put_with(|encoder, out| encoder.encode(message, out));
    }

    fn put_reply(&mut self, reply: &Reply) {
        self.put_with(|encoder, out| reply.encode(encoder, out));
    }

    fn put_with(&mut self, encode: impl FnOnce(&mut Encoder, &mut Vec<u8>)) {
        self.room_for(LONGEST_FRAME_BYTES);
        let before = self.out.len();
        encode(&mut self.encoder, &mut self.out);
        self.budget.spend(self.out.len() - before);
    }

    fn room_for(&mut self, bytes: usize) {
        if self.out.len() + bytes > DATAGRAM_BYTES {
            self.flush();
        }
    }

    fn flush(&mut self) {
        self.link.send(&self.out);
        self.out.clear();
    }

    /// So many frames reached the flight controller's wire.
    pub(super) fn note_forwarded(&mut self, frames: u64) {
        self.counts.forwarded_to_fc += frames;
    }

    /// A frame for the flight controller found no room.
    pub(super) fn note_dropped(&mut self) {
        self.counts.dropped += 1;
    }

    /// What has passed.
    pub fn figures(&self) -> GroundReport {
        let decoder = self.decoder.counters();
        GroundReport {
            sent: self.encoder.frames(),
            received: decoder.frames + decoder.unknown,
            crc_errors: decoder.crc_errors,
            dropped: self.counts.dropped + self.replies.dropped() + self.link.counters().dropped_queue_full,
            ..self.counts.clone()
        }
    }
}

/// What every ground station has to know.
fn banner(flight: &Flight) -> String {
    format!("SIMULATED: {} on a test bench, no vehicle flies", flight.scenario().name)
}

/// Sensors in which a fault acts.
fn faulty(flight: &Flight) -> Vec<Sensor> {
    let sensor = |component| match component {
        Component::Gyroscope => Some(Sensor::Gyroscope),
        Component::Accelerometer => Some(Sensor::Accelerometer),
        Component::Magnetometer => Some(Sensor::Magnetometer),
        Component::Barometer => Some(Sensor::Barometer),
        Component::Gnss => Some(Sensor::Gnss),
        Component::Altimeter => Some(Sensor::Altimeter),
        _ => None,
    };
    flight.faults().filter_map(|fault| sensor(fault.component)).collect()
}
