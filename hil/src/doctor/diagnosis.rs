//! What is wrong on a link: a pure function of what was observed there.

use std::io::ErrorKind;

use hopbench::controls::CHANNEL_COUNT;

use super::catalog;
use super::channel::{ChannelUse, MappedChannel};
use super::finding::{Finding, worst_first};
use super::observation::{ControlsStatistics, Observation};
use crate::wire::link::{LinkSpec, OpenFailure};
use crate::wire::mavlink::{LONGEST_FRAME_BYTES, frame_bytes};
use crate::wire::port;
use crate::wire::profile::Budget;
use crate::wire::stream::ADDRESS;

/// How often PX4 is asked for HIL_ACTUATOR_CONTROLS (Hz).
const CONTROLS_HZ: f64 = 200.0;
/// Slowest stream of controls that keeps a lander upright: the rate of the built-in guidance (Hz).
const CONTROLS_LEAST_HZ: f64 = 50.0;
/// PX4 sends no controls on a link set to this rate or less (byte/s).
const PX4_GATE_BYTES_PER_S: f64 = 5000.0;

/// What is wrong on a link, worst first.
pub fn diagnose(observed: &Observation) -> Vec<Finding> {
    let mut findings = Vec::new();
    wire_budget(observed, &mut findings);
    if let Some(failure) = &observed.failure {
        findings.push(open_failure(observed, failure));
    } else {
        if !observed.holders.is_empty() {
            findings.push(catalog::port_shared(&observed.holders));
        }
        bytes(observed, &mut findings);
        senders(observed, &mut findings);
        flight_controller(observed, &mut findings);
    }
    worst_first(findings)
}

fn open_failure(observed: &Observation, failure: &OpenFailure) -> Finding {
    let path = match &observed.link {
        LinkSpec::Serial { path, .. } => path.clone(),
        other => other.to_string(),
    };
    let serial = matches!(observed.link, LinkSpec::Serial { .. });
    match failure.kind {
        ErrorKind::NotFound if serial => {
            let present: Vec<String> =
                observed.ports.iter().map(|port| port.path.display().to_string()).collect();
            catalog::no_port(&path, &present)
        }
        ErrorKind::PermissionDenied => {
            catalog::permission_denied(&path, port::group_of(path.as_ref()).as_deref())
        }
        ErrorKind::ResourceBusy => catalog::port_busy(&path, &failure.cause),
        ErrorKind::AddrInUse => catalog::address_in_use(&path),
        _ => catalog::cannot_open(&path, &failure.cause),
    }
}

/// Both directions of a serial line.
fn wire_budget(observed: &Observation, findings: &mut Vec<Finding>) {
    let LinkSpec::Serial { baud, .. } = observed.link else { return };
    let back_percent =
        frame_bytes::HIL_ACTUATOR_CONTROLS as f64 * CONTROLS_HZ / (f64::from(baud) / 10.0) * 100.0;
    let budget = observed.profile.budget(&observed.rates, baud);
    if !matches!(budget, Budget::Fits { .. }) || back_percent >= 70.0 {
        findings.push(catalog::wire_overload(baud, observed.rates.imu_hz, &budget, back_percent));
    }
}

/// Whether anybody speaks, whether it is MAVLink, and whether it arrives whole.
fn bytes(observed: &Observation, findings: &mut Vec<Finding>) {
    let traffic = &observed.traffic;
    if !traffic.losses.is_empty() {
        findings.push(catalog::link_lost(&traffic.losses));
    }
    if !traffic.refused_peers.is_empty() {
        findings.push(catalog::second_client(&traffic.refused_peers));
    }
    if traffic.writes_not_taken > 0 {
        findings.push(catalog::not_taken(traffic.writes_not_taken));
    }
    let (bytes, listened_s) = (traffic.bytes, traffic.listened_s);
    if !traffic.had_peer {
        findings.push(catalog::nobody_there(&observed.link, listened_s));
    } else if bytes == 0 {
        findings.push(catalog::no_bytes(&observed.link, listened_s));
    } else if traffic.counters.frames == 0 {
        let text = printable(&traffic.first_bytes);
        findings.push(match (&observed.link, text) {
            (LinkSpec::Serial { baud, .. }, None) => catalog::wrong_baud(bytes, *baud),
            (_, text) => catalog::no_mavlink(bytes, text.as_deref()),
        });
    } else {
        let counters = &traffic.counters;
        // Who comes in half-way hears the end of a frame, at most a whole one.
        if counters.crc_errors > 1 || counters.skipped_bytes > LONGEST_FRAME_BYTES as u64 {
            findings.push(catalog::damaged(counters));
        }
        if counters.lost > 0 {
            findings.push(catalog::sequence_gaps(counters));
        }
        if traffic.version_1 > 0 {
            findings.push(catalog::mavlink_1(traffic.version_1, counters.frames));
        }
    }
}

/// The bytes as text, when they are text: a console, a satellite receiver.
fn printable(bytes: &[u8]) -> Option<String> {
    let text = |byte: &&u8| matches!(**byte, b' '..=b'~' | b'\r' | b'\n' | b'\t' | 0x1B);
    let share = bytes.iter().filter(text).count() * 10;
    (share >= bytes.len() * 9).then(|| String::from_utf8_lossy(&bytes[..bytes.len().min(40)]).into_owned())
}

/// Who speaks under which name.
fn senders(observed: &Observation, findings: &mut Vec<Finding>) {
    let senders = &observed.traffic.senders;
    if let Some(namesake) = senders.iter().find(|sender| sender.address == ADDRESS) {
        findings.push(catalog::our_system_id(namesake));
    }
    let commanding: Vec<_> = senders.iter().filter(|s| s.controls.frames > 0).map(|s| s.address).collect();
    let autopilots: Vec<_> = senders.iter().filter(|s| s.is_autopilot()).map(|s| s.address).collect();
    if commanding.len() > 1 {
        findings.push(catalog::two_controllers(&commanding));
    } else if autopilots.len() > 1 {
        findings.push(catalog::two_controllers(&autopilots));
    }
    for sender in senders {
        // A reboot sets one counter back; two programs under one name do so all the time.
        if sender.backward > 3 && sender.backward * 10 > sender.frames {
            findings.push(catalog::shared_system_id(sender));
        }
    }
}

/// Whether the flight controller is in the loop, and what its channels do.
fn flight_controller(observed: &Observation, findings: &mut Vec<Finding>) {
    let traffic = &observed.traffic;
    let Some(fc) = traffic.flight_controller() else {
        if traffic.counters.frames > 0 {
            let addresses: Vec<_> = traffic.senders.iter().map(|sender| sender.address).collect();
            findings.push(catalog::no_flight_controller(&addresses));
        }
        return;
    };
    if observed.profile.needs_hil_flag {
        if fc.heartbeats == 0 {
            findings.push(catalog::no_heartbeat(fc.address));
        } else if !fc.hil {
            findings.push(catalog::hil_flag_missing(fc));
        }
    }
    if fc.armed {
        findings.push(catalog::armed_already(fc.address));
    }
    let bytes_per_s = traffic.bytes as f64 / traffic.listened_s.max(1e-3);
    match fc.controls.rate_hz() {
        None if fc.controls.frames == 0 => {
            findings.push(catalog::no_controls(fc, traffic.sensors_sent, observed.profile));
            if observed.profile.needs_hil_flag && fc.hil && bytes_per_s < PX4_GATE_BYTES_PER_S {
                findings.push(catalog::data_rate_too_low(0.0, bytes_per_s));
            }
        }
        Some(controls_hz) if controls_hz < CONTROLS_LEAST_HZ.min(0.8 * observed.rates.imu_hz) => {
            findings.push(catalog::data_rate_too_low(controls_hz, bytes_per_s));
        }
        Some(controls_hz) => findings.push(catalog::controls(fc, controls_hz, traffic.sensors_sent)),
        None => findings.push(catalog::data_rate_too_low(0.0, bytes_per_s)),
    }
    if fc.controls.jumps > 0 {
        findings.push(catalog::clock_jumps(&fc.controls));
    }
    if let (Some(map), true) = (&observed.map, fc.controls.frames > 0) {
        channels(&fc.controls, map, findings);
    }
}

/// Whether what moves is read, and what is read moves and stays in its range.
fn channels(controls: &ControlsStatistics, map: &[MappedChannel], findings: &mut Vec<Finding>) {
    let moving: Vec<usize> = (0..CHANNEL_COUNT).filter(|channel| controls.moved(*channel)).collect();
    let unread: Vec<String> = moving
        .iter()
        .filter_map(|channel| match map.iter().find(|mapped| mapped.index == *channel) {
            None => Some(channel.to_string()),
            Some(mapped) if mapped.role == ChannelUse::Unread => Some(format!("{channel} ({})", mapped.name)),
            Some(_) => None,
        })
        .collect();
    if !unread.is_empty() {
        findings.push(catalog::channels_unread(&unread));
    }
    let still: Vec<String> = map
        .iter()
        .filter(|mapped| mapped.role == ChannelUse::Steering && !controls.moved(mapped.index))
        .map(|mapped| format!("{} ({})", mapped.index, mapped.name))
        .collect();
    if moving.is_empty() {
        findings.push(catalog::controls_still(controls.frames));
    } else if !still.is_empty() {
        findings.push(catalog::channels_still(&still));
    }
    for mapped in map.iter().filter(|mapped| mapped.role != ChannelUse::Unread) {
        let (index, range) = (mapped.index, mapped.range);
        let (least, greatest) = (controls.least[index], controls.greatest[index]);
        // A tenth of the range beyond its end is rounding and trim.
        let margin = 0.1 * (range[1] - range[0]);
        if controls.not_finite[index] {
            findings.push(catalog::not_a_number(mapped));
        } else if mapped.role == ChannelUse::Steering
            && (least < range[0] - margin || greatest > range[1] + margin)
        {
            findings.push(catalog::out_of_range(mapped, least, greatest));
        }
    }
}
