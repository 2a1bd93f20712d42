//! The data sheet: what the built-in autopilot is told of the vehicle before a flight.
//!
//! Nominal masses, geometry, noise figures, and a thrust table that the engine model gives once, as a flight
//! computer would be loaded with. It never sees the vehicle's state, nor what a scenario disturbs or breaks.

use crate::autopilot::Parameters;
use crate::autopilot::allocation::{ActuatorParameters, GIMBAL_AUTHORITY, ThrottleOutput, ThrustMap};
use crate::autopilot::control::Gains;
use crate::autopilot::navigation::{
    AccelerometerNoise, AltimeterNoise, BarometerNoise, GnssParameters, GyroscopeNoise, HorizontalVertical,
    MagnetometerNoise, NavigationParameters,
};
use crate::autopilot::propellant::PropellantParameters;
use crate::autopilot::rigid_body::MassProperties;
use crate::autopilot::roll::{RollDrive, RollThrusters};
use crate::autopilot::sequence::SequenceParameters;
use crate::autopilot::tracking::observer::ServoParameters;
use crate::autopilot::tracking::{TrackingParameters, WEIGHTS};
use crate::autopilot::{lcvx, mpc};
use crate::dynamics::mass::{Contents, ContentsRate, MassState};
use crate::environment::Environment;
use crate::frame::{Vec3, frd_from_structural};
use crate::input::Invalid;
use crate::noise::sample_std;
use crate::propulsion::{Drive, EngineCondition, PairLevels, WarmStart};
use crate::scenario::{Fidelity, Scenario};
use crate::vehicle::Vehicle;

use super::Instrumentation;

/// Nodes of the thrust table over thrust.
const THRUST_NODES: usize = 24;
/// Nodes of the thrust table over port radius.
const RADIUS_NODES: usize = 8;

/// The data sheet of a scenario as it is written, checked: what the autopilot of every dispersed flight is
/// told.
///
/// # Errors
/// When vehicle, site and scenario contradict each other.
pub fn nominal(scenario: &Scenario) -> Result<Parameters, Invalid> {
    let environment = Environment::new(&scenario.site, &scenario.file.wind, u64::from(scenario.file.seed))?;
    throttle_band(&scenario.vehicle, &environment)?;
    let parameters = parameters(scenario, &environment, &Instrumentation::default());
    parameters.validate()?;
    Ok(parameters)
}

/// The data sheet of a scenario's vehicle, site and mission, for sensors as a profile wants them.
pub fn parameters(
    scenario: &Scenario,
    environment: &Environment,
    instruments: &Instrumentation,
) -> Parameters {
    let vehicle = &scenario.vehicle;
    Parameters {
        mission: scenario.file.mission.clone(),
        sequence: sequence(vehicle, environment.atmosphere.pressure_pa),
        navigation: navigation(scenario, environment, instruments),
        propellant: propellant(vehicle),
        thrust_map: thrust_map(vehicle, environment.atmosphere.pressure_pa),
        actuators: ActuatorParameters {
            thrust_min_n: vehicle.rating.thrust_command_min_n,
            thrust_max_n: vehicle.rating.thrust_command_max_n,
            gimbal_limit_rad: vehicle.gimbal.limit_rad,
            gimbal_rate_limit_rad_s: vehicle.gimbal.rate_limit_rad_s,
            roll: roll(vehicle),
            // The paper's engine is driven by the thrust, and its valve angles are not the full engine's.
            throttle_output: match scenario.file.fidelity {
                Fidelity::Full => ThrottleOutput::Valve,
                Fidelity::Paper => ThrottleOutput::Thrust,
            },
        },
        gains: Gains::default(),
        tracking: tracking(vehicle, scenario.file.mission.tilt_limit_rad),
        planner: lcvx::Settings::FLIGHT,
    }
}

/// Share of the gimbal's rate that plans of predictive control may use: its feedback and allocation need the
/// rest.
const PLANNED_GIMBAL_RATE: f64 = 0.5;
/// Greatest rise of the thrust asked for, as a share of the rated thrust per second.
const THRUST_RATE_SHARE_1_S: f64 = 1.5;

fn tracking(vehicle: &Vehicle, tilt_rad: f64) -> TrackingParameters {
    let (gimbal, swinging) = (&vehicle.gimbal, mass_state(vehicle, 0.5).swinging);
    TrackingParameters {
        stages: 30,
        stage_s: 0.05,
        period_s: 0.02,
        weights: WEIGHTS,
        thrust_rate_n_s: THRUST_RATE_SHARE_1_S * vehicle.rating.thrust_rated_n,
        gimbal_rate_rad_s: PLANNED_GIMBAL_RATE * gimbal.rate_limit_rad_s,
        gimbal_limit_rad: GIMBAL_AUTHORITY * gimbal.limit_rad,
        roll_torque_n_m: vehicle.roll_moment_n_m(),
        tilt_rad,
        servo: ServoParameters {
            natural_frequency_rad_s: gimbal.natural_frequency_rad_s,
            damping_ratio: gimbal.damping_ratio,
            rate_limit_rad_s: gimbal.rate_limit_rad_s,
            delay_s: gimbal.delay_s,
        },
        engine_moment_kg_m: if gimbal.engine_inertia { swinging.first_moment_kg_m.z } else { 0.0 },
        engine_inertia_kg_m2: if gimbal.engine_inertia { swinging.inertia_kg_m2[(0, 0)] } else { 0.0 },
        solver: mpc::Settings::default(),
        fallback_solver: mpc::Settings { iterations: 40, tolerance: 1e-6 },
    }
}

/// Whether the engine, its port fresh, reaches the throttle band that the vehicle file promises. A port that
/// has grown may give less: the autopilot's table ends there.
pub(super) fn throttle_band(vehicle: &Vehicle, environment: &Environment) -> Result<(), Invalid> {
    let (engine, rating) = (&vehicle.engine, &vehicle.rating);
    let feed = engine.feed_map(vehicle.tank.pressure_pa, vehicle.tank.temperature_k);
    let condition = lit(vehicle, engine.grain().port_radius_m, environment.atmosphere.pressure_pa);
    let most = engine.inverse(&feed, rating.thrust_command_max_n, &condition, WarmStart::default());
    if !most.saturated {
        return Ok(());
    }
    let message = format!(
        "{} N is out of range; this engine gives up to {:.0} N",
        rating.thrust_command_max_n, most.point.thrust_n
    );
    Err(Invalid::new("vehicle.thrust_command_max_n", message))
}

/// The burning engine, throat as at the start.
fn lit(vehicle: &Vehicle, port_radius_m: f64, ambient_pa: f64) -> EngineCondition {
    EngineCondition::burning(port_radius_m, vehicle.engine.nozzle().throat_radius_m(), ambient_pa)
}

fn navigation(
    scenario: &Scenario,
    environment: &Environment,
    instruments: &Instrumentation,
) -> NavigationParameters {
    let vehicle = &scenario.vehicle;
    let sensors = &vehicle.sensors;
    let (imu, gnss) = (&sensors.imu, &sensors.gnss);
    let receiver = gnss.receiver();
    let rate_hz = instruments.imu_rate_hz.unwrap_or(imu.rate_hz);
    let weight_n = mass_properties(vehicle, 1.0).mass_kg * environment.gravity.magnitude_m_s2;
    let pad_density = environment.atmosphere.density_kg_m3 * environment.gravity.magnitude_m_s2;
    let metres = |pressure_pa: f64| if pad_density > 0.0 { pressure_pa / pad_density } else { 0.0 };
    let barometer = &sensors.barometer;
    NavigationParameters {
        imu_body_m: frd_from_structural(imu.position_m),
        accelerometer: AccelerometerNoise {
            noise_std_m_s2: sample_std(imu.accelerometer.noise_density_m_s2_sqrt_hz, rate_hz),
            bias_std_m_s2: imu.accelerometer.bias_std_m_s2,
            random_walk_m_s2_sqrt_s: imu.accelerometer.random_walk_m_s2_sqrt_s,
        },
        gyroscope: GyroscopeNoise {
            noise_std_rad_s: sample_std(imu.gyroscope.noise_density_rad_s_sqrt_hz, rate_hz),
            bias_std_rad_s: imu.gyroscope.bias_std_rad_s,
            random_walk_rad_s_sqrt_s: imu.gyroscope.random_walk_rad_s_sqrt_s,
        },
        gnss: GnssParameters {
            delay_s: scenario
                .file
                .sensors
                .gnss_delay_s
                .or(instruments.gnss_delay_s)
                .unwrap_or(receiver.delay_s),
            antenna_body_m: frd_from_structural(gnss.antenna_position_m),
            position_std_m: HorizontalVertical {
                horizontal: receiver.horizontal_noise_std_m,
                vertical: receiver.vertical_noise_std_m,
            },
            drift_std_m: HorizontalVertical {
                horizontal: receiver.horizontal_drift_std_m,
                vertical: receiver.vertical_drift_std_m,
            },
            drift_time_s: receiver.drift_time_constant_s,
            velocity_std_m_s: HorizontalVertical {
                horizontal: receiver.horizontal_velocity_noise_std_m_s,
                vertical: receiver.vertical_velocity_noise_std_m_s,
            },
        },
        barometer: BarometerNoise {
            noise_std_m: metres(sample_std(barometer.noise_density_pa_sqrt_hz, barometer.rate_hz)),
            random_walk_m_sqrt_s: metres(barometer.random_walk_pa_sqrt_s),
        },
        barometer_delay_s: barometer.delay_s,
        altimeter: AltimeterNoise {
            noise_std_m: sensors.altimeter.noise_std_m,
            noise_fraction: sensors.altimeter.noise_fraction,
        },
        altimeter_body_m: frd_from_structural(sensors.altimeter.position_m),
        altimeter_delay_s: sensors.altimeter.delay_s,
        magnetic_field_ned_t: Some(environment.magnetic_field_ned_t),
        magnetometer: MagnetometerNoise {
            noise_std_t: sample_std(
                sensors.magnetometer.noise_density_t_sqrt_hz,
                sensors.magnetometer.rate_hz,
            ),
            hard_iron_std_t: sensors.magnetometer.bias_std_t,
        },
        rest_heading_rad: 0.0,
        rest_ned_m: Vec3::new(0.0, 0.0, -vehicle.landing_gear.rest_height_m(weight_n)),
        gravity_m_s2: environment.gravity.magnitude_m_s2,
    }
}

/// Masses with this share of the propellants left.
fn mass_state(vehicle: &Vehicle, share: f64) -> MassState {
    let grain = &vehicle.engine_parameters.grain;
    let start = grain.port_radius_m;
    // Fuel goes with the square of the radius.
    let radius2 =
        start * start + (1.0 - share) * (grain.outer_radius_m * grain.outer_radius_m - start * start);
    let full_kg = vehicle.initial_nitrous_kg();
    let nitrous_kg = share * full_kg;
    let pressurant =
        vehicle.nitrogen(vehicle.initial_nitrogen_kg(full_kg), nitrous_kg, vehicle.site.pressure_pa);
    let contents = Contents {
        nitrous_kg,
        nitrous_density_kg_m3: vehicle.nitrous_density_kg_m3,
        port_radius_m: radius2.sqrt(),
        nitrogen_run_tank_kg: pressurant.tank_kg,
        nitrogen_bottle_kg: pressurant.bottle_kg,
    };
    vehicle.mass.evaluate(&contents, &ContentsRate::default())
}

/// Mass properties with this share of the propellants left.
fn mass_properties(vehicle: &Vehicle, share: f64) -> MassProperties {
    let mass = mass_state(vehicle, share).vehicle;
    let inertia = mass.inertia_about_com_kg_m2();
    MassProperties {
        mass_kg: mass.mass_kg,
        com_body_m: mass.centre_of_mass_body_m(),
        inertia_kg_m2: [inertia[(0, 0)], inertia[(1, 1)], inertia[(2, 2)]],
    }
}

fn propellant(vehicle: &Vehicle) -> PropellantParameters {
    let engine = &vehicle.engine_parameters;
    let servo = &vehicle.valve_servo;
    let fuel_kg_per_m2 =
        engine.grain.fuel_density_kg_m3 * engine.grain.length_m * f64::from(engine.grain.port_count);
    PropellantParameters {
        full: mass_properties(vehicle, 1.0),
        empty: mass_properties(vehicle, 0.0),
        oxidizer_kg: (vehicle.initial_nitrous_kg() - vehicle.tank.unusable_nitrous_kg).max(0.0),
        fuel_kg: engine.grain.fuel_kg(engine.grain.port_radius_m),
        port_radius_m: engine.grain.port_radius_m,
        fuel_kg_per_m2,
        delay_s: vehicle.valve_delay_s,
        lag_s: 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s,
        ignition_delay_s: engine.ignition.igniter_delay_s,
        rise_s: engine.ignition.rise_time_constant_s,
        thrust_min_n: vehicle.rating.thrust_command_min_n,
        thrust_max_n: vehicle.rating.thrust_command_max_n,
        thrust_shut_n: engine.ignition.shutdown_fraction * vehicle.rating.thrust_rated_n,
    }
}

/// The thrusters of one pair; who makes the pulses follows from their driver.
fn roll(vehicle: &Vehicle) -> RollThrusters {
    let rcs = &vehicle.reaction_control;
    let firing = rcs.loads(&PairLevels { a: 0.0, b: 1.0 }, rcs.supply_minimum_pa);
    RollThrusters {
        torque_n_m: vehicle.roll_moment_n_m(),
        flow_kg_s: firing.nitrogen_kg_s,
        dead_band: rcs.dead_band,
        drive: match rcs.drive {
            Drive::PulseModulated => RollDrive::Duty,
            Drive::OnOff => RollDrive::Pulses { minimum_on_s: rcs.minimum_on_time_s },
        },
    }
}

/// Times and thresholds of the start, from the engine's own.
fn sequence(vehicle: &Vehicle, ambient_pa: f64) -> SequenceParameters {
    let ignition = &vehicle.engine_parameters.ignition;
    let feed = vehicle.engine.feed_map(vehicle.tank.pressure_pa, vehicle.tank.temperature_k);
    let condition = lit(vehicle, vehicle.engine.grain().port_radius_m, ambient_pa);
    let idle =
        vehicle.engine.inverse(&feed, vehicle.rating.thrust_command_min_n, &condition, WarmStart::default());
    SequenceParameters {
        // Between unlit flow, a quarter of the idle pressure, and the burning chamber.
        lit_pressure_pa: ambient_pa + 0.4 * (idle.point.chamber_pa - ambient_pa),
        // 90 % of a first-order rise.
        thrust_rise_s: 2.4 * ignition.rise_time_constant_s,
        assumed_ignition_s: ignition.igniter_delay_s + 0.2,
        // The igniter, and the time the flow takes behind the isolation valve.
        ignition_timeout_s: ignition.igniter_delay_s + ignition.igniter_burn_s + 2.7,
        ..SequenceParameters::default()
    }
}

/// The engine's inverse over thrust and port radius, throat as at the start.
fn thrust_map(vehicle: &Vehicle, ambient_pa: f64) -> ThrustMap {
    let engine = &vehicle.engine;
    let feed = vehicle.engine.feed_map(vehicle.tank.pressure_pa, vehicle.tank.temperature_k);
    let spread = |low: f64, high: f64, nodes: usize| -> Vec<f64> {
        (0..nodes).map(|i| low + (high - low) * i as f64 / (nodes - 1) as f64).collect()
    };
    let rating = &vehicle.rating;
    let grain = &vehicle.engine_parameters.grain;
    let port_radius_m = spread(grain.port_radius_m, grain.outer_radius_m, RADIUS_NODES);
    // Where the engine cannot give the ends of the band, the table ends at what it gives at every radius.
    let within = |thrust_n: f64, tighter: fn(f64, f64) -> f64| {
        port_radius_m.iter().fold(thrust_n, |end_n, &radius| {
            let at = engine.inverse(&feed, thrust_n, &lit(vehicle, radius, ambient_pa), WarmStart::default());
            if at.saturated { tighter(end_n, at.point.thrust_n) } else { end_n }
        })
    };
    let least_n = within(0.5 * rating.thrust_command_min_n, f64::max);
    let most_n = within(rating.thrust_command_max_n, f64::min);
    let thrust_n = spread(least_n, most_n, THRUST_NODES);
    let mut map = ThrustMap {
        valve_rad: Vec::with_capacity(RADIUS_NODES),
        oxidizer_kg_s: Vec::with_capacity(RADIUS_NODES),
        fuel_kg_s: Vec::with_capacity(RADIUS_NODES),
        thrust_n,
        port_radius_m,
    };
    for &radius in &map.port_radius_m {
        let condition = lit(vehicle, radius, ambient_pa);
        let points: Vec<_> = map
            .thrust_n
            .iter()
            .map(|&t| engine.inverse(&feed, t, &condition, WarmStart::default()))
            .collect();
        map.valve_rad.push(points.iter().map(|p| p.valve_rad).collect());
        map.oxidizer_kg_s.push(points.iter().map(|p| p.point.oxidizer_kg_s).collect());
        map.fuel_kg_s.push(points.iter().map(|p| p.point.fuel_kg_s).collect());
    }
    map
}
