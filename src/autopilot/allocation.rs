//! Allocation: valve, gimbal and thruster commands for a thrust and a torque, from tables and geometry.

use super::roll::{RollModulator, RollThrusters};
use crate::frame::Vec3;
use crate::signal::Throttle;

/// The engine's inverse: tables over thrust and port radius.
///
/// Rows are port radii, columns thrusts, both rising. Bilinear between nodes; outside, the value at the
/// nearest edge.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ThrustMap {
    /// Thrust of the columns (N).
    pub thrust_n: Vec<f64>,
    /// Port radius of the rows (m).
    pub port_radius_m: Vec<f64>,
    /// Valve angle (rad).
    pub valve_rad: Vec<Vec<f64>>,
    /// Oxidiser flow (kg/s).
    pub oxidizer_kg_s: Vec<Vec<f64>>,
    /// Fuel flow (kg/s).
    pub fuel_kg_s: Vec<Vec<f64>>,
}

impl ThrustMap {
    /// Valve angle for a thrust (rad).
    pub fn valve_angle_rad(&self, thrust_n: f64, port_radius_m: f64) -> f64 {
        self.lookup(&self.valve_rad, thrust_n, port_radius_m)
    }

    /// Oxidiser and fuel flow at a thrust (kg/s).
    pub fn flows_kg_s(&self, thrust_n: f64, port_radius_m: f64) -> (f64, f64) {
        (
            self.lookup(&self.oxidizer_kg_s, thrust_n, port_radius_m),
            self.lookup(&self.fuel_kg_s, thrust_n, port_radius_m),
        )
    }

    /// Thrust at a valve angle (N): the inverse of [`Self::valve_angle_rad`], by bisection. Outside the table
    /// the value at the nearest edge; zero for a shut valve.
    pub fn thrust_at_valve_n(&self, valve_rad: f64, port_radius_m: f64) -> f64 {
        let (Some(&least), Some(&most)) = (self.thrust_n.first(), self.thrust_n.last()) else { return 0.0 };
        if valve_rad < 0.3 * self.valve_angle_rad(least, port_radius_m) {
            return 0.0;
        }
        let (mut low, mut high) = (least, most);
        for _ in 0..24 {
            let middle = 0.5 * (low + high);
            if self.valve_angle_rad(middle, port_radius_m) < valve_rad { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// The tables have the shape of their grid, and the valve angle rises with thrust.
    pub(crate) fn is_consistent(&self) -> bool {
        let rising = |v: &[f64]| !v.is_empty() && v.windows(2).all(|w| w[1] > w[0]);
        let shaped = |t: &[Vec<f64>]| {
            t.len() == self.port_radius_m.len()
                && t.iter().all(|row| row.len() == self.thrust_n.len() && row.iter().all(|x| x.is_finite()))
        };
        rising(&self.thrust_n)
            && rising(&self.port_radius_m)
            && shaped(&self.valve_rad)
            && shaped(&self.oxidizer_kg_s)
            && shaped(&self.fuel_kg_s)
            && self.valve_rad.iter().all(|row| rising(row))
    }

    fn lookup(&self, table: &[Vec<f64>], thrust_n: f64, port_radius_m: f64) -> f64 {
        let (i, u) = bracket(&self.port_radius_m, port_radius_m);
        let (j, v) = bracket(&self.thrust_n, thrust_n);
        let at = |row: usize, column: usize| {
            table.get(row).and_then(|r| r.get(column).or(r.last())).copied().unwrap_or(0.0)
        };
        let i1 = (i + 1).min(self.port_radius_m.len().saturating_sub(1));
        let j1 = (j + 1).min(self.thrust_n.len().saturating_sub(1));
        (1.0 - u) * ((1.0 - v) * at(i, j) + v * at(i, j1)) + u * ((1.0 - v) * at(i1, j) + v * at(i1, j1))
    }
}

/// Interval of a rising grid that contains `x`, and the position in it, 0..1; clamped to the ends.
fn bracket(grid: &[f64], x: f64) -> (usize, f64) {
    if grid.len() < 2 || x.is_nan() || x <= grid[0] {
        return (0, 0.0);
    }
    let upper = grid.partition_point(|&g| g < x).clamp(1, grid.len() - 1);
    let (a, b) = (grid[upper - 1], grid[upper]);
    (upper - 1, ((x - a) / (b - a)).clamp(0.0, 1.0))
}

/// Unit of the throttle command.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ThrottleOutput {
    /// [`Throttle::ThrustN`]: the plant's engine controller finds the valve angle.
    #[default]
    Thrust,
    /// [`Throttle::ValveRad`] through the [`ThrustMap`].
    Valve,
}

/// Actuators as the flight computer knows them.
#[derive(Clone, Debug, PartialEq)]
pub struct ActuatorParameters {
    /// Lower end of the throttle band (N).
    pub thrust_min_n: f64,
    /// Upper end of the throttle band (N).
    pub thrust_max_n: f64,
    /// Gimbal limit per axis (rad).
    pub gimbal_limit_rad: f64,
    /// Gimbal rate limit per axis (rad/s).
    pub gimbal_rate_limit_rad_s: f64,
    /// Roll thrusters.
    pub roll: RollThrusters,
    /// Unit of the throttle command.
    pub throttle_output: ThrottleOutput,
}

/// Shares of the gimbal's limit and rate limit that control may use; the rest is a margin for servo errors.
pub(crate) const GIMBAL_AUTHORITY: f64 = 0.95;
const GIMBAL_RATE_AUTHORITY: f64 = 0.7;

/// State of the allocation: the gimbal command in force and the roll modulator.
#[derive(Clone, Copy, Debug, Default)]
pub struct Allocation {
    gimbal_x_rad: f64,
    gimbal_y_rad: f64,
    roll: RollModulator,
}

/// Commands of one allocation.
#[derive(Clone, Copy, Debug)]
pub struct AllocatedCommand {
    /// Gimbal command about FRD x (rad).
    pub gimbal_x_rad: f64,
    /// Gimbal command about FRD y (rad).
    pub gimbal_y_rad: f64,
    /// Roll command, -1..1.
    pub rcs_roll: f64,
    /// Torque about the COM at these angles, axes x and y (N m).
    pub torque_xy_n_m: [f64; 2],
    /// The gimbal could not give the torque demanded, per axis x, y: integrators hold.
    pub saturated: [bool; 2],
}

impl Allocation {
    /// Continues from gimbal angles that another controller commanded.
    pub const fn resume(self, gimbal_x_rad: f64, gimbal_y_rad: f64) -> Self {
        Self { gimbal_x_rad, gimbal_y_rad, ..self }
    }

    /// Gimbal angles and roll command for a torque about the COM (N m): `M = T l sin δ` with thrust T along a
    /// line through the pivot, a lever arm l below the COM `com_body_m`, less the torque of the thrust line
    /// with the gimbal at zero.
    pub fn step(
        &mut self,
        parameters: &ActuatorParameters,
        torque_body_n_m: Vec3,
        thrust_n: f64,
        com_body_m: Vec3,
        dt_s: f64,
    ) -> AllocatedCommand {
        let lever_arm_m = -com_body_m.z;
        let offset_n_m = thrust_line_torque_n_m(thrust_n, com_body_m);
        let moment_n_m = (thrust_n * lever_arm_m).max(0.25 * parameters.thrust_min_n * lever_arm_m.max(0.05));
        let limit = GIMBAL_AUTHORITY * parameters.gimbal_limit_rad;
        let step = GIMBAL_RATE_AUTHORITY * parameters.gimbal_rate_limit_rad_s * dt_s;
        let axis = |torque: f64, last: f64| {
            let wanted = libm::asin((torque / moment_n_m).clamp(-0.5, 0.5));
            let angle = wanted.clamp(-limit, limit).clamp(last - step, last + step);
            (angle, (wanted - angle).abs() > 1e-3)
        };
        let (x, saturated_x) = axis(torque_body_n_m.x - offset_n_m.x, self.gimbal_x_rad);
        let (y, saturated_y) = axis(torque_body_n_m.y - offset_n_m.y, self.gimbal_y_rad);
        (self.gimbal_x_rad, self.gimbal_y_rad) = (x, y);

        let gimbal_n_m = |angle: f64| thrust_n * lever_arm_m * libm::sin(angle);
        AllocatedCommand {
            gimbal_x_rad: x,
            gimbal_y_rad: y,
            rcs_roll: self.roll.step(&parameters.roll, torque_body_n_m.z, dt_s),
            torque_xy_n_m: [gimbal_n_m(x) + offset_n_m.x, gimbal_n_m(y) + offset_n_m.y],
            saturated: [saturated_x, saturated_y],
        }
    }

    /// Counts the nitrogen of the roll thrusters under a command in force for `dt_s`, whoever gave it.
    pub(crate) fn count_nitrogen(&mut self, parameters: &ActuatorParameters, rcs_roll: f64, dt_s: f64) {
        self.roll.count_nitrogen(&parameters.roll, rcs_roll, dt_s);
    }

    /// Nitrogen that the roll thrusters have used (kg).
    pub fn nitrogen_rcs_kg(&self, parameters: &ActuatorParameters) -> f64 {
        self.roll.nitrogen_kg(&parameters.roll)
    }
}

/// Torque about the COM of thrust with the gimbal at zero (N m): r × F with r from the COM to the pivot.
pub(crate) fn thrust_line_torque_n_m(thrust_n: f64, com_body_m: Vec3) -> Vec3 {
    Vec3::new(com_body_m.y, -com_body_m.x, 0.0) * thrust_n
}

impl ActuatorParameters {
    /// Throttle command for a thrust (N), in the unit chosen.
    pub fn throttle(&self, map: &ThrustMap, thrust_n: f64, port_radius_m: f64) -> Throttle {
        match self.throttle_output {
            ThrottleOutput::Thrust => Throttle::ThrustN(thrust_n),
            ThrottleOutput::Valve if thrust_n > 0.0 => {
                Throttle::ValveRad(map.valve_angle_rad(thrust_n, port_radius_m))
            }
            ThrottleOutput::Valve => Throttle::ValveRad(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::autopilot::roll::RollDrive;

    fn map() -> ThrustMap {
        ThrustMap {
            thrust_n: vec![300.0, 600.0, 1000.0],
            port_radius_m: vec![0.025, 0.06],
            valve_rad: vec![vec![0.26, 0.36, 0.50], vec![0.27, 0.38, 0.53]],
            oxidizer_kg_s: vec![vec![0.15, 0.27, 0.43]; 2],
            fuel_kg_s: vec![vec![0.04, 0.056, 0.072]; 2],
        }
    }

    #[test]
    fn valve_and_thrust_are_inverse_between_the_nodes() {
        let map = map();
        assert!(map.is_consistent());
        for thrust in [310.0, 500.0, 777.0, 990.0] {
            let angle = map.valve_angle_rad(thrust, 0.04);
            // 24 bisections of 700 N leave 4e-5 N.
            assert!((map.thrust_at_valve_n(angle, 0.04) - thrust).abs() < 1e-3);
        }
        assert_eq!(map.thrust_at_valve_n(0.0, 0.04), 0.0);
    }

    fn parameters() -> ActuatorParameters {
        ActuatorParameters {
            thrust_min_n: 300.0,
            thrust_max_n: 1050.0,
            gimbal_limit_rad: 0.122,
            gimbal_rate_limit_rad_s: 1.57,
            roll: RollThrusters {
                torque_n_m: 2.0,
                flow_kg_s: 0.0157,
                dead_band: 0.06,
                drive: RollDrive::Duty,
            },
            throttle_output: ThrottleOutput::Thrust,
        }
    }

    #[test]
    fn a_small_torque_comes_back_from_thrust_and_lever_arm() {
        let parameters = parameters();
        let com = Vec3::new(0.0, 0.0, -0.4);
        let mut allocation = Allocation::default();
        let out = allocation.step(&parameters, Vec3::new(1.0, -0.5, 3.0), 700.0, com, 0.004);
        assert!((700.0 * 0.4 * libm::sin(out.gimbal_x_rad) - 1.0).abs() < 1e-12);
        assert!((700.0 * 0.4 * libm::sin(out.gimbal_y_rad) + 0.5).abs() < 1e-12);
        assert_eq!(out.rcs_roll, 1.0);
        assert_eq!(out.saturated, [false, false]);
        // The rate limit holds a jump back, says so, and what is left of the torque is what is reported.
        let out = allocation.step(&parameters, Vec3::new(100.0, 0.0, 0.0), 700.0, com, 0.004);
        assert!(out.gimbal_x_rad < 0.01 && out.saturated[0]);
        assert!((out.torque_xy_n_m[0] - 700.0 * 0.4 * libm::sin(out.gimbal_x_rad)).abs() < 1e-12);
    }

    #[test]
    fn an_engine_that_aims_past_the_centre_of_mass_is_turned_onto_it() {
        let parameters = parameters();
        let com = Vec3::new(0.002, -0.001, -0.4);
        let mut allocation = Allocation::default();
        // No torque wanted: after the rate limit has let it, force and centre of mass are in line.
        let mut out = allocation.step(&parameters, Vec3::zeros(), 700.0, com, 0.004);
        for _ in 0..10 {
            out = allocation.step(&parameters, Vec3::zeros(), 700.0, com, 0.004);
        }
        let force = Vec3::new(libm::sin(out.gimbal_y_rad), -libm::sin(out.gimbal_x_rad), -1.0) * 700.0;
        let torque = (-com).cross(&force);
        // Sines of 5 mrad against a unit axial part: second order.
        assert!(libm::hypot(torque.x, torque.y) < 1e-4 && out.torque_xy_n_m[0].abs() < 1e-12, "{torque}");
    }
}
