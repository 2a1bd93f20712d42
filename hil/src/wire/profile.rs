//! What a given flight controller expects, as data: streams, rates, heartbeats, pacing, and what may be
//! asked for. Facts behind the PX4 profiles were observed on version 1.16.1.

use hopbench::controls::ThrottleKind;
use hopbench::environment::atmosphere::STANDARD_GRAVITY_M_S2;
use hopbench::sensor::SensorParameters;
use hopbench::signal::Measurement;

use crate::wire::link::LinkSpec;
use crate::wire::mavlink::frame_bytes;

/// One kind of flight controller.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// As the command line spells it.
    pub name: &'static str,
    /// Pacing unless the command line says otherwise.
    pub pacing: Pacing,
    /// Whether it can answer each HIL_SENSOR with its time.
    pub lockstep_possible: bool,
    /// What its throttle channel commands unless the vehicle file says so.
    pub throttle: ThrottleKind,
    /// Delay of satellite navigation that it is set up for (s); `None`: the vehicle file's.
    pub gnss_delay_s: Option<f64>,
    /// Heartbeats to it.
    pub heartbeat: Heartbeat,
    /// Whether it gets nothing but heartbeats until its own carries the HIL flag.
    pub needs_hil_flag: bool,
    /// Whether it may ask for the true state.
    pub truth_on_request: bool,
    /// Whether the services of the bench are open to it: commands are acknowledged, parameters answered.
    pub answers: bool,
    /// Whether a new flight may begin while it is armed. A board that finds itself elsewhere would fly.
    pub resets_armed: bool,
    /// ODOMETRY, the rig's tracking, at most at this rate (Hz).
    pub odometry_hz: Option<f64>,
    /// NAMED_VALUE_FLOAT of each pressure, at most at this rate (Hz).
    pub pressure_hz: Option<f64>,
    /// SYSTEM_TIME (Hz).
    pub system_time_hz: Option<f64>,
    /// Whether inertial samples end in a 16-bit FIFO that overflows.
    pub clamps_inertial: bool,
}

/// Who waits for whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pacing {
    /// One step of the flight controller for each HIL_SENSOR.
    Lockstep,
    /// The wall clock.
    RealTime,
}

/// Heartbeats to a flight controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Heartbeat {
    /// It looks at none.
    Never,
    /// Once a second.
    EverySecond,
    /// Ten a second until it answers: PX4 on USB opens MAVLink only once it hears one.
    EagerUntilAnswered,
}

/// PX4 in software, dialling in on TCP.
pub const PX4_SITL: Profile = Profile {
    name: "px4-sitl",
    pacing: Pacing::Lockstep,
    lockstep_possible: true,
    throttle: ThrottleKind::Thrust,
    gnss_delay_s: Some(0.010),
    heartbeat: Heartbeat::Never,
    needs_hil_flag: false,
    truth_on_request: true,
    answers: false,
    resets_armed: false,
    odometry_hz: None,
    pressure_hz: None,
    system_time_hz: None,
    clamps_inertial: true,
};

/// PX4 on its own board. The true state is never sent: it would fight the board's estimator.
pub const PX4_HITL: Profile = Profile {
    name: "px4-hitl",
    pacing: Pacing::RealTime,
    lockstep_possible: false,
    gnss_delay_s: Some(0.110),
    heartbeat: Heartbeat::EagerUntilAnswered,
    needs_hil_flag: true,
    truth_on_request: false,
    ..PX4_SITL
};

/// Any flight controller that speaks MAVLink's HIL messages; the built-in autopilot is one.
pub const GENERIC: Profile = Profile {
    name: "generic",
    pacing: Pacing::RealTime,
    lockstep_possible: true,
    throttle: ThrottleKind::Valve,
    gnss_delay_s: None,
    heartbeat: Heartbeat::EverySecond,
    needs_hil_flag: false,
    truth_on_request: true,
    answers: true,
    resets_armed: true,
    odometry_hz: Some(50.0),
    pressure_hz: Some(50.0),
    system_time_hz: Some(1.0),
    clamps_inertial: false,
};

/// Every profile.
pub const PROFILES: [&Profile; 3] = [&PX4_SITL, &PX4_HITL, &GENERIC];

/// PX4 in software dials 4560 and its instance's number.
const PX4_PORTS: std::ops::RangeInclusive<u16> = 4560..=4569;

/// The profile of that name.
pub fn named(name: &str) -> Option<&'static Profile> {
    PROFILES.into_iter().find(|profile| profile.name == name)
}

/// The profile of a link when none is named: PX4 in software dials port 4560 plus its instance, serial is a
/// PX4 board.
pub fn default_for(link: &LinkSpec) -> &'static Profile {
    match link {
        LinkSpec::TcpListen(host) if PX4_PORTS.contains(&host.port) => &PX4_SITL,
        LinkSpec::Serial { .. } => &PX4_HITL,
        _ => &GENERIC,
    }
}

impl Profile {
    /// Keeps inertial samples within what PX4's FIFO holds: ±16 g in steps of g/2048, ±2000 deg/s.
    pub fn clamp(&self, measurement: &mut Measurement) {
        const ACCELERATION_M_S2: f64 = 16.0 * STANDARD_GRAVITY_M_S2 * (32767.0 / 32768.0);
        const RATE_RAD_S: f64 = 2000.0 * std::f64::consts::PI / 180.0 * (32767.0 / 32768.0);
        if !self.clamps_inertial {
            return;
        }
        let force = |a: &mut f64| *a = a.clamp(-ACCELERATION_M_S2, ACCELERATION_M_S2);
        let rate = |w: &mut f64| *w = w.clamp(-RATE_RAD_S, RATE_RAD_S);
        if let Some(imu) = &mut measurement.imu {
            imu.specific_force_body_m_s2.apply(force);
            imu.rate_body_rad_s.apply(rate);
        }
        if let Some(unit) = &mut measurement.broken_imu {
            unit.specific_force_body_m_s2.iter_mut().for_each(|left| left.apply(force));
            unit.rate_body_rad_s.iter_mut().for_each(|left| left.apply(rate));
        }
    }
}

impl Profile {
    /// Raises white noise below one step of PX4's sensor pipeline to that step, and names what it raised:
    /// samples that repeat themselves bit by bit look like a dead sensor to its checks. One sample at rate f
    /// has density times the root of f / 2, so a low rate makes even a good sensor repeat itself.
    pub fn raise_noise(&self, sensors: &mut SensorParameters, imu_rate_hz: Option<f64>) -> Vec<String> {
        if !self.clamps_inertial {
            return Vec::new();
        }
        let imu_hz = imu_rate_hz.unwrap_or(sensors.imu.rate_hz);
        let (magnetometer_hz, barometer_hz) = (sensors.magnetometer.rate_hz, sensors.barometer.rate_hz);
        let quantities: [(&str, &mut f64, f64, f64); 4] = [
            (
                "imu.accelerometer.noise_density_m_s2_sqrt_hz",
                &mut sensors.imu.accelerometer.noise_density_m_s2_sqrt_hz,
                imu_hz,
                STANDARD_GRAVITY_M_S2 / 2048.0,
            ),
            (
                "imu.gyroscope.noise_density_rad_s_sqrt_hz",
                &mut sensors.imu.gyroscope.noise_density_rad_s_sqrt_hz,
                imu_hz,
                (2000.0 / 32768.0) * std::f64::consts::PI / 180.0,
            ),
            (
                "magnetometer.noise_density_t_sqrt_hz",
                &mut sensors.magnetometer.noise_density_t_sqrt_hz,
                magnetometer_hz,
                1e-7,
            ),
            (
                "barometer.noise_density_pa_sqrt_hz",
                &mut sensors.barometer.noise_density_pa_sqrt_hz,
                barometer_hz,
                1.0,
            ),
        ];
        let mut raised = Vec::new();
        for (key, density, rate_hz, step) in quantities {
            let least = step / (0.5 * rate_hz).sqrt();
            if *density < least {
                *density = least;
                raised.push(format!("vehicle.sensors.{key} = {least:.3e}"));
            }
        }
        raised
    }
}

/// How often the sensors of a vehicle speak (Hz).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorRates {
    /// HIL_SENSOR.
    pub imu_hz: f64,
    /// HIL_GPS.
    pub gnss_hz: f64,
    /// DISTANCE_SENSOR.
    pub altimeter_hz: f64,
}

impl SensorRates {
    /// Those of a vehicle's sensors; `imu_hz`: another rate of HIL_SENSOR than the vehicle file's.
    pub fn of(sensors: &SensorParameters, imu_hz: Option<f64>) -> Self {
        Self {
            imu_hz: imu_hz.unwrap_or(sensors.imu.rate_hz),
            gnss_hz: sensors.gnss.rate_hz,
            altimeter_hz: sensors.altimeter.rate_hz,
        }
    }
}

/// Share of a serial line that a profile takes.
#[derive(Clone, Debug, PartialEq)]
pub enum Budget {
    /// Below 70 %.
    Fits {
        /// Share (%).
        load_percent: f64,
    },
    /// 70 to 90 %: queues build up now and then.
    Tight {
        /// Share (%).
        load_percent: f64,
    },
    /// Above 90 %: samples would arrive later and later.
    Refused {
        /// Share (%).
        load_percent: f64,
        /// Greatest usual rate of HIL_SENSOR that stays below 70 % (Hz), if there is one.
        fitting_hz: Option<f64>,
    },
}

impl Profile {
    /// Bytes a second to the flight controller, without what it may ask for.
    pub fn bytes_per_s(&self, rates: &SensorRates) -> f64 {
        let heartbeat_hz = if self.heartbeat == Heartbeat::Never { 0.0 } else { 1.0 };
        let streams = [
            (rates.imu_hz, frame_bytes::HIL_SENSOR),
            (rates.gnss_hz, frame_bytes::HIL_GPS),
            (rates.altimeter_hz, frame_bytes::DISTANCE_SENSOR),
            (heartbeat_hz, frame_bytes::HEARTBEAT),
            (self.odometry_hz.unwrap_or(0.0), frame_bytes::ODOMETRY),
            (self.pressure_hz.unwrap_or(0.0) * 3.0, frame_bytes::NAMED_VALUE_FLOAT),
            (self.system_time_hz.unwrap_or(0.0), frame_bytes::SYSTEM_TIME),
        ];
        streams.into_iter().map(|(hz, frame_bytes)| hz * frame_bytes as f64).sum()
    }

    /// Bytes a second that a serial line has left for what is asked for, answers and forwarded frames: up to
    /// 90 % of it.
    pub fn spare_bytes_s(&self, rates: &SensorRates, baud: u32) -> f64 {
        (0.9 * f64::from(baud) / 10.0 - self.bytes_per_s(rates)).max(0.0)
    }

    /// Whether the profile fits a serial line of `baud` symbols a second, ten to a byte.
    pub fn budget(&self, rates: &SensorRates, baud: u32) -> Budget {
        let load = |imu_hz: f64| {
            self.bytes_per_s(&SensorRates { imu_hz, ..*rates }) / (f64::from(baud) / 10.0) * 100.0
        };
        let load_percent = load(rates.imu_hz);
        if load_percent < 70.0 {
            Budget::Fits { load_percent }
        } else if load_percent <= 90.0 {
            Budget::Tight { load_percent }
        } else {
            let usual_hz = [1000.0, 500.0, 250.0, 200.0, 125.0, 100.0, 50.0];
            let fitting_hz = usual_hz.into_iter().find(|hz| *hz < rates.imu_hz && load(*hz) < 70.0);
            Budget::Refused { load_percent, fitting_hz }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATES: SensorRates = SensorRates { imu_hz: 250.0, gnss_hz: 10.0, altimeter_hz: 50.0 };

    #[test]
    fn the_link_chooses_the_profile() {
        for (link, name) in [
            ("tcp-listen:127.0.0.1:4560", "px4-sitl"),
            ("tcp-listen:4569", "px4-sitl"),
            ("tcp-listen:4570", "generic"),
            ("tcp-listen:4559", "generic"),
            ("serial:/dev/ttyACM0:921600", "px4-hitl"),
            ("udp-listen:127.0.0.1:14555", "generic"),
        ] {
            assert_eq!(default_for(&link.parse().unwrap()).name, name, "{link}");
        }
    }

    #[test]
    fn noise_is_raised_to_a_step_of_the_fifo_only_where_it_is_below() {
        let file =
            std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/vehicles/reference.toml");
        let sensors = crate::load::vehicle(&file, &[]).unwrap().sensors;
        // The reference vehicle at its own rate is noisy enough, and other controllers have no such steps.
        for (profile, rate_hz) in [(&PX4_SITL, None), (&PX4_HITL, Some(250.0)), (&GENERIC, Some(50.0))] {
            let mut asked = sensors.clone();
            assert_eq!(profile.raise_noise(&mut asked, rate_hz), [""; 0]);
            assert_eq!(asked.imu.gyroscope, sensors.imu.gyroscope);
        }
        // 1.4e-4 rad/s/√Hz at 100 Hz are 0.99e-3 rad/s, below 1.065e-3; the accelerometer's 10.6e-3 m/s² are
        // not.
        let mut slow = sensors.clone();
        let raised = PX4_HITL.raise_noise(&mut slow, Some(100.0));
        assert!(raised.len() == 1 && raised[0].contains("gyroscope"), "{raised:?}");
        let sigma = slow.imu.gyroscope.noise_density_rad_s_sqrt_hz * 50f64.sqrt();
        assert!((sigma - 1.0653e-3).abs() < 1e-6, "{sigma}");
    }

    #[test]
    fn a_slow_line_is_refused_with_the_rate_that_fits() {
        // 250 * 77 + 10 * 51 + 50 * 51 + 21 = 22331 byte/s.
        assert_eq!(PX4_HITL.bytes_per_s(&RATES), 22_331.0);
        assert!(
            matches!(PX4_HITL.budget(&RATES, 921_600), Budget::Fits { load_percent } if load_percent < 25.0)
        );
        assert!(matches!(PX4_HITL.budget(&RATES, 256_000), Budget::Tight { .. }));
        // 115200 baud carry 11520 byte/s, 70 % are 8064: 50 Hz takes 6931, 100 Hz 10781.
        let Budget::Refused { fitting_hz, .. } = PX4_HITL.budget(&RATES, 115_200) else { panic!() };
        assert_eq!(fitting_hz, Some(50.0));
        let Budget::Refused { fitting_hz, .. } = PX4_HITL.budget(&RATES, 9600) else { panic!() };
        assert_eq!(fitting_hz, None);
    }
}
