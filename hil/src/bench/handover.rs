//! Who flies: the judgement on a silent flight controller, the hand-over to the built-in autopilot, the way back, and
//! what each change of hands did to the vehicle.
//!
//! The autopilot has shadowed measurements and commands, so it starts from the motion under way and from the command
//! in force. It keeps the controls until somebody asks for them to be given back.

use hopbench::event::EventKind;
use hopbench::frame::{Vec3, tilt_rad};
use hopbench::plant::Snapshot;
use hopbench::scenario::{OnFcLoss, Outcome};
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::Source;
use hopbench::simulation::report::{Handover, Unrest};
use hopbench::time::SimTime;

use super::{Bench, Stage};
use crate::bench::pace::now_ns;

/// The vehicle's motion is compared over this long before and after.
const SPAN: SimTime = SimTime::from_us(2_000_000);
/// Parts of the span before.
const PARTS: usize = 4;

/// Watches for what a change of hands does.
#[derive(Debug, Default)]
pub(super) struct HandoverMonitor {
    /// Greatest motion in each of the last parts of a span; which part is the newest.
    recent: [Unrest; PARTS],
    newest: u64,
    change: Option<Change>,
}

/// A change of hands whose consequences are still watched.
#[derive(Debug)]
struct Change {
    record: Handover,
    at: SimTime,
    at_ns: u64,
    velocity_ned_m_s: Vec3,
    command: ActuatorCommand,
    thrust_command_n: f64,
    /// The new hand's first command: made, and taken in by the plant.
    first: First,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum First {
    Awaited,
    Made,
    TakenIn,
}

impl HandoverMonitor {
    /// Looks at the vehicle after a step; what is complete is returned.
    pub(super) fn watch(&mut self, now: &Snapshot) -> Option<Handover> {
        let unrest = Unrest {
            tilt_deg: tilt_rad(&now.q_ned_from_body).to_degrees(),
            rate_deg_s: now.rate_body_rad_s.norm().to_degrees(),
        };
        let part = now.time.us() / (SPAN.us() / PARTS as u64);
        if part != self.newest {
            self.newest = part;
            self.recent[part as usize % PARTS] = Unrest::default();
        }
        self.recent[part as usize % PARTS].take(&unrest);

        let change = self.change.as_mut()?;
        change.record.after.take(&unrest);
        let speed_change_m_s = (now.velocity_ned_m_s - change.velocity_ned_m_s).norm();
        change.record.speed_change_m_s = change.record.speed_change_m_s.max(speed_change_m_s);
        if change.first == First::Made {
            change.first = First::TakenIn;
            change.record.thrust_step_n = now.thrust_command_n - change.thrust_command_n;
        }
        (now.time.since(change.at) >= SPAN).then(|| self.change.take()).flatten().map(|change| change.record)
    }

    /// The motion of the last span.
    fn before(&self) -> Unrest {
        let mut all = Unrest::default();
        self.recent.iter().for_each(|part| all.take(part));
        all
    }

    /// Who took over has made a command.
    pub(super) fn commanded(&mut self, command: &ActuatorCommand, now: SimTime) {
        if let Some(change) = self.change.as_mut().filter(|change| change.first == First::Awaited) {
            change.first = First::Made;
            change.record.silence_ms += now.since(change.at).s() * 1e3;
            change.record.silence_wall_ms += now_ns().saturating_sub(change.at_ns) as f64 * 1e-6;
            let [x, y] = [
                command.gimbal_x_rad - change.command.gimbal_x_rad,
                command.gimbal_y_rad - change.command.gimbal_y_rad,
            ];
            change.record.gimbal_step_deg = libm::hypot(x, y).to_degrees();
        }
    }

    /// What is still watched when the run ends.
    pub(super) fn unfinished(&mut self) -> Option<Handover> {
        self.change.take().map(|change| change.record)
    }
}

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
                let why = self.silence();
                self.hand_over(why);
            } else if self.in_lockstep() {
                self.fc.answers = false;
                self.clock.rebase(self.flight.time().us());
                self.live.notice(format!("{}: silent, going on in real time", self.link.address()));
            } else if self.fc.first.is_some() {
                self.name_silence();
            }
        } else if self.fc.left_the_loop && self.stage == Stage::Flying && self.fc.armed {
            self.hand_over("HEARTBEAT without the HIL flag: its outputs may be live".to_owned());
        }
        self.inform();
    }

    /// On the pad or after the flight nobody is replaced, but silence is named at once and every second.
    fn name_silence(&mut self) {
        let now_ns = now_ns();
        let begins = self.fc.next_silence_ns.is_none();
        if self.fc.next_silence_ns.is_some_and(|next_ns| now_ns < next_ns) {
            return;
        }
        self.fc.next_silence_ns = Some(now_ns + 1_000_000_000);
        let silent_s = now_ns.saturating_sub(self.fc.heard_ns) as f64 * 1e-9;
        let why = if self.fc.left_the_loop { ", its HEARTBEAT lacks the HIL flag" } else { "" };
        let text = format!("{silent_s:.1} s without HIL_ACTUATOR_CONTROLS that count{why}");
        self.live.notice(format!("FC silent on {}: {text}", self.link.address()));
        if begins {
            self.flight.event(EventKind::FcSilent, text);
        }
    }

    /// How long nothing that could be obeyed has come.
    fn silence(&self) -> String {
        let silent = if self.in_lockstep() && self.fc.waited >= self.patience() {
            format!("{} ms waited in lockstep", self.fc.waited.as_millis())
        } else {
            format!(
                "{:.0} ms without HIL_ACTUATOR_CONTROLS",
                self.flight.time().since(self.fc.heard).s() * 1e3
            )
        };
        match (self.fc.rejected, self.fc.old) {
            (0, 0) => silent,
            (rejected, old) => format!("{silent}, {rejected} frames refused, {old} old or repeated"),
        }
    }

    fn hand_over(&mut self, why: String) {
        self.live.notice(format!("FC lost on {}: {why}", self.link.address()));
        self.flight.event(EventKind::FcLost, why);
        self.stage = Stage::Fallback;
        self.hold_peer();
        match self.scenario.file.on_fc_loss {
            OnFcLoss::Cut => {
                self.watch_change(None);
                self.command = ActuatorCommand::SAFE;
                self.hands.commanded(&self.command, self.flight.time());
            }
            OnFcLoss::Autopilot => {
                self.watch_change(Some(Source::Autopilot));
                self.flight.autopilot().take_over();
                self.flight.set_reference_elsewhere(None);
                self.flight.set_source(Source::Autopilot);
                self.flight.event(EventKind::Handover, "the built-in autopilot flies".to_owned());
                self.live.notice("the built-in autopilot flies".to_owned());
            }
        }
        self.clock.rebase(self.flight.time().us());
    }

    /// Gives the controls back to the flight controller, on somebody's request.
    ///
    /// # Errors
    /// When it does not fly the vehicle anyway, or cannot.
    pub fn give_back(&mut self) -> Result<(), &'static str> {
        if self.stage != Stage::Fallback {
            return Err("the flight controller has not been replaced");
        }
        if self.scenario.file.on_fc_loss == OnFcLoss::Cut {
            return Err("the engine was cut");
        }
        let Some(command) = self.fc.command.filter(|command| command.armed) else {
            return Err("the flight controller is not armed");
        };
        // In lockstep nobody has waited for it since; in real time a silent one would be lost again at once.
        if now_ns().saturating_sub(self.fc.heard_ns) > self.fc_timeout().as_nanos() as u64 / 2 {
            return Err("the flight controller is silent");
        }
        if self.fc.left_the_loop {
            return Err("the flight controller's HEARTBEAT lacks the HIL flag");
        }
        self.watch_change(Some(self.options.source));
        self.stage = Stage::Flying;
        self.fc.waited = std::time::Duration::ZERO;
        self.command = command;
        self.hands.commanded(&command, self.flight.time());
        if let Some(planner) = &mut self.planner {
            planner.forget();
        }
        self.flight.set_source(self.options.source);
        self.flight.event(EventKind::Handback, "the flight controller flies".to_owned());
        self.live.notice("the flight controller flies again".to_owned());
        self.clock.rebase(self.flight.time().us());
        Ok(())
    }

    /// Begins to watch what a change of hands does.
    fn watch_change(&mut self, to: Option<Source>) {
        let (now, at_ns) = (self.flight.snapshot(), now_ns());
        let record = Handover {
            to,
            time_s: now.time.s(),
            silence_ms: now.time.since(self.fc.heard).s() * 1e3,
            silence_wall_ms: at_ns.saturating_sub(self.fc.heard_ns) as f64 * 1e-6,
            before: self.hands.before(),
            ..Handover::default()
        };
        let change = Change {
            record,
            at: now.time,
            at_ns,
            velocity_ned_m_s: now.velocity_ned_m_s,
            command: self.command,
            thrust_command_n: now.thrust_command_n,
            first: First::Awaited,
        };
        if let Some(overtaken) = self.hands.change.replace(change) {
            self.flight.note_handover(overtaken.record);
        }
    }
}
