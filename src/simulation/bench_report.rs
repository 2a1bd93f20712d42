//! The bench's share of a report: hand-overs, time, the links.

use serde::Serialize;

use super::flown_by::Source;
use crate::scenario::Fidelity;

/// A change of who flies, and what it did to the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Handover {
    /// Who took over; null: the engine was cut.
    pub to: Option<Source>,
    /// Run time (s).
    pub time_s: f64,
    /// Simulated time from the flight controller's last good controls to the first command of who took over
    /// (ms).
    pub silence_ms: f64,
    /// The same by the wall clock (ms).
    pub silence_wall_ms: f64,
    /// First thrust commanded less the last of who flew before (N).
    pub thrust_step_n: f64,
    /// Angle between their gimbal commands (deg).
    pub gimbal_step_deg: f64,
    /// Motion in the two seconds before.
    pub before: PeakMotion,
    /// Motion in the two seconds after.
    pub after: PeakMotion,
    /// Greatest change of the velocity in the two seconds after (m/s).
    pub speed_change_m_s: f64,
}

/// Greatest tilt and body rate of a span.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PeakMotion {
    /// Tilt of the long axis (deg).
    pub tilt_deg: f64,
    /// Body rate (deg/s).
    pub rate_deg_s: f64,
}

impl PeakMotion {
    /// Widens the span.
    pub fn take(&mut self, other: &Self) {
        self.tilt_deg = self.tilt_deg.max(other.tilt_deg);
        self.rate_deg_s = self.rate_deg_s.max(other.rate_deg_s);
    }
}

/// Simulated and wall time.
#[derive(Clone, Debug, Default, Serialize)]
#[serde(default)]
pub struct Timing {
    /// Which physics the plant ran.
    pub plant_mode: Fidelity,
    /// Plant steps a second of simulated time (Hz).
    pub plant_hz: f64,
    /// Samples a second to the flight controller (Hz); null without a link.
    pub sensor_hz: Option<f64>,
    /// `realtime`, `lockstep` or `fast`; null without a link.
    pub pacing: Option<String>,
    /// Simulated time (s).
    pub simulated_s: f64,
    /// Wall time (s).
    pub wall_s: f64,
    /// Simulated over wall.
    pub realtime_factor: f64,
    /// Plant steps.
    pub steps: u64,
    /// Steps that began more than a step late.
    pub overruns: u64,
    /// Of these: made up for by steps without a pause.
    pub overruns_caught_up: u64,
    /// Of these: ended by letting time slip.
    pub overruns_slipped: u64,
    /// Of these: not made up for when the run ended.
    pub overruns_open: u64,
    /// The worst rows of late steps, worst first, at most 16.
    pub worst_overruns: Vec<Overrun>,
    /// Times that simulated time was let fall behind the clock for good.
    pub slips: u64,
    /// By how much altogether (s).
    pub slipped_s: f64,
    /// Wall time less simulated time, slips and lateness at the end (us): 0, or the bench has lost count.
    /// Null where nothing follows the clock.
    pub unaccounted_us: Option<f64>,
    /// Wall time that a step may cost in real time (us).
    pub step_budget_us: f64,
    /// Cost of a step of the plant (us).
    pub step_us: Option<Percentiles>,
    /// Cost of everything from one wake-up to the next sleep: receive, step, encode, send, shadow (us).
    pub cycle_us: Option<Percentiles>,
    /// Wake-up after the deadline (us).
    pub lateness_us: Option<Percentiles>,
    /// Sensor frame out to the actuator frame that answers it by its time stamp (us).
    pub round_trip_us: Option<Percentiles>,
    /// Sensor frame out to the actuator frame that answers it on the echo channel (us).
    pub echo_us: Option<Percentiles>,
    /// Wake-up of a thread beside the run that does nothing but sleep (us).
    pub reference_sleep_us: Option<Percentiles>,
    /// Echo of a datagram by a thread beside the run that does nothing else (us).
    pub reference_echo_us: Option<Percentiles>,
    /// What the kernel granted the stepping thread; null where nothing was asked.
    pub scheduler: Option<Scheduler>,
}

/// A row of steps that began late.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Overrun {
    /// Run time of the first (s).
    pub time_s: f64,
    /// How many; 0: late at a stage that counts no steps, as when an answer is waited for.
    pub steps: u64,
    /// The latest (ms).
    pub late_ms: f64,
    /// By how much time slipped at its end; null when it was caught up (ms).
    pub slipped_ms: Option<f64>,
}

/// What the kernel granted the thread that steps the plant.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Scheduler {
    /// The real-time class SCHED_FIFO.
    pub fifo: bool,
    /// Its priority there.
    pub priority: Option<u8>,
    /// Memory is never paged out.
    pub locked: bool,
    /// The one CPU it runs on.
    pub pinned_cpu: Option<usize>,
    /// What was not granted, why, and what would allow it.
    pub notes: Vec<String>,
}

/// Median and tail of a distribution.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(default)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99 %.
    pub p99: f64,
    /// 99.9 %.
    pub p999: f64,
    /// Greatest.
    pub max: f64,
}

/// The link's counters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(default)]
pub struct LinkReport {
    /// Frames that the system took.
    pub sent: u64,
    /// Frames thrown away, since nobody was there or the line was too slow.
    pub dropped: u64,
    /// Frames received whole.
    pub received: u64,
    /// Frames with a wrong checksum.
    pub crc_errors: u64,
    /// Frames missing by their sequence numbers.
    pub lost: u64,
    /// Frames that came twice by their sequence numbers.
    pub duplicates: u64,
    /// Frames that came after a later one.
    pub out_of_order: u64,
    /// Bytes received that belonged to no frame.
    pub skipped_bytes: u64,
    /// Datagrams or connections of somebody else, turned away.
    pub refused: u64,
    /// HIL_ACTUATOR_CONTROLS that held no number where a channel is read.
    pub controls_refused: u64,
    /// HIL_ACTUATOR_CONTROLS that came again, too late or out of the flight before.
    pub controls_old: u64,
    /// Waits for a reply that ran into their limit.
    pub stalls: u64,
    /// More about them; absent when there were none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stalled: Option<Stalled>,
    /// What faults of the wire did; absent when there were none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub disrupted: Option<Disrupted>,
    /// Silences between two HIL_ACTUATOR_CONTROLS of more than a tenth of `fc_timeout_ms`.
    pub gaps: u64,
    /// Longest silence between two HIL_ACTUATOR_CONTROLS, or from the last to the end (ms); null before there
    /// were two.
    pub longest_gap_ms: Option<f64>,
    /// Bytes that the system took.
    pub sent_bytes: u64,
    /// Bytes that came.
    pub received_bytes: u64,
    /// Frames a second, outward (Hz).
    pub rate_out_hz: f64,
    /// Frames a second, inward (Hz).
    pub rate_in_hz: f64,
    /// Share of the wire used outward; null where the wire has no rate (%).
    pub wire_load_percent: Option<f64>,
    /// Share of the wire used inward; null where the wire has no rate (%).
    pub wire_load_in_percent: Option<f64>,
}

/// Waits in lockstep that ran into their limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Stalled {
    /// Run time of the first (s).
    pub first_s: f64,
    /// Run time of the last (s).
    pub last_s: f64,
    /// Wall time of the longest (ms).
    pub longest_ms: f64,
    /// Wall time of all (ms).
    pub total_ms: f64,
    /// Whose sample or answer a fault of the wire has lost.
    pub lost_by_fault: u64,
    /// Whose answer came after all, too late.
    pub answered_late: u64,
}

/// What faults of the wire did to frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Disrupted {
    /// From the bench to the flight controller.
    pub to_fc: DisruptedWay,
    /// From the flight controller to the bench.
    pub from_fc: DisruptedWay,
}

/// What faults of the wire did to the frames of one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DisruptedWay {
    /// Lost.
    pub dropped: u64,
    /// Late.
    pub delayed: u64,
    /// Arrived twice.
    pub duplicated: u64,
    /// With a bit flipped.
    pub corrupted: u64,
}

/// What passed on the ground station's link.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct GroundReport {
    /// Frames of the bench itself.
    pub sent: u64,
    /// Whole frames that came.
    pub received: u64,
    /// Frames whose checksum did not hold.
    pub crc_errors: u64,
    /// Frames of the flight controller that were passed on.
    pub forwarded_from_fc: u64,
    /// Frames that were passed on to the flight controller.
    pub forwarded_to_fc: u64,
    /// Frames, or writes, that found no room.
    pub dropped: u64,
}
