//! The vehicle file: its tables, its dry parts, and what no single range can tell of them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::actuator::Gimbal;
use crate::controls::Controls;
use crate::dynamics::aerodynamics::Aerodynamics;
use crate::dynamics::landing_gear::{HoldDown, LandingGear};
use crate::dynamics::mass::Component;
use crate::dynamics::mass_report::{MassReport, MassReportError};
use crate::dynamics::slosh::{Slosh, SloshModel};
use crate::environment::Site;
use crate::frame::{Mat3, Vec3};
use crate::input::{Document, InputError, Invalid};
use crate::propulsion::{
    DepletionModel, EngineParameters, FeedParameters, ManifoldModel, PaperMode, Pressurant, ReactionControl,
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
    pub pressurant: Pressurant,
    /// Gimbal servos.
    pub gimbal: Gimbal,
    /// Cold-gas thrusters.
    pub rcs: ReactionControl,
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
    pub component: Vec<DryPart>,
    /// Limits of the thrust demand, and the numbers of the seed paper's mode.
    pub paper_mode: PaperMode,
}

/// `[[component]]`: a dry part, by its mass properties or by the file in which a CAD program printed them.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DryPart {
    /// Name of the part.
    pub name: String,
    /// Mass (kg).
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub mass_kg: Option<f64>,
    /// Centre of mass from the gimbal pivot (m), structural axes.
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub position_m: Option<[f64; 3]>,
    /// Inertia about the part's own centre of mass (kg m²), structural axes, tensor convention, symmetric.
    pub inertia_kg_m2: Option<[[f64; 3]; 3]>,
    /// Report "Mass Properties" of SolidWorks, beside the vehicle file, instead of the three keys above; its products of inertia are read with the sign that the report names.
    pub file: Option<String>,
    /// With `file`: the report's origin from the gimbal pivot (m), structural axes; absent: they coincide.
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub origin_m: Option<[f64; 3]>,
    /// With `file`: where the report's x, y and z axes point in the structural frame; absent: ["x", "y", "z"]. Right-handed.
    pub axes: Option<[Axis; 3]>,
    /// Whether the part turns with the gimbal.
    #[serde(default)]
    pub swings: bool,
}

/// A direction of the structural frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
pub enum Axis {
    /// Along x, toward leg 1.
    #[serde(rename = "x")]
    X,
    /// Along y.
    #[serde(rename = "y")]
    Y,
    /// Along z, toward the nose.
    #[serde(rename = "z")]
    Z,
    /// Against x.
    #[serde(rename = "-x")]
    MinusX,
    /// Against y.
    #[serde(rename = "-y")]
    MinusY,
    /// Against z, toward the nozzle.
    #[serde(rename = "-z")]
    MinusZ,
}

impl Axis {
    fn direction(self) -> Vec3 {
        match self {
            Self::X => Vec3::x(),
            Self::Y => Vec3::y(),
            Self::Z => Vec3::z(),
            Self::MinusX => -Vec3::x(),
            Self::MinusY => -Vec3::y(),
            Self::MinusZ => -Vec3::z(),
        }
    }
}

impl DryPart {
    /// Directions of the report's axes in the structural frame, as columns.
    fn structural_from_report(&self) -> Mat3 {
        let axes = self.axes.unwrap_or([Axis::X, Axis::Y, Axis::Z]);
        Mat3::from_columns(&axes.map(Axis::direction))
    }

    /// Takes over what a report says, turned into the structural frame.
    fn import(&mut self, report: &MassReport) {
        let turn = self.structural_from_report();
        let origin_m = Vec3::from(self.origin_m.unwrap_or([0.0; 3]));
        let inertia = turn * report.inertia_kg_m2 * turn.transpose();
        self.mass_kg = Some(report.mass_kg);
        self.position_m = Some((origin_m + turn * report.centre_m).into());
        self.inertia_kg_m2 = Some(core::array::from_fn(|row| {
            // Signed permutations move elements without rounding: symmetric stays symmetric.
            core::array::from_fn(|column| inertia[(row, column)])
        }));
    }

    /// What the keys alone can get wrong.
    fn validate(&self) -> Result<(), Invalid> {
        let direct = [
            ("mass_kg", self.mass_kg.is_some()),
            ("position_m", self.position_m.is_some()),
            ("inertia_kg_m2", self.inertia_kg_m2.is_some()),
        ];
        if self.file.is_some() {
            if let Some((key, _)) = direct.iter().find(|(_, given)| *given) {
                return Err(Invalid::new(*key, "not beside `file`, which gives it"));
            }
            let turn = self.structural_from_report();
            if (turn.determinant() - 1.0).abs() > 1e-9 {
                return Err(Invalid::new(
                    "axes",
                    "not right-handed: the third axis must be the first cross the second",
                ));
            }
            return Ok(());
        }
        if let Some((key, _)) = direct.iter().find(|(_, given)| !given) {
            return Err(Invalid::new(*key, "missing; give mass_kg, position_m and inertia_kg_m2, or `file`"));
        }
        for (key, given) in [("origin_m", self.origin_m.is_some()), ("axes", self.axes.is_some())] {
            if given {
                return Err(Invalid::new(key, "only beside `file`"));
            }
        }
        self.component()?.validate()
    }

    /// The part, structural axes.
    ///
    /// # Errors
    /// When it has a mass report that has not been taken in.
    pub fn component(&self) -> Result<Component, Invalid> {
        let (Some(mass_kg), Some(position_m), Some(inertia_kg_m2)) =
            (self.mass_kg, self.position_m, self.inertia_kg_m2)
        else {
            return Err(Invalid::new("file", format!("{}: its mass report has not been read", self.name)));
        };
        Ok(Component { name: self.name.clone(), mass_kg, position_m, inertia_kg_m2, swings: self.swings })
    }
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
    /// Thrust that full throttle asks for (N).
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub thrust_rated_n: f64,
    /// Lower end of the throttle band of the lit engine (N).
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub thrust_command_min_n: f64,
    /// Upper end of the throttle band (N).
    #[schemars(range(min = 1.0, max = 100000.0))]
    pub thrust_command_max_n: f64,
}

impl VehicleFile {
    /// Reads and checks a vehicle document.
    ///
    /// # Errors
    /// When a key is unknown, missing, of the wrong kind, out of range or at odds with another.
    pub(super) fn read(document: &Document) -> Result<Self, InputError> {
        let file: Self = document.read()?;
        let contradictions = file.contradictions();
        if contradictions.is_empty() { Ok(file) } else { Err(document.error(contradictions)) }
    }

    /// Components that name a mass report: their index and the file.
    pub(super) fn mass_reports(&self) -> Vec<(usize, String)> {
        let named = self.component.iter().enumerate();
        named.filter_map(|(index, part)| Some((index, part.file.clone()?))).collect()
    }

    /// Gives the component at `index` what its mass report says.
    ///
    /// # Errors
    /// When the report cannot be read, or tells of a body that cannot be.
    pub(super) fn import_mass(&mut self, index: usize, report: &str) -> Result<(), MassReportError> {
        let report = MassReport::parse(report)?;
        let part = &mut self.component[index];
        part.import(&report);
        let possible = part.component().and_then(|component| component.validate());
        possible.map_err(|invalid| MassReportError { line: 1, message: invalid.message })
    }

    /// What no single range can tell.
    fn contradictions(&self) -> Vec<Invalid> {
        let mut contradictions = Vec::new();
        let rating = &self.vehicle;
        if rating.thrust_command_min_n >= rating.thrust_command_max_n {
            contradictions.push(Invalid::new(
                "vehicle.thrust_command_min_n",
                format!(
                    "{} must be less than thrust_command_max_n, {}",
                    rating.thrust_command_min_n, rating.thrust_command_max_n
                ),
            ));
        }
        let mut note = |result: Result<(), Invalid>, parent: &str| {
            if let Err(invalid) = result {
                contradictions.push(invalid.within(parent));
            }
        };
        self.refuse_gas_in_a_feed_that_stores(&mut note);
        let (tank, regulator) = (&self.feed.tank, &self.pressurant.regulator);
        note(regulator.validate(), "pressurant.regulator");
        note(tank.ullage.validate(tank.pressure_pa, tank.temperature_k, regulator), "feed.tank.ullage");
        if self.slosh.second_mode && self.slosh.model != SloshModel::TwoWay {
            note(Err(Invalid::new("", "true needs slosh.model = \"two_way\"")), "slosh.second_mode");
        }
        note(self.rcs.validate(), "rcs");
        note(self.sensors.validate(), "sensors");
        note(self.controls.validate(), "controls");
        for (i, component) in self.component.iter().enumerate() {
            note(component.validate(), &format!("component.{i}"));
        }
        if self.component.is_empty() {
            contradictions.push(Invalid::new("component", "a vehicle needs at least one [[component]]"));
        }
        contradictions
    }

    /// An outlet that uncovers passes gas, and a feed system that stores holds liquid or its vapour alone.
    fn refuse_gas_in_a_feed_that_stores(&self, note: &mut impl FnMut(Result<(), Invalid>, &str)) {
        let stores = self.feed.manifold.model == ManifoldModel::Implicit || self.feed.line.is_some();
        if self.engine.depletion.model == DepletionModel::TwoPhase && stores {
            let message = "\"two_phase\" needs feed.manifold.model = \"quasi_steady\" and no [feed.line]";
            note(Err(Invalid::new("", message)), "engine.depletion.model");
        }
    }
}
