//! A serial port for real: rates, one user at a time, unplugged in flight and found again, a board that
//! reboots.

use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hopbench::simulation::{Flight, Instrumentation, Report};
use hopbench_hil::bench::live::Live;
use hopbench_hil::bench::{Bench, Options};
use hopbench_hil::wire::link::{Link, LinkSpec};
use hopbench_hil::wire::mavlink::{Decoder, Encoder, MavMessage, heartbeat};
use hopbench_hil::wire::profile::{GENERIC, PX4_HITL, Pacing, Profile};

use crate::fixture::peer::{lockstep, scenario};
use crate::fixture::terminal::{Board, Terminal};

fn open(text: &str) -> Link {
    Link::open(&text.parse::<LinkSpec>().unwrap()).unwrap()
}

/// A name that can be led to another port, as udev's links are.
struct Name(PathBuf);

impl Name {
    fn new(test: &str, port: &Terminal) -> Self {
        let name = std::env::temp_dir().join(format!("hopbench-{test}-{}", std::process::id()));
        let name = Self(name);
        name.lead_to(port);
        name
    }

    fn lead_to(&self, port: &Terminal) {
        let _ = std::fs::remove_file(&self.0);
        symlink(&port.path, &self.0).unwrap();
    }

    fn link(&self) -> String {
        format!("serial:{}:921600", self.0.display())
    }
}

impl Drop for Name {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// A run in real time on `link`, for as long as `board` acts.
fn run(link: &str, profile: &'static Profile, board: impl FnOnce()) -> Report {
    let options = Options { pacing: Pacing::RealTime, fast: false, baud: Some(921_600), ..lockstep(profile) };
    let (mut near, stop) = (open(link), AtomicBool::new(false));
    let mut flight = Flight::with(&scenario(&[]), 1, &Instrumentation::default()).unwrap();
    std::thread::scope(|threads| {
        let bench = threads.spawn(|| {
            let (timing, link) = Bench::new(&mut flight, &mut near, options, Live::silent()).run(&stop);
            let mut report = flight.report();
            report.require_fc();
            (report.timing, report.link) = (timing, Some(link));
            report
        });
        // A failed assertion must end the run too, or the scope would wait for ever.
        let acted = std::panic::catch_unwind(std::panic::AssertUnwindSafe(board));
        stop.store(true, Ordering::Relaxed);
        let report = bench.join().unwrap();
        if let Err(failure) = acted {
            std::panic::resume_unwind(failure);
        }
        report
    })
}

fn has_event(report: &Report, name: &str) -> bool {
    report.events.iter().any(|event| event.kind.name() == name)
}

#[test]
fn three_million_baud_carry_bytes_and_what_no_hardware_makes_is_refused_with_the_range() {
    let mut terminal = Terminal::new();
    let mut link = open(&format!("serial:{}:3000000", terminal.path));
    let sent: Vec<u8> = (0..=255).collect();
    link.send(&sent);
    let (mut got, deadline) = (Vec::new(), Instant::now() + Duration::from_secs(5));
    while got.len() < sent.len() && Instant::now() < deadline {
        link.receive(&mut Vec::new());
        terminal.read(&mut got);
    }
    assert_eq!(got, sent);
    let refused = "serial:/dev/ttyUSB0:12000001".parse::<LinkSpec>().unwrap_err().to_string();
    assert!(refused.contains("from 50 to 12000000"), "{refused}");
}

#[test]
fn a_port_in_use_names_who_uses_it() {
    let terminal = Terminal::new();
    let _first = open(&terminal.link());
    let busy = Link::open(&terminal.link().parse().unwrap()).unwrap_err();
    assert_eq!(busy.failure.kind, std::io::ErrorKind::ResourceBusy);
    let named = format!("(process {})", std::process::id());
    assert!(busy.to_string().contains("held by") && busy.to_string().contains(&named), "{busy}");
}

#[test]
fn whether_the_port_answers_quickly_and_is_found_again_is_said() {
    let terminal = Terminal::new();
    let link = open(&terminal.link());
    let settings = link.port_settings().unwrap();
    assert!(settings.contains("low-latency mode not offered"), "{settings}");
    assert!(settings.contains("/dev/serial/by-id") && settings.contains(&terminal.path), "{settings}");
}

#[test]
fn a_board_unplugged_in_flight_is_replaced_and_heard_again_when_it_is_back() {
    let mut board = Board::new();
    let name = Name::new("unplugged", &board.port);
    let mut back_us = 0;
    let report = run(&name.link(), &GENERIC, || {
        board.say(&heartbeat(0x01));
        for _ in 0..20 {
            let time_us = board.sensor_us();
            board.controls(time_us, 0x81, [0.5, 0.0, 0.0, 0.0]);
        }
        let last_us = board.sensor_us();
        board = Board::new(); // unplugged, and on another number
        std::thread::sleep(Duration::from_millis(400));
        name.lead_to(&board.port);
        back_us = board.sensor_us();
        // Simulated time went on: 200 ms of patience and the port's own 200 ms between two attempts.
        assert!(back_us > last_us + 200_000, "{last_us} to {back_us}");
        let time_us = board.sensor_us();
        board.controls(time_us, 0x81, [0.5, 0.0, 0.0, 0.0]);
        board.sensor_us();
    });
    assert!(has_event(&report, "fc_lost") && has_event(&report, "handover"), "{:#?}", report.events);
    // Its silence is counted, and was longer than the 400 ms without a plug.
    let link = report.link.unwrap();
    assert!(link.gaps >= 1 && link.longest_gap_ms.unwrap() > 400.0, "{link:?}");
    assert!(back_us > 0);
}

#[test]
fn a_board_that_reboots_on_the_pad_goes_on_where_it_was() {
    let mut board = Board::new();
    let link = board.port.link();
    let report = run(&link, &PX4_HITL, || {
        board.say(&heartbeat(0x21));
        for _ in 0..50 {
            let time_us = board.sensor_us();
            board.controls(time_us, 0x21, [0.0; 4]);
        }
        // Two seconds of silence; what was sent meanwhile is lost on it.
        let until = Instant::now() + Duration::from_secs(2);
        while Instant::now() < until {
            board.port.read(&mut Vec::new());
            std::thread::sleep(Duration::from_millis(10));
        }
        (board.encoder, board.decoder) = (Encoder::new(1, 1), Decoder::default());
        board.say(&heartbeat(0x21));
        let before_us = board.sensor_us();
        for _ in 0..50 {
            let time_us = board.sensor_us();
            board.controls(time_us, 0x21, [0.0; 4]);
        }
        // A busy machine may be behind, but its clock has gone on.
        assert!(before_us > 1_000_000, "{before_us}");
    });
    // Nothing was armed: nobody is lost, and a counter that begins anew is no gap.
    assert!(!has_event(&report, "fc_lost"), "{:#?}", report.events);
    let link = report.link.unwrap();
    assert_eq!((link.lost, link.crc_errors), (0, 0), "{link:?}");
    assert!(link.received >= 90, "{link:?}");
}

#[test]
fn a_board_that_leaves_the_loop_in_flight_gets_no_more_samples_and_is_replaced() {
    let mut board = Board::new();
    let link = board.port.link();
    let report = run(&link, &PX4_HITL, || {
        board.say(&heartbeat(0xA1));
        for _ in 0..20 {
            let time_us = board.sensor_us();
            board.controls(time_us, 0xA1, [0.5, 0.0, 0.0, 0.0]);
        }
        board.say(&heartbeat(0x81)); // armed, without the HIL flag
        // The samples that were under way end, while its controls go on.
        let (mut last_sample, deadline) = (Instant::now(), Instant::now() + Duration::from_secs(10));
        while last_sample.elapsed() < Duration::from_millis(500) {
            assert!(Instant::now() < deadline, "samples go on");
            board.controls(0, 0x81, [0.5, 0.0, 0.0, 0.0]);
            std::thread::sleep(Duration::from_millis(20));
            let mut bytes = Vec::new();
            board.port.read(&mut bytes);
            board.decoder.push(&bytes);
            while let Some(frame) = board.decoder.next_frame() {
                if matches!(frame.message(), Some(MavMessage::HIL_SENSOR(_))) {
                    last_sample = Instant::now();
                }
            }
        }
        // Heartbeats go on: it may come back.
        assert_eq!(board.hear(|message| Some(matches!(message, MavMessage::HEARTBEAT(_)))), Some(true));
    });
    assert!(has_event(&report, "handover"), "{:#?}", report.events);
}
