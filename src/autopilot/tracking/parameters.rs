//! Parameters of predictive tracking, and the weights that every vehicle shares.

use super::model::Airframe;
use super::observer::ServoParameters;
use crate::autopilot::mpc::{Settings, StageCost};
use crate::autopilot::rigid_body::MassProperties;

/// Parameters of predictive tracking.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackingParameters {
    /// Stages of the horizon.
    pub stages: usize,
    /// Length of a stage (s).
    pub stage_s: f64,
    /// Time between solves (s).
    pub period_s: f64,
    /// Costs of a stage, in the units of [`super::model`].
    pub weights: StageCost,
    /// Greatest rate of change of the thrust command (N/s).
    pub thrust_rate_n_s: f64,
    /// Greatest rate of the gimbal command (rad/s).
    pub gimbal_rate_rad_s: f64,
    /// Greatest gimbal angle per axis (rad).
    pub gimbal_limit_rad: f64,
    /// Greatest roll torque (N m).
    pub roll_torque_n_m: f64,
    /// Soft limit of the tilt (rad).
    pub tilt_rad: f64,
    /// Gimbal servo, per axis.
    pub servo: ServoParameters,
    /// The engine's first moment about the pivot (kg m).
    pub engine_moment_kg_m: f64,
    /// The engine's inertia about the pivot, across the axis (kg m²).
    pub engine_inertia_kg_m2: f64,
    /// Settings of the interior-point solver.
    pub solver: Settings,
    /// Settings of the general solver, the fallback.
    pub fallback_solver: Settings,
}

/// Costs of a stage in the units of [`super::model`]. Tuned on hops in gusts with a misaligned engine:
/// position error against gimbal activity (10 instead of 4 on position reduces the hover's error by a sixth),
/// and a cost of roll torque at which the thrusters do not respond to heading noise (a tenth of the
/// nitrogen).
pub const WEIGHTS: StageCost = StageCost {
    state: [10.0, 10.0, 8.0, 2.0, 2.0, 4.0, 0.3, 0.3, 0.1, 0.02, 0.02, 0.02, 0.01],
    input: [2.0, 0.5, 0.5, 10.0],
    change: [1.0, 1.0, 1.0, 2.0],
};

impl TrackingParameters {
    /// The vehicle in terms of the model.
    pub fn airframe(&self, mass: &MassProperties, thrust_lag_s: f64) -> Airframe {
        let MassProperties { mass_kg, inertia_kg_m2, com_body_m } = *mass;
        let arm_m = -com_body_m.z;
        let share =
            |inertia: f64| (self.engine_inertia_kg_m2 + self.engine_moment_kg_m * arm_m) / inertia.max(1e-3);
        Airframe {
            mass_kg,
            inertia_kg_m2,
            lever_arm_m: arm_m + self.engine_moment_kg_m / mass_kg.max(1e-3),
            recoil: [share(inertia_kg_m2[0]), share(inertia_kg_m2[1])],
            thrust_lag_s,
        }
    }
}
