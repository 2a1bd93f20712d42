//! Services: answers every inquiry of a flight controller or a ground station, and truthfully.
//!
//! A request or a parameter is carried out by [`super::carry_out`], and what became of it is queued as
//! replies, which leave after the samples of an instant, as far as the wire has room.

use std::collections::VecDeque;

use hopbench::event::Severity;
use hopbench::fault::Component;
use hopbench::simulation::Flight;

use crate::bench::carry_out::{carry_out, rate_not_in_hand, set_parameter, value_in_force};
use crate::bench::ground::Ground;
use crate::bench::parameter::{Parameter, as_typed, parameters};
use crate::bench::run::Run;
use crate::wire::fc_link::FcLink;
use crate::wire::profile::{Profile, SensorRates};
use crate::wire::reply::{ByteBudget, ParameterValue, ReplyQueue};
use crate::wire::request::{Answer, Inquiry, ParameterKey, Rejection, Request, denied};
use crate::wire::stream::{Refusal, TEXTS};

/// Frames of a ground station that wait for room on the flight controller's wire.
const QUEUE: usize = 64;

/// Where an inquiry comes from, and its answer goes.
pub(super) enum Port<'p, 'a> {
    Fc(&'p mut FcLink<'a>),
    Ground(&'p mut Ground),
}

/// What is open between the bench and those who ask.
pub(super) struct Services {
    parameters: Vec<Parameter>,
    /// To the flight controller; a ground station has its own.
    replies: ReplyQueue,
    budget: ByteBudget,
    /// What the profile's streams leave of the line (byte/s).
    spare_bytes_s: f64,
    tells_events: bool,
    /// Events told so far.
    told: usize,
    /// Frames of a ground station on their way to the flight controller.
    to_fc: VecDeque<Vec<u8>>,
}

impl Services {
    pub(super) fn new(profile: &Profile, rates: &SensorRates, baud: Option<u32>) -> Self {
        let spare_bytes_s = baud.map(|baud| profile.spare_bytes_s(rates, baud));
        Self {
            parameters: parameters(),
            replies: ReplyQueue::default(),
            budget: spare_bytes_s.map_or_else(ByteBudget::socket, ByteBudget::new),
            spare_bytes_s: spare_bytes_s.unwrap_or(f64::INFINITY),
            tells_events: false,
            told: 0,
            to_fc: VecDeque::new(),
        }
    }

    /// Another flight begins, with events of its own.
    pub(super) fn begin_again(&mut self) {
        self.told = 0;
    }

    /// Answers one inquiry.
    pub(super) fn answer(&mut self, inquiry: Inquiry, run: &mut Run, mut port: Port) {
        match inquiry {
            Inquiry::Command { request, receipt } => {
                let answer = request.and_then(|request| self.perform(request, run, &mut port));
                let Some(receipt) = receipt else { return };
                if let Err(Rejection::Denied(why) | Rejection::Unsupported(why)) = &answer {
                    self.warn(&mut port, why);
                }
                self.replies(&mut port).acknowledge(&receipt, &answer);
            }
            Inquiry::ParameterList => self.replies(&mut port).list_parameters(),
            Inquiry::ParameterRead(key) => {
                if let Some(place) = self.place(&key, &mut port) {
                    self.tell_parameter(place, run, &mut port);
                }
            }
            Inquiry::ParameterSet(name, value) => {
                let Some(place) = self.place(&ParameterKey::Name(name), &mut port) else { return };
                let answer = set_parameter(run, &self.parameters[usize::from(place)], as_typed(value));
                self.tell_parameter(place, run, &mut port);
                if let Err(Rejection::Denied(why) | Rejection::Unsupported(why)) = &answer {
                    self.warn(&mut port, why);
                }
            }
        }
    }

    fn perform(&mut self, request: Request, run: &mut Run, port: &mut Port) -> Answer {
        // Whether a fault of a component can be seen on the wire.
        let tracked = run.options.profile.odometry_hz.is_some();
        match request {
            Request::Interval { message, interval_us } => self.set_interval(message, interval_us, run, port),
            Request::Break(faults)
                if !tracked && faults.iter().any(|fault| fault.component == Component::Tracking) =>
            {
                denied("this profile sends nothing of that sensor")
            }
            request => carry_out(run, request),
        }
    }

    fn set_interval(&mut self, message: u32, interval_us: Option<u64>, run: &Run, port: &mut Port) -> Answer {
        let set = match port {
            Port::Ground(ground) => ground.set_interval(message, interval_us),
            Port::Fc(_) if message == TEXTS && run.options.profile.answers => {
                self.tells_events = interval_us.is_some();
                self.told = run.flight.events().len();
                Ok(())
            }
            Port::Fc(wire) => {
                let (streams, now) = (&mut wire.streams, run.wire_time());
                let set = streams.set_interval(message, interval_us, now, self.spare_bytes_s);
                let left_bytes_s = (self.spare_bytes_s - streams.asked_bytes_s()).max(0.0);
                if set.is_ok() && left_bytes_s.is_finite() {
                    self.budget.set_rate(left_bytes_s);
                }
                set
            }
        };
        match set {
            Ok(()) => Ok(()),
            Err(Refusal::NotAdjustable) => rate_not_in_hand(message),
            Err(Refusal::NoRoom { taken_bytes_s, left_bytes_s }) => {
                denied(format!("{taken_bytes_s:.0} byte/s would be taken, the line has {left_bytes_s:.0}"))
            }
        }
    }

    /// Place of a parameter in the list; says so where there is none.
    fn place(&mut self, key: &ParameterKey, port: &mut Port) -> Option<u16> {
        let count = self.parameters.len();
        let (place, missing) = match key {
            ParameterKey::Index(index) => {
                ((usize::from(*index) < count).then_some(*index), format!("{index}; there are {count}"))
            }
            ParameterKey::Name(name) => {
                let place = self.parameters.iter().position(|parameter| parameter.name == *name);
                (place.and_then(|place| u16::try_from(place).ok()), name.clone())
            }
        };
        if place.is_none() {
            self.warn(port, &format!("no parameter {missing}"));
        }
        place
    }

    fn tell_parameter(&mut self, place: u16, run: &Run, port: &mut Port) {
        let Some(value) = entry(&self.parameters, run, place) else { return };
        match port {
            Port::Fc(_) => self.replies.tell_parameter(&value),
            Port::Ground(ground) => ground.replies.tell_parameter(&value),
        }
    }

    fn warn(&mut self, port: &mut Port, text: &str) {
        match port {
            Port::Fc(_) => self.replies.tell(Severity::Warning, text),
            Port::Ground(ground) => ground.replies.tell(Severity::Warning, &simulated(text)),
        }
    }

    fn replies<'r>(&'r mut self, port: &'r mut Port) -> &'r mut ReplyQueue {
        match port {
            Port::Fc(_) => &mut self.replies,
            Port::Ground(ground) => &mut ground.replies,
        }
    }

    /// What has happened since, as text.
    pub(super) fn tell_events(&mut self, flight: &Flight, ground: Option<&mut Ground>) {
        let events = &flight.events()[self.told.min(flight.events().len())..];
        let mut listener = ground.filter(|ground| ground.has_listener());
        for event in events {
            let text = format!("{:.3} s {} {}", event.time_s, event.kind, event.detail);
            let severity = event.kind.severity();
            if let Some(ground) = &mut listener {
                ground.replies.tell(severity, &simulated(text.trim_end()));
            }
            if self.tells_events {
                self.replies.tell(severity, text.trim_end());
            }
        }
        self.told = flight.events().len();
    }

    /// A frame of the ground station for the flight controller; whether there is room for it.
    #[must_use]
    pub(super) fn forward(&mut self, raw: Vec<u8>) -> bool {
        let has_room = self.to_fc.len() < QUEUE;
        if has_room {
            self.to_fc.push_back(raw);
        }
        has_room
    }

    /// Puts out what waits for the flight controller, as far as its wire has room; frames of the ground
    /// station among it.
    pub(super) fn put_out(&mut self, now_ns: u64, run: &Run, wire: &mut FcLink) -> u64 {
        let (parameters, mut forwarded) = (&self.parameters, 0);
        while self.budget.is_open(now_ns)
            && let Some(reply) = self.replies.next(|index| entry(parameters, run, index))
        {
            let bytes = wire.streams.put_reply(&reply);
            self.budget.spend(bytes);
        }
        while self.budget.is_open(now_ns)
            && let Some(raw) = self.to_fc.pop_front()
        {
            wire.streams.put_raw(&raw);
            self.budget.spend(raw.len());
            forwarded += 1;
        }
        forwarded
    }

    /// A parameter with its value in force, `None` behind the last.
    pub(super) fn parameter(&self, run: &Run, index: u16) -> Option<ParameterValue<'_>> {
        entry(&self.parameters, run, index)
    }
}

fn entry<'p>(parameters: &'p [Parameter], run: &Run, index: u16) -> Option<ParameterValue<'p>> {
    let parameter = parameters.get(usize::from(index))?;
    let count = u16::try_from(parameters.len()).unwrap_or(u16::MAX);
    let value = value_in_force(run, &parameter.what);
    Some(ParameterValue { name: &parameter.name, value, index, count })
}

/// No text to a ground station may be taken for that of a real vehicle.
fn simulated(text: &str) -> String {
    format!("SIMULATED {text}")
}
