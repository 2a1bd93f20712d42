//! Parameters of the autopilot, and the contradictions between them.

use super::allocation::{ActuatorParameters, ThrustMap};
use super::control::Gains;
use super::lcvx;
use super::mission::Mission;
use super::navigation::NavigationParameters;
use super::propellant::PropellantParameters;
use super::sequence::SequenceParameters;
use super::tracking::TrackingParameters;
use crate::input::Invalid;

/// Parameters of the flight controller, set before the flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// The mission.
    pub mission: Mission,
    /// Times and thresholds of the sequence.
    pub sequence: SequenceParameters,
    /// Navigation: sensors and site.
    pub navigation: NavigationParameters,
    /// Engine and masses.
    pub propellant: PropellantParameters,
    /// The engine's inverse.
    pub thrust_map: ThrustMap,
    /// Actuators.
    pub actuators: ActuatorParameters,
    /// Gains of the cascaded controller.
    pub gains: Gains,
    /// Predictive tracking.
    pub tracking: TrackingParameters,
    /// Optimal guidance.
    pub planner: lcvx::Settings,
}

impl Parameters {
    /// Checks parameters against each other.
    ///
    /// # Errors
    /// The first contradiction.
    pub fn validate(&self) -> Result<(), Invalid> {
        if !self.thrust_map.is_consistent() {
            return Err(Invalid::new(
                "vehicle.thrust_command_max_n",
                "from half of thrust_command_min_n up to this there is no thrust that the engine gives at every \
                 radius of its ports, with a valve angle that rises with it",
            ));
        }
        let (low, high) = (self.actuators.thrust_min_n, self.actuators.thrust_max_n);
        if !(low > 0.0 && low < high) {
            return Err(Invalid::new("actuators.thrust_min_n", format!("{low} N must lie under {high} N")));
        }
        let (full, empty) = (self.propellant.full.mass_kg, self.propellant.empty.mass_kg);
        if !(empty > 0.0 && empty < full) {
            return Err(Invalid::new(
                "propellant.empty.mass_kg",
                format!("{empty} kg must lie under {full} kg"),
            ));
        }
        if self.mission.terminal_height_m >= self.mission.hover_height_m {
            return Err(Invalid::new(
                "mission.terminal_height_m",
                format!(
                    "{} m must lie under the hover height of {} m",
                    self.mission.terminal_height_m, self.mission.hover_height_m
                ),
            ));
        }
        let abort = &self.mission.abort;
        if abort.cut_tilt_rad <= abort.tilt_rad {
            return Err(Invalid::new(
                "mission.abort.cut_tilt_rad",
                format!(
                    "{} rad must lie over mission.abort.tilt_rad = {} rad",
                    abort.cut_tilt_rad, abort.tilt_rad
                ),
            ));
        }
        if let Some(ceiling_m) = abort.ceiling_m.filter(|&c| c <= self.mission.hover_height_m) {
            return Err(Invalid::new(
                "mission.abort.ceiling_m",
                format!("{ceiling_m} m must lie over the hover height of {} m", self.mission.hover_height_m),
            ));
        }
        let [north, east] = self.mission.target_north_east_m;
        if let Some(radius_m) = abort.radius_m.filter(|&r| r <= libm::hypot(north, east)) {
            return Err(Invalid::new(
                "mission.abort.radius_m",
                format!(
                    "{radius_m} m must reach beyond the landing point at {:.1} m",
                    libm::hypot(north, east)
                ),
            ));
        }
        let (limit, abort) = (self.mission.tilt_limit_rad, self.mission.abort.tilt_rad);
        if abort <= limit {
            return Err(Invalid::new(
                "mission.abort.tilt_rad",
                format!("{abort} rad must lie over mission.tilt_limit_rad = {limit} rad"),
            ));
        }
        Ok(())
    }
}
