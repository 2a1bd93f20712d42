//! What a flight comes to: its report, assembled from the truth, the referee and the autopilot.

use super::Flight;
use super::flown_by::Source;
use super::report::{Ladders, MassBalance, Propellant, Report, Timing, Verdict};
use crate::autopilot::{lcvx, tracking};
use crate::fault::Fault;
use crate::frame::Vec3;
use crate::plant::Snapshot;
use crate::scenario::Outcome;

/// First contact against the target, north and east (m).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchdownOffset {
    /// In truth.
    pub true_m: [f64; 2],
    /// By the estimate of the autopilot that flew; `None` when an outside one did.
    pub estimated_m: Option<[f64; 2]>,
}

impl Flight {
    /// The report, judged by what the scenario expects. Timing and link are the owner's to fill in.
    pub fn report(&self) -> Report {
        let (start, end) = (&self.initial, &self.snapshot);
        let mut flown_by = self.flown_by.clone();
        if let Some(last) = flown_by.last_mut() {
            last.to_s = end.time.s();
        }
        let [nozzle, rcs, vent] = end.expelled_kg;
        let target = self.scenario.target_north_east_m();
        let touchdown = self.referee.touchdown.map(|mut touchdown| {
            if let Some(estimate) = self.estimate_at_touchdown.map(|e| self.in_pad_frame(e)) {
                touchdown.control_error_m = Some(libm::hypot(estimate.x - target[0], estimate.y - target[1]));
                touchdown.navigation_error_m =
                    self.true_at_touchdown().map(|p| libm::hypot(estimate.x - p.x, estimate.y - p.y));
            }
            touchdown
        });
        let mut hash = self.hash;
        hash.add(self.plant.state());
        let more = self.modified_count - self.modified.len();
        let more = (more > 0).then(|| format!("and {more} more"));
        let mut report = Report {
            scenario: self.scenario.name.clone(),
            seed: self.seed,
            outcome: self.outcome().unwrap_or(Outcome::Aborted),
            flown_by,
            handovers: self.handovers.clone(),
            expect: Verdict::default(),
            touchdown,
            max_altitude_m: self.referee.max_altitude_m,
            hover: self.referee.hover(),
            autopilot: self.ladders(),
            propellant: self.propellant(),
            mass: MassBalance {
                initial_kg: start.mass_kg,
                final_kg: end.mass_kg,
                closure_error_kg: (start.mass_kg + start.manifold_kg + start.chamber_gas_kg)
                    - (end.mass_kg + end.manifold_kg + end.chamber_gas_kg)
                    - (nozzle + rcs + vent),
            },
            timing: Timing {
                plant_mode: self.scenario.file.fidelity,
                plant_hz: 1.0 / self.step_s(),
                step_budget_us: self.step_s() * 1e6,
                simulated_s: end.time.s(),
                steps: self.steps,
                ..Timing::default()
            },
            link: None,
            events: self.events.clone(),
            state_hash: hash.hex(),
            run: None,
            overrides: Vec::new(),
            modified: self.modified.iter().cloned().chain(more).collect(),
            modified_count: self.modified_count,
            faults_idle: self.faults.idle().map(Fault::name).collect(),
            flights: self.earlier.clone(),
            ground: None,
        };
        let flight_time_s =
            self.referee.touchdown.zip(self.referee.liftoff_s).map(|(t, liftoff_s)| t.time_s - liftoff_s);
        report.judge(&self.scenario.file.expect, flight_time_s);
        report
    }

    /// What the own autopilot's ladders did, if it flew.
    fn ladders(&self) -> Option<Ladders> {
        let (tracker, planning) = (self.autopilot.tracker(), self.autopilot.planning());
        let stood_on = |counts: &[u64], name: &dyn Fn(usize) -> &'static str| {
            let rungs = counts.iter().enumerate().filter(|(_, count)| **count > 0);
            rungs.map(|(i, &count)| (name(i).to_owned(), count)).collect()
        };
        let flew = !self.flown_elsewhere && self.flown_by.iter().any(|f| f.source == Source::Autopilot);
        flew.then(|| Ladders {
            control: stood_on(&tracker.counts(), &|i| tracking::Rung::ALL[i].name()),
            guidance: stood_on(&planning.counts(), &|i| lcvx::Rung::ALL[i].name()),
            plans_late: planning.late(),
        })
    }

    /// What each fluid has come to. Everything that the vehicle's mass lost is in one of the figures.
    fn propellant(&self) -> Propellant {
        let (start, end) = (&self.initial, &self.snapshot);
        let nitrous_kg = |s: &Snapshot| s.nitrous_kg + s.nitrous_vapor_kg;
        let nitrogen_kg = |s: &Snapshot| s.nitrogen_bottle_kg + s.nitrogen_ullage_kg;
        let [_, rcs_kg, vent_kg] = end.expelled_kg;
        let nitrogen_vented_kg = vent_kg - end.vented_vapor_kg;
        Propellant {
            nitrous_used_kg: nitrous_kg(start) - nitrous_kg(end),
            nitrous_left_kg: end.nitrous_kg,
            nitrous_vapor_kg: end.nitrous_vapor_kg,
            fuel_used_kg: start.fuel_kg - end.fuel_kg,
            fuel_left_kg: end.fuel_kg,
            nitrogen_rcs_kg: rcs_kg,
            nitrogen_vented_kg,
            // Only an outlet that uncovers lets nitrogen into the engine; elsewhere the difference is
            // round-off.
            nitrogen_nozzle_kg: if self.scenario.vehicle.gas_ingestion.is_some() {
                nitrogen_kg(start) - nitrogen_kg(end) - rcs_kg - nitrogen_vented_kg
            } else {
                0.0
            },
        }
    }

    /// Where the pivot was at first contact against the target, north and east (m): in truth, and by the
    /// estimate of the autopilot that flew.
    pub fn touchdown_offset_m(&self) -> Option<TouchdownOffset> {
        let [north, east] = self.scenario.target_north_east_m();
        let off = |p: Vec3| [p.x - north, p.y - east];
        let truth = off(self.true_at_touchdown()?);
        Some(TouchdownOffset {
            true_m: truth,
            estimated_m: self.estimate_at_touchdown.map(|e| off(self.in_pad_frame(e))),
        })
    }

    fn true_at_touchdown(&self) -> Option<Vec3> {
        self.referee.position_at_touchdown_ned_m()
    }

    /// Greatest tilt between lift-off and first contact (deg).
    pub fn peak_tilt_deg(&self) -> Option<f64> {
        self.referee.peak_tilt_rad.map(f64::to_degrees)
    }
}
