//! What a person sees while the bench waits and while it flies.

use hopbench::event::Phase;
use hopbench::signal::{ActuatorCommand, Throttle};
use hopbench::simulation::{Flight, Source};

use super::{Bench, Stage};
use crate::bench::pace::now_ns;

impl Bench<'_> {
    pub(super) fn inform(&mut self) {
        let now = now_ns();
        if let Some(text) = self.stalls.notice(now) {
            self.live.notice(text);
        }
        if self.fc.first.is_none() {
            if now >= self.figures.next_message_ns {
                self.figures.next_message_ns = now + 1_000_000_000;
                let bytes = self.link.counters().received_bytes;
                let nonsense = bytes > 0 && self.decoder.counters().frames == 0;
                let live_board = self.fc.may_be_live && self.fc.heartbeat == Some(false);
                let hint = match (nonsense, self.options.baud) {
                    _ if live_board => {
                        ", its HEARTBEAT lacks the HIL flag, so nothing but heartbeats is sent: SYS_HITL 1, then reboot"
                    }
                    (true, Some(_)) => ", no MAVLink in them: wrong baud rate?",
                    (true, None) => ", no MAVLink in them",
                    _ => "",
                };
                self.live.notice(format!("waiting for FC on {}, {bytes} bytes{hint}", self.link.address()));
            }
            return;
        }
        let (flight, command, stage) = (&*self.flight, &self.command, self.stage);
        let (source, clock, ever_armed) = (self.options.source, &mut self.clock, self.fc.ever_armed);
        let idle = if ever_armed { "disarmed" } else { "pad" };
        self.live.show(now, || live_line(flight, command, stage, source, idle, clock.recent_lateness_us()));
    }
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
