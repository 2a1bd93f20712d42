//! Shared by the motion tests: a state that RK4 integrates, and the reference vehicle's mass model.
#![allow(dead_code)] // each test file uses its part

use hopbench::dynamics::Load;
use hopbench::dynamics::mass::*;
use hopbench::dynamics::rigid_body::*;
use hopbench::dynamics::slosh::{Mode, Slosh, SloshState};
use hopbench::frame::{Mat3, Vec3, quaternion_rate};
use hopbench::integrator::Integrable;
use nalgebra::{Quaternion, UnitQuaternion, Vector2};

/// Motion of the pivot, attitude, rate and slosh.
#[derive(Clone, Debug)]
pub struct State {
    pub position_ned_m: Vec3,
    pub velocity_ned_m_s: Vec3,
    pub q_ned_from_body: Quaternion<f64>,
    pub rate_body_rad_s: Vec3,
    pub slosh: SloshState,
    pub second_slosh: SloshState,
}

impl State {
    pub fn at_rest() -> Self {
        Self {
            position_ned_m: Vec3::zeros(),
            velocity_ned_m_s: Vec3::zeros(),
            q_ned_from_body: Quaternion::identity(),
            rate_body_rad_s: Vec3::zeros(),
            slosh: SloshState::default(),
            second_slosh: SloshState::default(),
        }
    }

    pub fn ned_from_body(&self) -> Mat3 {
        UnitQuaternion::new_normalize(self.q_ned_from_body).to_rotation_matrix().into_inner()
    }

    /// Rate of the state under accelerations found for it.
    pub fn rate(&self, a: &Acceleration, gravity_m_s2: f64) -> State {
        assert_eq!(a.status, SolveStatus::Solved);
        State {
            position_ned_m: self.velocity_ned_m_s,
            velocity_ned_m_s: self.ned_from_body() * a.specific_force_body_m_s2 + Vec3::z() * gravity_m_s2,
            q_ned_from_body: quaternion_rate(&self.q_ned_from_body, self.rate_body_rad_s),
            rate_body_rad_s: a.angular_body_rad_s2,
            slosh: SloshState {
                displacement_body_m: self.slosh.velocity_body_m_s,
                velocity_body_m_s: a.slosh_body_m_s2[0],
            },
            second_slosh: SloshState {
                displacement_body_m: self.second_slosh.velocity_body_m_s,
                velocity_body_m_s: a.slosh_body_m_s2[1],
            },
        }
    }
}

impl Integrable for State {
    type Rate = State;
    fn advanced(&self, k: &State, dt_s: f64) -> State {
        State {
            position_ned_m: self.position_ned_m + k.position_ned_m * dt_s,
            velocity_ned_m_s: self.velocity_ned_m_s + k.velocity_ned_m_s * dt_s,
            q_ned_from_body: self.q_ned_from_body + k.q_ned_from_body * dt_s,
            rate_body_rad_s: self.rate_body_rad_s + k.rate_body_rad_s * dt_s,
            slosh: moved(&self.slosh, &k.slosh, dt_s),
            second_slosh: moved(&self.second_slosh, &k.second_slosh, dt_s),
        }
    }
    fn rk4_mean(k1: &State, k2: &State, k3: &State, k4: &State) -> State {
        let sum = k1.advanced(k2, 2.0).advanced(k3, 2.0).advanced(k4, 1.0);
        sum.advanced(&sum, -5.0 / 6.0)
    }
}

fn moved(s: &SloshState, k: &SloshState, dt_s: f64) -> SloshState {
    SloshState {
        displacement_body_m: s.displacement_body_m + k.displacement_body_m * dt_s,
        velocity_body_m_s: s.velocity_body_m_s + k.velocity_body_m_s * dt_s,
    }
}

/// A sine of the gimbal: amplitude [rad], frequency [rad/s], phase [rad].
pub type Sine = [f64; 3];

/// Gimbal angles, rates and accelerations of two sines.
pub fn gimbal_sine(x: Sine, y: Sine, t: f64) -> GimbalMotion {
    let of = |[amplitude, frequency, phase]: Sine| {
        let (s, c) = libm::sincos(frequency * t + phase);
        (amplitude * s, amplitude * frequency * c, -amplitude * frequency * frequency * s)
    };
    let (x, y) = (of(x), of(y));
    GimbalMotion {
        angle_rad: Vector2::new(x.0, y.0),
        rate_rad_s: Vector2::new(x.1, y.1),
        acceleration_rad_s2: Vector2::new(x.2, y.2),
    }
}

/// Tables of the reference vehicle that motion needs.
pub struct Reference {
    pub model: MassModel,
    pub slosh: Slosh,
    pub table: toml::Table,
}

impl Reference {
    pub fn section<T: serde::de::DeserializeOwned>(&self, key: &str) -> T {
        self.table[key].clone().try_into().unwrap()
    }
}

/// The reference vehicle with a share of the liquid's inertia turning in roll.
pub fn reference_vehicle() -> Reference {
    let table: toml::Table = include_str!("../../scenarios/vehicles/reference.toml").parse().unwrap();
    let number = |path: &[&str]| {
        let mut value = &table[path[0]];
        for key in &path[1..] {
            value = &value[*key];
        }
        value.as_float().or_else(|| value.as_integer().map(|i| i as f64)).unwrap()
    };
    let components: Vec<Component> = table["component"].clone().try_into().unwrap();
    for component in &components {
        component.validate().unwrap();
    }
    let tank = TankGeometry {
        radius_m: number(&["feed", "tank", "radius_m"]),
        length_m: number(&["feed", "tank", "length_m"]),
        floor_z_m: number(&["feed", "tank", "floor_z_m"]),
    };
    let bottle = BottleGeometry {
        radius_m: number(&["pressurant", "bottle", "radius_m"]),
        volume_m3: number(&["pressurant", "bottle", "volume_m3"]),
        centre_z_m: number(&["pressurant", "bottle", "centre_z_m"]),
    };
    let grain = GrainGeometry {
        port_count: 1,
        port_circle_radius_m: 0.0,
        outer_radius_m: number(&["engine", "grain", "outer_radius_m"]),
        length_m: number(&["engine", "grain", "length_m"]),
        top_z_m: number(&["engine", "grain", "top_z_m"]),
        fuel_density_kg_m3: number(&["engine", "grain", "fuel_density_kg_m3"]),
    };
    let slosh: Slosh = table["slosh"].clone().try_into().unwrap();
    let model = MassModel::new(&components, tank, bottle, grain, slosh.roll_inertia_factor);
    Reference { model, slosh, table }
}

/// Lift-off contents of the reference vehicle.
pub const FULL: Contents = Contents {
    nitrous_kg: 13.471703,
    nitrous_density_kg_m3: 834.3181387,
    port_radius_m: 0.025,
    nitrogen_run_tank_kg: 0.216701,
    nitrogen_bottle_kg: 2.971684 - 0.216701,
};

/// A balance without loads or flow.
pub fn balance<'a>(vehicle: &'a MassProperties, flow: &'a FlowTerms, rate_body_rad_s: Vec3) -> Balance<'a> {
    Balance { vehicle, flow, rate_body_rad_s, load: Load::NONE, slosh: [None; 2], swing: None }
}

/// The first mode of the full reference tank under an axial specific force.
pub fn full_mode(reference: &Reference, axial_m_s2: f64) -> Mode {
    mode_of(reference, FULL.nitrous_kg, axial_m_s2)
}

/// The first mode of so much liquid in the reference tank.
pub fn mode_of(reference: &Reference, nitrous_kg: f64, axial_m_s2: f64) -> Mode {
    let tank = reference.model.tank();
    reference.slosh.modes(tank, nitrous_kg, FULL.nitrous_density_kg_m3, axial_m_s2)[0].unwrap()
}
