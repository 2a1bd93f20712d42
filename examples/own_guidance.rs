//! A guidance law of your own on our plant: a vertical hop to 20 m and back in a breeze, landing softly.
//!
//! ```text
//! cargo run --release -p hopbench --example own_guidance
//! ```
//! The plant is the whole vehicle, from the valve to the feet: servos, delays, ignition, slosh, mass that
//! moves. [`law`] is called at every step (1 ms) and answers with thrust and gimbal angles. It may look at
//! the true state, `flight.snapshot()`, as here, or at what a flight computer would get,
//! `flight.measurement()`. World axes are north, east, down; body axes forward, right, down, so hovering is
//! no rotation at all.

#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // a program that reads a file and prints

use std::error::Error;

use hopbench::scenario::Scenario;
use hopbench::signal::{ActuatorCommand, Throttle};
use hopbench::simulation::{Flight, Report, fly_with};

const G: f64 = 9.80665; // [m/s²]
const HOVER_M: f64 = 20.0; // of the gimbal pivot above its height at rest; down again 14 s after ignition

/// What the actuators are to do now. Gains are in 1/s² on angles and positions, in 1/s on rates and speeds.
fn law(flight: &Flight) -> ActuatorCommand {
    let now = flight.snapshot();
    if flight.has_touched_down() {
        return ActuatorCommand::SAFE; // engine off, disarmed: the flight ends once the vehicle is at rest
    }
    if now.time.s() < 2.0 {
        return ActuatorCommand { armed: true, ..ActuatorCommand::SAFE }; // the isolation valve opens
    }

    // Height: a climb rate that ends at the hover, later one that dies away toward the ground; thrust to
    // follow it.
    let climb_rate_wanted_m_s = match flight.mission_s() {
        Some(mission_s) if mission_s > 14.0 => -(0.5 + 0.3 * now.height_m).clamp(0.5, 3.0),
        _ => (0.8 * (HOVER_M - now.height_m)).min(4.0),
    };
    let climb_rate_m_s = -now.velocity_ned_m_s.z;
    let thrust_n = now.mass_kg * (G + 1.5 * (climb_rate_wanted_m_s - climb_rate_m_s));

    // Position: back to the pad, by tilting the thrust. It points along body -z: nose up pushes south, right
    // side down pushes east.
    let (position, velocity) = (now.position_ned_m, now.velocity_ned_m_s);
    let push = (-0.6 * position - 1.1 * velocity).map(|a| a.clamp(-1.0, 1.0)); // [m/s²] north, east
    let (roll_wanted, pitch_wanted) = (push.y / G, -push.x / G);

    // Attitude: the gimbal turns the vehicle about its centre of mass with thrust times lever.
    let (roll, pitch, heading) = now.q_ned_from_body.euler_angles();
    let (rate, inertia) = (now.rate_body_rad_s, now.inertia_kg_m2);
    let authority_n_m = now.thrust_n.max(300.0) * now.com_structural_m.z; // per radian
    let turn = |off: f64, rate: f64, inertia: f64| inertia * (9.0 * off - 5.0 * rate) / authority_n_m;
    ActuatorCommand {
        armed: true,
        throttle: Throttle::ThrustN(thrust_n), // the engine controller finds the valve angle
        gimbal_x_rad: turn(roll_wanted - roll, rate.x, inertia[(0, 0)]),
        gimbal_y_rad: turn(pitch_wanted - pitch, rate.y, inertia[(1, 1)]),
        rcs_roll: (-4.0 * heading - 8.0 * rate.z).clamp(-1.0, 1.0), // nitrogen thrusters, about the long axis
        ..ActuatorCommand::SAFE // igniter, valves and hold-down follow the throttle by themselves
    }
}

/// A flight of the reference vehicle under our law instead of the built-in autopilot.
pub fn hop() -> Result<Report, Box<dyn Error>> {
    let mut scenario = Scenario::load("scenarios/hop_50m.toml", |file| std::fs::read_to_string(file))?;
    (scenario.file.wind.mean_speed_m_s, scenario.file.wind.from_deg) = (4.0, 240.0);
    Ok(fly_with(&scenario, 1, law)?.report())
}

fn main() -> Result<(), Box<dyn Error>> {
    let report = hop()?;
    println!("{:?}, highest {:.1} m", report.outcome, report.max_altitude_m);
    if let Some(t) = report.touchdown {
        println!("touchdown {:.2} m/s down, {:.2} m/s across", t.vertical_speed_m_s, t.lateral_speed_m_s);
        println!("tilt {:.1} deg, {:.2} m from the target", t.tilt_deg, t.position_error_m);
    }
    println!("nitrous oxide used {:.1} kg", report.propellant.nitrous_used_kg);
    Ok(())
}
