//! The built-in autopilot as a MAVLink flight controller: HIL messages in, HIL_ACTUATOR_CONTROLS out.
//!
//! It speaks through the same codec and links as any other controller and knows no more than they do. Told to
//! boot anew it forgets everything, is silent for as long as that takes, and begins disarmed; samples that
//! the wire repeats or delivers out of order are left alone.

use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Result;
use hopbench::autopilot::Autopilot;
use hopbench::autopilot::abort::Abort;
use hopbench::autopilot::allocation::ThrottleOutput;
use hopbench::controls::{Controls, Scale, ThrottleKind};
use hopbench::environment::Environment;
use hopbench::event::Phase;
use hopbench::frame::Vec3;
use hopbench::scenario::Scenario;
use hopbench::signal::Measurement;
use hopbench::simulation::{Instrumentation, data_sheet};
use hopbench::time::SimTime;

use crate::bench::planner::Planner;
use crate::load;
use crate::wire::link::{Link, Notice};
use crate::wire::mavlink::measurement::{MeasurementReader, is_reset};
use crate::wire::mavlink::{
    AUTOPILOT_COMPONENT, Address, ControlsFrame, Decoder, Encoder, Frame, FromFc, MODE_ARMED, MODE_HIL,
    MavMessage, RESULT_ACCEPTED, actuator_controls, heartbeat, is_reboot,
};

/// MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, as PX4 sets it.
const MODE_CUSTOM: u8 = 1;
/// HIL_ACTUATOR_CONTROLS flag: the answer carries the time of the sample.
const FLAG_LOCKSTEP: u64 = 1;
/// A plant that was there and is silent for this long has ended.
const PLANT_SILENCE: Duration = Duration::from_secs(3);
/// Who it is.
const ADDRESS: Address = Address { system: 1, component: AUTOPILOT_COMPONENT };
/// From the first sample after a reboot to the first answer, in the plant's time: boards take some seconds.
const BOOT: SimTime = SimTime::from_us(2_000_000);
/// A plant's clock that goes back by more than this has been set anew; by less, the sample is an old one.
const REORDERED: SimTime = SimTime::from_us(1_000_000);

/// The built-in autopilot at the end of a link.
pub struct Pilot {
    fresh: Autopilot,
    autopilot: Autopilot,
    planner: Planner,
    controls: Controls,
    scale: Scale,
    reader: MeasurementReader,
    decoder: Decoder,
    encoder: Encoder,
    /// Frames that the link took.
    sent: u64,
    armed: bool,
    last: Option<SimTime>,
    boot: Boot,
    /// Leaves when the plant falls silent.
    leaves: bool,
    next_heartbeat: Instant,
    out: Vec<u8>,
}

/// Whether it is up.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Boot {
    Done,
    /// Nothing heard since.
    Begun,
    /// Done at this time of the plant.
    Until(SimTime),
}

/// What it believes, for the report of the run at the other end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    /// Phase of the mission.
    pub phase: Phase,
    /// Where it wants the vehicle to be (m).
    pub reference_ned_m: Vec3,
    /// Where it takes the vehicle to be (m).
    pub estimate_ned_m: Vec3,
    /// Whether and why it has given the mission up.
    pub abort: Option<Abort>,
    /// On the wire, when it was made.
    pub time: SimTime,
}

/// What a normalised command is worth on the scenario's vehicle.
pub(crate) fn scale(scenario: &Scenario) -> Scale {
    let vehicle = &scenario.vehicle;
    Scale {
        thrust_rated_n: vehicle.rating.thrust_rated_n,
        valve_open_rad: vehicle.valve_servo.upper_rad,
        gimbal_limit_rad: vehicle.gimbal.limit_rad,
    }
}

impl Pilot {
    /// A flight controller that is told what a scenario's vehicle and mission are.
    ///
    /// # Errors
    /// When the scenario contradicts itself, or the system has no thread left to plan on.
    pub fn for_scenario(
        scenario: &Scenario,
        instruments: &Instrumentation,
        throttle: ThrottleKind,
    ) -> Result<Self> {
        let (wind, seed) = (&scenario.file.wind, u64::from(scenario.file.seed));
        let environment = Environment::new(&scenario.site, wind, seed)
            .map_err(|fault| load::contradiction(Path::new(&scenario.name), fault))?;
        let mut parameters = data_sheet::parameters(scenario, &environment, instruments);
        let controls = &scenario.vehicle.controls;
        parameters.actuators.throttle_output = match controls.speaks(throttle) {
            ThrottleKind::Thrust => ThrottleOutput::Thrust,
            ThrottleKind::Valve => ThrottleOutput::Valve,
        };
        Ok(Self::new(Autopilot::new(parameters), controls.clone(), scale(scenario))?)
    }

    /// A flight controller for a vehicle with these channels.
    ///
    /// # Errors
    /// When the system has no thread left to plan on.
    pub fn new(autopilot: Autopilot, controls: Controls, scale: Scale) -> std::io::Result<Self> {
        Ok(Self {
            fresh: autopilot.clone(),
            autopilot,
            planner: Planner::start()?,
            controls,
            scale,
            reader: MeasurementReader::default(),
            decoder: Decoder::default(),
            encoder: Encoder::new(ADDRESS.system, ADDRESS.component),
            sent: 0,
            armed: false,
            last: None,
            boot: Boot::Done,
            leaves: true,
            next_heartbeat: Instant::now(),
            out: Vec::with_capacity(512),
        })
    }

    /// Stays however long its plant is silent: whoever started it says when to stop.
    #[must_use]
    pub fn until_stopped(mut self) -> Self {
        self.leaves = false;
        self
    }

    /// Flies until `stop` says so, or until the plant is gone. `tell` hears what is believed.
    pub fn serve(&mut self, link: &mut Link, stop: impl Fn() -> bool, mut tell: impl FnMut(Belief)) {
        let mut received = Vec::new();
        let mut fed = Instant::now();
        while !stop() {
            link.wait(Instant::now() + Duration::from_millis(50));
            received.clear();
            link.receive(&mut received);
            let hung_up = link.take_notices().iter().any(|n| matches!(n, Notice::Disconnected(_)));
            self.decoder.push(&received);
            while let Some(frame) = self.decoder.next_frame() {
                // Whoever speaks is there, though simulated time may stand.
                fed = Instant::now();
                let Some(message) = frame.message() else { continue };
                if is_reset(&message) {
                    self.forget();
                }
                if is_reboot(&message, ADDRESS) {
                    self.reboot(&frame, link);
                } else if self.is_up(&message)
                    && let Some(measurement) = self.reader.take(&message)
                {
                    self.answer(&measurement);
                    self.sent += u64::from(link.send(&self.out));
                    tell(self.belief());
                }
            }
            self.beat(link);
            let silent = self.leaves && fed.elapsed() > PLANT_SILENCE;
            if self.last.is_some() && (hung_up || silent) {
                return;
            }
        }
    }

    /// Frames heard and sent so far.
    pub fn frames(&self) -> (u64, u64) {
        (self.decoder.counters().frames, self.sent)
    }

    /// Whether a plant has been heard.
    pub fn has_flown(&self) -> bool {
        self.last.is_some()
    }

    /// Says that it will, and then is a controller that was just switched on.
    fn reboot(&mut self, asked: &Frame, link: &mut Link) {
        if let FromFc::Command(command) = asked.from_fc() {
            self.out.clear();
            self.encoder.encode_ack(&command, RESULT_ACCEPTED, &mut self.out);
            self.sent += u64::from(link.send(&self.out));
        }
        self.forget();
        self.reader = MeasurementReader::default();
        self.encoder = Encoder::new(ADDRESS.system, ADDRESS.component);
        self.boot = Boot::Begun;
    }

    /// Whether it is up and the message no old sample.
    fn is_up(&mut self, message: &MavMessage) -> bool {
        let MavMessage::HIL_SENSOR(sample) = message else { return self.boot == Boot::Done };
        let now = SimTime::from_us(sample.time_usec);
        match self.boot {
            Boot::Begun => self.boot = Boot::Until(now + BOOT),
            Boot::Until(done) if now >= done => self.boot = Boot::Done,
            _ => {}
        }
        // A gap of zero: not later than the last.
        let old = self.last.is_some_and(|last| now <= last && last.since(now) <= REORDERED);
        self.boot == Boot::Done && !old
    }

    /// One HIL_SENSOR, one answer, in `out`.
    fn answer(&mut self, measurement: &Measurement) {
        if self.last.is_some_and(|last| measurement.time < last) {
            // A clock set anew: another flight on the same link.
            self.forget();
        }
        self.last = Some(measurement.time);
        self.planner.deliver(&mut self.autopilot, measurement.time);
        let command = self.autopilot.update(measurement);
        self.planner.take(&mut self.autopilot);
        self.armed = command.armed;
        let mut controls = self.controls.encode(&command, &self.scale);
        self.controls.set_echo(&mut controls, measurement.time);
        let frame = ControlsFrame {
            time_us: measurement.time.us(),
            flags: FLAG_LOCKSTEP,
            controls,
            mode: MODE_CUSTOM | if command.armed { MODE_ARMED } else { 0 },
        };
        self.out.clear();
        self.encoder.encode(&actuator_controls(&frame), &mut self.out);
    }

    /// Begins anew, as after a boot.
    fn forget(&mut self) {
        self.autopilot = self.fresh.clone();
        self.planner.forget();
        self.armed = false;
    }

    /// Once a second, and faster until the plant has spoken: whoever listens answers only who writes.
    fn beat(&mut self, link: &mut Link) {
        let now = Instant::now();
        if now < self.next_heartbeat || self.boot != Boot::Done {
            return;
        }
        self.next_heartbeat = now + Duration::from_millis(if self.last.is_some() { 1000 } else { 50 });
        self.out.clear();
        let mode = MODE_CUSTOM | MODE_HIL | if self.armed { MODE_ARMED } else { 0 };
        self.encoder.encode(&heartbeat(mode), &mut self.out);
        self.sent += u64::from(link.send(&self.out));
    }

    fn belief(&self) -> Belief {
        Belief {
            phase: self.autopilot.phase(),
            reference_ned_m: self.autopilot.reference().position_ned_m,
            estimate_ned_m: self.autopilot.estimate().position_ned_m,
            abort: self.autopilot.abort(),
            time: self.last.unwrap_or(SimTime::ZERO),
        }
    }
}
