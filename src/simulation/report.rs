//! What a run leaves behind: the object that `--json` prints.

use std::collections::BTreeMap;

use serde::Serialize;

pub use super::bench_report::{
    Disrupted, DisruptedWay, GroundReport, Handover, LinkReport, Overrun, PeakMotion, Percentiles, Scheduler,
    Stalled, Timing,
};

use super::flown_by::{FlownBy, Source};
use crate::event::{Event, EventKind};
use crate::scenario::{Expect, Outcome};

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
    /// Reports of the flights before this one in the same process, each ended by a reset; absent when there
    /// are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub flights: Vec<Report>,
    /// The ground station's link, where there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<GroundReport>,
}

/// How often each rung of the built-in autopilot's ladders was stood on; rungs never stood on are left out.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ladders {
    /// Predictive control, fifty times a second: `solved`, `capped`, `oracle`, `shifted`, `feedback`,
    /// `cascade`.
    pub control: BTreeMap<String, u64>,
    /// Plans adopted: `optimal`, `previous`, `wide_glide_slope`, `landing_error`, `quintic`, `ramp`, `hold`.
    pub guidance: BTreeMap<String, u64>,
    /// Plans that did not come in time.
    pub plans_late: u64,
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
    /// Root mean square of the flying autopilot's estimate of height against its reference (m); null when who
    /// flew sits at the other end of a link.
    pub altitude_control_rms_m: Option<f64>,
    /// Root mean square of that estimate's horizontal distance from the reference (m); null when who flew
    /// sits at the other end of a link.
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

impl Report {
    /// Whether somebody cut it short while nothing had gone wrong: then its verdict says nothing.
    pub fn is_excused(&self) -> bool {
        let has = |is: fn(&EventKind) -> bool| self.events.iter().any(|event| is(&event.kind));
        has(|kind| *kind == EventKind::CutShort) && !has(EventKind::is_abort)
    }

    /// Judges the report by `[expect]`.
    pub(super) fn judge(&mut self, expect: &Expect, flight_time_s: Option<f64>) {
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
        self.expect = Verdict { passed: items.iter().all(|item| item.passed), items };
    }

    /// Expects as well that an outside flight controller flew throughout: what somebody else brought home
    /// fails.
    pub fn require_fc(&mut self) {
        // Who is cut off after a loss has not flown to the end either, though nobody else took over.
        let lost = self.events.iter().any(|event| event.kind == EventKind::FcLost);
        let alone = !self.flown_by.is_empty() && self.flown_by.iter().all(|f| f.source == Source::Fc);
        let mut who: Vec<_> = self.flown_by.iter().map(|f| serde_json::json!(f.source)).collect();
        who.extend(lost.then(|| EventKind::FcLost.name().into()));
        self.expect.items.push(Item {
            name: "flown_by".to_owned(),
            value: who.into(),
            limit: serde_json::json!([Source::Fc]),
            passed: alone && !lost,
        });
        self.expect.passed &= alone && !lost;
    }
}
