//! What goes out to a flight controller, in which order and how often.
//!
//! The slow messages of an instant come before its HIL_SENSOR, which completes it: a controller that
//! answers HIL_SENSOR has then seen everything that belongs to it.

use hopbench::signal::Measurement;
use hopbench::time::SimTime;

use crate::mavlink::measurement::{
    TrueState, distance_sensor, hil_gps, hil_sensor, hil_state_quaternion, named_pressures, odometry,
    pressure,
};
use crate::mavlink::{
    Command, Encoder, FromFc, HIL_STATE_QUATERNION_ID, MavMessage, RESULT_ACCEPTED, RESULT_UNSUPPORTED,
    SET_MESSAGE_INTERVAL, heartbeat, no_parameters, system_time,
};
use crate::profile::{Heartbeat, Profile};

/// The bench is a component of the flight controller's own system, as simulators are by convention.
pub(crate) const SYSTEM_ID: u8 = 1;
pub(crate) const COMPONENT_ID: u8 = 200;
/// Interval of the true state when it is asked for without one (us).
const TRUTH_DEFAULT_US: u64 = 20_000;
/// Least interval of the true state: the plant's step (us).
const TRUTH_LEAST_US: u64 = 1_000;
/// Names of three pressures; each is due on its own.
const PRESSURES: usize = 3;

/// Frames to one flight controller.
#[derive(Debug)]
pub struct Streams {
    profile: &'static Profile,
    encoder: Encoder,
    heartbeat: Timer,
    system_time: Timer,
    odometry: Timer,
    pressures: [Timer; PRESSURES],
    truth: Option<Timer>,
    bytes: Vec<u8>,
}

/// Says when something is due again; the first time anchors the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Timer {
    interval_us: u64,
    due_us: Option<u64>,
}

impl Timer {
    fn every_s(seconds: f64) -> Self {
        Self { interval_us: (seconds * 1e6).round() as u64, due_us: None }
    }

    /// Whether it is due; if so, it is due again an interval later.
    fn fires(&mut self, now: SimTime) -> bool {
        let due_us = self.due_us.unwrap_or(now.us());
        if now.us() < due_us {
            return false;
        }
        let next_us = due_us.saturating_add(self.interval_us);
        // After a gap there is no catching up.
        self.due_us =
            Some(if next_us > now.us() { next_us } else { now.us().saturating_add(self.interval_us) });
        true
    }
}

impl Streams {
    /// Nothing sent yet.
    pub fn new(profile: &'static Profile) -> Self {
        let rate = |hz: Option<f64>| Timer::every_s(hz.map_or(f64::INFINITY, |hz| 1.0 / hz));
        Self {
            profile,
            encoder: Encoder::new(SYSTEM_ID, COMPONENT_ID),
            heartbeat: Timer::every_s(1.0),
            system_time: rate(profile.system_time_hz),
            odometry: rate(profile.odometry_hz),
            pressures: [rate(profile.pressure_hz); PRESSURES],
            truth: None,
            bytes: Vec::with_capacity(1024),
        }
    }

    /// Frames encoded so far.
    pub fn frames(&self) -> u64 {
        self.encoder.frames()
    }

    /// The bytes that wait, to be sent and cleared by the caller.
    pub fn bytes(&mut self) -> &mut Vec<u8> {
        &mut self.bytes
    }

    /// A heartbeat at once.
    pub fn put_heartbeat(&mut self) {
        self.put(&heartbeat(0));
    }

    /// Everything of one instant.
    pub fn put_measurement(&mut self, measurement: &Measurement) {
        let now = measurement.time;
        if self.profile.heartbeat != Heartbeat::Never && self.heartbeat.fires(now) {
            self.put_heartbeat();
        }
        if self.profile.system_time_hz.is_some() && self.system_time.fires(now) {
            self.put(&system_time(now.us()));
        }
        let slow = [hil_gps(measurement), distance_sensor(measurement)];
        slow.iter().flatten().for_each(|message| self.put(message));
        if self.profile.odometry_hz.is_some()
            && let Some(message) = odometry(measurement)
            && self.odometry.fires(now)
        {
            self.put(&message);
        }
        if self.profile.pressure_hz.is_some() {
            for (i, (name, value)) in named_pressures(&measurement.pressures).into_iter().enumerate() {
                if let Some(pressure_pa) = value
                    && self.pressures[i].fires(now)
                {
                    self.put(&pressure(name, pressure_pa, now.us()));
                }
            }
        }
        if let Some(message) = hil_sensor(measurement) {
            self.put(&message);
        }
    }

    /// The true state, if it was asked for and is due.
    pub fn put_truth(&mut self, now: SimTime, state: impl FnOnce() -> TrueState) {
        if self.truth.as_mut().is_some_and(|timer| timer.fires(now)) {
            self.put(&hil_state_quaternion(&state(), now.us()));
        }
    }

    /// Answers what a flight controller asks.
    pub fn answer(&mut self, said: &FromFc, now: SimTime) {
        match said {
            FromFc::Command(command) => {
                let result = self.obey(command, now);
                if self.profile.answers {
                    self.encoder.encode_ack(command, result, &mut self.bytes);
                }
            }
            FromFc::Parameters if self.profile.answers => self.put(&no_parameters()),
            _ => {}
        }
    }

    /// The one command a simulator obeys is for the interval of the true state.
    fn obey(&mut self, command: &Command, now: SimTime) -> u8 {
        let [message, interval_us, ..] = command.parameters;
        if command.command != SET_MESSAGE_INTERVAL
            || message != HIL_STATE_QUATERNION_ID as f32
            || !self.profile.truth_on_request
        {
            return RESULT_UNSUPPORTED;
        }
        self.truth = if interval_us < 0.0 {
            None
        } else {
            // 0 asks for the default; `as` saturates and turns NaN into 0.
            let interval_us = match interval_us as u64 {
                0 => TRUTH_DEFAULT_US,
                asked => asked.max(TRUTH_LEAST_US),
            };
            Some(Timer { interval_us, due_us: Some(now.us().saturating_add(interval_us)) })
        };
        RESULT_ACCEPTED
    }

    fn put(&mut self, message: &MavMessage) {
        self.encoder.encode(message, &mut self.bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mavlink::Decoder;
    use crate::profile::{GENERIC, PX4_HITL, PX4_SITL};

    fn asks(message: f32, interval_us: f32) -> FromFc {
        let parameters = [message, interval_us, 0.0, 0.0, 0.0, 0.0, 0.0];
        FromFc::Command(Command { command: SET_MESSAGE_INTERVAL, parameters, from: (1, 1) })
    }

    fn ids(streams: &mut Streams) -> Vec<u32> {
        let mut decoder = Decoder::default();
        decoder.push(streams.bytes());
        streams.bytes().clear();
        std::iter::from_fn(|| decoder.next_frame()).map(|frame| frame.message_id).collect()
    }

    fn truth() -> TrueState {
        TrueState {
            q_ned_from_body: nalgebra::UnitQuaternion::identity(),
            rate_body_rad_s: Default::default(),
            latitude_rad: 0.8,
            longitude_rad: 0.1,
            altitude_m: 500.0,
            velocity_ned_m_s: Default::default(),
            airspeed_m_s: 0.0,
            specific_force_body_m_s2: Default::default(),
        }
    }

    #[test]
    fn truth_comes_at_the_interval_asked_for_and_never_to_a_board() {
        for (profile, ack) in [(&GENERIC, vec![77]), (&PX4_SITL, vec![])] {
            let mut streams = Streams::new(profile);
            streams.put_truth(SimTime::from_us(1000), truth);
            assert!(ids(&mut streams).is_empty());
            streams.answer(&asks(115.0, 5000.0), SimTime::from_us(1000));
            assert_eq!(ids(&mut streams), ack);
            let mut times = Vec::new();
            for ms in 2..=31 {
                streams.put_truth(SimTime::from_us(1000 * ms), truth);
                times.extend(ids(&mut streams).iter().map(|_| ms));
            }
            assert_eq!(times, [6, 11, 16, 21, 26, 31]);
            streams.answer(&asks(115.0, -1.0), SimTime::from_us(32_000));
            ids(&mut streams);
            streams.put_truth(SimTime::from_us(100_000), truth);
            assert!(ids(&mut streams).is_empty());
        }
        let mut board = Streams::new(&PX4_HITL);
        board.answer(&asks(115.0, 5000.0), SimTime::ZERO);
        board.put_truth(SimTime::from_us(100_000), truth);
        assert!(ids(&mut board).is_empty());
    }

    #[test]
    fn what_is_not_supported_is_said_where_somebody_listens() {
        let mut streams = Streams::new(&GENERIC);
        streams.answer(&asks(105.0, 4000.0), SimTime::ZERO);
        streams.answer(&FromFc::Parameters, SimTime::ZERO);
        assert_eq!(ids(&mut streams), [77, 22]);
        let mut streams = Streams::new(&PX4_SITL);
        streams.answer(&asks(105.0, 4000.0), SimTime::ZERO);
        streams.answer(&FromFc::Parameters, SimTime::ZERO);
        assert!(ids(&mut streams).is_empty());
    }

    #[test]
    fn timers_keep_their_grid() {
        let mut timer = Timer::every_s(0.02);
        let fired: Vec<u64> =
            (1..=25).map(|i| i * 4000).filter(|us| timer.fires(SimTime::from_us(*us))).collect();
        assert_eq!(fired, [4000, 24_000, 44_000, 64_000, 84_000]);
    }
}
