//! The plant at one instant, as reports, sensors and referees see it.

use nalgebra::UnitQuaternion;

use crate::frame::{Mat3, Vec3, tilt_rad};
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
    /// Gas in the chamber, with the filling model (kg).
    pub chamber_gas_kg: f64,
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
}

impl Snapshot {
    /// Angle between the long axis and the vertical (rad).
    pub fn tilt_rad(&self) -> f64 {
        tilt_rad(&self.q_ned_from_body)
    }

    /// Header of the `fly --csv` table.
    pub const CSV_HEADER: &'static str = "time_s,north_m,east_m,down_m,vn_m_s,ve_m_s,vd_m_s,qw,qx,qy,qz,\
p_rad_s,q_rad_s,r_rad_s,mass_kg,com_x_m,com_y_m,com_z_m,ixx_kg_m2,iyy_kg_m2,izz_kg_m2,ixy_kg_m2,ixz_kg_m2,\
iyz_kg_m2,nitrous_kg,fuel_kg,nitrogen_bottle_kg,nitrogen_ullage_kg,port_radius_m,throat_radius_m,\
oxidizer_kg_s,fuel_kg_s,of_ratio,chamber_pa,injector_inlet_pa,quality,tank_pa,bottle_pa,valve_deg,\
valve_area_m2,thrust_command_n,thrust_n,gimbal_x_deg,gimbal_y_deg,rcs_roll,slosh_x_m,slosh_y_m,\
slosh_force_x_n,slosh_force_y_n,wind_n_m_s,wind_e_m_s,wind_d_m_s";

    /// The row below [`Snapshot::CSV_HEADER`], in its order.
    pub fn csv_row(&self) -> [f64; 52] {
        let (p, v, w) = (self.position_ned_m, self.velocity_ned_m_s, self.rate_body_rad_s);
        let q = self.q_ned_from_body;
        let (c, i, wind) = (self.com_structural_m, self.inertia_kg_m2, self.wind_ned_m_s);
        [
            self.time.s(),
            p.x,
            p.y,
            p.z,
            v.x,
            v.y,
            v.z,
            q.w,
            q.i,
            q.j,
            q.k,
            w.x,
            w.y,
            w.z,
            self.mass_kg,
            c.x,
            c.y,
            c.z,
            i[(0, 0)],
            i[(1, 1)],
            i[(2, 2)],
            i[(0, 1)],
            i[(0, 2)],
            i[(1, 2)],
            self.nitrous_kg,
            self.fuel_kg,
            self.nitrogen_bottle_kg,
            self.nitrogen_ullage_kg,
            self.port_radius_m,
            self.throat_radius_m,
            self.oxidizer_kg_s,
            self.fuel_kg_s,
            self.of_ratio,
            self.chamber_pa,
            self.injector_inlet_pa,
            self.quality,
            self.tank_pa,
            self.bottle_pa,
            self.valve_rad.to_degrees(),
            self.valve_area_m2,
            self.thrust_command_n,
            self.thrust_n,
            self.gimbal_rad[0].to_degrees(),
            self.gimbal_rad[1].to_degrees(),
            self.rcs_roll,
            self.slosh_m[0],
            self.slosh_m[1],
            self.slosh_force_n[0],
            self.slosh_force_n[1],
            wind.x,
            wind.y,
            wind.z,
        ]
    }
}
