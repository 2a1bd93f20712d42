//! What happens in a flight, by name: the one list that the report, faults that wait for an event, texts to a
//! ground station, the campaign's columns and `docs/events.md` go by.
//!
//! Phases and abort reasons stand here since events carry them; what they mean to the mission is the
//! autopilot's.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Event {
    /// Run time (s).
    pub time_s: f64,
    /// What; its name goes into the report.
    #[serde(rename = "name")]
    pub kind: EventKind,
    /// Numbers and reasons.
    pub detail: String,
}

/// How grave an event is, in the words of syslog.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// Goes as planned.
    Info,
    /// Worth a look.
    Notice,
    /// Something is not as it should be.
    Warning,
    /// Something has failed.
    Error,
    /// The mission or its controller is given up.
    Critical,
}

impl Severity {
    /// Name in documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Info => "info",
            Self::Notice => "notice",
            Self::Warning => "warning",
            Self::Error => "error",
            Self::Critical => "critical",
        }
    }
}

/// A row of the table of events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Name; a part in capitals stands for names that follow from what happened.
    pub name: &'static str,
    /// How grave.
    pub severity: Severity,
    /// What has happened.
    pub meaning: &'static str,
}

const PHASE: Row = Row {
    name: "phase:NAME",
    severity: Severity::Info,
    meaning: "the built-in autopilot enters a phase of its mission",
};
const ABORT: Row = Row {
    name: "abort:REASON",
    severity: Severity::Critical,
    meaning: "the built-in autopilot gives the mission up",
};
const FAULT: Row = Row { name: "fault:NAME", severity: Severity::Warning, meaning: "a fault begins" };
const FAULT_OVER: Row = Row { name: "fault_over:NAME", severity: Severity::Notice, meaning: "a fault ends" };

/// Makes the list of events from its rows: the variant, its name, how grave it is, what has happened.
macro_rules! event_kinds {
    ($($variant:ident, $name:literal, $severity:ident, $meaning:literal;)*) => {
        /// What can happen.
        #[derive(Clone, Debug, PartialEq, Eq)]
        pub enum EventKind {
            $(#[doc = concat!("`", $name, "`: ", $meaning, ".")] $variant,)*
            /// `phase:NAME`: the built-in autopilot enters a phase of its mission.
            Phase(Phase),
            /// `abort:REASON`: the built-in autopilot gives the mission up.
            Abort(AbortReason),
            /// `fault:NAME`: a fault begins.
            Fault(String),
            /// `fault_over:NAME`: a fault ends.
            FaultOver(String),
        }

        impl EventKind {
            /// Those whose name is the same whatever happened.
            const PLAIN: &[Self] = &[$(Self::$variant),*];

            /// Its row in the table of events.
            pub const fn row(&self) -> Row {
                match self {
                    $(Self::$variant => Row {
                        name: $name,
                        severity: Severity::$severity,
                        meaning: $meaning,
                    },)*
                    Self::Phase(_) => PHASE,
                    Self::Abort(_) => ABORT,
                    Self::Fault(_) => FAULT,
                    Self::FaultOver(_) => FAULT_OVER,
                }
            }
        }
    };
}

event_kinds! {
    Armed, "armed", Info, "whoever flies arms the vehicle";
    Ignition, "ignition", Info, "the chamber lights";
    Liftoff, "liftoff", Info, "nothing touches the ground any more, for the first time";
    Touchdown, "touchdown", Info, "first contact after having been in the air";
    Shutdown, "shutdown", Info, "the flame is out";
    Disturbance, "disturbance", Info, "an entry of the scenario's `[[disturbance]]` begins or ends";
    Saturated, "saturated", Warning, "more thrust is asked for than the open valve gives; once for each excursion";
    BottleLow, "bottle_low", Warning, "the nitrogen bottle no longer feeds its regulator";
    TankHigh, "tank_high", Info, "the run tank is above what its regulator keeps";
    NitrousDepleted, "nitrous_depleted", Error, "no liquid nitrous oxide is left to flow";
    FuelBurnThrough, "fuel_burn_through", Error, "the grain is burnt through: what fuel is left limits the flame";
    Singular, "abort:singular", Critical, "the balance of momentum has no solution: the run ends";
    Interrupted, "abort:interrupted", Critical, "the user ends the run";
    FcFirst, "fc_first", Info, "first controls of the flight controller";
    FcSilent, "fc_silent", Info, "no controls that count, on the pad or after the flight";
    FcLost, "fc_lost", Critical, "the flight controller is lost in flight";
    Handover, "handover", Warning, "the built-in autopilot takes the controls";
    Handback, "handback", Notice, "the flight controller has the controls back";
    Stall, "stall", Info, "no answer in time in lockstep, for the first time; `link.stalls` counts them";
    Modified, "modified", Warning, "somebody changes the run from outside";
    Reset, "reset", Notice, "somebody asks for a new flight: this one ends";
    CutShort, "cut_short", Info, "the flight was not over when the reset ended it";
}

/// The table of events, a row for each name.
pub fn catalogue() -> impl Iterator<Item = Row> {
    EventKind::PLAIN.iter().map(EventKind::row).chain([PHASE, ABORT, FAULT, FAULT_OVER])
}

impl EventKind {
    /// Name on the wire, in the report and in a scenario.
    pub fn name(&self) -> Cow<'static, str> {
        match self {
            Self::Phase(phase) => format!("phase:{}", phase.name()).into(),
            Self::Abort(reason) => format!("abort:{}", reason.name()).into(),
            Self::Fault(name) => format!("fault:{name}").into(),
            Self::FaultOver(name) => format!("fault_over:{name}").into(),
            plain => plain.row().name.into(),
        }
    }

    /// How grave it is.
    pub const fn severity(&self) -> Severity {
        self.row().severity
    }

    /// The mission was given up, whoever or whatever decided it.
    pub const fn is_abort(&self) -> bool {
        matches!(self, Self::Abort(_) | Self::Singular | Self::Interrupted)
    }
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.name())
    }
}

/// A name that no event has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownEvent(String);

impl fmt::Display for UnknownEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} never happens; allowed ", self.0)?;
        let phases = Phase::ALL.into_iter().map(EventKind::Phase);
        let aborts = AbortReason::ALL.into_iter().map(EventKind::Abort);
        for kind in EventKind::PLAIN.iter().cloned().chain(phases).chain(aborts) {
            write!(f, "{kind}, ")?;
        }
        write!(f, "{} and {} of another entry", FAULT.name, FAULT_OVER.name)
    }
}

impl FromStr for EventKind {
    type Err = UnknownEvent;

    fn from_str(text: &str) -> Result<Self, UnknownEvent> {
        let plain = Self::PLAIN.iter().find(|kind| kind.row().name == text).cloned();
        let with_data = || match text.split_once(':')? {
            ("phase", name) => Phase::ALL.into_iter().find(|phase| phase.name() == name).map(Self::Phase),
            ("abort", name) => {
                AbortReason::ALL.into_iter().find(|reason| reason.name() == name).map(Self::Abort)
            }
            ("fault", name) => Some(Self::Fault(name.to_owned())),
            ("fault_over", name) => Some(Self::FaultOver(name.to_owned())),
            _ => None,
        };
        plain.or_else(with_data).ok_or_else(|| UnknownEvent(text.to_owned()))
    }
}

impl Serialize for EventKind {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for EventKind {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// One phase of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// At rest on the pad: attitude, biases and the local origin are being estimated.
    Align,
    /// Aligned and armed; the isolation valve opens.
    Ready,
    /// Throttle at idle until the chamber burns.
    Ignition,
    /// Thrust rises, lift-off, climb to the hover height.
    Ascent,
    /// Hover, and the horizontal transfer to the landing point.
    Hover,
    /// Descent from the hover to the terminal height.
    Descent,
    /// Last metres at constant speed, to contact.
    Terminal,
    /// Contact detected, engine commanded off.
    Touchdown,
    /// On the ground, engine off, still armed.
    Shutdown,
    /// Disarmed.
    Done,
    /// Mission given up: descent from where the vehicle is, to the terminal height.
    AbortLand,
    /// Vehicle given up: engine off.
    AbortCut,
}

impl Phase {
    /// All of them, in the order of a flight; the aborts last.
    pub const ALL: [Self; 12] = [
        Self::Align,
        Self::Ready,
        Self::Ignition,
        Self::Ascent,
        Self::Hover,
        Self::Descent,
        Self::Terminal,
        Self::Touchdown,
        Self::Shutdown,
        Self::Done,
        Self::AbortLand,
        Self::AbortCut,
    ];

    /// Name in events: `phase:NAME`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Align => "align",
            Self::Ready => "ready",
            Self::Ignition => "ignition",
            Self::Ascent => "ascent",
            Self::Hover => "hover",
            Self::Descent => "descent",
            Self::Terminal => "terminal",
            Self::Touchdown => "touchdown",
            Self::Shutdown => "shutdown",
            Self::Done => "done",
            Self::AbortLand => "abort_land",
            Self::AbortCut => "abort_cut",
        }
    }
}

/// Why a mission ends early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AbortReason {
    /// The propellant lasts no longer than the way down and the reserve.
    Propellant,
    /// Tilt beyond what control commands.
    Tilt,
    /// Neither satellite fixes nor altimeter.
    Navigation,
    /// Lateral acceleration by the wind above its limit.
    Wind,
    /// Guidance has no plan left that keeps its limits.
    Guidance,
    /// The vehicle is too far from its reference.
    OffReference,
    /// Tilt beyond recovery.
    Toppling,
    /// The vehicle leaves the volume cleared for the flight.
    FlightVolume,
    /// Full thrust would not stop the fall before the ground.
    CannotStop,
    /// Thrust far above the command while climbing.
    Runaway,
    /// No inertial samples.
    Inertial,
}

impl AbortReason {
    /// All of them, cuts first: of two triggers in one step the graver decides.
    pub const ALL: [Self; 11] = [
        Self::Toppling,
        Self::FlightVolume,
        Self::CannotStop,
        Self::Runaway,
        Self::Inertial,
        Self::Guidance,
        Self::Tilt,
        Self::OffReference,
        Self::Navigation,
        Self::Wind,
        Self::Propellant,
    ];

    /// Name in events: `abort:REASON`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Propellant => "propellant",
            Self::Tilt => "tilt",
            Self::Navigation => "navigation",
            Self::Wind => "wind",
            Self::Guidance => "guidance",
            Self::OffReference => "off_reference",
            Self::Toppling => "toppling",
            Self::FlightVolume => "flight_volume",
            Self::CannotStop => "cannot_stop",
            Self::Runaway => "runaway",
            Self::Inertial => "inertial",
        }
    }
}
