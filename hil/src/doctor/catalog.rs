//! Every finding: how bad it is, its name, what is seen, why it happens, what to do.
//!
//! One list, read top to bottom; each function is an entry with the name of its finding, its arguments are
//! what was observed. A new finding is one more entry here, and one line where it is judged.

use super::channel::MappedChannel;
use super::finding::Finding;
use super::finding::Severity::{Error, Ok, Warning};
use super::observation::{ControlsStatistics, Sender};
use crate::wire::link::LinkSpec;
use crate::wire::mavlink::{AUTOPILOT_ARDUPILOT, Address, Counters};
use crate::wire::port::{Holder, Port};
use crate::wire::profile::{Budget, Profile};

// The link does not open.

pub(super) fn no_port(path: &str, present: &[String]) -> Finding {
    Finding {
        severity: Error,
        name: "no_port",
        seen: format!("there is no {path}; present: {}", list(present)),
        why: "the board is not plugged in, has no power, or got another number".into(),
        fix: "plug it in and look at `dmesg`; name it by its link in /dev/serial/by-id, which keeps".into(),
    }
}

pub(super) fn permission_denied(path: &str, group: Option<&str>) -> Finding {
    let group = group.unwrap_or("dialout");
    Finding {
        severity: Error,
        name: "permission_denied",
        seen: format!("{path} may not be opened by this user; its group is {group}"),
        why: "serial ports belong to a group that this user is not in".into(),
        fix: format!("sudo usermod -aG {group} $USER, then log out and in again"),
    }
}

pub(super) fn port_busy(path: &str, cause: &str) -> Finding {
    Finding {
        severity: Error,
        name: "port_busy",
        seen: format!("{path}: {cause}"),
        why: "a port has one user at a time, and another program was first".into(),
        fix: "end that program; ModemManager: sudo systemctl stop ModemManager; a ground station: let it \
              use another port of the board"
            .into(),
    }
}

pub(super) fn address_in_use(link: &str) -> Finding {
    Finding {
        severity: Error,
        name: "address_in_use",
        seen: format!("{link}: the port is taken"),
        why: "another program listens there, perhaps another bench or a simulator".into(),
        fix: "end it (`ss -lptu` names it), or listen on another port".into(),
    }
}

pub(super) fn cannot_open(link: &str, cause: &str) -> Finding {
    Finding {
        severity: Error,
        name: "cannot_open",
        seen: format!("{link}: {cause}"),
        why: "the system refuses it".into(),
        fix: "check the path, the host and the rate of the link".into(),
    }
}

// Nobody, or nothing useful, at the other end.

pub(super) fn nobody_there(link: &LinkSpec, listened_s: f64) -> Finding {
    Finding {
        severity: Error,
        name: "nobody_there",
        seen: format!("nobody came to {link} in {listened_s:.1} s"),
        why: "the other end does not run, uses another address or port, or a firewall is between".into(),
        fix: "start it; PX4 in software dials 4560 plus its instance; a listener on another machine needs \
              its address, not the loopback"
            .into(),
    }
}

pub(super) fn no_bytes(link: &LinkSpec, listened_s: f64) -> Finding {
    Finding {
        severity: Error,
        name: "no_bytes",
        seen: format!("not one byte on {link} in {listened_s:.1} s"),
        why: "the flight controller has no power, RX and TX are not crossed, ground is missing, or this is \
              a port without MAVLink"
            .into(),
        fix: "check power and wiring; PX4: MAV_0_CONFIG to MAV_2_CONFIG name the ports with MAVLink; USB \
              opens once it hears a heartbeat, which was sent"
            .into(),
    }
}

pub(super) fn wrong_baud(bytes: u64, baud: u32) -> Finding {
    Finding {
        severity: Error,
        name: "wrong_baud",
        seen: format!("{bytes} bytes at {baud} baud, no MAVLink frame and no text in them"),
        why: "at another rate than the sender's, bits are read as other bits".into(),
        fix: "take the sender's rate: PX4 SER_TEL1_BAUD and its kin; 57600, 115200 and 921600 are usual"
            .into(),
    }
}

pub(super) fn no_mavlink(bytes: u64, text: Option<&str>) -> Finding {
    Finding {
        severity: Error,
        name: "no_mavlink",
        seen: match text {
            Some(text) => format!("{bytes} bytes of text, no MAVLink frame: {text:?}"),
            None => format!("{bytes} bytes, no MAVLink frame in them"),
        },
        why: "another protocol speaks here: a console, a satellite receiver, another program".into(),
        fix: "choose the port on which the flight controller speaks MAVLink".into(),
    }
}

pub(super) fn mavlink_1(frames: u64, of: u64) -> Finding {
    Finding {
        severity: Warning,
        name: "mavlink_1",
        seen: format!("{frames} of {of} frames are MAVLink 1"),
        why: "the flight controller is set to version 1, or has not yet heard version 2; the bench reads \
              both and speaks 2"
            .into(),
        fix: "PX4: MAV_PROTO_VER 2; pymavlink: MAVLINK20=1".into(),
    }
}

// The link is bad.

pub(super) fn port_shared(holders: &[Holder]) -> Finding {
    Finding {
        severity: Warning,
        name: "port_shared",
        seen: format!("the port is also open in {}", list(holders)),
        why: "it was opened without a lock; two readers each get a part of the bytes".into(),
        fix: "end the other program".into(),
    }
}

pub(super) fn second_client(names: &[String]) -> Finding {
    Finding {
        severity: Error,
        name: "second_client",
        seen: format!("{} was turned away", list(names)),
        why: "one flight controller at a time; a second program sends to the same address".into(),
        fix: "end it, or give it a port of its own".into(),
    }
}

pub(super) fn link_lost(reasons: &[String]) -> Finding {
    Finding {
        severity: Error,
        name: "link_lost",
        seen: format!("the link broke {} times: {}", reasons.len(), list(reasons)),
        why: "a loose plug, a board that reboots or browns out, or a program that ended".into(),
        fix: "look at `dmesg`; give the board power of its own".into(),
    }
}

pub(super) fn not_taken(writes: u64) -> Finding {
    Finding {
        severity: Warning,
        name: "not_taken",
        seen: format!("{writes} writes were not taken by the other end"),
        why: "it does not read, or the line is slower than what is sent".into(),
        fix: "lower --sensor-hz; check that the other program runs".into(),
    }
}

pub(super) fn damaged(counters: &Counters) -> Finding {
    let Counters { frames, crc_errors, skipped_bytes, .. } = counters;
    Finding {
        severity: if crc_errors * 20 > *frames { Error } else { Warning },
        name: "damaged",
        seen: format!(
            "{crc_errors} damaged frames beside {frames} good ones, {skipped_bytes} bytes in no frame"
        ),
        why: "noise on the line, bytes lost in a full buffer, a rate that is a little off, or two writers"
            .into(),
        fix: "shorter wires with ground, flow control or a lower rate; MAVLink's own dialect must be \
              `common`"
            .into(),
    }
}

pub(super) fn sequence_gaps(counters: &Counters) -> Finding {
    let Counters { lost, frames, .. } = counters;
    Finding {
        severity: Warning,
        name: "sequence_gaps",
        seen: format!("{lost} frames missing by their counters, {frames} came"),
        why: "a line or a radio that is too slow, a buffer that overflows, or packets lost on the way".into(),
        fix: "raise the rate of the line, lower the sender's streams".into(),
    }
}

pub(super) fn wire_overload(baud: u32, sensor_hz: f64, budget: &Budget, back_percent: f64) -> Finding {
    let (out_percent, refused, fitting_hz) = match *budget {
        Budget::Fits { load_percent } | Budget::Tight { load_percent } => (load_percent, false, None),
        Budget::Refused { load_percent, fitting_hz } => (load_percent, true, fitting_hz),
    };
    Finding {
        severity: if refused || back_percent > 90.0 { Error } else { Warning },
        name: "wire_overload",
        seen: format!(
            "of {baud} baud, HIL_SENSOR at {sensor_hz:.0} Hz and what goes with it take {out_percent:.0} %, \
             200 Hz of controls {back_percent:.0} % of the way back"
        ),
        why: "above 70 % queues build up, above 90 % samples come later and later".into(),
        fix: match fitting_hz {
            Some(hz) => format!("--sensor-hz {hz:.0}, or 921600 baud"),
            None => "921600 baud".to_owned(),
        },
    }
}

// Who speaks.

pub(super) fn our_system_id(sender: &Sender) -> Finding {
    let Sender { address, frames, .. } = sender;
    Finding {
        severity: Error,
        name: "our_system_id",
        seen: format!("{frames} frames from {}, which is the bench's own name", address),
        why: "another simulator is on the link, or an echo: RX and TX tied together, a terminal that \
              echoes"
            .into(),
        fix: "end the other simulator; break the loop".into(),
    }
}

pub(super) fn two_controllers(addresses: &[Address]) -> Finding {
    Finding {
        severity: Error,
        name: "two_controllers",
        seen: format!("{} speak as flight controllers", list(addresses)),
        why: "two autopilots share the link, or one is forwarded into it".into(),
        fix: "leave one of them; end the forwarding".into(),
    }
}

pub(super) fn shared_system_id(sender: &Sender) -> Finding {
    let Sender { address, backward, frames, .. } = sender;
    Finding {
        severity: Error,
        name: "shared_system_id",
        seen: format!("the counter of {} went back in {backward} of {frames} frames", address),
        why: "two programs speak under one system and component".into(),
        fix: "give each a name of its own: PX4 MAV_SYS_ID, pymavlink source_system".into(),
    }
}

pub(super) fn no_flight_controller(addresses: &[Address]) -> Finding {
    Finding {
        severity: Error,
        name: "no_flight_controller",
        seen: format!("MAVLink from {}, but no flight controller's HEARTBEAT or controls", list(addresses)),
        why: "a ground station, a camera or a companion speaks here; an autopilot is component 1".into(),
        fix: "connect the flight controller itself".into(),
    }
}

// The flight controller.

pub(super) fn no_heartbeat(address: Address) -> Finding {
    Finding {
        severity: Error,
        name: "no_heartbeat",
        seen: format!("controls but no HEARTBEAT from {}", address),
        why: "without it nobody knows whether the board is in the loop, and its outputs may be live".into(),
        fix: "enable HEARTBEAT on this link".into(),
    }
}

pub(super) fn hil_flag_missing(fc: &Sender) -> Finding {
    let Sender { address, heartbeats, .. } = fc;
    Finding {
        severity: Error,
        name: "hil_flag_missing",
        seen: format!("{heartbeats} HEARTBEAT from {}, none with the HIL flag", address),
        why: "the board flies for real: its outputs are live, and it would mix these samples with its own \
              sensors"
            .into(),
        fix: "PX4: SYS_HITL 1 and a HITL airframe, then reboot; the bench sends nothing but heartbeats \
              until then"
            .into(),
    }
}

pub(super) fn armed_already(address: Address) -> Finding {
    Finding {
        severity: Error,
        name: "armed_already",
        seen: format!("{} is armed", address),
        why: "a run begins disarmed: the first armed frame releases the vehicle at once".into(),
        fix: "disarm it; keep igniter and oxidiser disconnected".into(),
    }
}

pub(super) fn no_controls(fc: &Sender, sensors_sent: u64, profile: &Profile) -> Finding {
    let Sender { address, autopilot, heartbeats, .. } = fc;
    Finding {
        severity: Error,
        name: "no_controls",
        seen: format!(
            "{heartbeats} HEARTBEAT from {} (autopilot {autopilot}) but no HIL_ACTUATOR_CONTROLS; \
             {sensors_sent} HIL_SENSOR were sent",
            address
        ),
        why: no_controls_why(*autopilot, profile.name),
        fix: "go through the causes in this order; `mavlink status` and `listener actuator_outputs_sim` on \
              the board's console show which it is"
            .into(),
    }
}

pub(super) fn data_rate_too_low(controls_hz: f64, bytes_per_s: f64) -> Finding {
    Finding {
        severity: if controls_hz < 5.0 { Error } else { Warning },
        name: "data_rate_too_low",
        seen: format!("HIL_ACTUATOR_CONTROLS at {controls_hz:.1} Hz, {bytes_per_s:.0} byte/s in all"),
        why: "the link is set to too low a rate: PX4 sends controls only above 5000 byte/s, and its \
              default for a telemetry port is 1200; below 5 Hz a controller counts as lost"
            .into(),
        fix: "PX4: MAV_0_RATE (or of that port) 100000 and reboot; 921600 baud; USB needs nothing".into(),
    }
}

pub(super) fn clock_jumps(controls: &ControlsStatistics) -> Finding {
    let ControlsStatistics { jumps, worst_jump_s, .. } = controls;
    Finding {
        severity: Warning,
        name: "clock_jumps",
        seen: format!(
            "time_usec jumped {jumps} times against this machine's clock, worst {worst_jump_s:+.3} s"
        ),
        why: "the board rebooted, its time was set, or two controllers answer in turn".into(),
        fix: "let it answer with the time of the HIL_SENSOR, or with a clock that only goes forward".into(),
    }
}

pub(super) fn controls(fc: &Sender, controls_hz: f64, sensors_sent: u64) -> Finding {
    let Sender { address, hil, heartbeats, .. } = fc;
    Finding {
        severity: Ok,
        name: "controls",
        seen: format!(
            "HIL_ACTUATOR_CONTROLS at {controls_hz:.0} Hz from {}, {heartbeats} HEARTBEAT, HIL flag {}; \
             {sensors_sent} HIL_SENSOR were sent",
            address,
            if *hil { "set" } else { "not set" }
        ),
        why: String::new(),
        fix: String::new(),
    }
}

// What its channels do.

pub(super) fn channels_unread(channels: &[String]) -> Finding {
    Finding {
        severity: Warning,
        name: "channels_unread",
        seen: format!("the flight controller moves controls[] {}, and nobody reads them", list(channels)),
        why: "the map of the vehicle file and the outputs of the flight controller differ; igniter and \
              valves are read only with sequence.source = \"controls\""
            .into(),
        fix: "[controls.channels] of the vehicle file, or the output functions (PX4: HIL_ACT_FUNC1 and on)"
            .into(),
    }
}

pub(super) fn channels_still(channels: &[String]) -> Finding {
    Finding {
        severity: Warning,
        name: "channels_still",
        seen: format!("controls[] {} never moved while others did", list(channels)),
        why: "no output of the flight controller is assigned to them, or a controller does not run".into(),
        fix: "[controls.channels] of the vehicle file, or the output functions (PX4: HIL_ACT_FUNC1 and on)"
            .into(),
    }
}

pub(super) fn controls_still(frames: u64) -> Finding {
    Finding {
        severity: Ok,
        name: "controls_still",
        seen: format!("all sixteen controls stood still in {frames} frames"),
        why: "a disarmed controller holds its outputs; that says nothing about the map of channels".into(),
        fix: "move sticks or servos, or fly the hop, to see them move".into(),
    }
}

pub(super) fn not_a_number(channel: &MappedChannel) -> Finding {
    let MappedChannel { name, index, .. } = channel;
    Finding {
        severity: Warning,
        name: "not_a_number",
        seen: format!("controls[{index}], {name}, holds no number"),
        why: "an output without a function; armed, a frame with it is refused and the last command holds"
            .into(),
        fix: "assign a function to that output".into(),
    }
}

pub(super) fn out_of_range(channel: &MappedChannel, least: f64, greatest: f64) -> Finding {
    let MappedChannel { name, index, range: [low, high], .. } = channel;
    Finding {
        severity: Warning,
        name: "out_of_range",
        seen: format!(
            "controls[{index}], {name}, runs from {least} to {greatest}; its range is {low} to {high}"
        ),
        why: "the flight controller speaks another unit (pulse widths, degrees); what is beyond is clamped"
            .into(),
        fix: format!("range = [{least}, {greatest}] in [controls.channels.{name}], if that is its unit"),
    }
}

// The machine.

pub(super) fn cpus(count: usize) -> Finding {
    Finding {
        severity: if count < 2 { Warning } else { Ok },
        name: "cpus",
        seen: format!("{count} processors"),
        why: "the stepping thread wants one, everything else another".into(),
        fix: "two or more".into(),
    }
}

pub(super) fn clock_source(name: &str) -> Finding {
    Finding {
        severity: if matches!(name, "tsc" | "arch_sys_counter" | "kvm-clock") { Ok } else { Warning },
        name: "clock_source",
        seen: format!("the clock is read from {name}"),
        why: "reading another source takes microseconds each time".into(),
        fix: "boot with tsc=reliable if the processor has an invariant one".into(),
    }
}

pub(super) fn sleep(median_us: f64, worst_us: f64, slack_ns: Option<u64>) -> Finding {
    Finding {
        severity: if worst_us > 1000.0 { Warning } else { Ok },
        name: "sleep",
        seen: format!(
            "100 sleeps of 1 ms end {median_us:.0} us late (median), {worst_us:.0} us at worst; \
             timer slack {}",
            slack_ns.map_or("unknown".to_owned(), |ns| format!("{:.0} us", ns as f64 / 1e3))
        ),
        why: "other work on the machine, power saving, a virtual machine".into(),
        fix: "leave the machine alone during a run; a kernel with PREEMPT_RT".into(),
    }
}

pub(super) fn priority(limit: Option<u64>, root: bool) -> Finding {
    Finding {
        severity: if root || limit.is_none_or(|limit| limit > 0) { Ok } else { Warning },
        name: "priority",
        seen: match (root, limit) {
            (true, _) => "real-time priority: root may use it".to_owned(),
            (false, None) => "real-time priority: up to 99".to_owned(),
            (false, Some(limit)) => format!("real-time priority: up to {limit}"),
        },
        why: "without it any other program may hold up the stepping thread".into(),
        fix: "a line `@dialout - rtprio 80` in /etc/security/limits.d/hopbench.conf, then log in again"
            .into(),
    }
}

pub(super) fn memory_lock(limit_bytes: Option<u64>) -> Finding {
    Finding {
        severity: if limit_bytes.is_none_or(|bytes| bytes >= 64 << 20) { Ok } else { Warning },
        name: "memory_lock",
        seen: match limit_bytes {
            None => "memory may be locked without limit".to_owned(),
            Some(bytes) => format!("{:.0} MB of memory may be locked", bytes as f64 / 1e6),
        },
        why: "memory that is paged out in mid-run costs milliseconds".into(),
        fix: "a line `@dialout - memlock unlimited` in /etc/security/limits.d/hopbench.conf".into(),
    }
}

pub(super) fn governor(name: &str) -> Finding {
    Finding {
        severity: if name == "performance" { Ok } else { Warning },
        name: "governor",
        seen: format!("processors run under the governor {name}"),
        why: "a processor that has slowed down wakes up late".into(),
        fix: "sudo cpupower frequency-set -g performance".into(),
    }
}

pub(super) fn ports(ports: &[Port]) -> Finding {
    let shut = ports.iter().any(|port| !port.may_open);
    Finding {
        severity: if shut { Warning } else { Ok },
        name: "ports",
        seen: match ports.is_empty() {
            true => "no serial port is present".to_owned(),
            false => format!("serial ports: {}", ports.iter().map(port_text).collect::<Vec<_>>().join(", ")),
        },
        why: "a port opens for its owner and its group".into(),
        fix: "name a board by its link in /dev/serial/by-id, which keeps; sudo usermod -aG dialout $USER"
            .into(),
    }
}

pub(super) fn not_in_group(group: &str) -> Finding {
    Finding {
        severity: Warning,
        name: "not_in_group",
        seen: format!("this user is not in the group {group}"),
        why: "serial ports belong to it".into(),
        fix: format!("sudo usermod -aG {group} $USER, then log out and in again"),
    }
}

pub(super) fn modem_manager(pid: u32) -> Finding {
    Finding {
        severity: Warning,
        name: "modem_manager",
        seen: format!("ModemManager runs (process {pid})"),
        why: "it opens every new serial port for some seconds and writes modem commands to it".into(),
        fix: "sudo systemctl disable --now ModemManager".into(),
    }
}

/// The known causes of heartbeats without controls, those first that fit.
fn no_controls_why(autopilot: u8, profile: &str) -> String {
    let causes: &[&str] = match (autopilot, profile) {
        (AUTOPILOT_ARDUPILOT, _) => {
            &["this is an ArduPilot, which knows neither HIL_SENSOR nor HIL_ACTUATOR_CONTROLS"]
        }
        (_, "px4-hitl") => &[
            "HITL is not enabled, or the board was not rebooted since (SYS_HITL 1)",
            "the link's rate is 5000 byte/s or less (MAV_0_RATE, default 1200), or this port is in \
             another mode",
            "the firmware lacks pwm_out_sim (CONFIG_MODULES_SIMULATION_PWM_OUT_SIM)",
            "no output has a function (HIL_ACT_FUNC1 and on), or the airframe is none for HITL",
            "HIL_SENSOR does not reach it: TX of the bench not connected, or another port has the HIL stream",
        ],
        (_, "px4-sitl") => &[
            "its start-up waits for the first HIL_SENSOR: nothing reaches it",
            "a module in its lockstep stands still (EKF2, logger): its console names it",
            "the airframe is none for the simulator (SYS_AUTOSTART, PWM_MAIN_FUNC1 and on)",
            "HIL_SENSOR comes faster than it samples: IMU_INTEG_RATE, or --sensor-hz 250",
            "this is its ground-station port, not the simulator's 4560 plus instance",
        ],
        _ => &[
            "the flight controller's simulator interface is not running or listens on another port",
            "it does not stream message 93: ask for it by SET_MESSAGE_INTERVAL, or raise the link's rate",
            "it waits for a message that this profile does not send: --profile px4-sitl or px4-hitl",
            "it filters by system id: the bench is system 1, component 200",
            "its HIL mode is off",
        ],
    };
    let numbered: Vec<String> =
        causes.iter().enumerate().map(|(i, cause)| format!("{}. {cause}", i + 1)).collect();
    format!("known causes: {}", numbered.join("; "))
}

fn list<T: std::fmt::Display>(items: &[T]) -> String {
    if items.is_empty() {
        return "none".to_owned();
    }
    items.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

fn port_text(port: &Port) -> String {
    let name = port.by_id.as_ref().map_or(String::new(), |name| format!(" = {}", name.display()));
    let shut = match (port.may_open, &port.group) {
        (true, _) => String::new(),
        (false, Some(group)) => format!(", not for this user (group {group})"),
        (false, None) => ", not for this user".to_owned(),
    };
    format!("{}{name}{shut}", port.path.display())
}
