//! `hopbench doctor`: each cause is made on a real link, and named by the real command.
#![allow(clippy::disallowed_methods, reason = "runs the program and reads what it says")]

use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use hopbench_hil::doctor::{Machine, Severity, diagnose_machine};
use hopbench_hil::wire::link::Link;
use hopbench_hil::wire::mavlink::{
    ControlsFrame, Decoder, Encoder, MavMessage, actuator_controls, heartbeat,
};
use hopbench_hil::wire::port::Port;

use crate::fixture::terminal::{Terminal, controls};

const DISARMED: u8 = 0x01;
const ARMED: u8 = 0x81;
const HIL: u8 = 0x21;

/// What the command found.
struct Report {
    code: i32,
    text: String,
    findings: Vec<(String, String, String)>,
}

impl Report {
    fn names(&self) -> Vec<&str> {
        self.findings.iter().map(|(name, _, _)| name.as_str()).collect()
    }

    /// What was seen of this cause, and why it happens; the test fails without it.
    fn of(&self, name: &str) -> &str {
        let found = self.findings.iter().find(|(found, _, _)| found == name);
        &found.unwrap_or_else(|| panic!("no {name} in {}", self.text)).2
    }

    fn error(&self, name: &str) -> &str {
        assert_eq!(self.code, 3, "{}", self.text);
        let found = self.findings.iter().find(|(found, _, _)| found == name);
        assert_eq!(found.map(|(_, severity, _)| severity.as_str()), Some("error"), "{name}: {}", self.text);
        self.of(name)
    }

    fn warning(&self, name: &str) -> &str {
        let found = self.findings.iter().find(|(found, _, _)| found == name);
        assert_eq!(found.map(|(_, severity, _)| severity.as_str()), Some("warning"), "{name}: {}", self.text);
        self.of(name)
    }
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hopbench"));
    command.args(["doctor", "--json"]).args(arguments);
    command
}

fn report(command: &mut Command) -> Report {
    let done = command.output().unwrap();
    let text = String::from_utf8_lossy(&done.stdout).into_owned() + &String::from_utf8_lossy(&done.stderr);
    let json: serde_json::Value =
        serde_json::from_slice(&done.stdout).unwrap_or_else(|e| panic!("{e}: {text}"));
    let findings = json["findings"].as_array().unwrap().iter().map(|finding| {
        let word = |key: &str| finding[key].as_str().unwrap().to_owned();
        if finding["severity"] != "ok" {
            assert!(!word("why").is_empty() && !word("fix").is_empty(), "{finding}");
        }
        (word("name"), word("severity"), format!("{}; {}", word("seen"), word("why")))
    });
    Report { code: done.status.code().unwrap(), findings: findings.collect(), text }
}

fn doctor(arguments: &[&str]) -> Report {
    report(&mut command(arguments))
}

/// The command on a serial port, while `speak` adds to what the board says, 200 times a second; also what
/// the board heard.
fn with_board(
    arguments: &[&str],
    mut speak: impl FnMut(u64, &[u8], &mut Vec<u8>) + Send,
) -> (Report, Vec<u8>) {
    let mut port = Terminal::new();
    let link = port.link();
    let done = AtomicBool::new(false);
    std::thread::scope(|threads| {
        let board = threads.spawn(|| {
            let mut all = Vec::new();
            let mut tick = 0;
            while !done.load(Ordering::Relaxed) {
                let (mut heard, mut said) = (Vec::new(), Vec::new());
                port.read(&mut heard);
                speak(tick, &heard, &mut said);
                port.write(&said);
                all.extend(heard);
                tick += 1;
                std::thread::sleep(Duration::from_millis(5));
            }
            all
        });
        let all = [&["--fc", &link, "--listen-s", "1.5"], arguments].concat();
        let report = std::panic::catch_unwind(|| doctor(&all));
        done.store(true, Ordering::Relaxed);
        let heard = board.join().unwrap();
        (report.unwrap_or_else(|failure| std::panic::resume_unwind(failure)), heard)
    })
}

/// A board that sends a HEARTBEAT now and then, and controls at every tick.
fn flying(
    mode: u8,
    mut controls_of: impl FnMut(u64) -> Option<MavMessage> + Send,
) -> impl FnMut(u64, &[u8], &mut Vec<u8>) + Send {
    let mut encoder = Encoder::new(1, 1);
    move |tick, _, said| {
        if tick % 20 == 0 {
            encoder.encode(&heartbeat(mode), said);
        }
        if let Some(message) = controls_of(tick) {
            encoder.encode(&message, said);
        }
    }
}

/// Channels that move within their ranges.
fn swaying(tick: u64) -> [f64; 4] {
    let sway = (tick % 10) as f64 * 0.02;
    [0.5 + sway, sway, -sway, sway]
}

const GENERIC: [&str; 2] = ["--profile", "generic"];
const SCENARIO: [&str; 4] = [
    "--profile",
    "generic",
    "--scenario",
    concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/hover_5m.toml"),
];

// ------------------------------------------------------------------------------- links that do not open

#[test]
fn no_port() {
    doctor(&["--fc", "serial:/dev/no-such-tty:921600"]).error("no_port");
}

#[test]
fn permission_denied() {
    let port = Terminal::new();
    std::fs::set_permissions(&port.path, std::fs::Permissions::from_mode(0o000)).unwrap();
    let link = port.link();
    let mut command = command(&["--fc", &link]);
    if rustix::process::geteuid().is_root() {
        command.uid(65534); // nobody: root may open anything
    }
    let report = report(&mut command);
    assert!(report.error("permission_denied").contains(&port.path));
    assert!(report.text.contains("usermod -aG"), "{}", report.text);
}

#[test]
fn port_busy_and_by_whom() {
    let port = Terminal::new();
    let _first = Link::open(&port.link().parse().unwrap()).unwrap();
    let report = doctor(&["--fc", &port.link()]);
    let who = format!("(process {})", std::process::id());
    assert!(report.error("port_busy").contains(&who), "{}", report.text);
}

#[test]
fn port_shared_with_a_program_that_takes_no_lock() {
    let port = Terminal::new();
    let _other = std::fs::File::open(&port.path).unwrap();
    let report = doctor(&["--fc", &port.link(), "--listen-s", "0.2"]);
    let who = format!("(process {})", std::process::id());
    assert!(report.warning("port_shared").contains(&who), "{}", report.text);
}

#[test]
fn address_in_use_and_an_address_that_is_not_ours() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let _listener = TcpListener::bind(taken).unwrap();
    doctor(&["--fc", &format!("tcp-listen:{taken}")]).error("address_in_use");
    doctor(&["--fc", "udp-listen:192.0.2.1:14550"]).error("cannot_open");
}

// ------------------------------------------------------------------------------- nothing useful comes

#[test]
fn nobody_there_and_no_bytes() {
    doctor(&["--fc", "tcp-listen:0", "--listen-s", "0.3"]).error("nobody_there");
    let port = Terminal::new();
    doctor(&["--fc", &port.link(), "--listen-s", "0.3"]).error("no_bytes");
}

#[test]
fn wrong_baud() {
    // What a UART makes of another rate: no text, no frame.
    let mut state = 1u32;
    let (report, _) = with_board(&[], |_, _, said| {
        for _ in 0..20 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            said.push(0x80 | (state >> 24) as u8 & 0x7C);
        }
    });
    assert!(report.error("wrong_baud").contains("921600"), "{}", report.text);
}

#[test]
fn bytes_but_no_mavlink() {
    let (report, _) = with_board(&[], |_, _, said| said.extend(b"nsh> ver all\r\n"));
    assert!(report.error("no_mavlink").contains("nsh>"), "{}", report.text);
}

#[test]
fn mavlink_1() {
    let mut sequence = 0u8;
    let (report, _) = with_board(&GENERIC, |tick, _, said| {
        let mut raw = ::mavlink::MAVLinkV1MessageRaw::new();
        let header = ::mavlink::MavHeader { system_id: 1, component_id: 1, sequence };
        raw.serialize_message(header, &controls(tick * 5000, DISARMED, swaying(tick)));
        sequence = sequence.wrapping_add(1);
        said.extend_from_slice(raw.raw_bytes());
    });
    report.warning("mavlink_1");
}

// ------------------------------------------------------------------------------- a bad link

#[test]
fn a_second_client_is_named() {
    let place = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let done = AtomicBool::new(false);
    let report = std::thread::scope(|threads| {
        threads.spawn(|| {
            let both = [UdpSocket::bind("127.0.0.1:0").unwrap(), UdpSocket::bind("127.0.0.1:0").unwrap()];
            while !done.load(Ordering::Relaxed) {
                for socket in &both {
                    let _ = socket.send_to(b"hello", place);
                }
                std::thread::sleep(Duration::from_millis(10));
            }
        });
        let report = doctor(&["--fc", &format!("udp-listen:{place}"), "--listen-s", "1"]);
        done.store(true, Ordering::Relaxed);
        report
    });
    assert!(report.error("second_client").contains("127.0.0.1:"), "{}", report.text);
}

#[test]
fn a_link_that_breaks() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let link = format!("tcp:{}", listener.local_addr().unwrap());
    let report = std::thread::scope(|threads| {
        threads.spawn(|| drop(listener.accept()));
        doctor(&["--fc", &link, "--listen-s", "1.5"])
    });
    report.error("link_lost");
}

#[test]
fn writes_that_are_not_taken() {
    // Nobody reads the master's end: 77 bytes at 1 kHz fill every queue on the way within a second.
    let port = Terminal::new();
    let report =
        doctor(&["--fc", &port.link(), "--profile", "generic", "--sensor-hz", "1000", "--listen-s", "4"]);
    report.warning("not_taken");
}

#[test]
fn damage_and_gaps() {
    let mut encoder = Encoder::new(1, 1);
    let (report, _) = with_board(&GENERIC, |tick, _, said| {
        let start = said.len();
        encoder.encode(&controls(tick * 5000, DISARMED, swaying(tick)), said);
        if tick % 4 == 1 {
            said[start + 20] ^= 0x55;
        }
    });
    report.error("damaged");
    report.warning("sequence_gaps");
}

#[test]
fn wire_overload() {
    let port = Terminal::new();
    let link = format!("serial:{}:57600", port.path);
    let report = doctor(&["--fc", &link, "--listen-s", "0.2"]);
    assert!(report.error("wire_overload").contains('%'), "{}", report.text);
}

// ------------------------------------------------------------------------------- who speaks

#[test]
fn names_that_clash() {
    let mut own = Encoder::new(1, 200);
    let (report, _) = with_board(&GENERIC, |_, _, said| own.encode(&heartbeat(0), said));
    report.error("our_system_id");
    report.error("no_flight_controller");

    let (mut first, mut second) = (Encoder::new(1, 1), Encoder::new(2, 1));
    let (report, _) = with_board(&GENERIC, |_, _, said| {
        first.encode(&heartbeat(DISARMED), said);
        second.encode(&heartbeat(DISARMED), said);
    });
    assert!(report.error("two_controllers").contains("1/1, 2/1"), "{}", report.text);

    // Two programs under one name: their counters are a quarter of the circle apart.
    let (mut first, mut second) = (Encoder::new(1, 1), Encoder::new(1, 1));
    (0..64).for_each(|_| second.encode(&heartbeat(DISARMED), &mut Vec::new()));
    let (report, _) = with_board(&GENERIC, |_, _, said| {
        first.encode(&heartbeat(DISARMED), said);
        second.encode(&heartbeat(DISARMED), said);
    });
    report.error("shared_system_id");
}

// ------------------------------------------------------------------------------- the flight controller

#[test]
fn a_board_that_is_not_in_the_loop_gets_nothing_but_heartbeats() {
    let (report, heard) = with_board(&[], flying(DISARMED, |_| None));
    report.error("hil_flag_missing");
    let mut decoder = Decoder::default();
    decoder.push(&heard);
    let ids: Vec<u32> = std::iter::from_fn(|| decoder.next_frame()).map(|frame| frame.message_id).collect();
    assert!(!ids.is_empty() && ids.iter().all(|id| *id == 0), "{ids:?}");
}

#[test]
fn heartbeats_but_no_controls_print_the_known_causes() {
    let (report, heard) = with_board(&[], flying(HIL, |_| None));
    let causes = report.error("no_controls");
    for cause in ["SYS_HITL", "MAV_0_RATE", "pwm_out_sim", "HIL_ACT_FUNC", "HIL_SENSOR"] {
        assert!(causes.contains(cause), "{cause}: {causes}");
    }
    // A link at PX4's default rate carries heartbeats and no more.
    report.error("data_rate_too_low");
    // In the loop, it was sent samples to answer.
    let mut decoder = Decoder::default();
    decoder.push(&heard);
    let mut frames = std::iter::from_fn(|| decoder.next_frame());
    assert!(frames.any(|frame| matches!(frame.message(), Some(MavMessage::HIL_SENSOR(_)))));

    let (report, _) = with_board(&GENERIC, flying(DISARMED, |_| None));
    assert!(report.error("no_controls").contains("SET_MESSAGE_INTERVAL"), "{}", report.text);
}

#[test]
fn controls_without_heartbeat() {
    let mut encoder = Encoder::new(1, 1);
    let (report, _) = with_board(&[], |tick, _, said| {
        encoder.encode(&controls(tick * 5000, HIL, swaying(tick)), said);
    });
    report.error("no_heartbeat");
}

#[test]
fn armed_already() {
    let (report, _) = with_board(&GENERIC, flying(ARMED, |tick| Some(controls(0, ARMED, swaying(tick)))));
    report.error("armed_already");
}

#[test]
fn data_rate_too_low() {
    let slow = |tick| (tick % 20 == 0).then(|| controls(0, DISARMED, swaying(tick)));
    let (report, _) = with_board(&GENERIC, flying(DISARMED, slow));
    report.of("data_rate_too_low");
}

#[test]
fn clock_jumps() {
    // Its clock starts again from zero every 50 frames.
    let (report, _) = with_board(
        &GENERIC,
        flying(DISARMED, |tick| Some(controls(5000 * (tick % 50 + 1), DISARMED, swaying(tick)))),
    );
    assert!(report.warning("clock_jumps").contains("-0.2"), "{}", report.text);
}

#[test]
fn a_controller_that_answers_each_sample_is_in_order() {
    let (mut decoder, mut encoder) = (Decoder::default(), Encoder::new(1, 1));
    let (report, _) = with_board(&GENERIC, |tick, heard, said| {
        if tick % 50 == 0 {
            encoder.encode(&heartbeat(DISARMED), said);
        }
        decoder.push(heard);
        while let Some(frame) = decoder.next_frame() {
            if let Some(MavMessage::HIL_SENSOR(data)) = frame.message() {
                encoder.encode(&controls(data.time_usec, DISARMED, [0.0; 4]), said);
            }
        }
    });
    assert_eq!(report.code, 0, "{}", report.text);
    assert!(!report.names().contains(&"clock_jumps"), "{}", report.text);
}

// ------------------------------------------------------------------------------- channels

#[test]
fn channels_that_do_nothing() {
    let sways = |tick: u64| {
        let mut frame = ControlsFrame { time_us: 0, flags: 0, controls: [0.0; 16], mode: DISARMED };
        frame.controls[0] = swaying(tick)[0];
        // Channel 4 is the igniter, which an automatic sequence does not read; nobody reads 9.
        (frame.controls[4], frame.controls[9]) = (swaying(tick)[1], swaying(tick)[1]);
        Some(actuator_controls(&frame))
    };
    let (report, _) = with_board(&SCENARIO, flying(DISARMED, sways));
    assert!(report.warning("channels_unread").contains("4 (igniter), 9"), "{}", report.text);
    let still = report.warning("channels_still");
    assert!(still.contains("1 (gimbal_x), 2 (gimbal_y), 3 (rcs_roll)"), "{still}");
    assert_eq!(report.code, 0, "warnings alone: {}", report.text);
}

#[test]
fn channels_in_another_unit_or_without_a_number() {
    let pulses = |tick| {
        let sway = swaying(tick)[1] * 1000.0;
        Some(controls(0, DISARMED, [1500.0 + sway, 1500.0 - sway, f64::NAN, sway / 1000.0]))
    };
    let (report, _) = with_board(&SCENARIO, flying(DISARMED, pulses));
    assert!(report.warning("out_of_range").contains("throttle"), "{}", report.text);
    assert!(report.warning("not_a_number").contains("gimbal_y"), "{}", report.text);
}

#[test]
fn channels_that_stand_still_while_disarmed_say_nothing() {
    let (report, _) = with_board(&SCENARIO, flying(DISARMED, |_| Some(controls(0, DISARMED, [0.0; 4]))));
    report.of("controls_still");
    assert!(!report.names().contains(&"channels_still"), "{}", report.text);
}

// ------------------------------------------------------------------------------- the machine

#[test]
fn this_machine_is_looked_at_without_a_link() {
    let report = doctor(&[]);
    assert_eq!(report.code, 0, "{}", report.text);
    for name in ["cpus", "sleep", "priority", "memory_lock", "ports"] {
        report.of(name);
    }
}

#[test]
fn a_machine_that_is_not_fit_is_told_why() {
    let port = Port {
        path: "/dev/ttyACM0".into(),
        by_id: Some("/dev/serial/by-id/usb-Board".into()),
        group: Some("dialout".to_owned()),
        may_open: false,
    };
    let machine = Machine {
        cpus: 1,
        clock_source: Some("hpet".to_owned()),
        timer_slack_ns: Some(50_000),
        sleep_late_us: (60.0, 4000.0),
        priority_limit: Some(0),
        root: false,
        memory_lock_bytes: Some(65_536),
        governor: Some("powersave".to_owned()),
        ports: vec![port],
        in_dialout: Some(false),
        modem_manager: Some(812),
    };
    let fit = Machine {
        cpus: 4,
        clock_source: Some("tsc".to_owned()),
        sleep_late_us: (60.0, 200.0),
        priority_limit: None,
        memory_lock_bytes: None,
        governor: Some("performance".to_owned()),
        ports: Vec::new(),
        in_dialout: Some(true),
        modem_manager: None,
        ..machine.clone()
    };
    let warned = |machine: &Machine| {
        let findings = diagnose_machine(machine);
        let mut names: Vec<&str> =
            findings.iter().filter(|f| f.severity > Severity::Ok).map(|f| f.name).collect();
        names.sort_unstable();
        names
    };
    let all = [
        "clock_source",
        "cpus",
        "governor",
        "memory_lock",
        "modem_manager",
        "not_in_group",
        "ports",
        "priority",
        "sleep",
    ];
    assert_eq!(warned(&machine), all);
    assert_eq!(warned(&fit), [""; 0]);
}

#[test]
fn wrong_arguments_are_exit_2() {
    for arguments in [&["--fc", "carrier-pigeon:1"][..], &["--listen-s", "0"], &["--sensor-hz", "250"]] {
        let done = command(arguments).output().unwrap();
        assert_eq!(done.status.code(), Some(2), "{arguments:?}");
    }
}
