//! A plant of the test's own: compact six degrees of freedom with what a lander's controller has to fear.
//!
//! Variable mass, valve and gimbal servos with dead time, the swinging engine (zeros of torque over gimbal
//! angle), one slosh mode per axis, legs with friction, wind with gusts, and sensors with noise, bias,
//! drift and delay. Written apart from the product's plant on purpose, from the same equations
//! (moments about the pivot, body axes): a controller must not be proven on its own model alone.
//! Semi-implicit Euler at 0.5 ms.

#![allow(dead_code)]

use hopbench::autopilot::allocation::{ActuatorParameters, ThrottleOutput, ThrustMap};
use hopbench::autopilot::control::Gains;
use hopbench::autopilot::navigation::{
    AccelerometerNoise, AltimeterNoise, BarometerNoise, GnssParameters, GyroscopeNoise, HorizontalVertical,
    MagnetometerNoise, NavigationParameters,
};
use hopbench::autopilot::propellant::PropellantParameters;
use hopbench::autopilot::rigid_body::MassProperties;
use hopbench::autopilot::roll::{RollDrive, RollThrusters};
use hopbench::autopilot::sequence::SequenceParameters;
use hopbench::autopilot::tracking::observer::ServoParameters;
use hopbench::autopilot::tracking::{TrackingParameters, WEIGHTS};
use hopbench::autopilot::{Mission, Parameters, lcvx, mpc};
use hopbench::frame::{Mat3, Vec3, point_inertia, skew, tilt_rad};
use hopbench::signal::*;
use hopbench::time::SimTime;
use nalgebra::{SMatrix, SVector, UnitQuaternion};
use std::collections::VecDeque;

const G: f64 = 9.80665;
const STEP_S: f64 = 5e-4;
const STEPS_PER_IMU: u64 = 8;
const LATITUDE_RAD: f64 = 0.497_418_8;
const LONGITUDE_RAD: f64 = -1.406_211_8;
/// Metres per radian at 28.5 deg: WGS 84 meridian and parallel, good to 1e-4 of a hop's distance.
const NORTH_M: f64 = 6_350_090.0;
const EAST_M: f64 = 5_609_350.0;
const FIELD_NED_T: Vec3 = Vec3::new(2.39e-5, -2.6e-6, 3.86e-5);
pub const IMU_BODY_M: Vec3 = Vec3::new(0.0, 0.010, -1.25);
const ANTENNA_BODY_M: Vec3 = Vec3::new(0.0, -0.10, -1.32);
const ALTIMETER_BODY_M: Vec3 = Vec3::new(0.15, 0.0, -0.05);

/// Steady points of the reference engine at a port radius of 35 mm: thrust, valve angle, flows.
const ENGINE: [[f64; 4]; 5] = [
    [300.0, 15.022, 0.15488, 0.04141],
    [450.0, 17.878, 0.21224, 0.04924],
    [650.0, 21.451, 0.28963, 0.05843],
    [850.0, 25.040, 0.36791, 0.06664],
    [1000.0, 28.888, 0.42718, 0.07235],
];

/// Engine map for plant and autopilot.
pub fn thrust_map() -> ThrustMap {
    let column = |k: usize, scale: f64| vec![ENGINE.iter().map(|row| row[k] * scale).collect::<Vec<_>>()];
    ThrustMap {
        thrust_n: ENGINE.iter().map(|row| row[0]).collect(),
        port_radius_m: vec![0.035],
        valve_rad: column(1, 1f64.to_radians()),
        oxidizer_kg_s: column(2, 1.0),
        fuel_kg_s: column(3, 1.0),
    }
}

/// The autopilot's knowledge of this plant.
pub fn parameters(mission: Mission, rtk: bool) -> Parameters {
    let per_axis = |horizontal, vertical| HorizontalVertical { horizontal, vertical };
    Parameters {
        mission,
        sequence: SequenceParameters::default(),
        navigation: NavigationParameters {
            imu_body_m: IMU_BODY_M,
            accelerometer: AccelerometerNoise {
                noise_std_m_s2: 1.7e-2,
                bias_std_m_s2: 0.05,
                random_walk_m_s2_sqrt_s: 3e-4,
            },
            gyroscope: GyroscopeNoise {
                noise_std_rad_s: 1.6e-3,
                bias_std_rad_s: 8.7e-4,
                random_walk_rad_s_sqrt_s: 2e-5,
            },
            gnss: GnssParameters {
                delay_s: if rtk { 0.10 } else { 0.12 },
                antenna_body_m: ANTENNA_BODY_M,
                position_std_m: if rtk { per_axis(0.010, 0.015) } else { per_axis(0.15, 0.30) },
                drift_std_m: if rtk { per_axis(0.010, 0.015) } else { per_axis(0.60, 1.00) },
                drift_time_s: 200.0,
                velocity_std_m_s: if rtk { per_axis(0.03, 0.05) } else { per_axis(0.05, 0.08) },
            },
            barometer: BarometerNoise { noise_std_m: 0.21, random_walk_m_sqrt_s: 0.025 },
            barometer_delay_s: 0.02,
            altimeter: AltimeterNoise { noise_std_m: 0.02, noise_fraction: 0.002 },
            altimeter_body_m: ALTIMETER_BODY_M,
            altimeter_delay_s: 0.02,
            magnetic_field_ned_t: Some(FIELD_NED_T),
            magnetometer: MagnetometerNoise { noise_std_t: 2e-7, hard_iron_std_t: 5e-7 },
            rest_heading_rad: 0.0,
            rest_ned_m: Vec3::new(0.0, 0.0, -0.741),
            gravity_m_s2: G,
        },
        propellant: PropellantParameters {
            full: MassProperties {
                mass_kg: 73.40,
                com_body_m: Vec3::new(0.0, 0.0, -0.4015),
                inertia_kg_m2: [22.294, 22.294, 2.418],
            },
            empty: MassProperties {
                mass_kg: 60.73,
                com_body_m: Vec3::new(0.0, 0.0, -0.3878),
                inertia_kg_m2: [20.73, 20.73, 2.367],
            },
            oxidizer_kg: 13.32,
            fuel_kg: 2.95,
            port_radius_m: 0.025,
            fuel_kg_per_m2: 940.0 * 0.25,
            delay_s: 0.005,
            lag_s: 2.0 * 0.8 / 31.416,
            ignition_delay_s: 0.3,
            rise_s: 0.25,
            thrust_min_n: 300.0,
            thrust_max_n: 1050.0,
            thrust_shut_n: 20.0,
        },
        thrust_map: thrust_map(),
        actuators: ActuatorParameters {
            thrust_min_n: 300.0,
            thrust_max_n: 1050.0,
            gimbal_limit_rad: 7f64.to_radians(),
            gimbal_rate_limit_rad_s: 90f64.to_radians(),
            roll: RollThrusters {
                torque_n_m: 2.0,
                flow_kg_s: 0.0157,
                dead_band: 0.06,
                drive: RollDrive::Duty,
            },
            throttle_output: ThrottleOutput::Thrust,
        },
        gains: Gains::default(),
        tracking: TrackingParameters {
            stages: 30,
            stage_s: 0.05,
            period_s: 0.02,
            weights: WEIGHTS,
            thrust_rate_n_s: 1500.0,
            gimbal_rate_rad_s: 0.8,
            gimbal_limit_rad: 0.95 * 7f64.to_radians(),
            roll_torque_n_m: 2.0,
            tilt_rad: 0.21,
            servo: ServoParameters {
                natural_frequency_rad_s: 50.265,
                damping_ratio: 0.7,
                rate_limit_rad_s: 90f64.to_radians(),
                delay_s: 0.005,
            },
            engine_moment_kg_m: 2.6,
            engine_inertia_kg_m2: 0.7203,
            solver: mpc::Settings::default(),
            fallback_solver: mpc::Settings { iterations: 40, tolerance: 1e-6 },
        },
        planner: lcvx::Settings::FLIGHT,
    }
}

/// Uniform and normal numbers from a seed (splitmix64, Box-Muller).
#[derive(Clone)]
pub struct Noise(u64);

impl Noise {
    pub fn new(seed: u64) -> Self {
        // Hashed, since seeds a multiple of the increment apart would give shifts of one sequence.
        let z = (seed ^ 0xD1B5_4A32_D192_ED03).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 31)).wrapping_mul(0x94D0_49BB_1331_11EB);
        Self(z ^ (z >> 29))
    }

    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn normal(&mut self, std: f64) -> f64 {
        let (u, v) = (self.uniform().max(1e-300), self.uniform());
        std * (-2.0 * libm::log(u)).sqrt() * libm::cos(core::f64::consts::TAU * v)
    }

    pub fn vector(&mut self, std: f64) -> Vec3 {
        Vec3::new(self.normal(std), self.normal(std), self.normal(std))
    }
}

/// What differs from flight to flight.
#[derive(Clone)]
pub struct Conditions {
    pub seed: u64,
    pub rtk: bool,
    pub wind_m_s: f64,
    pub thrust_factor: f64,
    pub com_offset_body_m: Vec3,
    pub gnss_outage_s: Option<(f64, f64)>,
    pub chamber_transducer: bool,
    pub altimeter: bool,
    pub magnetometer: bool,
    pub barometer: bool,
    pub slosh_damping: f64,
    pub servo_delay_s: f64,
    pub gimbal_natural_frequency_rad_s: f64,
    pub inertia_factor: f64,
}

impl Conditions {
    pub fn calm(seed: u64) -> Self {
        Self {
            seed,
            rtk: false,
            wind_m_s: 0.0,
            thrust_factor: 1.0,
            com_offset_body_m: Vec3::zeros(),
            gnss_outage_s: None,
            chamber_transducer: true,
            altimeter: true,
            magnetometer: true,
            barometer: true,
            slosh_damping: 0.03,
            servo_delay_s: 0.005,
            gimbal_natural_frequency_rad_s: 50.265,
            inertia_factor: 1.0,
        }
    }

    /// Wind 0..6 m/s with gusts, thrust ±4 %, centre of mass ±5 mm, drawn from the seed.
    pub fn dispersed(seed: u64) -> Self {
        let mut draw = Noise::new(seed ^ 0xABCD);
        Self {
            wind_m_s: 6.0 * draw.uniform(),
            thrust_factor: 1.0 + 0.08 * (draw.uniform() - 0.5),
            com_offset_body_m: Vec3::new(0.01 * (draw.uniform() - 0.5), 0.01 * (draw.uniform() - 0.5), 0.0),
            rtk: seed % 2 == 1,
            ..Self::calm(seed)
        }
    }
}

#[derive(Clone)]
struct Servo {
    position: f64,
    velocity: f64,
    omega: f64,
    damping: f64,
    rate_limit: f64,
    delayed: VecDeque<f64>,
}

impl Servo {
    fn new(omega: f64, damping: f64, rate_limit: f64, delay_s: f64) -> Self {
        let steps = (delay_s / STEP_S).round() as usize;
        Self { position: 0.0, velocity: 0.0, omega, damping, rate_limit, delayed: vec![0.0; steps].into() }
    }

    /// Steps and gives the acceleration realised.
    fn step(&mut self, command: f64) -> f64 {
        self.delayed.push_back(command);
        let target = self.delayed.pop_front().unwrap_or(command);
        let wanted = self.omega * self.omega * (target - self.position)
            - 2.0 * self.damping * self.omega * self.velocity;
        let before = self.velocity;
        self.velocity = (self.velocity + wanted * STEP_S).clamp(-self.rate_limit, self.rate_limit);
        self.position += self.velocity * STEP_S;
        (self.velocity - before) / STEP_S
    }
}

/// Contact seen first.
#[derive(Clone, Copy, Debug)]
pub struct Touchdown {
    pub time_s: f64,
    pub vertical_speed_m_s: f64,
    pub lateral_speed_m_s: f64,
    pub tilt_rad: f64,
    pub position_ned_m: Vec3,
}

pub struct Plant {
    pub conditions: Conditions,
    pub steps: u64,
    pub position_ned_m: Vec3,
    pub velocity_ned_m_s: Vec3,
    pub q: UnitQuaternion<f64>,
    pub rate: Vec3,
    pub oxidizer_kg: f64,
    pub fuel_kg: f64,
    pub thrust_n: f64,
    pub slosh_m: [f64; 2],
    pub lift_off_s: Option<f64>,
    pub touchdown: Option<Touchdown>,
    pub in_contact: bool,
    slosh_rate: [f64; 2],
    valve: Servo,
    gimbal: [Servo; 2],
    anchors: [Option<Vec3>; 4],
    throttled_s: f64,
    rise: f64,
    roll_phase_s: f64,
    roll_torque: f64,
    map: ThrustMap,
    force_sum: Vec3,
    rate_sum: Vec3,
    wind: Vec3,
    gust: Vec3,
    sensors: Sensors,
}

struct Sensors {
    noise: Noise,
    accel_bias: Vec3,
    gyro_bias: Vec3,
    gnss_drift: Vec3,
    baro_bias_m: f64,
    iron: Vec3,
    altimeter_bias_m: f64,
    gnss: VecDeque<(u64, GnssFix)>,
    baro: VecDeque<(u64, BarometerSample)>,
    altimeter: VecDeque<(u64, AltimeterSample)>,
}

impl Plant {
    pub fn new(conditions: Conditions) -> Self {
        let mut noise = Noise::new(conditions.seed);
        let drift = if conditions.rtk { [0.010, 0.015] } else { [0.6, 1.0] };
        let sensors = Sensors {
            accel_bias: noise.vector(0.05),
            gyro_bias: noise.vector(8.7e-4),
            gnss_drift: Vec3::new(noise.normal(drift[0]), noise.normal(drift[0]), noise.normal(drift[1])),
            baro_bias_m: noise.normal(2.5),
            iron: noise.vector(5e-7),
            altimeter_bias_m: noise.normal(0.02),
            noise,
            gnss: VecDeque::new(),
            baro: VecDeque::new(),
            altimeter: VecDeque::new(),
        };
        let direction = Noise::new(conditions.seed ^ 77).uniform() * core::f64::consts::TAU;
        let wind = Vec3::new(libm::cos(direction), libm::sin(direction), 0.0) * conditions.wind_m_s;
        let delay_s = conditions.servo_delay_s;
        let gimbal = Servo::new(conditions.gimbal_natural_frequency_rad_s, 0.7, 90f64.to_radians(), delay_s);
        Self {
            conditions,
            steps: 0,
            position_ned_m: Vec3::new(0.0, 0.0, -0.741),
            velocity_ned_m_s: Vec3::zeros(),
            q: UnitQuaternion::identity(),
            rate: Vec3::zeros(),
            oxidizer_kg: 13.472,
            fuel_kg: 2.952,
            thrust_n: 0.0,
            slosh_m: [0.0; 2],
            lift_off_s: None,
            touchdown: None,
            in_contact: true,
            slosh_rate: [0.0; 2],
            valve: Servo::new(31.416, 0.8, 120f64.to_radians(), delay_s),
            gimbal: [gimbal.clone(), gimbal],
            anchors: [None; 4],
            throttled_s: 0.0,
            rise: 0.0,
            roll_phase_s: 0.0,
            roll_torque: 0.0,
            map: thrust_map(),
            force_sum: Vec3::zeros(),
            rate_sum: Vec3::zeros(),
            wind,
            gust: Vec3::zeros(),
            sensors,
        }
    }

    pub fn gyro_bias(&self) -> Vec3 {
        self.sensors.gyro_bias
    }

    pub fn accelerometer_bias(&self) -> Vec3 {
        self.sensors.accel_bias
    }

    pub fn time_s(&self) -> f64 {
        self.steps as f64 * STEP_S
    }

    pub fn mass_kg(&self) -> f64 {
        56.976 + self.oxidizer_kg + self.fuel_kg
    }

    pub fn com_body_m(&self) -> Vec3 {
        let used = (73.40 - self.mass_kg()) / (73.40 - 60.73);
        self.conditions.com_offset_body_m + Vec3::new(0.0, 0.0, -(0.4015 - 0.0137 * used))
    }

    pub fn com_velocity(&self) -> Vec3 {
        self.velocity_ned_m_s + self.q * self.rate.cross(&self.com_body_m())
    }

    pub fn height_m(&self) -> f64 {
        -0.741 - self.position_ned_m.z
    }

    /// One inertial sample's time with a command held, then the measurement of its end.
    pub fn advance(&mut self, command: &ActuatorCommand) -> Measurement {
        self.force_sum = Vec3::zeros();
        self.rate_sum = Vec3::zeros();
        for _ in 0..STEPS_PER_IMU {
            self.step(command);
        }
        self.measure()
    }

    fn step(&mut self, command: &ActuatorCommand) {
        self.steps += 1;
        let demand = match command.throttle {
            _ if !command.armed => 0.0,
            Throttle::ThrustN(t) if t > 20.0 => self.map.valve_angle_rad(t.clamp(300.0, 1050.0), 0.035),
            Throttle::ThrustN(_) => 0.0,
            Throttle::ValveRad(a) => a,
        };
        self.engine(demand);
        let limit = 7f64.to_radians();
        let gx = self.gimbal[0].step(command.gimbal_x_rad.clamp(-limit, limit));
        let gy = self.gimbal[1].step(command.gimbal_y_rad.clamp(-limit, limit));
        self.roll(if command.armed { command.rcs_roll } else { 0.0 });
        self.blow();

        let r = *self.q.to_rotation_matrix().matrix();
        let mass = self.mass_kg();
        let com = self.com_body_m();
        let s = com * mass;
        let inertia_com = Vec3::new(21.5, 21.5, 2.39) * self.conditions.inertia_factor;
        let inertia = Mat3::from_diagonal(&inertia_com) + point_inertia(com) * mass;

        // Thrust through the pivot, and the reaction of the swinging engine.
        let (x, y) = (self.gimbal[0].position, self.gimbal[1].position);
        let engine_mass = 10.5 + self.fuel_kg;
        let (k, engine_inertia) = (engine_mass * 0.209, 0.7203);
        let mut force = Vec3::new(libm::sin(y), -libm::sin(x), -libm::cos(x) * libm::cos(y)) * self.thrust_n;
        let axial = force.z;
        force += Vec3::new(gy, -gx, 0.0) * k;
        let mut moment = Vec3::new(gx, gy, 0.0) * engine_inertia + Vec3::new(0.0, 0.0, self.roll_torque);

        let pressure_point = Vec3::new(0.0, 0.0, -0.62);
        let air = r.transpose() * (self.velocity_ned_m_s - self.wind - self.gust)
            + self.rate.cross(&pressure_point);
        let drag = -Vec3::new(0.45 * air.x, 0.45 * air.y, 0.10 * air.z) * (0.5 * 1.225 * air.norm());
        force += drag;
        moment += pressure_point.cross(&drag);
        let (legs, legs_moment) = self.legs(&r);
        force += legs;
        moment += legs_moment;

        // Slosh: first mode of an upright cylinder (Abramson), mass and height from the filling.
        let column = (self.oxidizer_kg / (834.3 * core::f64::consts::PI * 0.095 * 0.095)).max(0.02);
        let depth = 1.8412 * column / 0.095;
        let slosh_mass = (self.oxidizer_kg * 2.0 * libm::tanh(depth) / (2.3900 * depth)).max(0.02);
        let slosh_z = -(0.2 + column - 0.095 / 1.8412 * 2.0 * libm::tanh(0.5 * depth)).max(0.25);
        let effective = ((-axial - legs.z) / mass).max(0.0);
        let omega2 = effective * 1.8412 / 0.095 * libm::tanh(depth);
        let damping = 2.0 * self.conditions.slosh_damping * omega2.sqrt();
        let rs = Vec3::new(self.slosh_m[0], self.slosh_m[1], slosh_z);
        let rs_rate = Vec3::new(self.slosh_rate[0], self.slosh_rate[1], 0.0);
        let w = self.rate;

        let mut m8 = SMatrix::<f64, 8, 8>::zeros();
        let mut b8 = SVector::<f64, 8>::zeros();
        m8.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Mat3::identity() * mass));
        m8.fixed_view_mut::<3, 3>(0, 3).copy_from(&-skew(s));
        m8.fixed_view_mut::<3, 3>(3, 0).copy_from(&skew(s));
        m8.fixed_view_mut::<3, 3>(3, 3).copy_from(&inertia);
        for i in 0..2 {
            let mut e = Vec3::zeros();
            e[i] = 1.0;
            let lever = rs.cross(&e);
            m8[(i, 6 + i)] = slosh_mass;
            m8[(6 + i, i)] = slosh_mass;
            m8[(6 + i, 6 + i)] = slosh_mass;
            for j in 0..3 {
                m8[(3 + j, 6 + i)] = slosh_mass * lever[j];
                m8[(6 + i, 3 + j)] = slosh_mass * lever[j];
            }
        }
        let right_force = force - w.cross(&w.cross(&s)) - w.cross(&rs_rate) * (2.0 * slosh_mass);
        let right_moment =
            moment - w.cross(&(inertia * w)) - rs.cross(&w.cross(&rs_rate)) * (2.0 * slosh_mass);
        let right_slosh = -(w.cross(&w.cross(&rs)) + w.cross(&rs_rate) * 2.0) * slosh_mass;
        for i in 0..3 {
            b8[i] = right_force[i];
            b8[3 + i] = right_moment[i];
        }
        for i in 0..2 {
            let spring = omega2 * self.slosh_m[i] + damping * self.slosh_rate[i];
            b8[6 + i] = right_slosh[i] - slosh_mass * spring;
        }
        let solution = m8.lu().solve(&b8).expect("the mass matrix is positive definite");
        let a = Vec3::new(solution[0], solution[1], solution[2]);
        let wd = Vec3::new(solution[3], solution[4], solution[5]);

        self.velocity_ned_m_s += (r * a + Vec3::new(0.0, 0.0, G)) * STEP_S;
        self.rate += wd * STEP_S;
        self.position_ned_m += self.velocity_ned_m_s * STEP_S;
        self.q *= UnitQuaternion::from_scaled_axis(self.rate * STEP_S);
        self.q.renormalize();
        for i in 0..2 {
            self.slosh_rate[i] += solution[6 + i] * STEP_S;
            self.slosh_m[i] += self.slosh_rate[i] * STEP_S;
        }
        self.force_sum += a + wd.cross(&IMU_BODY_M) + w.cross(&w.cross(&IMU_BODY_M));
        self.rate_sum += self.rate;
        self.judge();
    }

    fn judge(&mut self) {
        if !self.in_contact && self.lift_off_s.is_none() {
            self.lift_off_s = Some(self.time_s());
        }
        let flown = self.lift_off_s.is_some_and(|t| self.time_s() > t + 1.0);
        if self.in_contact && flown && self.touchdown.is_none() {
            let v = self.com_velocity();
            self.touchdown = Some(Touchdown {
                time_s: self.time_s(),
                vertical_speed_m_s: v.z,
                lateral_speed_m_s: libm::hypot(v.x, v.y),
                tilt_rad: tilt_rad(&self.q),
                position_ned_m: self.position_ned_m,
            });
        }
    }

    fn engine(&mut self, valve_command: f64) {
        self.throttled_s = if valve_command > 0.0 { self.throttled_s + STEP_S } else { 0.0 };
        self.valve.step(valve_command);
        let lit = self.throttled_s > 0.3 && self.oxidizer_kg > 0.15 && self.fuel_kg > 0.0;
        let rate = if lit { (1.0 - self.rise) / 0.25 } else { -self.rise / 0.1 };
        if lit || self.throttled_s == 0.0 || self.oxidizer_kg <= 0.15 {
            self.rise += rate * STEP_S;
        }
        let least = ENGINE[0][1].to_radians();
        let open = (self.valve.position / least).clamp(0.0, 1.0);
        let on_map = self.map.thrust_at_valve_n(self.valve.position.max(least), 0.035);
        let share = open * open;
        self.thrust_n = self.conditions.thrust_factor * on_map * share * self.rise;
        if self.throttled_s > 0.0 || self.thrust_n > 1.0 {
            let (ox, fuel) = self.map.flows_kg_s(on_map, 0.035);
            self.oxidizer_kg -= ox * share * STEP_S;
            self.fuel_kg -= fuel * share * self.rise * STEP_S;
        }
    }

    /// Pulse modulation over 0.1 s with pulses of 20 ms at least.
    fn roll(&mut self, command: f64) {
        self.roll_phase_s = (self.roll_phase_s + STEP_S) % 0.1;
        let on_s = 0.1 * command.abs().min(1.0);
        let on = command.abs() > 0.05 && on_s >= 0.02 && self.roll_phase_s < on_s;
        let target = if on { 2.0_f64.copysign(command) } else { 0.0 };
        self.roll_torque += (target - self.roll_torque) * STEP_S / 0.010;
    }

    /// Turbulence as a first-order process, and one 1-cos gust of 3 m/s in the hover.
    fn blow(&mut self) {
        let level = 0.15 * self.conditions.wind_m_s;
        let drive = level * (2.0 * STEP_S / 2.0).sqrt();
        let mut white = self.sensors.noise.vector(1.0);
        white.z *= 0.3;
        self.gust += -self.gust * (STEP_S / 2.0) + white * drive;
        let t = self.time_s() - 25.0;
        if self.conditions.wind_m_s > 0.0 && (0.0..2.0).contains(&t) && self.steps.is_multiple_of(2) {
            // Added as a rate so that it blends with the process: 3 m/s at the peak.
            let direction = self.wind.normalize();
            let rate = 3.0 * 0.5 * core::f64::consts::PI * libm::sin(core::f64::consts::PI * t);
            self.gust += direction * rate * 2.0 * STEP_S;
        }
    }

    fn legs(&mut self, r: &Mat3) -> (Vec3, Vec3) {
        let (mut force, mut moment) = (Vec3::zeros(), Vec3::zeros());
        self.in_contact = false;
        for (i, (x, y)) in [(0.75, 0.0), (0.0, 0.75), (-0.75, 0.0), (0.0, -0.75)].into_iter().enumerate() {
            let pad = Vec3::new(x, y, 0.75);
            let at = self.position_ned_m + r * pad;
            if at.z <= 0.0 {
                self.anchors[i] = None;
                continue;
            }
            self.in_contact = true;
            let v = self.velocity_ned_m_s + r * self.rate.cross(&pad);
            let normal = (2.0e4 * at.z + 600.0 * v.z).max(0.0);
            let anchor = *self.anchors[i].get_or_insert(at);
            let mut stick = (anchor - at) * 4.0e4 - v * 400.0;
            stick.z = 0.0;
            let most = 0.5 * normal;
            if stick.norm() > most {
                stick *= most / stick.norm().max(1e-9);
                self.anchors[i] = Some(at);
            }
            let f = r.transpose() * (stick - Vec3::new(0.0, 0.0, normal));
            force += f;
            moment += pad.cross(&f);
        }
        (force, moment)
    }

    fn measure(&mut self) -> Measurement {
        let s = &mut self.sensors;
        let n = STEPS_PER_IMU as f64;
        let tick = self.steps / STEPS_PER_IMU;
        let us = self.steps * 500;
        s.accel_bias += s.noise.vector(3e-4 * 0.004f64.sqrt());
        s.gyro_bias += s.noise.vector(2e-5 * 0.004f64.sqrt());
        let mut m = Measurement { time: SimTime::from_us(us), ..Measurement::default() };
        m.imu = Some(ImuSample {
            specific_force_body_m_s2: self.force_sum / n + s.accel_bias + s.noise.vector(1.7e-2),
            rate_body_rad_s: self.rate_sum / n + s.gyro_bias + s.noise.vector(1.6e-3),
            interval_s: 0.004,
            temperature_k: 290.0,
        });
        let r = *self.q.to_rotation_matrix().matrix();
        let at = |body: Vec3| self.position_ned_m + r * body;
        if tick.is_multiple_of(25) {
            let rtk = self.conditions.rtk;
            let (position, drift, velocity) = if rtk {
                ([0.010, 0.015], [0.010, 0.015], [0.03, 0.05])
            } else {
                ([0.15, 0.30], [0.60, 1.00], [0.05, 0.08])
            };
            for i in 0..3 {
                let keep = libm::exp(-0.1 / 200.0);
                s.gnss_drift[i] =
                    s.gnss_drift[i] * keep + s.noise.normal(drift[i / 2] * (1.0 - keep * keep).sqrt());
            }
            let p = at(ANTENNA_BODY_M) + s.gnss_drift;
            let v = self.velocity_ned_m_s + r * self.rate.cross(&ANTENNA_BODY_M);
            let fix = GnssFix {
                latitude_rad: LATITUDE_RAD + (p.x + s.noise.normal(position[0])) / NORTH_M,
                longitude_rad: LONGITUDE_RAD + (p.y + s.noise.normal(position[0])) / EAST_M,
                altitude_m: 3.0 - p.z + s.noise.normal(position[1]),
                velocity_ned_m_s: v + Vec3::new(
                    s.noise.normal(velocity[0]),
                    s.noise.normal(velocity[0]),
                    s.noise.normal(velocity[1]),
                ),
                horizontal_accuracy_m: 0.9,
                vertical_accuracy_m: 1.5,
                fix_type: if rtk { 6 } else { 3 },
                satellites: 14,
            };
            let t = us as f64 * 1e-6;
            if !self.conditions.gnss_outage_s.is_some_and(|(a, b)| t >= a && t < b) {
                s.gnss.push_back((us + if rtk { 100_000 } else { 120_000 }, fix));
            }
        }
        if tick.is_multiple_of(5) {
            let height = 3.0 - at(IMU_BODY_M).z + s.baro_bias_m + s.noise.normal(0.21);
            let sample =
                BarometerSample { pressure_pa: 101_325.0, pressure_altitude_m: height, temperature_k: 288.0 };
            s.baro.push_back((us + 20_000, sample));
            let field = r.transpose() * FIELD_NED_T + s.iron + s.noise.vector(2e-7);
            m.magnetic_field_body_t = self.conditions.magnetometer.then_some(field);
            let cosine = r[(2, 2)];
            let range = -at(ALTIMETER_BODY_M).z / cosine;
            let noise = s.noise.normal(libm::hypot(0.02, 0.002 * range));
            let valid = (0.20..=40.0).contains(&range) && cosine > 0.866;
            let sample = AltimeterSample {
                range_m: valid.then_some(range + s.altimeter_bias_m + noise),
                minimum_m: 0.20,
                maximum_m: 40.0,
            };
            s.altimeter.push_back((us + 20_000, sample));
            if self.conditions.chamber_transducer {
                m.pressures.chamber_pa = Some(1.01325e5 + self.thrust_n * 2.3e3 + s.noise.normal(5e3));
            }
        }
        if s.gnss.front().is_some_and(|(due, _)| *due <= us) {
            m.gnss = s.gnss.pop_front().map(|(_, fix)| fix);
        }
        if s.baro.front().is_some_and(|(due, _)| *due <= us) {
            m.barometer = s.baro.pop_front().map(|(_, b)| b).filter(|_| self.conditions.barometer);
        }
        if s.altimeter.front().is_some_and(|(due, _)| *due <= us) {
            m.altimeter = s.altimeter.pop_front().map(|(_, a)| a).filter(|_| self.conditions.altimeter);
        }
        m
    }
}
