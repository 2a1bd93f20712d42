//! What goes out to a flight controller, in which order and how often.
//!
//! The slow messages of an instant come before its HIL_SENSOR, which completes it: a controller that
//! answers HIL_SENSOR has then seen everything that belongs to it.

use hopbench::environment::geodesy::Datum;
use hopbench::plant::Snapshot;
use hopbench::signal::Measurement;
use hopbench::time::SimTime;

use crate::wire::mavlink::measurement::{
    distance_sensor, hil_gps, hil_sensor, hil_state_quaternion, named_pressures, odometry, pressure,
    reset_mark,
};
use crate::wire::mavlink::telemetry::plant_array;
use crate::wire::mavlink::{Address, Encoder, MavMessage, frame_bytes, heartbeat, id, reboot, system_time};
use crate::wire::profile::{Heartbeat, Profile};
use crate::wire::reply::Reply;

/// Texts: a flight controller that asks for them hears of events.
pub const TEXTS: u32 = id::STATUSTEXT;

/// The bench is a component of the flight controller's own system, as simulators are by convention.
pub const ADDRESS: Address = Address { system: 1, component: 200 };

/// Interval of the true state when it is asked for without one (us).
const TRUTH_DEFAULT_US: u64 = 20_000;
/// Least interval of the true state: the plant's step (us).
const TRUTH_LEAST_US: u64 = 1_000;
/// Interval of the plant's floats when they are asked for without one, and the least (us).
const PLANT_DEFAULT_US: u64 = 100_000;
const PLANT_LEAST_US: u64 = 4_000;
/// Names of three pressures; each is due on its own.
const PRESSURES: usize = 3;

/// Frames to one flight controller.
#[derive(Debug)]
pub struct Streams {
    profile: &'static Profile,
    encoder: Encoder,
    heartbeat: Timer,
    system_time: Option<Timer>,
    odometry: Option<Timer>,
    pressures: Option<[Timer; PRESSURES]>,
    truth: Option<Timer>,
    plant: Option<Timer>,
    bytes: Vec<u8>,
}

/// Says when something is due again; the first time anchors the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timer {
    interval_us: u64,
    due_us: Option<u64>,
}

impl Timer {
    /// Due at once, and from then on at this interval.
    pub fn every_us(interval_us: u64) -> Self {
        Self { interval_us, due_us: None }
    }

    fn at_hz(hz: f64) -> Self {
        Self::every_us((1e6 / hz).round() as u64)
    }

    /// Whether it is due; if so, it is due again an interval later.
    pub fn fires(&mut self, now: SimTime) -> bool {
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

    /// How often it is due (Hz).
    pub fn hz(&self) -> f64 {
        1e6 / self.interval_us as f64
    }
}

impl Streams {
    /// Nothing sent yet.
    pub fn new(profile: &'static Profile) -> Self {
        let Address { system, component } = ADDRESS;
        Self {
            profile,
            encoder: Encoder::new(system, component),
            heartbeat: Timer::every_us(1_000_000),
            system_time: profile.system_time_hz.map(Timer::at_hz),
            odometry: profile.odometry_hz.map(Timer::at_hz),
            pressures: profile.pressure_hz.map(|hz| [Timer::at_hz(hz); PRESSURES]),
            truth: None,
            plant: None,
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

    /// Tells the flight controller to boot anew.
    pub fn put_reboot(&mut self, to: Address) {
        self.put(&reboot(to));
    }

    /// Everything of one instant.
    pub fn put_measurement(&mut self, measurement: &Measurement) {
        let now = measurement.time;
        if self.profile.heartbeat != Heartbeat::Never && self.heartbeat.fires(now) {
            self.put_heartbeat();
        }
        if self.system_time.as_mut().is_some_and(|timer| timer.fires(now)) {
            self.put(&system_time(now.us()));
        }
        let slow = [hil_gps(measurement), distance_sensor(measurement)];
        slow.iter().flatten().for_each(|message| self.put(message));
        if let Some(timer) = &mut self.odometry
            && let Some(message) = odometry(measurement)
            && timer.fires(now)
        {
            self.put(&message);
        }
        for (i, (name, value)) in named_pressures(&measurement.pressures).into_iter().enumerate() {
            if let Some(timers) = &mut self.pressures
                && let Some(pressure_pa) = value
                && timers[i].fires(now)
            {
                self.put(&pressure(name, pressure_pa, now.us()));
            }
        }
        if let Some(message) = hil_sensor(measurement) {
            self.put(&message);
        }
    }

    /// The true state, if it was asked for and is due.
    pub fn put_truth(&mut self, now: SimTime, vehicle: &Snapshot, datum: &Datum) {
        if self.truth.as_mut().is_some_and(|timer| timer.fires(now)) {
            self.put(&hil_state_quaternion(vehicle, datum, now.us()));
        }
    }

    /// The plant's floats, if they were asked for and are due.
    pub fn put_plant(&mut self, now: SimTime, plant: &Snapshot) {
        if self.plant.as_mut().is_some_and(|timer| timer.fires(now)) {
            self.put(&plant_array(plant, now.us()));
        }
    }

    /// The mark of a new flight.
    pub fn put_reset(&mut self, now: SimTime) {
        self.put(&reset_mark(now.us()));
    }

    /// A reply; its length on the wire.
    pub(crate) fn put_reply(&mut self, reply: &Reply) -> usize {
        let before = self.bytes.len();
        reply.encode(&mut self.encoder, &mut self.bytes);
        self.bytes.len() - before
    }

    /// A frame of somebody else, as it came.
    pub fn put_raw(&mut self, raw: &[u8]) {
        self.bytes.extend_from_slice(raw);
    }

    /// Sets how often a message comes (us), from `now` on: `None` never, 0 its default. A rate beyond what
    /// the sensors have, or beyond `spare_bytes_s` of the line, is not taken.
    ///
    /// # Errors
    /// When the message is none whose rate this profile leaves to its controller, or does not fit the line.
    pub fn set_interval(
        &mut self,
        message: u32,
        interval_us: Option<u64>,
        now: SimTime,
        spare_bytes_s: f64,
    ) -> Result<(), Refusal> {
        let (profile, answers) = (self.profile, self.profile.answers);
        let timer = |default_us: u64, least_us: u64| {
            interval_us.map(|us| {
                let interval_us = if us == 0 { default_us } else { us.max(least_us) };
                Timer { interval_us, due_us: Some(now.us().saturating_add(interval_us)) }
            })
        };
        let own = |hz: f64| timer((1e6 / hz) as u64, (1e6 / hz) as u64);
        match (message, profile.odometry_hz, profile.pressure_hz, profile.system_time_hz) {
            (id::HIL_STATE_QUATERNION, ..) if profile.truth_on_request => {
                let truth = timer(TRUTH_DEFAULT_US, TRUTH_LEAST_US);
                fits(&[truth, None], &[None, self.plant], spare_bytes_s)?;
                self.truth = truth;
            }
            (id::DEBUG_FLOAT_ARRAY, ..) if answers => {
                let plant = timer(PLANT_DEFAULT_US, PLANT_LEAST_US);
                fits(&[None, plant], &[self.truth, None], spare_bytes_s)?;
                self.plant = plant;
            }
            (id::ODOMETRY, Some(hz), ..) => self.odometry = own(hz),
            (id::NAMED_VALUE_FLOAT, _, Some(hz), _) => self.pressures = own(hz).map(|t| [t; PRESSURES]),
            (id::SYSTEM_TIME, .., Some(hz)) => self.system_time = own(hz),
            _ => return Err(Refusal::NotAdjustable),
        }
        Ok(())
    }

    /// Bytes a second of what was asked for beyond the profile's own streams.
    pub fn asked_bytes_s(&self) -> f64 {
        asked_bytes_s(&[self.truth, self.plant])
    }

    fn put(&mut self, message: &MavMessage) {
        self.encoder.encode(message, &mut self.bytes);
    }
}

/// Why an interval is not taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// The message is none, or its rate belongs to a sensor.
    NotAdjustable,
    /// The line has no room; bytes a second that would be taken and that are left.
    NoRoom {
        /// Taken (byte/s).
        taken_bytes_s: f64,
        /// Left (byte/s).
        left_bytes_s: f64,
    },
}

/// Of true state and plant.
fn asked_bytes_s(timers: &[Option<Timer>; 2]) -> f64 {
    let bytes = [frame_bytes::HIL_STATE_QUATERNION, frame_bytes::DEBUG_FLOAT_ARRAY];
    timers.iter().zip(bytes).map(|(timer, bytes)| timer.map_or(0.0, |timer| timer.hz() * bytes as f64)).sum()
}

/// Whether what is asked for now and what goes on fit what is left of the line.
fn fits(asked: &[Option<Timer>; 2], kept: &[Option<Timer>; 2], left_bytes_s: f64) -> Result<(), Refusal> {
    let taken_bytes_s = asked_bytes_s(asked) + asked_bytes_s(kept);
    // To take a stream away always fits.
    if asked.iter().any(Option::is_some) && taken_bytes_s > left_bytes_s {
        return Err(Refusal::NoRoom { taken_bytes_s, left_bytes_s });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::mavlink::Decoder;
    use crate::wire::profile::{GENERIC, PX4_HITL, PX4_SITL};

    fn ids(streams: &mut Streams) -> Vec<u32> {
        let mut decoder = Decoder::default();
        decoder.push(streams.bytes());
        streams.bytes().clear();
        std::iter::from_fn(|| decoder.next_frame()).map(|frame| frame.message_id).collect()
    }

    #[test]
    fn truth_comes_at_the_interval_asked_for_and_never_to_a_board() {
        let us = SimTime::from_us;
        let (vehicle, datum) = (Snapshot::default(), Datum::new(0.8, 0.1, 500.0));
        for profile in [&GENERIC, &PX4_SITL] {
            let mut streams = Streams::new(profile);
            streams.put_truth(us(1000), &vehicle, &datum);
            assert!(ids(&mut streams).is_empty());
            streams.set_interval(115, Some(5000), us(1000), 1e6).unwrap();
            let mut times = Vec::new();
            for ms in 2..=31 {
                streams.put_truth(us(1000 * ms), &vehicle, &datum);
                times.extend(ids(&mut streams).iter().map(|_| ms));
            }
            assert_eq!(times, [6, 11, 16, 21, 26, 31]);
            streams.set_interval(115, None, us(32_000), 0.0).unwrap();
            streams.put_truth(us(100_000), &vehicle, &datum);
            assert!(ids(&mut streams).is_empty());
        }
        let mut board = Streams::new(&PX4_HITL);
        assert_eq!(board.set_interval(115, Some(5000), SimTime::ZERO, 1e6), Err(Refusal::NotAdjustable));
        board.put_truth(us(100_000), &vehicle, &datum);
        assert!(ids(&mut board).is_empty());
    }

    /// 58 floats of 4 bytes, time, name and number, 12 bytes of frame: 264; at 10 Hz 2640 byte/s.
    #[test]
    fn what_does_not_fit_the_line_is_refused_and_what_goes_on_counts() {
        let mut streams = Streams::new(&GENERIC);
        let mut ask = |id, interval_us, spare| streams.set_interval(id, interval_us, SimTime::ZERO, spare);
        let refused = Err(Refusal::NoRoom { taken_bytes_s: 2640.0, left_bytes_s: 2600.0 });
        assert_eq!(ask(id::DEBUG_FLOAT_ARRAY, Some(100_000), 2600.0), refused);
        assert_eq!(ask(id::DEBUG_FLOAT_ARRAY, Some(0), 2640.0), Ok(()));
        // 76 bytes at 50 Hz on top of it.
        assert!(matches!(ask(115, Some(0), 6439.0), Err(Refusal::NoRoom { .. })));
        assert_eq!(ask(115, Some(0), 6440.0), Ok(()));
        assert_eq!(ask(id::DEBUG_FLOAT_ARRAY, None, 0.0), Ok(()));
        assert_eq!(streams.asked_bytes_s(), 3800.0);
    }

    #[test]
    fn rates_of_sensors_are_the_vehicle_s() {
        let mut streams = Streams::new(&GENERIC);
        for sensor in [107, 113, 132] {
            assert_eq!(
                streams.set_interval(sensor, Some(1000), SimTime::ZERO, 1e6),
                Err(Refusal::NotAdjustable)
            );
        }
        for own in [2, 251, 331] {
            assert_eq!(streams.set_interval(own, None, SimTime::ZERO, 1e6), Ok(()));
            assert_eq!(
                Streams::new(&PX4_SITL).set_interval(own, None, SimTime::ZERO, 1e6),
                Err(Refusal::NotAdjustable)
            );
        }
    }

    #[test]
    fn timers_keep_their_grid() {
        let mut timer = Timer::every_us(20_000);
        let fired: Vec<u64> =
            (1..=25).map(|i| i * 4000).filter(|us| timer.fires(SimTime::from_us(*us))).collect();
        assert_eq!(fired, [4000, 24_000, 44_000, 64_000, 84_000]);
    }
}
