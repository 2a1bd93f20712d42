//! What a hand-over does to the vehicle: its motion before and after, the step in its commands, the silence
//! in between.

use hopbench::frame::{Vec3, tilt_rad};
use hopbench::plant::Snapshot;
use hopbench::signal::ActuatorCommand;
use hopbench::simulation::Source;
use hopbench::simulation::report::{Handover, PeakMotion};
use hopbench::time::SimTime;

use crate::bench::pace::now_ns;

/// The vehicle's motion is compared over this long before and after.
const SPAN: SimTime = SimTime::from_us(2_000_000);
/// Parts of the span before.
const PARTS: usize = 4;

/// Watches what a hand-over does.
#[derive(Debug, Default)]
pub(super) struct HandoverMonitor {
    /// Greatest motion in each of the last parts of a span; which part is the newest.
    recent: [PeakMotion; PARTS],
    newest: u64,
    change: Option<Change>,
}

/// A hand-over whose consequences are still watched.
#[derive(Debug)]
struct Change {
    record: Handover,
    at: SimTime,
    at_ns: u64,
    velocity_ned_m_s: Vec3,
    command: ActuatorCommand,
    thrust_command_n: f64,
    /// Of whoever took over.
    first: FirstCommand,
}

/// What was in force when the controls changed hands.
#[derive(Debug)]
pub(super) struct Situation<'a> {
    pub(super) vehicle: &'a Snapshot,
    pub(super) command: ActuatorCommand,
    /// Last good controls: simulated and wall time.
    pub(super) heard: SimTime,
    pub(super) heard_ns: u64,
}

/// The first command of whoever took over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FirstCommand {
    Awaited,
    Issued,
    InEffect,
}

impl HandoverMonitor {
    /// Looks at the vehicle after a step; what is complete is returned.
    pub(super) fn watch(&mut self, now: &Snapshot) -> Option<Handover> {
        let motion = PeakMotion {
            tilt_deg: tilt_rad(&now.q_ned_from_body).to_degrees(),
            rate_deg_s: now.rate_body_rad_s.norm().to_degrees(),
        };
        let part = now.time.us() / (SPAN.us() / PARTS as u64);
        if part != self.newest {
            self.newest = part;
            self.recent[part as usize % PARTS] = PeakMotion::default();
        }
        self.recent[part as usize % PARTS].take(&motion);

        let change = self.change.as_mut()?;
        change.record.after.take(&motion);
        let speed_change_m_s = (now.velocity_ned_m_s - change.velocity_ned_m_s).norm();
        change.record.speed_change_m_s = change.record.speed_change_m_s.max(speed_change_m_s);
        if change.first == FirstCommand::Issued {
            change.first = FirstCommand::InEffect;
            change.record.thrust_step_n = now.thrust_command_n - change.thrust_command_n;
        }
        (now.time.since(change.at) >= SPAN).then(|| self.change.take()).flatten().map(|change| change.record)
    }

    /// The motion of the last span.
    fn before(&self) -> PeakMotion {
        let mut all = PeakMotion::default();
        self.recent.iter().for_each(|part| all.take(part));
        all
    }

    /// Who took over has made a command.
    pub(super) fn commanded(&mut self, command: &ActuatorCommand, now: SimTime) {
        if let Some(change) = self.change.as_mut().filter(|change| change.first == FirstCommand::Awaited) {
            change.first = FirstCommand::Issued;
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

    /// Begins to watch; what was still watched is returned. `to`: who flies from now on.
    pub(super) fn begin(&mut self, before: &Situation, to: Option<Source>) -> Option<Handover> {
        let (now, at_ns) = (before.vehicle, now_ns());
        let record = Handover {
            to,
            time_s: now.time.s(),
            silence_ms: now.time.since(before.heard).s() * 1e3,
            silence_wall_ms: at_ns.saturating_sub(before.heard_ns) as f64 * 1e-6,
            before: self.before(),
            ..Handover::default()
        };
        let change = Change {
            record,
            at: now.time,
            at_ns,
            velocity_ned_m_s: now.velocity_ned_m_s,
            command: before.command,
            thrust_command_n: now.thrust_command_n,
            first: FirstCommand::Awaited,
        };
        self.change.replace(change).map(|overtaken| overtaken.record)
    }
}
