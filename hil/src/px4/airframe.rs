//! The airframe of a vehicle: what its gains, speeds and parameters come to.

use hopbench::input::Invalid;
use hopbench::vehicle::Vehicle;
use serde::Serialize;

use super::allocation;
use super::budget::{self, Budget, Hop};
use super::lander::Lander;
use super::parameters::{self, Parameter, Target};
use super::tuning::Tuning;

/// Everything that is written for one vehicle.
#[derive(Clone, Debug, Serialize)]
pub struct Airframe {
    /// The vehicle's name.
    pub vehicle: String,
    /// The vehicle as it begins to hover, for which the gains are.
    pub lander: Lander,
    /// Gains and limits.
    pub tuning: Tuning,
    /// Propellant of the hop.
    pub budget: Budget,
    /// Parameters for PX4 in software.
    pub sitl: Vec<Parameter>,
    /// Parameters for PX4 on its own board.
    pub hitl: Vec<Parameter>,
}

/// The airframe of a vehicle that is to fly a hop.
///
/// # Errors
/// When PX4 cannot serve the vehicle's map of channels, cannot steer the vehicle, or the propellant is too
/// little.
pub fn airframe(vehicle: &Vehicle, hop: &Hop) -> Result<Airframe, Invalid> {
    let outputs = allocation::outputs(&vehicle.controls)?;
    Lander::of(vehicle, &budget::full_contents(vehicle)).check_flyable()?;
    let budget = budget::hop_budget(vehicle, hop)?;
    let lander = Lander::of(vehicle, &budget.at_hover);
    lander.check_flyable()?;
    let tuning = Tuning::of(&lander);
    let parameters = |target| {
        parameters::list(&parameters::Inputs {
            vehicle,
            lander: &lander,
            tuning: &tuning,
            budget: &budget,
            outputs: &outputs,
            target,
        })
    };
    Ok(Airframe {
        vehicle: vehicle.name.clone(),
        sitl: parameters(Target::Sitl),
        hitl: parameters(Target::Hitl),
        lander,
        tuning,
        budget,
    })
}
