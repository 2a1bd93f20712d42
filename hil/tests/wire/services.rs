//! What a flight controller and a ground station ask of the bench, and what they get: over links in memory.

#![allow(clippy::disallowed_methods)] // a test reads the documentation

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hopbench::event::{AbortReason, EventKind};
use hopbench::fault::{Component, Mode, catalogue};
use hopbench::plant::column::{ARRAY, Column};
use hopbench::simulation::{Flight, Instrumentation, MODIFIED_KEPT, Report};
use hopbench_hil::bench::ground::{GROUND_ADDRESS, Ground};
use hopbench_hil::bench::live::Live;
use hopbench_hil::bench::parameter::parameters;
use hopbench_hil::bench::{Bench, Options};
use hopbench_hil::wire::link::Link;
use hopbench_hil::wire::mavlink::measurement::is_reset;
use hopbench_hil::wire::mavlink::{Address, Decoder, Encoder, MavMessage, heartbeat};
use hopbench_hil::wire::profile::{GENERIC, PX4_SITL, Pacing, SensorRates};
use hopbench_hil::wire::stream::Refusal;
use mavlink::dialects::common as dialect;

use crate::fixture::peer::{Fc, Then, lockstep, run, scenario};

const FC_SIDE: Address = Address { system: 1, component: 200 };

/// A machine under load answers late; that is not what these tests are about.
const PATIENT: &[&str] = &["fc_timeout_ms=10000"];

fn patient() -> Options {
    Options { lockstep_timeout: Duration::from_secs(5), ..lockstep(&GENERIC) }
}

fn command(to: Address, command: dialect::MavCmd, parameters: [f32; 3]) -> MavMessage {
    MavMessage::COMMAND_LONG(dialect::COMMAND_LONG_DATA {
        target_system: to.system,
        target_component: to.component,
        command,
        param1: parameters[0],
        param2: parameters[1],
        param3: parameters[2],
        ..Default::default()
    })
}

fn set(to: Address, name: &str, value: f32) -> MavMessage {
    MavMessage::PARAM_SET(dialect::PARAM_SET_DATA {
        target_system: to.system,
        target_component: to.component,
        param_id: name.into(),
        param_value: value,
        param_type: dialect::MavParamType::MAV_PARAM_TYPE_REAL32,
    })
}

fn list(to: Address) -> MavMessage {
    MavMessage::PARAM_REQUEST_LIST(dialect::PARAM_REQUEST_LIST_DATA {
        target_system: to.system,
        target_component: to.component,
    })
}

/// Answers disarmed until `found` has what it looks for.
fn idle_until<T>(fc: &mut Fc, mut found: impl FnMut(&MavMessage) -> Option<T>) -> T {
    let deadline = Instant::now() + Duration::from_secs(20);
    while Instant::now() < deadline {
        let message = fc.next_within(Duration::from_secs(5)).expect("the bench goes on");
        if let MavMessage::HIL_SENSOR(data) = &message {
            fc.controls(data.time_usec, false, [0.0; 4]);
        }
        if let Some(it) = found(&message) {
            return it;
        }
    }
    panic!("it did not come");
}

/// Sends a command and gives its MAV_RESULT.
fn ask(fc: &mut Fc, what: dialect::MavCmd, parameters: [f32; 3]) -> u8 {
    fc.send(&command(FC_SIDE, what, parameters));
    idle_until(fc, |message| match message {
        MavMessage::COMMAND_ACK(ack) if ack.command == what => Some(ack.result as u8),
        _ => None,
    })
}

fn value_of(message: &MavMessage, name: &str) -> Option<f32> {
    match message {
        MavMessage::PARAM_VALUE(data) if data.param_id.to_str() == Ok(name) => Some(data.param_value),
        _ => None,
    }
}

/// The value in force.
fn read(fc: &mut Fc, name: &str) -> f32 {
    fc.send(&MavMessage::PARAM_REQUEST_READ(dialect::PARAM_REQUEST_READ_DATA {
        param_index: -1,
        target_system: 1,
        target_component: 200,
        param_id: name.into(),
    }));
    idle_until(fc, |message| value_of(message, name))
}

fn set_and_read(fc: &mut Fc, name: &str, value: f32) -> f32 {
    fc.send(&set(FC_SIDE, name, value));
    idle_until(fc, |message| value_of(message, name))
}

#[test]
fn a_pause_stops_time_and_steps_move_it() {
    let report = run(&scenario(PATIENT), patient(), |fc| {
        fc.idle_until(100_000);
        assert_eq!(ask(fc, dialect::MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, [0.0; 3]), 0);
        // What was on its way.
        let mut last = 0;
        while let Some(time_us) = fc.sensor_within(Duration::from_millis(200)) {
            fc.controls(time_us, false, [0.0; 4]);
            last = time_us;
        }
        fc.send(&set(FC_SIDE, "SIM_STEP", 8.0));
        // Eight steps of a millisecond are two samples of four.
        for i in 1..=2 {
            let time_us = fc.sensor();
            assert!(last == 0 || time_us == last + 4000 * i, "{last} {time_us}");
            fc.controls(time_us, false, [0.0; 4]);
        }
        assert_eq!(fc.sensor_within(Duration::from_millis(200)), None);
        assert_eq!(ask(fc, dialect::MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, [1.0, 0.0, 0.0]), 0);
        fc.sensor();
        Then::Stop
    });
    // A pause is no silence of the controller.
    assert_eq!(report.link.unwrap().stalls, 0);
    assert!(report.modified.iter().any(|what| what.ends_with("paused")), "{:?}", report.modified);
}

#[test]
fn every_parameter_is_listed_read_by_index_and_name_and_set() {
    let report = run(&scenario(PATIENT), patient(), |fc| {
        fc.idle_until(40_000);
        let all = parameters();
        fc.send(&list(FC_SIDE));
        let mut seen = std::collections::BTreeSet::new();
        idle_until(fc, |message| {
            if let MavMessage::PARAM_VALUE(data) = message {
                assert_eq!(usize::from(data.param_count), all.len());
                let name = &all[usize::from(data.param_index)].name;
                assert_eq!(data.param_id.to_str(), Ok(name.as_str()));
                seen.insert(data.param_index);
            }
            (seen.len() == all.len()).then_some(())
        });
        assert_eq!(read(fc, "F_GYR_BIAS"), 0.0);
        // In force, out of range, out of force.
        assert_eq!(set_and_read(fc, "F_GYR_BIAS", 0.1), 0.1);
        assert_eq!(set_and_read(fc, "F_GYR_BIAS", 1e6), 0.1);
        assert_eq!(set_and_read(fc, "F_GYR_BIAS", f32::NAN), 0.1);
        assert_eq!(set_and_read(fc, "F_GYR_BIAS", 0.0), 0.0);
        assert_eq!(set_and_read(fc, "WIND_N", 3.5), 3.5);
        assert_eq!(set_and_read(fc, "SIM_STEP", 4.0), 0.0);
        fc.send(&set(FC_SIDE, "NO_SUCH", 1.0));
        idle_until(fc, |m| match m {
            MavMessage::STATUSTEXT(text) => text.text.to_str().unwrap().contains("NO_SUCH").then_some(()),
            _ => None,
        });
        Then::Stop
    });
    let modified = report.modified.join("\n");
    assert!(modified.contains("gyroscope bias 0.1") && modified.contains("WIND_N 3.5"), "{modified}");
}

/// Each row of the catalogue is set and taken away by its parameter; what acts is what was asked for.
#[test]
fn every_fault_comes_and_goes_by_its_parameter() {
    run(&scenario(PATIENT), patient(), |fc| {
        fc.idle_until(40_000);
        for (row, parameter) in
            catalogue().zip(parameters().into_iter().skip(parameters().len() - catalogue().count()))
        {
            // These would cut the line that the test speaks on.
            if matches!(row.component, Component::WireToFc | Component::WireFromFc | Component::Fc) {
                continue;
            }
            let value = row.value.map_or(1.0, |quantity| quantity.default) as f32;
            assert_eq!(set_and_read(fc, &parameter.name, value), value, "{}", parameter.name);
            assert_eq!(set_and_read(fc, &parameter.name, 0.0), 0.0, "{}", parameter.name);
        }
        Then::Stop
    });
}

#[test]
fn a_failure_is_accepted_only_where_it_acts() {
    use dialect::MavCmd::MAV_CMD_INJECT_FAILURE as FAIL;
    let report = run(&scenario(PATIENT), patient(), |fc| {
        fc.idle_until(40_000);
        let mut fail = |unit: f32, kind: f32, instance: f32| ask(fc, FAIL, [unit, kind, instance]);
        assert_eq!(fail(4.0, 1.0, 0.0), 0); // gps off
        assert_eq!(fail(102.0, 2.0, 1.0), 0); // gimbal x stuck
        assert_eq!(fail(100.0, 1.0, 0.0), 3); // no battery
        assert_eq!(fail(4.0, 1.0, 2.0), 2); // no second receiver
        assert_eq!(fail(4.0, 0.0, 0.0), 0);
        assert_eq!(set_and_read(fc, "F_GNS_OFF", 0.0), 0.0);
        Then::Stop
    });
    let modified = report.modified.join("\n");
    for what in ["fault gnss off", "fault gimbal_x stuck", "mended gnss off"] {
        assert!(modified.contains(what), "{what} in {modified}");
    }
    assert!(report.events.iter().any(|e| e.kind.name() == format!("fault:gimbal_x_{}", Mode::Stuck.name())));
}

#[test]
fn after_a_reset_time_goes_on_and_the_flight_begins_anew() {
    let report = run(&scenario(PATIENT), patient(), |fc| {
        fc.idle_until(200_000);
        assert_eq!(set_and_read(fc, "F_BAR_OFF", 1.0), 1.0);
        let mut last = 0;
        for flight in 0..2 {
            assert_eq!(ask(fc, dialect::MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, [1.0, 0.0, 0.0]), 0);
            let (mut marked, mut after) = (false, 0);
            idle_until(fc, |message| {
                if let MavMessage::HIL_SENSOR(data) = message {
                    assert!(data.time_usec > last, "flight {flight}: {} after {last}", data.time_usec);
                    last = data.time_usec;
                    marked |= is_reset(message);
                    after += u32::from(marked);
                }
                (after > 50).then_some(())
            });
        }
        // The scenario again, without what was injected.
        assert_eq!(set_and_read(fc, "F_MAG_OFF", 0.0), 0.0);
        assert_eq!(read(fc, "F_BAR_OFF"), 0.0);
        Then::Stop
    });
    assert_eq!(report.flights.len(), 2);
    assert!(report.modified.is_empty() && !report.flights[0].modified.is_empty());
    assert!(
        report.flights.iter().all(|flight| flight.events.iter().any(|event| event.kind.name() == "reset"))
    );
    // Cut short by the reset; one that had given up before would not be excused, nor is one that nobody cut
    // short.
    let mut flown = report.flights[0].clone();
    assert!(report.flights.iter().all(Report::is_excused) && !report.is_excused());
    flown.events[0].kind = EventKind::Abort(AbortReason::Tilt);
    assert!(!flown.is_excused());
}

#[test]
fn what_is_in_force_changes_nothing_and_a_flood_of_changes_is_counted() {
    let report = run(&scenario(PATIENT), patient(), |fc| {
        fc.idle_until(40_000);
        for _ in 0..3 {
            assert_eq!(set_and_read(fc, "SIM_SPEED", 1.0), 1.0);
            assert_eq!(set_and_read(fc, "THRUST_BIAS", 0.1), 0.1f32);
            assert_eq!(set_and_read(fc, "F_MAG_BIAS", 1e-5), 1e-5f32);
        }
        for i in 1..=MODIFIED_KEPT {
            set_and_read(fc, "WIND_N", i as f32 * 0.125);
        }
        Then::Stop
    });
    // Two before the wind changed a hundred times.
    assert_eq!(report.modified_count, MODIFIED_KEPT + 2, "{:?}", report.modified);
    assert_eq!(report.modified.len(), MODIFIED_KEPT + 1);
    assert_eq!(report.modified[MODIFIED_KEPT], "and 2 more");
    assert_eq!(report.events.iter().filter(|event| event.kind.name() == "modified").count(), MODIFIED_KEPT);
}

/// The page of the bench names every float with its place.
#[test]
fn the_page_of_the_bench_lists_the_plant_s_floats() {
    let page = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/bench.md");
    let page = std::fs::read_to_string(page).unwrap();
    for (i, Column { name, .. }) in ARRAY.iter().enumerate() {
        assert!(page.contains(&format!("| {i} `{name}` |")), "{i} {name}");
    }
}

/// Reset is for the bench alone: to everybody it would be for the flight controller too.
#[test]
fn a_reboot_for_everybody_is_not_the_bench_s() {
    let report = run(&scenario(PATIENT), patient(), |fc| {
        fc.idle_until(40_000);
        let reboot = dialect::MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN;
        fc.send(&command(Address { system: 0, component: 0 }, reboot, [1.0, 0.0, 0.0]));
        let result = idle_until(fc, |m| match m {
            MavMessage::COMMAND_ACK(ack) if ack.command == reboot => Some(ack.result as u8),
            _ => None,
        });
        assert_eq!(result, 3);
        Then::Stop
    });
    assert!(report.flights.is_empty());
}

#[test]
fn the_plant_s_floats_come_when_asked_for() {
    run(&scenario(PATIENT), patient(), |fc| {
        fc.idle_until(40_000);
        assert_eq!(ask(fc, dialect::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [350.0, 3_999.0, 0.0]), 2);
        assert_eq!(ask(fc, dialect::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [350.0, 100_000.0, 0.0]), 0);
        let floats = |m: &MavMessage| match m {
            MavMessage::DEBUG_FLOAT_ARRAY(data) => Some((data.time_usec, data.data)),
            _ => None,
        };
        let (first_us, data) = idle_until(fc, floats);
        let (second_us, _) = idle_until(fc, floats);
        assert_eq!(second_us - first_us, 100_000);
        let of = |name: &str| data[ARRAY.iter().position(|column| column.name == name).unwrap()];
        // hover_5m stands on the pad, full, with 65 bar in its tank.
        assert!((60e5..70e5).contains(&of("tank_pa")), "{}", of("tank_pa"));
        assert!(of("mass_kg") > 50.0 && of("nitrous_kg") > 1.0 && of("thrust_n") == 0.0);
        Then::Stop
    });
}

/// 90 % of the line less the profile's streams is what a list may take: so it lasts at least so long, less a
/// frame and a burst. Load can only make it longer.
#[test]
fn a_list_keeps_within_what_the_line_has_left() {
    let rates = SensorRates { imu_hz: 250.0, gnss_hz: 10.0, altimeter_hz: 50.0 };
    let taken = GENERIC.bytes_per_s(&rates);
    // A line that has about 4000 byte/s left.
    let baud = ((taken + 4000.0) / 0.9 * 10.0) as u32;
    let spare = GENERIC.spare_bytes_s(&rates, baud);
    let options = Options { baud: Some(baud), pacing: Pacing::RealTime, fast: false, ..lockstep(&GENERIC) };
    run(&scenario(&[]), options, |fc| {
        fc.idle_until(40_000);
        let start = Instant::now();
        fc.send(&list(FC_SIDE));
        let count = parameters().len();
        let mut seen = 0;
        idle_until(fc, |message| {
            seen += usize::from(matches!(message, MavMessage::PARAM_VALUE(_)));
            (seen == count).then_some(())
        });
        // 37 bytes each; their trailing zeros may be cut, so at least 30.
        let least_s = (count as f64 * 30.0 - 300.0) / spare;
        assert!(
            start.elapsed().as_secs_f64() > least_s,
            "{:?} for {count}, at least {least_s} s",
            start.elapsed()
        );
        Then::Stop
    });
}

/// COMMAND_ACK is 22 bytes long, 10 of them payload.
#[test]
fn acknowledgements_keep_within_what_the_line_has_left() {
    let rates = SensorRates { imu_hz: 250.0, gnss_hz: 10.0, altimeter_hz: 50.0 };
    let baud = ((GENERIC.bytes_per_s(&rates) + 2000.0) / 0.9 * 10.0) as u32;
    let spare = GENERIC.spare_bytes_s(&rates, baud);
    let options = Options { baud: Some(baud), pacing: Pacing::RealTime, fast: false, ..lockstep(&GENERIC) };
    run(&scenario(PATIENT), options, |fc| {
        fc.idle_until(40_000);
        let (start, count) = (Instant::now(), 60);
        let never = command(FC_SIDE, dialect::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [115.0, -1.0, 0.0]);
        (0..count).for_each(|_| fc.send(&never));
        let mut answered = 0;
        idle_until(fc, |message| {
            answered += usize::from(matches!(message, MavMessage::COMMAND_ACK(_)));
            (answered == count).then_some(())
        });
        // Less a frame and a burst.
        let least_s = (count as f64 * 22.0 - 50.0) / spare;
        assert!(start.elapsed().as_secs_f64() > least_s, "{:?}, at least {least_s} s", start.elapsed());
        Then::Stop
    });
}

// -------------------------------------------------------------------------------------------- ground station

/// A ground station at the other end of a link in memory.
struct Station {
    link: Link,
    decoder: Decoder,
    encoder: Encoder,
    /// Every whole frame, with its number.
    frames: Vec<(u32, Vec<u8>)>,
    messages: Vec<(Address, MavMessage)>,
}

impl Station {
    fn send(&mut self, message: &MavMessage) {
        let mut bytes = Vec::new();
        self.encoder.encode(message, &mut bytes);
        self.link.send(&bytes);
    }

    fn listen(&mut self) {
        let mut bytes = Vec::new();
        self.link.receive(&mut bytes);
        self.decoder.push(&bytes);
        let frames = &mut self.frames;
        while let Some(frame) = self.decoder.next_frame_raw(|id, raw| frames.push((id, raw.to_vec()))) {
            if let Some(message) = frame.message() {
                self.messages.push((frame.sender, message));
            }
        }
    }
}

fn watched(options: Options, play: impl FnOnce(&mut Fc, &mut Station)) -> Report {
    let ((mut near, far), (ground_near, ground_far)) = (Link::pair().unwrap(), Link::pair().unwrap());
    let stop = AtomicBool::new(false);
    let mut flight = Flight::with(&scenario(&[]), 1, &Instrumentation::default()).unwrap();
    std::thread::scope(|threads| {
        let bench = threads.spawn(|| {
            let mut ground = Ground::new(ground_near, None);
            Bench::new(&mut flight, &mut near, options, Live::silent()).with_ground(&mut ground).run(&stop);
            let mut report = flight.report();
            report.require_fc();
            report.ground = Some(ground.figures());
            report
        });
        let mut fc = Fc::new(far);
        let mut station = Station {
            link: ground_far,
            decoder: Decoder::default(),
            encoder: Encoder::new(255, 190),
            frames: Vec::new(),
            messages: Vec::new(),
        };
        let played = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| play(&mut fc, &mut station)));
        stop.store(true, Ordering::Relaxed);
        let report = bench.join().unwrap();
        if let Err(failure) = played {
            std::panic::resume_unwind(failure);
        }
        report
    })
}

/// Goes on with the flight, disarmed, until the station has heard it.
fn until(fc: &mut Fc, station: &mut Station, mut heard: impl FnMut(&Station) -> bool) {
    let deadline = Instant::now() + Duration::from_secs(20);
    loop {
        let time_us = fc.sensor();
        fc.controls(time_us, false, [0.0; 4]);
        station.listen();
        if heard(station) {
            return;
        }
        assert!(Instant::now() < deadline, "not heard; {} frames", station.frames.len());
    }
}

#[test]
fn the_ground_sees_the_true_vehicle_and_that_it_is_simulated() {
    let report = watched(lockstep(&GENERIC), |fc, station| {
        let wanted = [0, 1, 31, 32, 33, 245, 253, 350];
        until(fc, station, |s| {
            wanted.iter().all(|id| s.frames.iter().filter(|(have, _)| have == id).count() >= 1)
        });
        for (sender, message) in &station.messages {
            assert_eq!(*sender, GROUND_ADDRESS);
            match message {
                MavMessage::HEARTBEAT(beat) => {
                    assert_eq!(beat.autopilot, dialect::MavAutopilot::MAV_AUTOPILOT_INVALID);
                    assert_eq!(beat.mavtype, dialect::MavType::MAV_TYPE_ROCKET);
                }
                MavMessage::STATUSTEXT(text) if text.chunk_seq == 0 => {
                    assert!(text.text.to_str().unwrap().starts_with("SIMULATED"));
                }
                MavMessage::LOCAL_POSITION_NED(at) => assert!(at.z < -0.5 && at.z > -1.0, "{}", at.z),
                _ => {}
            }
        }
    });
    assert!(report.ground.unwrap().sent > 0);
}

#[test]
fn frames_pass_both_ways_as_they_came_and_hil_messages_never() {
    // Message 0xABCDEF, which no dialect has, and a signed HEARTBEAT.
    let mut unknown = vec![0xFD, 3, 0, 0, 9, 1, 1, 0xEF, 0xCD, 0xAB, 1, 2, 3];
    let crc = mavlink::calculate_crc(&unknown[1..], 77);
    unknown.extend(crc.to_le_bytes());
    let mut signed = vec![0xFD, 9, 1, 0, 7, 1, 1, 0, 0, 0, 0, 0, 0, 0, 2, 12, 0x20, 3, 3];
    let crc = mavlink::calculate_crc(&signed[1..], 50);
    signed.extend(crc.to_le_bytes());
    signed.extend([0xA5; 13]);

    let report = watched(lockstep(&GENERIC), |fc, station| {
        until(fc, station, |s| !s.frames.is_empty());
        fc.link.send(&unknown);
        fc.link.send(&signed);
        until(fc, station, |s| {
            [&unknown, &signed].iter().all(|raw| s.frames.iter().any(|(_, have)| have == *raw))
        });
        assert!(!station.frames.iter().any(|(id, _)| hopbench_hil::wire::mavlink::is_hil(*id)));

        // To the flight controller: an arming command, what nobody knows, but neither HIL_SENSOR nor what is
        // the bench's.
        let arm = dialect::MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
        station.send(&MavMessage::HIL_SENSOR(dialect::HIL_SENSOR_DATA::default()));
        station.send(&set(GROUND_ADDRESS, "WIND_E", 2.0));
        station.send(&command(Address { system: 1, component: 1 }, arm, [1.0, 0.0, 0.0]));
        station.link.send(&unknown);
        let (mut armed, mut raw_came) = (false, false);
        let deadline = Instant::now() + Duration::from_secs(20);
        while !(armed && raw_came) && Instant::now() < deadline {
            let mut bytes = Vec::new();
            fc.link.wait(Instant::now() + Duration::from_millis(20));
            fc.link.receive(&mut bytes);
            fc.decoder.push(&bytes);
            let mut times = Vec::new();
            while let Some(frame) = fc.decoder.next_frame_raw(|_, raw| raw_came |= raw == unknown) {
                match frame.message() {
                    Some(MavMessage::COMMAND_LONG(long)) => {
                        assert_eq!((long.command, frame.sender.system), (arm, 255));
                        armed = true;
                    }
                    Some(MavMessage::HIL_SENSOR(data)) => {
                        assert_eq!(frame.sender.system, 1);
                        times.push(data.time_usec);
                    }
                    Some(MavMessage::PARAM_SET(data)) => panic!("{data:?}"),
                    _ => {}
                }
            }
            times.into_iter().for_each(|time_us| fc.controls(time_us, false, [0.0; 4]));
        }
        assert!(armed && raw_came);
        until(fc, station, |s| s.messages.iter().any(|(_, m)| value_of(m, "WIND_E") == Some(2.0)));
    });
    let ground = report.ground.unwrap();
    assert!(ground.forwarded_to_fc >= 2 && ground.forwarded_from_fc >= 2, "{ground:?}");
}

#[test]
fn a_text_of_the_flight_controller_is_contradicted_at_once() {
    watched(lockstep(&GENERIC), |fc, station| {
        until(fc, station, |s| !s.frames.is_empty());
        let text = dialect::STATUSTEXT_DATA { text: "Armed by command".into(), ..Default::default() };
        fc.send(&MavMessage::STATUSTEXT(text));
        until(fc, station, |s| {
            let said = s.messages.iter().position(
                |(_, m)| matches!(m, MavMessage::STATUSTEXT(t) if t.text.to_str() == Ok("Armed by command")),
            );
            let Some((sender, next)) = said.and_then(|place| s.messages.get(place + 1)) else { return false };
            let MavMessage::STATUSTEXT(next) = next else { panic!("{next:?} between text and banner") };
            assert!(*sender == GROUND_ADDRESS && next.text.to_str().unwrap().starts_with("SIMULATED"));
            true
        });
    });
}

/// 9600 baud carry 960 byte/s, 90 % of which are 864; attitude alone would take 60 bytes 250 times a second.
#[test]
fn a_slow_ground_line_takes_no_more_than_it_carries() {
    let mut ground = Ground::new(Link::pair().unwrap().0, Some(9600));
    assert!(matches!(
        ground.set_interval(31, Some(4_000)),
        Err(Refusal::NoRoom { taken_bytes_s, left_bytes_s: 864.0 }) if taken_bytes_s > 15_000.0
    ));
    assert_eq!(ground.set_interval(350, None), Ok(()));
    assert_eq!(ground.set_interval(31, Some(1_000_000)), Ok(()));
    // Heartbeat, 32, 245 and 1 take 21 + 400 + 28 + 55: 360 are left, which is six of 60.
    assert_eq!(ground.set_interval(33, None), Ok(()));
    assert_eq!(ground.set_interval(31, Some(200_000)), Ok(()));
    assert_eq!(ground.set_interval(107, None), Err(Refusal::NotAdjustable));
}

#[test]
fn a_px4_that_is_armed_is_not_reset() {
    let report = watched(lockstep(&PX4_SITL), |fc, station| {
        until(fc, station, |s| !s.frames.is_empty());
        let reboot = dialect::MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN;
        let time_us = fc.sensor();
        fc.controls(time_us, true, [0.0; 4]);
        station.send(&command(GROUND_ADDRESS, reboot, [1.0, 0.0, 0.0]));
        let deadline = Instant::now() + Duration::from_secs(20);
        let result = loop {
            let time_us = fc.sensor();
            fc.controls(time_us, true, [0.0; 4]);
            station.listen();
            let ack = station.messages.iter().find_map(|(_, m)| match m {
                MavMessage::COMMAND_ACK(ack) => Some(ack.result as u8),
                _ => None,
            });
            if let Some(result) = ack {
                break result;
            }
            assert!(Instant::now() < deadline);
        };
        assert_eq!(result, 2);
    });
    assert!(report.flights.is_empty());
}

#[test]
fn a_ground_station_that_floods_or_goes_disturbs_no_flight() {
    let report = watched(lockstep(&GENERIC), |fc, station| {
        until(fc, station, |s| !s.frames.is_empty());
        let mut bytes = Vec::new();
        for _ in 0..2000 {
            station.encoder.encode(&heartbeat(0), &mut bytes);
        }
        for part in bytes.chunks(1000) {
            station.link.send(part);
        }
        let mut samples = 0;
        until(fc, station, |_| {
            samples += 1;
            samples > 500
        });
        station.link = Link::pair().unwrap().0;
        let now = fc.sensor();
        fc.controls(now, false, [0.0; 4]);
        fc.idle_until(now + 200_000);
    });
    // All that came was passed on or counted.
    let ground = report.ground.unwrap();
    assert!(ground.dropped + ground.forwarded_to_fc >= 1500, "{ground:?}");
    assert_eq!(report.events.iter().filter(|e| e.kind.name() == "fc_lost").count(), 0);
}
