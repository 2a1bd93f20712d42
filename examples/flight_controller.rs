//! A flight computer in one page: flies `scenarios/own_computer.toml` over UDP, in its own units.
//!
//! ```text
//! cargo run --release -- hil scenarios/own_computer.toml --fc udp-listen:127.0.0.1:14600
//! cargo run --release --example flight_controller -- 127.0.0.1:14600
//! ```
//! In: HIL_SENSOR 250 Hz, ODOMETRY as the 5 Hz position beacon, pressures as NAMED_VALUE_FLOAT, HIL_GPS,
//! DISTANCE_SENSOR. Out: HIL_ACTUATOR_CONTROLS for each HIL_SENSOR, with its time: gimbal angles in radians,
//! thrust in newtons, roll thrusters -1, 0 or 1. Body FRD, world NED, small angles. Nothing here is
//! Hopbench's: the `mavlink` crate and a socket are all that a computer of your own needs.

#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // a program with clock, socket and standard error

use std::net::UdpSocket;
use std::time::{Duration, Instant};

use mavlink::dialects::common::{
    DISTANCE_SENSOR_DATA, HEARTBEAT_DATA, HIL_ACTUATOR_CONTROLS_DATA, HIL_SENSOR_DATA, MavMessage,
    MavModeFlag, ODOMETRY_DATA,
};
use mavlink::{MavHeader, MavlinkReader};

const G: f32 = 9.80665; // [m/s²]
const MASS_KG: f32 = 73.2; // at ignition; it burns 0.00053 kg per newton second
const ANGULAR_PER_GIMBAL: f32 = 0.40 / 22.0; // lever over inertia: [rad/s²] per newton and radian
const GIMBAL_LIMIT_RAD: f32 = 0.122;
const HOVER_M: f32 = 5.0;

#[rustfmt::skip]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Phase { #[default] Align, Armed, Light, Climb, Hover, Descend, Down, Safe }
use Phase::*;

#[derive(Default)]
struct Computer {
    phase: Phase,
    since_s: f32,
    last_us: u64,
    position_m: [f32; 3],   // NED from the beacon's origin
    velocity_m_s: [f32; 3], // NED
    attitude_rad: [f32; 3], // small rotations about x, y, z
    gyro_bias_rad_s: [f32; 3],
    trim_m_s2: [f32; 3],      // integral of the velocity error: wear, mass and wind
    rest_down_m: Option<f32>, // beacon's height on the pad
    mass_kg: f32,
    tank_bar: f32,
    chamber_bar: f32,
    ground_m: f32, // altimeter
}

impl Computer {
    fn beacon(&mut self, m: &ODOMETRY_DATA) {
        let [w, x, y, z] = m.q;
        let measured = [2.0 * (w * x + y * z), 2.0 * (w * y - x * z), 2.0 * (w * z + x * y)];
        let (r, v) = (self.attitude_rad, [m.vx, m.vy, m.vz]); // its velocity is in body axes
        let (turned, position) = (cross(r, v), [m.x, m.y, m.z]);
        for i in 0..3 {
            // Between two beacons the inertial unit carries on; a beacon pulls part of the way.
            self.position_m[i] += 0.6 * (position[i] - self.position_m[i]);
            self.velocity_m_s[i] += 0.5 * (v[i] + turned[i] - self.velocity_m_s[i]);
            self.attitude_rad[i] += 0.3 * (measured[i] - self.attitude_rad[i]);
        }
        if self.phase == Align {
            self.rest_down_m = Some(self.rest_down_m.map_or(m.z, |rest| rest + 0.2 * (m.z - rest)));
        }
    }

    /// One inertial sample: navigates, moves on through the phases, answers with armed and the four outputs.
    fn step(&mut self, m: &HIL_SENSOR_DATA) -> (bool, [f32; 4]) {
        let dt_s = if self.last_us == 0 { 0.004 } else { (m.time_usec - self.last_us) as f32 * 1e-6 };
        self.last_us = m.time_usec;
        self.since_s += dt_s;
        let (gyro, force) = ([m.xgyro, m.ygyro, m.zgyro], [m.xacc, m.yacc, m.zacc]);
        if self.phase == Align {
            (0..3).for_each(|i| self.gyro_bias_rad_s[i] += 0.01 * (gyro[i] - self.gyro_bias_rad_s[i]));
        }
        let rate: [f32; 3] = std::array::from_fn(|i| gyro[i] - self.gyro_bias_rad_s[i]);
        let turned = cross(self.attitude_rad, force);
        let flies = matches!(self.phase, Climb | Hover | Descend);
        for i in 0..3 {
            let acceleration = force[i] + turned[i] + if i == 2 { G } else { 0.0 };
            self.attitude_rad[i] += rate[i] * dt_s;
            self.velocity_m_s[i] += if flies { acceleration * dt_s } else { 0.0 };
            self.position_m[i] += if flies { self.velocity_m_s[i] * dt_s } else { 0.0 };
        }
        let height_m = self.rest_down_m.map_or(0.0, |rest| rest - self.position_m[2]);
        let next = match self.phase {
            Align if self.since_s > 2.5 && self.rest_down_m.is_some() && self.tank_bar > 55.0 => Armed,
            Armed if self.since_s > 1.5 => Light, // the isolation valve has opened
            Light if self.since_s > 1.2 && self.chamber_bar > 5.0 => Climb,
            Light if self.since_s > 3.0 => Safe, // no flame
            Climb if height_m > HOVER_M - 0.3 => Hover,
            Hover if self.since_s > 5.0 => Descend,
            Descend if self.ground_m < 1.0 && m.zacc < -14.0 => Down, // the legs push
            Down if self.since_s > 1.0 => Safe,
            same => same,
        };
        if next != self.phase {
            eprintln!("{:7.3} s {next:?}, {height_m:.2} m", m.time_usec as f32 * 1e-6);
            (self.phase, self.since_s) = (next, 0.0);
        }
        match self.phase {
            Align | Safe => (false, [0.0; 4]),
            Armed | Down => (true, [0.0; 4]),
            Light => (true, [0.0, 0.0, 300.0, 0.0]),
            Climb | Hover | Descend => (true, self.fly(height_m, rate, dt_s)),
        }
    }

    /// Position to velocity to acceleration to thrust and tilt; tilt to rate to gimbal angle.
    fn fly(&mut self, height_m: f32, rate: [f32; 3], dt_s: f32) -> [f32; 4] {
        let limit = |value: f32, most: f32| value.clamp(-most, most);
        let down_m_s = match self.phase {
            Descend if height_m < 1.2 => 0.5,
            Descend => 1.2,
            _ => -limit(0.8 * (HOVER_M - height_m), (0.3 + self.since_s).min(1.5)),
        };
        let [north_m, east_m, _] = self.position_m;
        let wanted = [limit(-0.35 * north_m, 0.5), limit(-0.35 * east_m, 0.5), down_m_s];
        let mut acceleration = [0.0; 3];
        for (i, (gain, integral)) in [(0.9, 0.15), (0.9, 0.15), (1.8, 0.6)].into_iter().enumerate() {
            let error = wanted[i] - self.velocity_m_s[i];
            self.trim_m_s2[i] = limit(self.trim_m_s2[i] + integral * error * dt_s, 1.5);
            acceleration[i] = limit(gain * error + self.trim_m_s2[i], 2.0);
        }
        let thrust_n = (self.mass_kg * (G - acceleration[2])).clamp(300.0, 1000.0);
        self.mass_kg -= thrust_n * 0.00053 * dt_s;
        // Thrust is along -z: pitch down to go north, roll right to go east.
        let tilt = [limit(acceleration[1] / G, 0.1), limit(-acceleration[0] / G, 0.1)];
        let gimbal_rad: [f32; 2] = std::array::from_fn(|i| {
            let turn = limit(2.2 * (tilt[i] - self.attitude_rad[i]), 0.3);
            limit(6.0 * (turn - rate[i]) / (thrust_n * ANGULAR_PER_GIMBAL), GIMBAL_LIMIT_RAD)
        });
        // 1 fires the pair that turns negatively about z; none within a dead zone.
        let heading = self.attitude_rad[2] + 1.2 * rate[2];
        let thrusters = if heading.abs() > 0.04 { heading.signum() } else { 0.0 };
        [gimbal_rad[0], gimbal_rad[1], thrust_n, thrusters]
    }
}

fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

fn main() -> std::io::Result<()> {
    let bench = std::env::args().nth(1).unwrap_or_else(|| "127.0.0.1:14600".to_owned());
    let socket = UdpSocket::bind("0.0.0.0:0")?;
    socket.connect(&bench)?;
    socket.set_read_timeout(Some(Duration::from_millis(100)))?;
    let mut computer = Computer { mass_kg: MASS_KG, ..Default::default() };
    let mut header = MavHeader { system_id: 1_u8.into(), component_id: 1, sequence: 0 };
    let mut send = |message: MavMessage| -> std::io::Result<()> {
        let mut frame = Vec::with_capacity(128);
        mavlink::write_v2_msg(&mut frame, header, &message).map_err(std::io::Error::other)?;
        header.sequence = header.sequence.wrapping_add(1);
        socket.send(&frame).or(Ok(0)).map(drop) // a bench that is not there yet refuses: speak again
    };
    let flags = MavModeFlag::MAV_MODE_FLAG_HIL_ENABLED | MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    let mode = |armed| if armed { flags | MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { flags };
    let (mut heard, mut beat, mut armed) = (Instant::now(), None::<Instant>, false);
    // The bench answers whoever writes; it ends the run, and so does three seconds of silence.
    while computer.last_us == 0 && heard.elapsed().as_secs() < 60 || heard.elapsed().as_secs() < 3 {
        let interval = Duration::from_millis(if computer.last_us == 0 { 100 } else { 1000 });
        if beat.is_none_or(|beat| beat.elapsed() > interval) {
            let alive = HEARTBEAT_DATA { base_mode: mode(armed), mavlink_version: 3, ..Default::default() };
            send(MavMessage::HEARTBEAT(alive))?;
            beat = Some(Instant::now());
        }
        let mut datagram = [0; 2048];
        let Ok(length) = socket.recv(&mut datagram) else { continue };
        let mut frames = MavlinkReader::new(&datagram[..length]);
        while let Ok((_, message)) = frames.read_any_message::<MavMessage>() {
            match message {
                MavMessage::ODOMETRY(m) => computer.beacon(&m),
                MavMessage::DISTANCE_SENSOR(DISTANCE_SENSOR_DATA { current_distance, .. }) => {
                    computer.ground_m = f32::from(current_distance) * 0.01; // cm -> m
                }
                MavMessage::NAMED_VALUE_FLOAT(m) => match m.name.to_str() {
                    Ok("tank_bar") => computer.tank_bar = m.value,
                    Ok("chamb_bar") => computer.chamber_bar = m.value,
                    _ => {}
                },
                MavMessage::HIL_GPS(m) if computer.last_us == 0 => eprintln!("at {}, {}", m.lat, m.lon),
                MavMessage::HIL_SENSOR(m) => {
                    heard = Instant::now();
                    let outputs;
                    (armed, outputs) = computer.step(&m);
                    let (time_usec, mode) = (m.time_usec, mode(armed));
                    let mut answer = HIL_ACTUATOR_CONTROLS_DATA { time_usec, mode, ..Default::default() };
                    answer.controls[..4].copy_from_slice(&outputs);
                    send(MavMessage::HIL_ACTUATOR_CONTROLS(answer))?;
                }
                _ => {}
            }
        }
    }
    if computer.phase == Safe { Ok(()) } else { Err(std::io::Error::other("the vehicle did not come down")) }
}
