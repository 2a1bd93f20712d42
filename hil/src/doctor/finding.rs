//! Everything that can be found, in words: what was seen, why it happens, what to do.

use crate::wire::mavlink::Counters;
use crate::wire::port::{Holder, Port};

/// How bad it is, in rising order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// As it should be.
    Ok,
    /// Works, but not as well as it could, or not for long.
    Warning,
    /// Does not work.
    Error,
}

/// A finding in words.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Explanation {
    /// How bad it is.
    pub severity: Severity,
    /// The cause, one word for scripts.
    pub name: &'static str,
    /// What was seen, with figures.
    pub seen: String,
    /// Why it happens.
    pub why: String,
    /// What to do.
    pub fix: String,
}

/// A system and a component.
pub type Id = (u8, u8);

/// One cause. The fields are what was seen.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)]
pub enum Finding {
    // The link does not open.
    NoPort {
        path: String,
        present: Vec<String>,
    },
    PermissionDenied {
        path: String,
        group: Option<String>,
    },
    PortBusy {
        path: String,
        cause: String,
    },
    AddressInUse {
        link: String,
    },
    CannotOpen {
        link: String,
        cause: String,
    },
    // Nobody, or nothing useful, at the other end.
    NobodyThere {
        link: String,
        listened_s: f64,
    },
    NoBytes {
        link: String,
        listened_s: f64,
    },
    WrongBaud {
        bytes: u64,
        baud: u32,
    },
    NoMavlink {
        bytes: u64,
        text: Option<String>,
    },
    Mavlink1 {
        frames: u64,
        of: u64,
    },
    // The link is bad.
    PortShared {
        holders: Vec<Holder>,
    },
    SecondClient {
        names: Vec<String>,
    },
    LinkLost {
        whys: Vec<String>,
    },
    NotTaken {
        writes: u64,
    },
    Damaged {
        counters: Counters,
    },
    SequenceGaps {
        lost: u64,
        frames: u64,
    },
    WireOverload {
        baud: u32,
        sensor_hz: f64,
        out_percent: f64,
        back_percent: f64,
        fitting_hz: Option<f64>,
        refused: bool,
    },
    // Who speaks.
    OurSystemId {
        id: Id,
        frames: u64,
    },
    TwoControllers {
        ids: Vec<Id>,
    },
    SharedSystemId {
        id: Id,
        backward: u64,
        frames: u64,
    },
    NoFlightController {
        ids: Vec<Id>,
    },
    // The flight controller.
    NoHeartbeat {
        id: Id,
    },
    HilFlagMissing {
        id: Id,
        heartbeats: u64,
    },
    ArmedAlready {
        id: Id,
    },
    NoControls {
        id: Id,
        autopilot: u8,
        heartbeats: u64,
        sensors_sent: u64,
        profile: &'static str,
    },
    DataRateTooLow {
        controls_hz: f64,
        bytes_per_s: f64,
    },
    ClockJumps {
        jumps: u64,
        worst_s: f64,
    },
    Heard {
        id: Id,
        hil: bool,
        heartbeats: u64,
        controls_hz: f64,
        sensors_sent: u64,
    },
    // What its channels do.
    ChannelsUnread {
        channels: Vec<String>,
    },
    ChannelsStill {
        channels: Vec<String>,
    },
    ControlsStill {
        frames: u64,
    },
    NotANumber {
        name: &'static str,
        index: usize,
    },
    OutOfRange {
        name: &'static str,
        index: usize,
        least: f64,
        greatest: f64,
        range: [f64; 2],
    },
    // The machine.
    Cpus {
        count: usize,
    },
    ClockSource {
        name: String,
    },
    Sleep {
        median_us: f64,
        worst_us: f64,
        slack_ns: Option<u64>,
    },
    Priority {
        limit: Option<u64>,
        root: bool,
    },
    MemoryLock {
        limit_bytes: Option<u64>,
    },
    Governor {
        name: String,
    },
    Ports {
        ports: Vec<Port>,
    },
    NotInGroup {
        group: String,
    },
    ModemManager {
        pid: u32,
    },
}

/// MAV_AUTOPILOT_ARDUPILOTMEGA
const ARDUPILOT: u8 = 3;

impl Finding {
    /// How bad it is.
    pub fn severity(&self) -> Severity {
        self.explanation().severity
    }

    /// The cause, one word for scripts.
    pub fn name(&self) -> &'static str {
        self.explanation().name
    }

    /// In words. One list, read top to bottom.
    pub fn explanation(&self) -> Explanation {
        use Severity::{Error, Ok, Warning};
        let of = |severity, name, seen: String, why: &str, fix: String| Explanation {
            severity,
            name,
            seen,
            why: why.to_owned(),
            fix,
        };
        match self {
            Self::NoPort { path, present } => of(
                Error,
                "no_port",
                format!("there is no {path}; present: {}", listed(present)),
                "the board is not plugged in, has no power, or got another number",
                "plug it in and look at `dmesg`; name it by its link in /dev/serial/by-id, which keeps".to_owned(),
            ),
            Self::PermissionDenied { path, group } => {
                let group = group.as_deref().unwrap_or("dialout");
                of(
                    Error,
                    "permission_denied",
                    format!("{path} may not be opened by this user; its group is {group}"),
                    "serial ports belong to a group that this user is not in",
                    format!("sudo usermod -aG {group} $USER, then log out and in again"),
                )
            }
            Self::PortBusy { path, cause } => of(
                Error,
                "port_busy",
                format!("{path}: {cause}"),
                "a port has one user at a time, and another program was first",
                "end that program; ModemManager: sudo systemctl stop ModemManager; a ground station: \
                 let it use another port of the board"
                    .to_owned(),
            ),
            Self::AddressInUse { link } => of(
                Error,
                "address_in_use",
                format!("{link}: the port is taken"),
                "another program listens there, perhaps another bench or a simulator",
                "end it (`ss -lptu` names it), or listen on another port".to_owned(),
            ),
            Self::CannotOpen { link, cause } => of(
                Error,
                "cannot_open",
                format!("{link}: {cause}"),
                "the system refuses it",
                "check the path, the host and the rate of the link".to_owned(),
            ),
            Self::NobodyThere { link, listened_s } => of(
                Error,
                "nobody_there",
                format!("nobody came to {link} in {listened_s:.1} s"),
                "the other end does not run, uses another address or port, or a firewall is between",
                "start it; PX4 in software dials 4560 plus its instance; a listener on another machine needs \
                 its address, not the loopback"
                    .to_owned(),
            ),
            Self::NoBytes { link, listened_s } => of(
                Error,
                "no_bytes",
                format!("not one byte on {link} in {listened_s:.1} s"),
                "the flight controller has no power, RX and TX are not crossed, ground is missing, or this is a \
                 port without MAVLink",
                "check power and wiring; PX4: MAV_0_CONFIG to MAV_2_CONFIG name the ports with MAVLink; USB \
                 opens once it hears a heartbeat, which was sent"
                    .to_owned(),
            ),
            Self::WrongBaud { bytes, baud } => of(
                Error,
                "wrong_baud",
                format!("{bytes} bytes at {baud} baud, no MAVLink frame and no text in them"),
                "at another rate than the sender's, bits are read as other bits",
                "take the sender's rate: PX4 SER_TEL1_BAUD and its kin; 57600, 115200 and 921600 are usual".to_owned(),
            ),
            Self::NoMavlink { bytes, text } => of(
                Error,
                "no_mavlink",
                match text {
                    Some(text) => format!("{bytes} bytes of text, no MAVLink frame: {text:?}"),
                    None => format!("{bytes} bytes, no MAVLink frame in them"),
                },
                "another protocol speaks here: a console, a satellite receiver, another program",
                "choose the port on which the flight controller speaks MAVLink".to_owned(),
            ),
            Self::Mavlink1 { frames, of: all } => of(
                Warning,
                "mavlink_1",
                format!("{frames} of {all} frames are MAVLink 1"),
                "the flight controller is set to version 1, or has not yet heard version 2; the bench reads both \
                 and speaks 2",
                "PX4: MAV_PROTO_VER 2; pymavlink: MAVLINK20=1".to_owned(),
            ),
            Self::PortShared { holders } => of(
                Warning,
                "port_shared",
                format!("the port is also open in {}", listed(holders)),
                "it was opened without a lock; two readers each get a part of the bytes",
                "end the other program".to_owned(),
            ),
            Self::SecondClient { names } => of(
                Error,
                "second_client",
                format!("{} was turned away", listed(names)),
                "one flight controller at a time; a second program sends to the same address",
                "end it, or give it a port of its own".to_owned(),
            ),
            Self::LinkLost { whys } => of(
                Error,
                "link_lost",
                format!("the link broke {} times: {}", whys.len(), listed(whys)),
                "a loose plug, a board that reboots or browns out, or a program that ended",
                "look at `dmesg`; give the board power of its own".to_owned(),
            ),
            Self::NotTaken { writes } => of(
                Warning,
                "not_taken",
                format!("{writes} writes were not taken by the other end"),
                "it does not read, or the line is slower than what is sent",
                "lower --sensor-hz; check that the other program runs".to_owned(),
            ),
            Self::Damaged { counters: Counters { frames, crc_errors, skipped_bytes, .. } } => of(
                if crc_errors * 20 > *frames { Error } else { Warning },
                "damaged",
                format!("{crc_errors} damaged frames beside {frames} good ones, {skipped_bytes} bytes in no frame"),
                "noise on the line, bytes lost in a full buffer, a rate that is a little off, or two writers",
                "shorter wires with ground, flow control or a lower rate; MAVLink's own dialect must be `common`".to_owned(),
            ),
            Self::SequenceGaps { lost, frames } => of(
                Warning,
                "sequence_gaps",
                format!("{lost} frames missing by their counters, {frames} came"),
                "a line or a radio that is too slow, a buffer that overflows, or packets lost on the way",
                "raise the rate of the line, lower the sender's streams".to_owned(),
            ),
            Self::WireOverload { baud, sensor_hz, out_percent, back_percent, fitting_hz, refused } => of(
                if *refused || *back_percent > 90.0 { Error } else { Warning },
                "wire_overload",
                format!(
                    "of {baud} baud, HIL_SENSOR at {sensor_hz:.0} Hz and what goes with it take {out_percent:.0} %, \
                     200 Hz of controls {back_percent:.0} % of the way back"
                ),
                "above 70 % queues build up, above 90 % samples come later and later",
                match fitting_hz {
                    Some(hz) => format!("--sensor-hz {hz:.0}, or 921600 baud"),
                    None => "921600 baud".to_owned(),
                },
            ),
            Self::OurSystemId { id, frames } => of(
                Error,
                "our_system_id",
                format!("{frames} frames from {}, which is the bench's own name", name_of(*id)),
                "another simulator is on the link, or an echo: RX and TX tied together, a terminal that echoes",
                "end the other simulator; break the loop".to_owned(),
            ),
            Self::TwoControllers { ids } => of(
                Error,
                "two_controllers",
                format!("{} speak as flight controllers", listed(&names_of(ids))),
                "two autopilots share the link, or one is forwarded into it",
                "leave one of them; end the forwarding".to_owned(),
            ),
            Self::SharedSystemId { id, backward, frames } => of(
                Error,
                "shared_system_id",
                format!("the counter of {} went back in {backward} of {frames} frames", name_of(*id)),
                "two programs speak under one system and component",
                "give each a name of its own: PX4 MAV_SYS_ID, pymavlink source_system".to_owned(),
            ),
            Self::NoFlightController { ids } => of(
                Error,
                "no_flight_controller",
                format!("MAVLink from {}, but no flight controller's HEARTBEAT or controls", listed(&names_of(ids))),
                "a ground station, a camera or a companion speaks here; an autopilot is component 1",
                "connect the flight controller itself".to_owned(),
            ),
            Self::NoHeartbeat { id } => of(
                Error,
                "no_heartbeat",
                format!("controls but no HEARTBEAT from {}", name_of(*id)),
                "without it nobody knows whether the board is in the loop, and its outputs may be live",
                "enable HEARTBEAT on this link".to_owned(),
            ),
            Self::HilFlagMissing { id, heartbeats } => of(
                Error,
                "hil_flag_missing",
                format!("{heartbeats} HEARTBEAT from {}, none with the HIL flag", name_of(*id)),
                "the board flies for real: its outputs are live, and it would mix these samples with its own sensors",
                "PX4: SYS_HITL 1 and a HITL airframe, then reboot; the bench sends nothing but heartbeats until then".to_owned(),
            ),
            Self::ArmedAlready { id } => of(
                Error,
                "armed_already",
                format!("{} is armed", name_of(*id)),
                "a run begins disarmed: the first armed frame releases the vehicle at once",
                "disarm it; keep igniter and oxidiser disconnected".to_owned(),
            ),
            Self::NoControls { id, autopilot, heartbeats, sensors_sent, profile } => Explanation {
                severity: Error,
                name: "no_controls",
                seen: format!(
                    "{heartbeats} HEARTBEAT from {} (autopilot {autopilot}) but no HIL_ACTUATOR_CONTROLS; \
                     {sensors_sent} HIL_SENSOR were sent",
                    name_of(*id)
                ),
                why: no_controls_why(*autopilot, profile),
                fix: "go through the causes in this order; `mavlink status` and `listener actuator_outputs_sim` on \
                      the board's console show which it is"
                    .to_owned(),
            },
            Self::DataRateTooLow { controls_hz, bytes_per_s } => of(
                if *controls_hz < 5.0 { Error } else { Warning },
                "data_rate_too_low",
                format!("HIL_ACTUATOR_CONTROLS at {controls_hz:.1} Hz, {bytes_per_s:.0} byte/s in all"),
                "the link is set to too low a rate: PX4 sends controls only above 5000 byte/s, and its default for \
                 a telemetry port is 1200; below 5 Hz a controller counts as lost",
                "PX4: MAV_0_RATE (or of that port) 100000 and reboot; 921600 baud; USB needs nothing".to_owned(),
            ),
            Self::ClockJumps { jumps, worst_s } => of(
                Warning,
                "clock_jumps",
                format!("time_usec jumped {jumps} times against this machine's clock, worst {worst_s:+.3} s"),
                "the board rebooted, its time was set, or two controllers answer in turn",
                "let it answer with the time of the HIL_SENSOR, or with a clock that only goes forward".to_owned(),
            ),
            Self::Heard { id, hil, heartbeats, controls_hz, sensors_sent } => of(
                Ok,
                "controls",
                format!(
                    "HIL_ACTUATOR_CONTROLS at {controls_hz:.0} Hz from {}, {heartbeats} HEARTBEAT, HIL flag {}; \
                     {sensors_sent} HIL_SENSOR were sent",
                    name_of(*id),
                    if *hil { "set" } else { "not set" }
                ),
                "",
                String::new(),
            ),
            Self::ChannelsUnread { channels } => of(
                Warning,
                "channels_unread",
                format!("the flight controller moves controls[] {}, and nobody reads them", listed(channels)),
                "the map of the vehicle file and the outputs of the flight controller differ; igniter and valves are \
                 read only with sequence.source = \"controls\"",
                "[controls.channels] of the vehicle file, or the output functions (PX4: HIL_ACT_FUNC1 and on)".to_owned(),
            ),
            Self::ChannelsStill { channels } => of(
                Warning,
                "channels_still",
                format!("controls[] {} never moved while others did", listed(channels)),
                "no output of the flight controller is assigned to them, or a controller does not run",
                "[controls.channels] of the vehicle file, or the output functions (PX4: HIL_ACT_FUNC1 and on)".to_owned(),
            ),
            Self::ControlsStill { frames } => of(
                Ok,
                "controls_still",
                format!("all sixteen controls stood still in {frames} frames"),
                "a disarmed controller holds its outputs; that says nothing about the map of channels",
                "move sticks or servos, or fly the hop, to see them move".to_owned(),
            ),
            Self::NotANumber { name, index } => of(
                Warning,
                "not_a_number",
                format!("controls[{index}], {name}, holds no number"),
                "an output without a function; armed, a frame with it is refused and the last command holds",
                "assign a function to that output".to_owned(),
            ),
            Self::OutOfRange { name, index, least, greatest, range: [low, high] } => of(
                Warning,
                "out_of_range",
                format!("controls[{index}], {name}, runs from {least} to {greatest}; its range is {low} to {high}"),
                "the flight controller speaks another unit (pulse widths, degrees); what is beyond is clamped",
                format!("range = [{least}, {greatest}] in [controls.channels.{name}], if that is its unit"),
            ),
            Self::Cpus { count } => of(
                if *count < 2 { Warning } else { Ok },
                "cpus",
                format!("{count} processors"),
                "the stepping thread wants one, everything else another",
                "two or more".to_owned(),
            ),
            Self::ClockSource { name } => of(
                if matches!(name.as_str(), "tsc" | "arch_sys_counter" | "kvm-clock") { Ok } else { Warning },
                "clock_source",
                format!("the clock is read from {name}"),
                "reading another source takes microseconds each time",
                "boot with tsc=reliable if the processor has an invariant one".to_owned(),
            ),
            Self::Sleep { median_us, worst_us, slack_ns } => of(
                if *worst_us > 1000.0 { Warning } else { Ok },
                "sleep",
                format!(
                    "100 sleeps of 1 ms end {median_us:.0} us late (median), {worst_us:.0} us at worst; timer slack {}",
                    slack_ns.map_or("unknown".to_owned(), |ns| format!("{:.0} us", ns as f64 / 1e3))
                ),
                "other work on the machine, power saving, a virtual machine",
                "leave the machine alone during a run; a kernel with PREEMPT_RT".to_owned(),
            ),
            Self::Priority { limit, root } => of(
                if *root || limit.is_none_or(|limit| limit > 0) { Ok } else { Warning },
                "priority",
                match (root, limit) {
                    (true, _) => "real-time priority: root may use it".to_owned(),
                    (false, None) => "real-time priority: up to 99".to_owned(),
                    (false, Some(limit)) => format!("real-time priority: up to {limit}"),
                },
                "without it any other program may hold up the stepping thread",
                "a line `@dialout - rtprio 80` in /etc/security/limits.d/hopbench.conf, then log in again".to_owned(),
            ),
            Self::MemoryLock { limit_bytes } => of(
                if limit_bytes.is_none_or(|bytes| bytes >= 64 << 20) { Ok } else { Warning },
                "memory_lock",
                match limit_bytes {
                    None => "memory may be locked without limit".to_owned(),
                    Some(bytes) => format!("{:.0} MB of memory may be locked", *bytes as f64 / 1e6),
                },
                "memory that is paged out in mid-run costs milliseconds",
                "a line `@dialout - memlock unlimited` in /etc/security/limits.d/hopbench.conf".to_owned(),
            ),
            Self::Governor { name } => of(
                if name == "performance" { Ok } else { Warning },
                "governor",
                format!("processors run under the governor {name}"),
                "a processor that has slowed down wakes up late",
                "sudo cpupower frequency-set -g performance".to_owned(),
            ),
            Self::Ports { ports } => {
                let shut = ports.iter().any(|port| !port.may_open);
                of(
                    if shut { Warning } else { Ok },
                    "ports",
                    match ports.is_empty() {
                        true => "no serial port is present".to_owned(),
                        false => format!("serial ports: {}", ports.iter().map(described).collect::<Vec<_>>().join(", ")),
                    },
                    "a port opens for its owner and its group",
                    "name a board by its link in /dev/serial/by-id, which keeps; sudo usermod -aG dialout $USER".to_owned(),
                )
            }
            Self::NotInGroup { group } => of(
                Warning,
                "not_in_group",
                format!("this user is not in the group {group}"),
                "serial ports belong to it",
                format!("sudo usermod -aG {group} $USER, then log out and in again"),
            ),
            Self::ModemManager { pid } => of(
                Warning,
                "modem_manager",
                format!("ModemManager runs (process {pid})"),
                "it opens every new serial port for some seconds and writes modem commands to it",
                "sudo systemctl disable --now ModemManager".to_owned(),
            ),
        }
    }
}

/// The known causes of heartbeats without controls, those first that fit.
fn no_controls_why(autopilot: u8, profile: &str) -> String {
    let causes: &[&str] = match (autopilot, profile) {
        (ARDUPILOT, _) => &["this is an ArduPilot, which knows neither HIL_SENSOR nor HIL_ACTUATOR_CONTROLS"],
        (_, "px4-hitl") => &[
            "HITL is not enabled, or the board was not rebooted since (SYS_HITL 1)",
            "the link's rate is 5000 byte/s or less (MAV_0_RATE, default 1200), or this port is in another mode",
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

fn listed<T: std::fmt::Display>(items: &[T]) -> String {
    if items.is_empty() {
        return "none".to_owned();
    }
    items.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

fn name_of((system, component): Id) -> String {
    format!("{system}/{component}")
}

fn names_of(ids: &[Id]) -> Vec<String> {
    ids.iter().map(|id| name_of(*id)).collect()
}

fn described(port: &Port) -> String {
    let name = port.by_id.as_ref().map_or(String::new(), |name| format!(" = {}", name.display()));
    let shut = match (port.may_open, &port.group) {
        (true, _) => String::new(),
        (false, Some(group)) => format!(", not for this user (group {group})"),
        (false, None) => ", not for this user".to_owned(),
    };
    format!("{}{name}{shut}", port.path.display())
}
