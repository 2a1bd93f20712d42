//! The plant at one instant, as reports, sensors and referees see it.

use nalgebra::UnitQuaternion;

use super::{Evaluation, Plant};
use crate::frame::{Mat3, Vec3, structural_from_frd, tilt_rad};
use crate::time::SimTime;

/// Everything worth knowing of the vehicle at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// Run time.
    pub time: SimTime,
    /// Gimbal pivot, north-east-down from the pad surface (m).
    pub position_ned_m: Vec3,
    /// Velocity of the pivot (m/s).
    pub velocity_ned_m_s: Vec3,
    /// Attitude.
    pub q_ned_from_body: UnitQuaternion<f64>,
    /// Body rate (rad/s).
    pub rate_body_rad_s: Vec3,
    /// Acceleration of the pivot over ground (m/s²).
    pub acceleration_ned_m_s2: Vec3,
    /// Specific force at the pivot, body axes (m/s²).
    pub specific_force_body_m_s2: Vec3,
    /// Pivot above its rest height on full legs (m).
    pub height_m: f64,
    /// Mass (kg).
    pub mass_kg: f64,
    /// Centre of mass, liquid at rest and engine at zero gimbal, structural frame (m).
    pub com_structural_m: Vec3,
    /// Velocity of the centre of mass (m/s).
    pub com_velocity_ned_m_s: Vec3,
    /// Inertia about that centre of mass, body FRD (kg m²).
    pub inertia_kg_m2: Mat3,
    /// Liquid nitrous oxide (kg).
    pub nitrous_kg: f64,
    /// Fuel left (kg).
    pub fuel_kg: f64,
    /// Nitrogen in the bottle (kg).
    pub nitrogen_bottle_kg: f64,
    /// Nitrogen in the run tank (kg).
    pub nitrogen_ullage_kg: f64,
    /// Nitrous oxide vapour in the run tank, with the balance of energy (kg).
    pub nitrous_vapor_kg: f64,
    /// Temperature of the liquid (K).
    pub liquid_k: f64,
    /// Temperatures of the gas in bottle and run tank, where they are states (K).
    pub gas_k: [f64; 2],
    /// Gas in the chamber, with the filling model (kg).
    pub chamber_gas_kg: f64,
    /// Oxidiser between valve and injector, with the implicit manifold (kg).
    pub manifold_kg: f64,
    /// Port radius (m).
    pub port_radius_m: f64,
    /// Throat radius (m).
    pub throat_radius_m: f64,
    /// Oxidiser flow (kg/s).
    pub oxidizer_kg_s: f64,
    /// Fuel flow (kg/s).
    pub fuel_kg_s: f64,
    /// Oxidiser to fuel; 0 without flow.
    pub of_ratio: f64,
    /// Chamber pressure (Pa).
    pub chamber_pa: f64,
    /// Injector inlet pressure P2 (Pa).
    pub injector_inlet_pa: f64,
    /// Vapour share at the injector inlet.
    pub quality: f64,
    /// Run-tank pressure (Pa).
    pub tank_pa: f64,
    /// Bottle pressure (Pa).
    pub bottle_pa: f64,
    /// Oxidiser valve angle (rad).
    pub valve_rad: f64,
    /// Its open area (m²).
    pub valve_area_m2: f64,
    /// Thrust asked for (N).
    pub thrust_command_n: f64,
    /// Thrust (N).
    pub thrust_n: f64,
    /// Gimbal angles as realised, in the sense of the commands (rad).
    pub gimbal_rad: [f64; 2],
    /// Thruster pairs as realised, -1 to 1 about FRD z.
    pub rcs_roll: f64,
    /// Slosh displacement, body FRD x and y (m).
    pub slosh_m: [f64; 2],
    /// Slosh force on the vehicle, body FRD x and y (N).
    pub slosh_force_n: [f64; 2],
    /// Velocity of the air (m/s).
    pub wind_ned_m_s: Vec3,
    /// Pads on the ground.
    pub pads_down: u32,
    /// Deepest deflection of a leg (m).
    pub leg_deflection_m: f64,
    /// Something that is no pad touches the ground.
    pub hull_contact: bool,
    /// The engine burns.
    pub lit: bool,
    /// The balance of momentum had no solution: the run means nothing any more.
    pub singular: bool,
    /// Mass that left through nozzle, thrusters and vent (kg).
    pub expelled_kg: [f64; 3],
    /// Nitrous oxide vapour in what left through the vent (kg).
    pub vented_vapor_kg: f64,
}

impl Snapshot {
    /// Angle between the long axis and the vertical (rad).
    pub fn tilt_rad(&self) -> f64 {
        tilt_rad(&self.q_ned_from_body)
    }
}

impl Plant {
    pub(super) fn snapshot_of(&self, now: &Evaluation) -> Snapshot {
        let state = &self.state;
        let attitude = state.attitude();
        let com_body_m = now.mass.centre_of_mass_body_m();
        let com_velocity_ned_m_s =
            state.velocity_ned_m_s + now.motion.ned_from_body * state.rate_body_rad_s.cross(&com_body_m);
        let motion = &now.motion;
        let gear = &self.vehicle.landing_gear;
        let deflection_m = |pad: &Vec3| motion.point_ned_m(*pad).z;
        let leg_deflection_m = if self.options.ground && !gear.clear_of_ground(motion, 0.0) {
            self.pads_body_m[..gear.legs()].iter().map(deflection_m).fold(0.0, f64::max)
        } else {
            0.0
        };
        let hull_contact = self.options.ground
            && [self.exit_points.nozzle, self.exit_points.vent]
                .iter()
                .any(|point| motion.point_ned_m(*point).z > 0.0);
        let force = now.acceleration.slosh_force_body_n;
        Snapshot {
            time: self.time,
            position_ned_m: state.position_ned_m,
            velocity_ned_m_s: state.velocity_ned_m_s,
            q_ned_from_body: attitude,
            rate_body_rad_s: state.rate_body_rad_s,
            acceleration_ned_m_s2: now.rate.velocity_ned_m_s,
            specific_force_body_m_s2: now.acceleration.specific_force_body_m_s2,
            height_m: -state.position_ned_m.z - self.rest_height_m,
            mass_kg: now.mass.mass_kg,
            com_structural_m: structural_from_frd(com_body_m),
            com_velocity_ned_m_s,
            inertia_kg_m2: now.mass.inertia_about_com_kg_m2(),
            nitrous_kg: state.nitrous_kg,
            fuel_kg: self.fuel_kg(state),
            nitrogen_bottle_kg: now.pressurant.bottle_kg,
            nitrogen_ullage_kg: now.pressurant.tank_kg,
            nitrous_vapor_kg: now.pressurant.vapor_kg,
            liquid_k: now.pressurant.liquid_k,
            gas_k: [state.gas.bottle_k, state.gas.ullage_k],
            chamber_gas_kg: state.chamber_oxidizer_kg + state.chamber_fuel_kg,
            manifold_kg: state.manifold_kg,
            port_radius_m: state.port_radius_m,
            throat_radius_m: state.throat_radius_m,
            oxidizer_kg_s: now.engine.oxidizer_kg_s,
            fuel_kg_s: now.engine.fuel_kg_s,
            of_ratio: now.engine.of_ratio,
            chamber_pa: now.engine.chamber_pa,
            injector_inlet_pa: now.engine.injector_inlet_pa,
            quality: now.engine.quality,
            tank_pa: now.pressurant.tank_pa,
            bottle_pa: now.pressurant.bottle_pa,
            valve_rad: now.valve_rad,
            valve_area_m2: now.valve_area_m2,
            thrust_command_n: self.discrete.demand.thrust_n,
            thrust_n: now.engine.thrust_n,
            gimbal_rad: [now.gimbal_rad.x, now.gimbal_rad.y],
            rcs_roll: state.rcs_level.y - state.rcs_level.x,
            slosh_m: [state.slosh_m.x, state.slosh_m.y],
            slosh_force_n: [force.x, force.y],
            wind_ned_m_s: now.wind_ned_m_s,
            pads_down: now.contact.pads_down as u32,
            leg_deflection_m,
            hull_contact,
            lit: self.inputs.lit,
            singular: self.discrete.balance_singular,
            expelled_kg: [state.expelled_nozzle_kg, state.expelled_rcs_kg, state.expelled_vent_kg],
            vented_vapor_kg: state.vented_vapor_kg,
        }
    }
}
