//! Who flies: the judgement on a silent flight controller, and the hand-over to the built-in autopilot.

use hopbench::scenario::{OnFcLoss, Outcome};
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::Source;

use super::{Bench, Stage};
use crate::planner::Planner;

impl Bench<'_> {
    /// Whether the flight controller is lost, whether anybody will ever arm, and what a person should know.
    pub(super) fn judge(&mut self) {
        let wait_s = self.scenario.file.arm_wait_s;
        if let (Some(first), false) = (self.fc.first, self.fc.ever_armed)
            && wait_s > 0.0
            && self.flight.time().since(first).s() >= wait_s
        {
            self.flight.end(Outcome::Timeout);
        }
        if self.is_lost() {
            if self.stage == Stage::Flying && self.fc.armed {
                self.hand_over();
            } else if self.in_lockstep() {
                self.fc.answers = false;
                self.clock.rebase(self.flight.time().us());
                self.live.notice(format!("{}: silent, going on in real time", self.link.address()));
            }
        }
        self.inform();
    }

    pub(super) fn hand_over(&mut self) {
        let silent = if self.in_lockstep() {
            format!("{} ms waited in lockstep", self.fc.waited.as_millis())
        } else {
            format!(
                "{:.0} ms without HIL_ACTUATOR_CONTROLS",
                self.flight.time().since(self.fc.heard).s() * 1e3
            )
        };
        let silent = match self.fc.rejected {
            0 => silent,
            rejected => format!("{silent}, {rejected} frames refused"),
        };
        self.live.notice(format!("FC lost on {}: {silent}", self.link.address()));
        self.flight.event("fc_lost", silent);
        self.stage = Stage::Fallback;
        self.clock.rebase(self.flight.time().us());
        match self.scenario.file.on_fc_loss {
            OnFcLoss::Cut => self.command = ActuatorCommand::SAFE,
            OnFcLoss::Autopilot => {
                self.flight.autopilot().take_over();
                match Planner::start() {
                    Ok(planner) => self.planner = Some(planner),
                    Err(e) => self.live.notice(format!("no thread to plan on, landing by ramps: {e}")),
                }
                self.flight.set_reference_elsewhere(None);
                self.flight.set_source(Source::Autopilot);
                self.flight.event("handover", "the built-in autopilot flies".to_owned());
                self.live.notice("the built-in autopilot flies".to_owned());
            }
        }
    }
}
