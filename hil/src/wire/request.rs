//! What a flight controller and a ground station ask, MAVLink turned into words of no protocol;
//! `bench/carry_out.rs` carries it out.
//!
//! Controls and status become such words here too, and what is sent in answer becomes MAVLink in
//! [`super::reply`] and [`super::stream`]; whoever steps the plant knows of no message. One number of MAVLink
//! passes: that of a message whose rate is asked, since a refusal names it.
//!
//! | command | request |
//! |---|---|
//! | MAV_CMD_DO_PAUSE_CONTINUE 0, 1 | pause, resume |
//! | MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN 1, to the bench itself | a new flight |
//! | MAV_CMD_NAV_GUIDED_ENABLE 1 | controls back to the flight controller |
//! | MAV_CMD_INJECT_FAILURE | a fault, or its end |
//! | MAV_CMD_SET_MESSAGE_INTERVAL | how often a message comes |

use hopbench::controls::CHANNEL_COUNT;
use hopbench::fault::{Component, Fault, Mode};

use crate::wire::failure::{Failure, failure};
use crate::wire::mavlink::{
    Command, FromFc, GUIDED_ENABLE, INJECT_FAILURE, PAUSE_CONTINUE, REBOOT, SET_MESSAGE_INTERVAL,
};

pub(crate) use crate::wire::mavlink::ParameterKey;

/// No message comes oftener when it is asked for (us): a sample is 4 ms at the usual 250 Hz.
const LEAST_INTERVAL_US: u64 = 4_000;

/// Controls of a flight controller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ControlsInput {
    /// In lockstep the time of the sample that they answer (us); 0: any.
    pub(crate) time_us: u64,
    /// The sender's counter.
    pub(crate) sequence: u8,
    /// Whether they are to be obeyed.
    pub(crate) armed: bool,
    /// Output channels.
    pub(crate) channels: [f64; CHANNEL_COUNT],
}

/// What a flight controller says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Status {
    /// Its outputs end in the simulation.
    pub(crate) in_the_loop: bool,
    /// It is a PX4.
    pub(crate) is_px4: bool,
}

/// What the bench can be told to do.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Request {
    /// A new flight.
    Reset,
    /// Simulated time stands.
    Pause,
    /// Simulated time runs on.
    Resume,
    /// The controls go back to the flight controller.
    GiveBack,
    /// These faults begin.
    Break(Vec<Fault>),
    /// What acts in these components ends; all modes, or one.
    Mend(Vec<Component>, Option<Mode>),
    /// How often a message comes.
    Interval {
        /// Its number, one of [`crate::wire::mavlink::id`] or one that nobody sends.
        message: u32,
        /// `None` never, 0 its default (us).
        interval_us: Option<u64>,
    },
}

/// Why a request is not carried out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Rejection {
    /// It could be, but not now or not so.
    Denied(String),
    /// The bench has nothing of that kind.
    Unsupported(String),
}

/// What became of a request.
pub(crate) type Answer = Result<(), Rejection>;

/// A command that wants to be acknowledged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Receipt(pub(super) Command);

/// What is asked of the bench.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Inquiry {
    /// To do something.
    Command {
        /// What, if it is anything that the bench knows.
        request: Result<Request, Rejection>,
        /// `None`: nobody waits for an answer.
        receipt: Option<Receipt>,
    },
    /// For all parameters.
    ParameterList,
    /// For one parameter.
    ParameterRead(ParameterKey),
    /// To set a parameter.
    ParameterSet(String, f32),
}

/// Not now or not so.
pub(crate) fn denied<T>(why: impl Into<String>) -> Result<T, Rejection> {
    Err(Rejection::Denied(why.into()))
}

/// Not at all.
pub(crate) fn unsupported<T>(why: impl Into<String>) -> Result<T, Rejection> {
    Err(Rejection::Unsupported(why.into()))
}

/// What a message asks, if it asks anything.
pub(crate) fn inquiry(message: FromFc) -> Option<Inquiry> {
    match message {
        FromFc::Command(command) => {
            Some(Inquiry::Command { request: request(&command), receipt: Some(Receipt(command)) })
        }
        FromFc::ParameterList(_) => Some(Inquiry::ParameterList),
        FromFc::ParameterRead(_, key) => Some(Inquiry::ParameterRead(key)),
        FromFc::ParameterSet(_, name, value) => Some(Inquiry::ParameterSet(name, value)),
        FromFc::Controls(_) | FromFc::Heartbeat(_) | FromFc::Other(_) => None,
    }
}

fn request(command: &Command) -> Result<Request, Rejection> {
    let [first, second, third, ..] = command.parameters;
    let to_itself = command.to.system != 0 && command.to.component != 0;
    match command.command {
        SET_MESSAGE_INTERVAL => interval(first, second),
        PAUSE_CONTINUE if first == 0.0 => Ok(Request::Pause),
        PAUSE_CONTINUE if first == 1.0 => Ok(Request::Resume),
        PAUSE_CONTINUE => denied("pause is 0, continue 1"),
        REBOOT if first == 1.0 && to_itself => Ok(Request::Reset),
        REBOOT => unsupported("the bench resets at 1, addressed to itself"),
        GUIDED_ENABLE if first == 1.0 => Ok(Request::GiveBack),
        GUIDED_ENABLE => unsupported("the bench takes over when the FC is lost"),
        INJECT_FAILURE => match failure(first, second, third) {
            Failure::Break(broken) => Ok(Request::Break(
                broken.into_iter().map(|(component, mode)| Fault::new(component, mode)).collect(),
            )),
            Failure::Mend(components) => Ok(Request::Mend(components, None)),
            Failure::NoSuchInstance(count) => denied(format!("instances are 1 to {count}, 0 all")),
            Failure::Unsupported => unsupported("no such failure in the catalogue"),
        },
        other => unsupported(format!("command {other} is none of the bench's")),
    }
}

fn interval(message: f32, interval_us: f32) -> Result<Request, Rejection> {
    // `as` saturates and turns NaN into 0.
    let interval_us = if interval_us < 0.0 { None } else { Some(interval_us as u64) };
    if (1..LEAST_INTERVAL_US).contains(&interval_us.unwrap_or(0)) {
        return denied(format!("the least interval is {LEAST_INTERVAL_US} us"));
    }
    let number = message as u32;
    if number as f32 != message {
        return unsupported(format!("the rate of message {message} is not in the bench's hand"));
    }
    Ok(Request::Interval { message: number, interval_us })
}
