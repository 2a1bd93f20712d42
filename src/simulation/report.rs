//! What a run leaves behind: the object that `--json` prints.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::event::{Event, EventKind};
use crate::scenario::{Expect, Fidelity, Outcome};

/// One run, as reported. Keys are a contract.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Name of the scenario.
    pub scenario: String,
    /// Seed in force.
    pub seed: u32,
    /// How it ended.
    pub outcome: Outcome,
    /// Who flew, in order.
    pub flown_by: Vec<FlownBy>,
    /// Changes of who flies while the bench flew; absent when there was none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub handovers: Vec<Handover>,
    /// What was expected, and what came.
    pub expect: Verdict,
    /// First pad contact after lift-off.
    pub touchdown: Option<Touchdown>,
    /// Highest the pivot rose above its rest height (m).
    pub max_altitude_m: f64,
    /// The hover phase of the mission.
    pub hover: Option<Hover>,
    /// What the built-in autopilot's ladders did, where it flew in this process.
    pub autopilot: Option<Ladders>,
    /// Fluids and fuel.
    pub propellant: Propellant,
    /// Mass book-keeping.
    pub mass: MassBalance,
    /// Simulated and wall time.
    pub timing: Timing,
    /// The link, in `hil`.
    pub link: Option<LinkReport>,
    /// What happened.
    pub events: Vec<Event>,
    /// Hash over the states of the run: equal bits, equal hash.
    pub state_hash: String,
    /// Folder of the run, if one was written.
    pub run: Option<String>,
    /// Values that replaced those of the files, `KEY=VALUE`; absent when there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub overrides: Vec<String>,
    /// What was changed from outside while it flew, in order; such a run is not its scenario's. The first
    /// hundred changes, and then how many more there were.
    pub modified: Vec<String>,
    /// How many changes that were.
    pub modified_count: usize,
    /// Names of the scenario's faults that never began; absent when all did.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub faults_idle: Vec<String>,
    /// Reports of the flights before this one in the same process, each ended by a reset; absent when there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub flights: Vec<Report>,
    /// The ground station's link, where there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<GroundReport>,
}

/// What passed on the ground station's link.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GroundReport {
    /// Frames of the bench itself.
    pub sent: u64,
    /// Whole frames that came.
    pub received: u64,
    /// Frames whose checksum did not hold.
    pub crc_errors: u64,
    /// Frames of the flight controller that were passed on.
    pub forwarded_from_fc: u64,
    /// Frames that were passed on to the flight controller.
    pub forwarded_to_fc: u64,
    /// Frames, or writes, that found no room.
    pub dropped: u64,
}

/// How often each rung of the built-in autopilot's ladders was stood on; rungs never stood on are left out.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ladders {
    /// Predictive control, fifty times a second: `solved`, `capped`, `oracle`, `shifted`, `feedback`, `cascade`.
    pub control: BTreeMap<String, u64>,
    /// Plans adopted: `optimal`, `previous`, `wide_glide_slope`, `landing_error`, `quintic`, `ramp`, `hold`.
    pub guidance: BTreeMap<String, u64>,
    /// Plans that did not come in time.
    pub plans_late: u64,
}

/// Who commands the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// A flight controller on the link.
    Fc,
    /// The built-in autopilot.
    Autopilot,
    /// An open-loop schedule.
    Commands,
}

/// A span of the run in one hand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FlownBy {
    /// Whose.
    pub source: Source,
    /// From this run time (s).
    pub from_s: f64,
    /// To this run time (s).
    pub to_s: f64,
}

/// A change of who flies, and what it did to the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Handover {
    /// Who took over; null: the engine was cut.
    pub to: Option<Source>,
    /// Run time (s).
    pub time_s: f64,
    /// Simulated time from the flight controller's last good controls to the first command of who took over (ms).
    pub silence_ms: f64,
    /// The same by the wall clock (ms).
    pub silence_wall_ms: f64,
    /// First thrust commanded less the last of who flew before (N).
    pub thrust_step_n: f64,
    /// Angle between their gimbal commands (deg).
    pub gimbal_step_deg: f64,
    /// Motion in the two seconds before.
    pub before: Unrest,
    /// Motion in the two seconds after.
    pub after: Unrest,
    /// Greatest change of the velocity in the two seconds after (m/s).
    pub speed_change_m_s: f64,
}

/// Greatest tilt and body rate of a span.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Unrest {
    /// Tilt of the long axis (deg).
    pub tilt_deg: f64,
    /// Body rate (deg/s).
    pub rate_deg_s: f64,
}

impl Unrest {
    /// Widens the span.
    pub fn take(&mut self, other: &Self) {
        self.tilt_deg = self.tilt_deg.max(other.tilt_deg);
        self.rate_deg_s = self.rate_deg_s.max(other.rate_deg_s);
    }
}

/// Expectations against results.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Verdict {
    /// Every item passed.
    pub passed: bool,
    /// One entry per expectation.
    pub items: Vec<Item>,
}

/// One expectation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Item {
    /// Key in `[expect]`.
    pub name: String,
    /// What came; null when it did not happen.
    pub value: serde_json::Value,
    /// What was allowed.
    pub limit: serde_json::Value,
    /// Whether it is within.
    pub passed: bool,
}

/// First pad contact after lift-off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Touchdown {
    /// Run time (s).
    pub time_s: f64,
    /// Downward speed of the centre of mass (m/s).
    pub vertical_speed_m_s: f64,
    /// Horizontal speed of the centre of mass (m/s).
    pub lateral_speed_m_s: f64,
    /// Tilt of the long axis (deg).
    pub tilt_deg: f64,
    /// Horizontal distance of the true pivot from the target (m).
    pub position_error_m: f64,
    /// Horizontal distance of the flying autopilot's estimate from the target (m).
    pub control_error_m: Option<f64>,
    /// Horizontal distance of that estimate from the truth (m).
    pub navigation_error_m: Option<f64>,
}

/// The hover phase.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Hover {
    /// Length (s).
    pub duration_s: f64,
    /// Root mean square of true height against the reference (m).
    pub altitude_rms_m: f64,
    /// Root mean square of true horizontal distance from the reference (m).
    pub lateral_rms_m: f64,
    /// Root mean square of the flying autopilot's estimate of height against its reference (m); null when who flew sits at the other end of a link.
    pub altitude_control_rms_m: Option<f64>,
    /// Root mean square of that estimate's horizontal distance from the reference (m); null when who flew sits at the other end of a link.
    pub lateral_control_rms_m: Option<f64>,
}

/// Fluids and fuel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Propellant {
    /// Nitrous oxide that left the tank for good, liquid and vapour (kg).
    pub nitrous_used_kg: f64,
    /// Liquid nitrous oxide left (kg).
    pub nitrous_left_kg: f64,
    /// Nitrous oxide vapour in the run tank, neither used nor left as propellant (kg).
    pub nitrous_vapor_kg: f64,
    /// Fuel used (kg).
    pub fuel_used_kg: f64,
    /// Fuel left (kg).
    pub fuel_left_kg: f64,
    /// Nitrogen through the thrusters (kg).
    pub nitrogen_rcs_kg: f64,
    /// Nitrogen through the vent (kg).
    pub nitrogen_vented_kg: f64,
    /// Nitrogen through the engine, once an outlet that uncovers draws gas (kg).
    pub nitrogen_nozzle_kg: f64,
}

/// Mass book-keeping.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MassBalance {
    /// At step 0 (kg).
    pub initial_kg: f64,
    /// At the end (kg).
    pub final_kg: f64,
    /// Initial less final less everything that left through nozzle, thrusters and vent (kg).
    pub closure_error_kg: f64,
}

/// Simulated and wall time.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Timing {
    /// Which physics the plant ran.
    pub plant_mode: Fidelity,
    /// Plant steps a second of simulated time (Hz).
    pub plant_hz: f64,
    /// Samples a second to the flight controller (Hz); null without a link.
    pub sensor_hz: Option<f64>,
    /// `realtime`, `lockstep` or `fast`; null without a link.
    pub pacing: Option<String>,
    /// Simulated time (s).
    pub simulated_s: f64,
    /// Wall time (s).
    pub wall_s: f64,
    /// Simulated over wall.
    pub realtime_factor: f64,
    /// Plant steps.
    pub steps: u64,
    /// Steps that began more than a step late.
    pub overruns: u64,
    /// Of these: made up for by steps without a pause.
    pub overruns_caught_up: u64,
    /// Of these: ended by letting time slip.
    pub overruns_slipped: u64,
    /// Of these: not made up for when the run ended.
    pub overruns_open: u64,
    /// The worst rows of late steps, worst first, at most 16.
    pub worst_overruns: Vec<Overrun>,
    /// Times that simulated time was let fall behind the clock for good.
    pub slips: u64,
    /// By how much altogether (s).
    pub slipped_s: f64,
    /// Wall time less simulated time, slips and lateness at the end (us): 0, or the bench has lost count. Null where nothing follows the clock.
    pub unaccounted_us: Option<f64>,
    /// Wall time that a step may cost in real time (us).
    pub step_budget_us: f64,
    /// Cost of a step of the plant (us).
    pub step_us: Option<Percentiles>,
    /// Cost of everything from one wake-up to the next sleep: receive, step, encode, send, shadow (us).
    pub cycle_us: Option<Percentiles>,
    /// Wake-up after the deadline (us).
    pub lateness_us: Option<Percentiles>,
    /// Sensor frame out to the actuator frame that answers it by its time stamp (us).
    pub round_trip_us: Option<Percentiles>,
    /// Sensor frame out to the actuator frame that answers it on the echo channel (us).
    pub echo_us: Option<Percentiles>,
    /// Wake-up of a thread beside the run that does nothing but sleep (us).
    pub reference_sleep_us: Option<Percentiles>,
    /// Echo of a datagram by a thread beside the run that does nothing else (us).
    pub reference_echo_us: Option<Percentiles>,
    /// What the kernel granted the stepping thread; null where nothing was asked.
    pub scheduler: Option<Scheduler>,
}

/// A row of steps that began late.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Overrun {
    /// Run time of the first (s).
    pub time_s: f64,
    /// How many; 0: late at a stage that counts no steps, as when an answer is waited for.
    pub steps: u64,
    /// The latest (ms).
    pub late_ms: f64,
    /// By how much time slipped at its end; null when it was caught up (ms).
    pub slipped_ms: Option<f64>,
}

/// What the kernel granted the thread that steps the plant.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Scheduler {
    /// The real-time class SCHED_FIFO.
    pub fifo: bool,
    /// Its priority there.
    pub priority: Option<u8>,
    /// Memory is never paged out.
    pub locked: bool,
    /// The one CPU it runs on.
    pub pinned_cpu: Option<usize>,
    /// What was not granted, why, and what would allow it.
    pub notes: Vec<String>,
}

/// Median and tail of a distribution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99 %.
    pub p99: f64,
    /// 99.9 %.
    pub p999: f64,
    /// Greatest.
    pub max: f64,
}

/// The link's counters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LinkReport {
    /// Frames that the system took.
    pub sent: u64,
    /// Frames thrown away, since nobody was there or the line was too slow.
    pub dropped: u64,
    /// Frames received whole.
    pub received: u64,
    /// Frames with a wrong checksum.
    pub crc_errors: u64,
    /// Frames missing by their sequence numbers.
    pub lost: u64,
    /// Frames that came twice by their sequence numbers.
    pub duplicates: u64,
    /// Frames that came after a later one.
    pub out_of_order: u64,
    /// Bytes received that belonged to no frame.
    pub skipped_bytes: u64,
    /// Datagrams or connections of somebody else, turned away.
    pub refused: u64,
    /// HIL_ACTUATOR_CONTROLS that held no number where a channel is read.
    pub controls_refused: u64,
    /// HIL_ACTUATOR_CONTROLS that came again, too late or out of the flight before.
    pub controls_old: u64,
    /// Waits for a reply that ran into their limit.
    pub stalls: u64,
    /// More about them; absent when there were none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stalled: Option<Stalled>,
    /// What faults of the wire did; absent when there were none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub disrupted: Option<Disrupted>,
    /// Silences between two HIL_ACTUATOR_CONTROLS of more than a tenth of `fc_timeout_ms`.
    pub gaps: u64,
    /// Longest silence between two HIL_ACTUATOR_CONTROLS, or from the last to the end (ms); null before there were two.
    pub longest_gap_ms: Option<f64>,
    /// Bytes that the system took.
    pub sent_bytes: u64,
    /// Bytes that came.
    pub received_bytes: u64,
    /// Frames a second, outward (Hz).
    pub rate_out_hz: f64,
    /// Frames a second, inward (Hz).
    pub rate_in_hz: f64,
    /// Share of the wire used outward; null where the wire has no rate (%).
    pub wire_load_percent: Option<f64>,
    /// Share of the wire used inward; null where the wire has no rate (%).
    pub wire_load_in_percent: Option<f64>,
}

/// Waits in lockstep that ran into their limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Stalled {
    /// Run time of the first (s).
    pub first_s: f64,
    /// Run time of the last (s).
    pub last_s: f64,
    /// Wall time of the longest (ms).
    pub longest_ms: f64,
    /// Wall time of all (ms).
    pub total_ms: f64,
    /// Whose sample or answer a fault of the wire has lost.
    pub lost_by_fault: u64,
    /// Whose answer came after all, too late.
    pub answered_late: u64,
}

/// What faults of the wire did to frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Disrupted {
    /// From the bench to the flight controller.
    pub to_fc: DisruptedWay,
    /// From the flight controller to the bench.
    pub from_fc: DisruptedWay,
}

/// What faults of the wire did to the frames of one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DisruptedWay {
    /// Lost.
    pub dropped: u64,
    /// Late.
    pub delayed: u64,
    /// Arrived twice.
    pub duplicated: u64,
    /// With a bit flipped.
    pub corrupted: u64,
}

impl Report {
    /// Whether somebody cut it short while nothing had gone wrong: then its verdict says nothing.
    pub fn is_excused(&self) -> bool {
        let has = |is: fn(&EventKind) -> bool| self.events.iter().any(|event| is(&event.kind));
        has(|kind| *kind == EventKind::CutShort) && !has(EventKind::is_abort)
    }

    /// Judges the report by `[expect]`. `fc_must_fly`: an outside flight controller was attached and
    /// no fallback is expected, so anybody else's flight fails.
    pub fn judge(&mut self, expect: &Expect, flight_time_s: Option<f64>, fc_must_fly: bool) {
        let mut items = Vec::new();
        let mut at_most = |name: &str, value: Option<f64>, limit: Option<f64>| {
            if let Some(limit) = limit {
                items.push(Item {
                    name: name.to_owned(),
                    value: value.into(),
                    limit: limit.into(),
                    passed: value.is_some_and(|value| value <= limit),
                });
            }
        };
        let touchdown = self.touchdown;
        let of = |f: fn(Touchdown) -> f64| touchdown.map(f);
        at_most(
            "touchdown_vertical_speed_max_m_s",
            of(|t| t.vertical_speed_m_s),
            expect.touchdown_vertical_speed_max_m_s,
        );
        at_most(
            "touchdown_lateral_speed_max_m_s",
            of(|t| t.lateral_speed_m_s),
            expect.touchdown_lateral_speed_max_m_s,
        );
        at_most("touchdown_tilt_max_deg", of(|t| t.tilt_deg), expect.touchdown_tilt_max_deg);
        // Where an outside controller flew there is no estimate to judge.
        let outside = self.flown_by.iter().any(|span| span.source == Source::Fc)
            && touchdown.is_some_and(|t| t.control_error_m.is_none());
        if !outside {
            at_most(
                "control_error_max_m",
                touchdown.and_then(|t| t.control_error_m),
                expect.control_error_max_m,
            );
        }
        at_most("position_error_max_m", of(|t| t.position_error_m), expect.position_error_max_m);
        at_most("flight_time_max_s", flight_time_s, expect.flight_time_max_s);
        at_most(
            "mass_closure_max",
            Some(self.mass.closure_error_kg.abs() / self.mass.initial_kg),
            expect.mass_closure_max,
        );
        let mut at_least = |name: &str, value: f64, limit: Option<f64>| {
            if let Some(limit) = limit {
                items.push(Item {
                    name: name.to_owned(),
                    value: value.into(),
                    limit: limit.into(),
                    passed: value >= limit,
                });
            }
        };
        let p = self.propellant;
        let share = |left: f64, used: f64| if left + used > 0.0 { left / (left + used) } else { 0.0 };
        at_least(
            "fuel_left_min_fraction",
            share(p.fuel_left_kg, p.fuel_used_kg),
            expect.fuel_left_min_fraction,
        );
        at_least(
            "nitrous_left_min_fraction",
            share(p.nitrous_left_kg, p.nitrous_used_kg),
            expect.nitrous_left_min_fraction,
        );
        at_least("max_altitude_min_m", self.max_altitude_m, expect.max_altitude_min_m);
        if let Some(outcome) = expect.outcome {
            items.insert(
                0,
                Item {
                    name: "outcome".to_owned(),
                    value: serde_json::json!(self.outcome),
                    limit: serde_json::json!(outcome),
                    passed: self.outcome == outcome,
                },
            );
        }
        if fc_must_fly {
            // Who is cut off after a loss has not flown to the end either, though nobody else took over.
            let lost = self.events.iter().any(|event| event.kind == EventKind::FcLost);
            let alone = !self.flown_by.is_empty() && self.flown_by.iter().all(|f| f.source == Source::Fc);
            let mut who: Vec<_> = self.flown_by.iter().map(|f| serde_json::json!(f.source)).collect();
            who.extend(lost.then(|| EventKind::FcLost.name().into()));
            items.push(Item {
                name: "flown_by".to_owned(),
                value: who.into(),
                limit: serde_json::json!([Source::Fc]),
                passed: alone && !lost,
            });
        }
        self.expect = Verdict { passed: items.iter().all(|item| item.passed), items };
    }
}
