//! A vehicle as data: every parameter of a vehicle file, checked, and the models made of them.
//!
//! Vectors and tensors of a file are in the structural frame (x toward leg 1, z toward the nose), and stay so here:
//! each model turns its own into body FRD where it computes with them. Scalar heights (`..._z_m`) are above the
//! gimbal pivot.

mod load;

pub use load::VehicleInputs;
pub(crate) use load::folder_of;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::actuator::{Gimbal, Servo, StrokeValve};
use crate::controls::Controls;
use crate::dynamics::aerodynamics::Aerodynamics;
use crate::dynamics::landing_gear::{HoldDown, LandingGear};
use crate::dynamics::mass::{BottleGeometry, Component, GrainGeometry, MassModel, TankGeometry};
use crate::dynamics::mass_report::{MassReport, MassReportError};
use crate::dynamics::slosh::{HardeningLaw, Slosh, SloshModel};
use crate::environment::Site;
use crate::fluid::{Nitrogen, Nitrous};
use crate::frame::{Mat3, Vec3};
use crate::input::{Document, InputError, Invalid};
use crate::propulsion::{
    BottleModel, ChamberModel, DepletionModel, Engine, EngineError, EngineParameters, EngineTexts,
    FeedParameters, GasBalance, GasIngestion, GasProperties, GasState, Isolation, ManifoldModel,
    NitrogenInventory, NitrogenState, PairLevels, PaperMode, Pressurant, PressurantGas, ReactionControl,
    Stores, StoresRate, Tank, UllageModel, Vent, VentedGas, Withdrawal,
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
    fn component(&self) -> Result<Component, Invalid> {
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
    fn read(document: &Document) -> Result<Self, InputError> {
        let file: Self = document.read()?;
        let faults = file.contradictions();
        if faults.is_empty() { Ok(file) } else { Err(document.error(faults)) }
    }

    /// Components that name a mass report: their index and the file.
    fn mass_reports(&self) -> Vec<(usize, String)> {
        let named = self.component.iter().enumerate();
        named.filter_map(|(index, part)| Some((index, part.file.clone()?))).collect()
    }

    /// Gives the component at `index` what its mass report says.
    ///
    /// # Errors
    /// When the report cannot be read, or tells of a body that cannot be.
    fn import_mass(&mut self, index: usize, report: &str) -> Result<(), MassReportError> {
        let report = MassReport::parse(report)?;
        let part = &mut self.component[index];
        part.import(&report);
        let possible = part.component().and_then(|component| component.validate());
        possible.map_err(|fault| MassReportError { line: 1, message: fault.message })
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
            faults.push(Invalid::new("component", "a vehicle needs at least one [[component]]"));
        }
        faults
    }
}

impl VehicleFile {
    /// An outlet that uncovers passes gas, and a feed system that stores holds liquid or its vapour alone.
    fn refuse_gas_in_a_feed_that_stores(&self, note: &mut impl FnMut(Result<(), Invalid>, &str)) {
        let stores = self.feed.manifold.model == ManifoldModel::Implicit || self.feed.line.is_some();
        if self.engine.depletion.model == DepletionModel::TwoPhase && stores {
            let message = "\"two_phase\" needs feed.manifold.model = \"quasi_steady\" and no [feed.line]";
            note(Err(Invalid::new("", message)), "engine.depletion.model");
        }
    }
}

/// Table that a vehicle file names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Table {
    /// `engine.map.file`.
    Map,
    /// `feed.valve.area_file`.
    ValveArea,
}

/// Why a vehicle file and its tables make no vehicle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
enum VehicleError {
    /// A table cannot be read.
    #[error("{message}")]
    Table {
        /// Which.
        table: Table,
        /// Line and column, and what is wrong there.
        message: String,
    },
    /// A key contradicts a table or another key.
    #[error("{0}")]
    Invalid(#[from] Invalid),
}

/// How the gas in bottle and tank is modelled: chosen once, by `GasModel::of`.
#[derive(Clone, Debug)]
pub enum GasModel {
    /// One mass of nitrogen, distributed by algebra at constant temperature.
    Distributed,
    /// Masses and temperatures are states.
    Balanced(Box<GasBalance>),
}

/// Bottle and tank at one instant, by either model.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant)] // lives on the stack for one evaluation
pub enum GasSupply {
    /// Distributed by algebra.
    Distributed(NitrogenState),
    /// From states.
    Balanced(GasProperties),
}

impl GasModel {
    /// Balances for whatever constant temperature and a constant outlet pressure cannot serve.
    fn of(file: &VehicleFile, liquid_kg_m3: f64) -> Self {
        let (tank, regulator) = (&file.feed.tank, &file.pressurant.regulator);
        let distributed = file.pressurant.bottle.model == BottleModel::Isothermal
            && tank.ullage.model == UllageModel::ConstantTemperature
            && regulator.droop_pa_s_kg == 0.0
            && regulator.lockup_pa == 0.0
            && regulator.set_pressure_pa == tank.pressure_pa
            && file.engine.depletion.model == DepletionModel::TimeConstant;
        if distributed {
            return Self::Distributed;
        }
        Self::Balanced(Box::new(GasBalance::new(&file.pressurant, tank, liquid_kg_m3)))
    }
}

impl GasSupply {
    /// Pressures and masses.
    pub fn nitrogen(&self) -> &NitrogenState {
        match self {
            Self::Distributed(nitrogen) => nitrogen,
            Self::Balanced(view) => &view.nitrogen,
        }
    }

    /// Mass share of vapour in the gas above the liquid.
    #[inline]
    pub(crate) fn vapor_share(&self) -> f64 {
        match self {
            Self::Distributed(_) => 0.0,
            Self::Balanced(view) => view.vapor_share(),
        }
    }

    /// Shares of what thrusters and vent want (kg/s) that are there, where each takes `drain_s` at least to
    /// empty its store; 1 or above, or no number, where there is plenty.
    #[inline]
    pub(crate) fn shares_left(&self, stores: &Stores, wanted_kg_s: [f64; 2], drain_s: f64) -> [f64; 2] {
        let [thrusters, vent] = wanted_kg_s;
        match self {
            Self::Distributed(_) => [stores.nitrogen_kg.max(0.0) / (drain_s * (thrusters + vent)); 2],
            Self::Balanced(view) => {
                let NitrogenState { tank_kg, vapor_kg, bottle_kg, .. } = view.nitrogen;
                [bottle_kg / (drain_s * thrusters), (tank_kg + vapor_kg) / (drain_s * vent)]
            }
        }
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
    /// Everything from the valve to the nozzle, as one function.
    pub engine: Engine,
    /// The numbers it was made of.
    pub engine_parameters: EngineParameters,
    /// Delay from a command to the valve's motion (s).
    pub valve_delay_s: f64,
    /// Step of the valve's encoder (rad); 0: none.
    pub valve_encoder_rad: f64,
    /// Run tank.
    pub tank: Tank,
    /// Valve between tank and throttle.
    pub isolation: Isolation,
    /// Vent of the run tank.
    pub vent: Vent,
    /// Bottle and regulator.
    pub pressurant: Pressurant,
    /// What is in the bottle and above the liquid.
    pub pressurant_gas: PressurantGas,
    /// How that gas is modelled.
    pub gas_model: GasModel,
    /// How the tank's outlet uncovers, where gas may follow the liquid.
    pub uncovering: Option<GasIngestion>,
    /// Servo of the throttle valve.
    pub valve_servo: Servo,
    /// Servo of either gimbal axis.
    pub gimbal_servo: Servo,
    /// Gimbal.
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
    /// Density of the liquid in the tank (kg/m³).
    pub nitrous_density_kg_m3: f64,
    /// Numbers of the seed paper's mode.
    pub paper_mode: PaperMode,
}

impl Vehicle {
    /// From a file that was read and the texts of the two tables that it names.
    ///
    /// # Errors
    /// When a table cannot be read or contradicts the file.
    fn new(file: VehicleFile, map: &str, valve_area: &str) -> Result<Self, VehicleError> {
        let texts = EngineTexts { map, valve_area };
        let engine = Engine::new(&file.engine, &file.feed, &file.paper_mode, texts).map_err(|e| match e {
            EngineError::ValveArea(e) => {
                VehicleError::Table { table: Table::ValveArea, message: e.to_string() }
            }
            EngineError::Parameter(e) => VehicleError::Invalid(e),
            e => VehicleError::Table { table: Table::Map, message: e.to_string() },
        })?;
        let (tank, grain, bottle) = (&file.feed.tank, &file.engine.grain, &file.pressurant.bottle);
        let nitrous = Nitrous::tables().liquid(tank.pressure_pa, tank.temperature_k);
        let gas_model = GasModel::of(&file, nitrous.density_kg_m3);
        let uncovering = (file.engine.depletion.model == DepletionModel::TwoPhase).then(|| {
            let density = nitrous.density_kg_m3;
            let injector_m2 = file.feed.injector.effective_area_m2();
            GasIngestion::new(
                tank.unusable_nitrous_kg,
                density * file.feed.manifold.volume_m3,
                // Liquid that does not boil, from the greatest pressure of the file into none.
                injector_m2
                    * (2.0 * density * tank.pressure_pa.max(file.pressurant.regulator.set_pressure_pa))
                        .sqrt(),
            )
        });
        let parts = file.component.iter().enumerate();
        let components = parts
            .map(|(i, part)| part.component().map_err(|fault| fault.within(&format!("component.{i}"))))
            .collect::<Result<Vec<_>, _>>()?;
        let mass = MassModel::new(
            &components,
            TankGeometry { radius_m: tank.radius_m, length_m: tank.length_m, floor_z_m: tank.floor_z_m },
            BottleGeometry {
                radius_m: bottle.radius_m,
                volume_m3: bottle.volume_m3,
                centre_z_m: bottle.centre_z_m,
            },
            GrainGeometry {
                port_count: grain.port_count,
                // Ports of a grain with several stand midway between axis and outer radius.
                port_circle_radius_m: if grain.port_count == 1 { 0.0 } else { 0.5 * grain.outer_radius_m },
                outer_radius_m: grain.outer_radius_m,
                length_m: grain.length_m,
                top_z_m: grain.top_z_m,
                fuel_density_kg_m3: grain.fuel_density_kg_m3,
            },
            file.slosh.roll_inertia_factor,
        );
        let pressurant_gas = PressurantGas::new(&file.pressurant, tank.temperature_k);
        let valve = &file.feed.valve;
        Ok(Self {
            name: file.vehicle.name.clone(),
            valve_servo: Servo {
                natural_frequency_rad_s: valve.natural_frequency_rad_s,
                damping_ratio: valve.damping_ratio,
                rate_limit_rad_s: valve.rate_limit_rad_s,
                lower_rad: 0.0,
                upper_rad: valve.open_angle_rad,
                backlash_rad: valve.backlash_rad,
                friction_rad: valve.friction_rad,
                drive_share: 1.0,
            },
            gimbal_servo: file.gimbal.servo(),
            gimbal: file.gimbal,
            valve_delay_s: valve.delay_s,
            valve_encoder_rad: valve.encoder_resolution_rad,
            reaction_control: file.rcs,
            engine,
            engine_parameters: file.engine,
            tank: file.feed.tank,
            isolation: file.feed.isolation,
            vent: file.feed.vent,
            pressurant_gas,
            gas_model,
            uncovering,
            pressurant: file.pressurant,
            rating: file.vehicle,
            controls: file.controls,
            slosh: file.slosh,
            aero: file.aero,
            landing_gear: file.landing_gear,
            hold_down: file.hold_down,
            site: file.site,
            sensors: file.sensors,
            mass,
            nitrous_density_kg_m3: nitrous.density_kg_m3,
            paper_mode: file.paper_mode,
        })
    }

    /// Takes the model choices of the seed paper, whatever the file says.
    pub(crate) fn apply_paper_models(&mut self) {
        self.slosh.model = SloshModel::OneWayPaper;
        self.slosh.hardening_law = HardeningLaw::PerAxis;
        self.slosh.second_mode = false;
        self.slosh.baffle_damping_ratio = 0.0;
        // The paper's liquid is a solid column.
        self.slosh.roll_inertia_factor = 1.0;
        self.mass.set_roll_inertia_factor(1.0);
        self.gimbal.engine_inertia = false;
        self.engine_parameters.chamber.model = ChamberModel::QuasiSteady;
        self.engine_parameters.grain.fuel_flow_lag_s = 0.0;
        self.gas_model = GasModel::Distributed;
        self.uncovering = None;
    }

    /// Liquid that the run tank holds at the start (kg).
    pub fn initial_nitrous_kg(&self) -> f64 {
        (1.0 - self.tank.ullage_fraction) * self.tank_capacity_kg()
    }

    /// Liquid that would fill the run tank to the top (kg).
    pub fn tank_capacity_kg(&self) -> f64 {
        self.tank.volume_m3() * self.nitrous_density_kg_m3
    }

    /// Nitrogen at the start, bottle and run tank, above so much liquid (kg).
    pub fn initial_nitrogen_kg(&self, nitrous_kg: f64) -> f64 {
        let vapor_pa = match &self.gas_model {
            GasModel::Distributed => 0.0,
            GasModel::Balanced(balance) => balance.initial_vapor_pa(self.tank.temperature_k),
        };
        let nitrogen_pa = (self.tank.pressure_pa - vapor_pa).max(0.0);
        let density = Nitrogen::tables().density_kg_m3(nitrogen_pa, self.tank.temperature_k);
        self.pressurant.initial_bottle_kg() + density * self.ullage_m3(nitrous_kg)
    }

    /// Volume above so much liquid in the run tank (m³).
    pub fn ullage_m3(&self, nitrous_kg: f64) -> f64 {
        (self.tank.volume_m3() - nitrous_kg / self.nitrous_density_kg_m3).max(0.0)
    }

    /// Moment of the pair of positive roll at full supply, about body z (N m).
    pub fn roll_moment_n_m(&self) -> f64 {
        let rcs = &self.reaction_control;
        rcs.loads(&PairLevels { a: 0.0, b: 1.0 }, rcs.supply_minimum_pa).moment_body_n_m.z
    }

    /// The gas at the start, of so much nitrogen above so much liquid; nothing where it is no state.
    pub(crate) fn initial_gas(&self, nitrogen_kg: f64, nitrous_kg: f64, ambient_pa: f64) -> GasState {
        let GasModel::Balanced(balance) = &self.gas_model else {
            return GasState::default();
        };
        let bottle_kg = self.pressurant.initial_bottle_kg();
        let full_kg = self.initial_nitrogen_kg(nitrous_kg) - bottle_kg;
        // Too little for bottle and tank: as much in the tank as a lost regulator leaves there.
        let split = self.nitrogen(nitrogen_kg, nitrous_kg, ambient_pa);
        let tank_kg = if split.regulated { full_kg } else { full_kg.min(split.tank_kg) };
        balance.initial((nitrogen_kg - tank_kg).max(0.0), nitrous_kg, self.tank.temperature_k)
    }

    /// Bottle and tank, by the model that was chosen.
    #[inline]
    pub(crate) fn gas_supply(&self, stores: &Stores, ambient_pa: f64) -> GasSupply {
        match &self.gas_model {
            GasModel::Distributed => {
                let inventory = NitrogenInventory {
                    total_kg: stores.nitrogen_kg,
                    ullage_m3: self.ullage_m3(stores.nitrous_kg),
                    ambient_pa,
                    regulator_sag_pa: stores.regulator_sag_pa,
                };
                GasSupply::Distributed(self.pressurant.distribute(&self.pressurant_gas, &inventory))
            }
            GasModel::Balanced(balance) => GasSupply::Balanced(balance.properties(stores)),
        }
    }

    /// How bottle and tank change.
    #[inline]
    pub(crate) fn gas_rate(&self, stores: &Stores, supply: &GasSupply, out: &Withdrawal) -> StoresRate {
        match (&self.gas_model, supply) {
            (GasModel::Balanced(balance), GasSupply::Balanced(view)) => balance.rate(view, out),
            _ => {
                // What fills the room that the liquid leaves, at constant pressure.
                let ullage_m3 = self.ullage_m3(stores.nitrous_kg);
                let tank_kg = supply.nitrogen().tank_kg;
                let ullage_kg_m3 = if ullage_m3 > 0.0 { tank_kg / ullage_m3 } else { 0.0 };
                let nitrogen_kg_s = -(out.thrusters_kg_s + out.gas_kg_s);
                let run_tank_kg_s = ullage_kg_m3 * out.liquid_kg_s / self.nitrous_density_kg_m3;
                StoresRate {
                    nitrogen_kg_s,
                    run_tank_kg_s,
                    total_kg_s: nitrogen_kg_s,
                    ..StoresRate::default()
                }
            }
        }
    }

    /// Where the nitrogen is under a sound regulator, distributed by algebra.
    pub fn nitrogen(&self, nitrogen_kg: f64, nitrous_kg: f64, ambient_pa: f64) -> NitrogenState {
        let inventory = NitrogenInventory {
            total_kg: nitrogen_kg,
            ullage_m3: self.ullage_m3(nitrous_kg),
            ambient_pa,
            regulator_sag_pa: 0.0,
        };
        self.pressurant.distribute(&self.pressurant_gas, &inventory)
    }

    /// Flow through the vent (kg/s), `opened` 0 to 1.
    pub(crate) fn vent_kg_s(&self, supply: &GasSupply, opened: f64, ambient_pa: f64) -> f64 {
        if opened <= 0.0 {
            return 0.0;
        }
        let pressure_pa = supply.nitrogen().tank_pa;
        let density_kg_m3 = match supply {
            GasSupply::Distributed(_) => {
                Nitrogen::tables().density_kg_m3(pressure_pa, self.tank.temperature_k)
            }
            GasSupply::Balanced(view) => view.ullage_density_kg_m3(),
        };
        self.vent.flow_kg_s(&VentedGas { pressure_pa, density_kg_m3, ambient_pa }, opened)
    }

    /// Isolation valve in time.
    pub(crate) fn isolation_stroke(&self) -> StrokeValve {
        StrokeValve { stroke_time_s: self.isolation.stroke_time_s }
    }

    /// Vent valve in time.
    pub(crate) fn vent_stroke(&self) -> StrokeValve {
        StrokeValve { stroke_time_s: self.vent.stroke_time_s }
    }

    /// The nearest angle that the valve's encoder can resolve (rad).
    pub fn encoded(&self, valve_rad: f64) -> f64 {
        if self.valve_encoder_rad > 0.0 {
            ((valve_rad / self.valve_encoder_rad).round() * self.valve_encoder_rad)
                .min(self.valve_servo.upper_rad)
        } else {
            valve_rad
        }
    }
}
