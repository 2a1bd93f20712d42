//! The words for a person: that nobody has come yet, then the line of where the run is. `live.rs` prints
//! them.

use hopbench::event::Phase;
use hopbench::signal::{ActuatorCommand, Throttle};
use hopbench::simulation::{Flight, Source};

use crate::bench::pace::now_ns;
use crate::bench::run::{Run, Stage};
use crate::wire::fc_link::FcLink;

/// Between two notices that nobody has come.
const WAITING_EVERY_NS: u64 = 1_000_000_000;

/// Says that nobody has come, and then shows where the run is.
#[derive(Debug)]
pub(super) struct StatusLine {
    next_waiting_ns: u64,
}

impl StatusLine {
    pub(super) fn begin() -> Self {
        Self { next_waiting_ns: now_ns() + WAITING_EVERY_NS }
    }

    pub(super) fn inform(&mut self, run: &mut Run, wire: &FcLink) {
        let now_ns = now_ns();
        if run.controller.first().is_none() {
            if now_ns >= self.next_waiting_ns {
                self.next_waiting_ns = now_ns + WAITING_EVERY_NS;
                run.live.notice(waiting(run, wire));
            }
            return;
        }
        let idle = if run.controller.was_ever_armed() { "disarmed" } else { "pad" };
        let (flight, command, stage, source) = (&*run.flight, &run.command, run.stage, run.options.source);
        let clock = &mut run.clock;
        let line = || live_line(flight, command, stage, source, idle, clock.recent_lateness_us());
        run.live.show(now_ns, line);
    }
}

fn waiting(run: &Run, wire: &FcLink) -> String {
    let hint = match (wire.hears_nonsense(), run.options.baud) {
        _ if run.controller.is_live_board() => {
            ", its HEARTBEAT lacks the HIL flag, so nothing but heartbeats is sent: SYS_HITL 1, then reboot"
        }
        (true, Some(_)) => ", no MAVLink in them: wrong baud rate?",
        (true, None) => ", no MAVLink in them",
        _ => "",
    };
    format!("waiting for FC on {}, {} bytes{hint}", run.address(), wire.received_bytes())
}

fn live_line(
    flight: &Flight,
    command: &ActuatorCommand,
    stage: Stage,
    source: Source,
    idle: &'static str,
    late_us: f64,
) -> String {
    let now = flight.snapshot();
    let who = match (stage, source) {
        (Stage::Fallback, _) => "fallback",
        (_, Source::Fc) => "FC",
        (_, Source::Autopilot) => "autopilot",
        (_, Source::Commands) => "commands",
    };
    let asked_n = match command.throttle {
        Throttle::ThrustN(thrust_n) => thrust_n,
        Throttle::ValveRad(_) => now.thrust_command_n,
    };
    let phase = flight.phase().map_or(if command.armed { "armed" } else { idle }, Phase::name);
    format!(
        "{:7.2} s {phase:<9} h {:6.2} m  v {:+5.2} m/s  thrust {:4.0}/{asked_n:4.0} N  valve {:4.1} deg  \
         Pc {:4.1} bar  N2O {:5.2} kg  {who}  late {late_us:.0} us",
        now.time.s(),
        now.height_m,
        -now.velocity_ned_m_s.z,
        now.thrust_n,
        now.valve_rad.to_degrees(),
        now.chamber_pa * 1e-5,
        now.nitrous_kg,
    )
}
