//! What only a bench asks of a flight: faults and wind by hand, another flight in the same process, an
//! autopilot that sits at the other end of a link.

use super::report::Handover;
use super::{Flight, Instrumentation, Report};
use crate::event::EventKind;
use crate::fault::{Acting, Component, Fault, Mode, WireEffect};
use crate::frame::Vec3;
use crate::input::Invalid;
use crate::plant::{BenchDisturbance, Plant};
use crate::signal::ActuatorCommand;

/// Changes from outside that are kept with their words; what comes on top is counted.
pub const MODIFIED_KEPT: usize = 100;

impl Flight {
    /// The same flight at step 0 again, as the scenario has it, under a seed.
    ///
    /// # Errors
    /// As [`Flight::new`].
    pub fn again(&self, seed: u32) -> Result<Self, Invalid> {
        let plant = Plant::seeded(&self.scenario, seed)?;
        let mut fresh =
            Self::assemble(&self.scenario, seed, &self.instruments, plant, self.parameters.clone())?;
        fresh.flown_elsewhere = self.flown_elsewhere;
        Ok(fresh)
    }

    /// Ends this flight's place in the process: its report is kept, and `fresh`, which [`Flight::again`] set
    /// up, begins.
    pub fn begin_again(&mut self, mut fresh: Self, report: Report) {
        fresh.earlier = std::mem::take(&mut self.earlier);
        fresh.earlier.push(report);
        *self = fresh;
    }

    /// Reports of the flights that came before this one in the process.
    pub fn earlier(&self) -> &[Report] {
        &self.earlier
    }

    /// What was asked of the sensors beyond the scenario.
    pub fn instruments(&self) -> &Instrumentation {
        &self.instruments
    }

    /// Wind and disturbances that somebody at a bench has added.
    pub fn bench_disturbance(&self) -> &BenchDisturbance {
        &self.bench_disturbance
    }

    /// Adds wind and disturbances within two steps, instead of those added before. The caller notes
    /// that the run is modified.
    pub fn set_bench_disturbance(&mut self, bench_disturbance: BenchDisturbance) {
        self.bench_disturbance = bench_disturbance;
        self.plant.set_bench_disturbance(&bench_disturbance);
    }

    /// Breaks something now, without regard to a trigger; what acts of the same component and mode is
    /// replaced. The run is marked as modified.
    ///
    /// # Errors
    /// When the component cannot break so, or the value is out of range.
    pub fn inject(&mut self, fault: &Fault) -> Result<(), Invalid> {
        self.faults.inject(fault, self.plant.time())?;
        self.note_modified(&format!("fault {}", fault.describe()));
        self.event(EventKind::Fault(fault.name()), fault.describe());
        Ok(())
    }

    /// Mends what acts in a component, of one mode or of any, and says how much that was. The run is marked
    /// as modified if anything was.
    pub fn clear_fault(&mut self, component: Component, mode: Option<Mode>) -> usize {
        let mut ended = Vec::new();
        self.faults.clear(component, mode, |fault| ended.push((fault.name(), fault.describe())));
        let count = ended.len();
        for (name, what) in ended {
            self.note_modified(&format!("mended {what}"));
            self.event(EventKind::FaultOver(name), String::new());
        }
        count
    }

    /// The faults that act now.
    pub fn faults(&self) -> impl Iterator<Item = &Acting> {
        self.faults.acting()
    }

    /// What is broken between the bench and the flight controller.
    pub fn wire_effect(&self) -> &WireEffect {
        &self.faults.effects().wire
    }

    /// Notes that something was changed from outside: the run is no longer its scenario's. Beyond the first
    /// [`MODIFIED_KEPT`] changes are only counted, so that somebody who sends without end fills no memory.
    pub fn note_modified(&mut self, what: &str) {
        self.modified_count += 1;
        if self.modified.len() < MODIFIED_KEPT {
            self.modified.push(format!("{:.3} s: {what}", self.plant.time().s()));
            self.event(EventKind::Modified, what.to_owned());
        }
    }

    /// What was changed from outside so far, the first of it.
    pub fn modified(&self) -> &[String] {
        &self.modified
    }

    /// The autopilot that flies is not this flight's own but one at the other end of a link: its estimate
    /// comes by [`Flight::set_estimate_at_touchdown`].
    pub fn set_flown_elsewhere(&mut self) {
        self.flown_elsewhere = true;
    }

    /// The estimate of the autopilot that flew, if that was not the flight's own but one at the other
    /// end of a link; used for the errors at touchdown.
    pub fn set_estimate_at_touchdown(&mut self, position_ned_m: Vec3) {
        self.estimate_at_touchdown.get_or_insert(position_ned_m);
    }

    /// Position that an autopilot at the other end of a link wants to hold; `None`: the flight's own flies.
    pub fn set_reference_elsewhere(&mut self, position_ned_m: Option<Vec3>) {
        self.reference_elsewhere_ned_m = position_ned_m;
    }

    /// Notes what a change of hands did.
    pub fn note_handover(&mut self, handover: Handover) {
        self.handovers.push(handover);
    }

    /// Keeps the built-in autopilot in step while another flies.
    pub fn shadow(&mut self, applied: &ActuatorCommand) {
        if let Some(measurement) = &self.measurement {
            self.autopilot.observe(measurement, applied);
        }
    }
}
