//! A vehicle as data: every parameter of a vehicle file, checked, and the models made of them.
//!
//! Vectors and tensors of a file are in the structural frame (x toward leg 1, z toward the nose), and stay so
//! here: each model turns its own into body FRD where it computes with them. Scalar heights (`..._z_m`) are
//! above the gimbal pivot.

mod file;
mod gas;
mod load;

pub use file::{Axis, DryPart, Rating, VehicleFile};
pub use gas::{GasModel, GasSupply};
pub use load::VehicleInputs;
pub(crate) use load::folder_of;

use crate::actuator::{Gimbal, Servo, StrokeValve};
use crate::controls::Controls;
use crate::dynamics::aerodynamics::Aerodynamics;
use crate::dynamics::landing_gear::{HoldDown, LandingGear};
use crate::dynamics::mass::{BottleGeometry, GrainGeometry, MassModel, TankGeometry};
use crate::dynamics::slosh::{HardeningLaw, Slosh, SloshModel};
use crate::environment::Site;
use crate::fluid::{Nitrogen, Nitrous};
use crate::input::Invalid;
use crate::propulsion::{
    ChamberModel, DepletionModel, Engine, EngineError, EngineParameters, EngineTexts, GasIngestion, GasState,
    Isolation, NitrogenInventory, NitrogenState, PairLevels, PaperMode, Pressurant, PressurantGas,
    ReactionControl, Stores, StoresRate, Tank, Vent, VentedGas, Withdrawal,
};
use crate::sensor::SensorParameters;

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

/// A vehicle, ready for a plant: parameters as the file has them, in structural axes, tables parsed.
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
    /// When the tank's outlet ingests gas, where gas may follow the liquid.
    pub gas_ingestion: Option<GasIngestion>,
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
    /// Instruments, their places and directions in structural axes.
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
        let tank = &file.feed.tank;
        let nitrous = Nitrous::tables().liquid(tank.pressure_pa, tank.temperature_k);
        let gas_model = GasModel::of(&file, nitrous.density_kg_m3);
        let gas_ingestion = gas_ingestion(&file, nitrous.density_kg_m3);
        let mass = mass_model(&file)?;
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
            gas_ingestion,
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
        self.gas_model = GasModel::Isothermal;
        self.gas_ingestion = None;
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
            GasModel::Isothermal => 0.0,
            GasModel::EnergyBalance(balance) => balance.initial_vapor_pa(self.tank.temperature_k),
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
        let GasModel::EnergyBalance(balance) = &self.gas_model else {
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
            GasModel::Isothermal => GasSupply::Isothermal(self.distributed(stores, ambient_pa)),
            GasModel::EnergyBalance(balance) => GasSupply::EnergyBalance(balance.properties(stores)),
        }
    }

    /// How bottle and tank change.
    #[inline]
    pub(crate) fn gas_rate(&self, stores: &Stores, supply: &GasSupply, out: &Withdrawal) -> StoresRate {
        match (&self.gas_model, supply) {
            (GasModel::EnergyBalance(balance), GasSupply::EnergyBalance(view)) => balance.rate(view, out),
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
        let stores = Stores { nitrogen_kg, nitrous_kg, gas: GasState::default(), regulator_sag_pa: 0.0 };
        self.distributed(&stores, ambient_pa)
    }

    /// Where the nitrogen of these stores is, distributed by algebra.
    #[inline]
    fn distributed(&self, stores: &Stores, ambient_pa: f64) -> NitrogenState {
        let inventory = NitrogenInventory {
            total_kg: stores.nitrogen_kg,
            ullage_m3: self.ullage_m3(stores.nitrous_kg),
            ambient_pa,
            regulator_sag_pa: stores.regulator_sag_pa,
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
            GasSupply::Isothermal(_) => {
                Nitrogen::tables().density_kg_m3(pressure_pa, self.tank.temperature_k)
            }
            GasSupply::EnergyBalance(view) => view.ullage_density_kg_m3(),
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
    pub fn rounded_to_encoder(&self, valve_rad: f64) -> f64 {
        if self.valve_encoder_rad > 0.0 {
            ((valve_rad / self.valve_encoder_rad).round() * self.valve_encoder_rad)
                .min(self.valve_servo.upper_rad)
        } else {
            valve_rad
        }
    }
}

/// When the tank's outlet ingests gas; nothing where gas may not follow the liquid.
fn gas_ingestion(file: &VehicleFile, nitrous_kg_m3: f64) -> Option<GasIngestion> {
    if file.engine.depletion.model != DepletionModel::TwoPhase {
        return None;
    }
    let (tank, regulator) = (&file.feed.tank, &file.pressurant.regulator);
    let injector_m2 = file.feed.injector.effective_area_m2();
    Some(GasIngestion::new(
        tank.unusable_nitrous_kg,
        nitrous_kg_m3 * file.feed.manifold.volume_m3,
        // Liquid that does not boil, from the greatest pressure of the file into none.
        injector_m2 * (2.0 * nitrous_kg_m3 * tank.pressure_pa.max(regulator.set_pressure_pa)).sqrt(),
    ))
}

/// Masses of the dry parts, and the shapes of what the vehicle holds.
fn mass_model(file: &VehicleFile) -> Result<MassModel, Invalid> {
    let (tank, grain, bottle) = (&file.feed.tank, &file.engine.grain, &file.pressurant.bottle);
    let parts = file.component.iter().enumerate();
    let components = parts
        .map(|(i, part)| part.component().map_err(|invalid| invalid.within(&format!("component.{i}"))))
        .collect::<Result<Vec<_>, _>>()?;
    Ok(MassModel::new(
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
    ))
}
