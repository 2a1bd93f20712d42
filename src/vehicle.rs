//! A vehicle as data: every parameter of a vehicle file, checked, and put into body axes.
//!
//! Vehicle files speak the structural frame (x toward leg 1, z toward the nose). [`Vehicle::new`] turns
//! every vector and tensor into body FRD, here and nowhere else; scalar heights (`..._z_m`) stay heights
//! above the gimbal pivot.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::actuator::{Gimbal, Servo};
use crate::controls::Controls;
use crate::dynamics::aerodynamics::Aerodynamics;
use crate::dynamics::landing_gear::{HoldDown, LandingGear};
use crate::dynamics::mass::{BottleGeometry, Component, GrainGeometry, MassModel, TankGeometry};
use crate::dynamics::slosh::Slosh;
use crate::environment::Site;
use crate::frame::{Mat3, Vec3, frd_from_structural, inertia_frd_from_structural};
use crate::input::{Document, InputError, Invalid};
use crate::propulsion::{
    Engine, EngineParameters, FeedParameters, PaperMode, Pressurant, PressurantParameters, ReactionControl,
    ReactionControlParameters, TableError,
};
use crate::sensor::SensorParameters;

/// A vehicle file.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VehicleFile {
    /// Name and throttle band.
    pub vehicle: Rating,
    /// What a flight controller's channels mean.
    pub controls: Controls,
    /// Grain, map, chamber, nozzle, ignition, depletion.
    pub engine: EngineParameters,
    /// Tank, valve, manifold, injector, isolation, vent.
    pub feed: FeedParameters,
    /// Bottle and regulator.
    pub pressurant: PressurantParameters,
    /// Gimbal servos.
    pub gimbal: Gimbal,
    /// Cold-gas thrusters.
    pub rcs: ReactionControlParameters,
    /// Liquid in motion.
    pub slosh: Slosh,
    /// Drag.
    pub aero: Aerodynamics,
    /// Legs.
    pub landing_gear: LandingGear,
    /// What holds the vehicle down until release.
    pub hold_down: HoldDown,
    /// Where it flies, unless a scenario says otherwise.
    pub site: Site,
    /// Instruments.
    pub sensors: SensorParameters,
    /// Dry parts.
    pub component: Vec<Component>,
    /// Limits of the thrust demand, and the numbers of the seed paper's mode.
    pub paper_mode: PaperMode,
}

/// `[vehicle]`: name and throttle band.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rating {
    /// Name for reports.
    pub name: String,
    /// What is known and what is not, in a sentence.
    #[serde(default)]
    pub fidelity_notes: String,
    /// Thrust that full throttle asks for [N].
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub thrust_rated_n: f64,
    /// Lower end of the throttle band of the lit engine [N].
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub thrust_command_min_n: f64,
    /// Upper end of the throttle band [N].
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub thrust_command_max_n: f64,
}

impl VehicleFile {
    /// Reads and checks a vehicle document.
    ///
    /// # Errors
    /// When a key is unknown, missing, of the wrong kind, out of range or at odds with another.
    pub fn read(document: &Document) -> Result<Self, InputError> {
        let file: Self = document.read()?;
        let faults = file.contradictions();
        if faults.is_empty() { Ok(file) } else { Err(document.error(faults)) }
    }

    /// What no single range can tell.
    fn contradictions(&self) -> Vec<Invalid> {
        let mut faults = Vec::new();
        let rating = &self.vehicle;
        if rating.thrust_command_min_n >= rating.thrust_command_max_n {
            faults.push(Invalid::new(
                "vehicle.thrust_command_min_n",
                format!(
                    "{} must be less than thrust_command_max_n, {}",
                    rating.thrust_command_min_n, rating.thrust_command_max_n
                ),
            ));
        }
        let mut note = |result: Result<(), Invalid>, parent: &str| {
            if let Err(fault) = result {
                faults.push(fault.within(parent));
            }
        };
        note(self.engine.validate(), "engine");
        note(self.feed.validate(), "feed");
        note(self.pressurant.validate(&self.feed.tank), "pressurant");
        note(self.rcs.validate(), "rcs");
        note(self.sensors.validate(), "sensors");
        note(self.controls.validate(), "controls");
        for (i, component) in self.component.iter().enumerate() {
            note(component.validate(), &format!("component.{i}"));
        }
        if self.component.is_empty() {
            faults.push(Invalid::new("component", "a vehicle needs at least one [[component]]"));
        }
        faults
    }
}

/// A vehicle, ready for a plant: parameters in body FRD, tables parsed.
#[derive(Clone, Debug)]
pub struct Vehicle {
    /// Name for reports.
    pub name: String,
    /// Throttle band.
    pub rating: Rating,
    /// What a flight controller's channels mean.
    pub controls: Controls,
    /// Everything from the valve to the nozzle.
    pub engine: Engine,
    /// Bottle, regulator, run tank's gas.
    pub pressurant: Pressurant,
    /// Gimbal servos.
    pub gimbal: Gimbal,
    /// Cold-gas thrusters.
    pub reaction_control: ReactionControl,
    /// Liquid in motion.
    pub slosh: Slosh,
    /// Drag.
    pub aero: Aerodynamics,
    /// Legs.
    pub landing_gear: LandingGear,
    /// What holds the vehicle down until release.
    pub hold_down: HoldDown,
    /// Where it flies, unless a scenario says otherwise.
    pub site: Site,
    /// Instruments, positions in body FRD.
    pub sensors: SensorParameters,
    /// Masses.
    pub mass: MassModel,
}
