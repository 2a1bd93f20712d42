//! State of the plant and its rate: the same names, the same shape.

use nalgebra::{Quaternion, UnitQuaternion};

use crate::frame::Vec3;
use crate::integrator::Integrable;
use crate::propulsion::GasState;

/// Comparison of a field of the state; what is not a number differs from itself.
trait Differs {
    fn differs(&self, other: &Self) -> bool;
}

impl Differs for f64 {
    #[inline(always)]
    fn differs(&self, other: &Self) -> bool {
        self != other
    }
}

impl Differs for Vec3 {
    #[inline(always)]
    fn differs(&self, other: &Self) -> bool {
        (self.x != other.x) | (self.y != other.y) | (self.z != other.z)
    }
}

impl Differs for Quaternion<f64> {
    #[inline(always)]
    fn differs(&self, other: &Self) -> bool {
        (self.w != other.w) | (self.i != other.i) | (self.j != other.j) | (self.k != other.k)
    }
}

impl Differs for GasState {
    #[inline(always)]
    fn differs(&self, other: &Self) -> bool {
        self != other
    }
}

/// Defines `State` and `Rate` with the same fields, and how a state moves along a rate.
macro_rules! state {
    ($($(#[doc = $doc:literal])* $field:ident: $kind:ty,)*) => {
        /// Everything that is integrated. Discrete things (commands in flight, contact anchors, the
        /// ignition sequence) stand beside it in [`super::Plant`] and change between steps only.
        #[derive(Clone, Copy, Debug)]
        pub struct State {
            $($(#[doc = $doc])* pub $field: $kind,)*
        }

        /// Time derivative of every field of [`State`], per second.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Rate {
            $($(#[doc = $doc])* pub $field: $kind,)*
        }

        impl PartialEq for State {
            /// Without a branch: it is asked at every step, and mostly the answer is yes.
            #[inline]
            fn eq(&self, other: &Self) -> bool {
                !(false $(| self.$field.differs(&other.$field))*)
            }
        }

        impl Integrable for State {
            type Rate = Rate;

            #[inline(always)]
            fn advanced(&self, rate: &Rate, dt_s: f64) -> Self {
                Self { $($field: self.$field + rate.$field * dt_s,)* }
            }

            #[inline]
            fn rk4_mean(k1: &Rate, k2: &Rate, k3: &Rate, k4: &Rate) -> Rate {
                Rate {
                    $($field: (k1.$field + (k2.$field + k3.$field) * 2.0 + k4.$field) * (1.0 / 6.0),)*
                }
            }
        }
    };
}

state! {
    /// Gimbal pivot, north-east-down from the pad surface (m).
    position_ned_m: Vec3,
    /// Velocity of the pivot (m/s).
    velocity_ned_m_s: Vec3,
    /// Attitude, Hamilton; renormalised after each step.
    q_ned_from_body: Quaternion<f64>,
    /// Body rate (rad/s).
    rate_body_rad_s: Vec3,
    /// Sloshing mass against the tank axis, x and y in FRD; z stays 0 (m).
    slosh_m: Vec3,
    /// Its velocity in the body (m/s).
    slosh_m_s: Vec3,
    /// The same of the second mode; zero while it is off (m).
    second_slosh_m: Vec3,
    /// Its velocity in the body (m/s).
    second_slosh_m_s: Vec3,
    /// Nitrous oxide in the run tank (kg).
    nitrous_kg: f64,
    /// Nitrogen in bottle and run tank together (kg).
    nitrogen_kg: f64,
    /// Where nitrogen and vapour are and how warm, with the gas as a state.
    gas: GasState,
    /// Port radius (m).
    port_radius_m: f64,
    /// Throat radius (m).
    throat_radius_m: f64,
    /// Oxidiser in the chamber's gas, with the filling model (kg).
    chamber_oxidizer_kg: f64,
    /// Fuel in the chamber's gas, with the filling model (kg).
    chamber_fuel_kg: f64,
    /// Oxidiser between valve and injector, with the implicit manifold (kg). Advanced by the feed's own
    /// implicit step, as is the next.
    manifold_kg: f64,
    /// Flow of the liquid column before the valve, with a feed line (kg/s).
    line_kg_s: f64,
    /// Fuel flow off the grain, when that lags (kg/s).
    fuel_flow_kg_s: f64,
    /// Share of the oxidiser that burns, 0 to 1.
    burning_fraction: f64,
    /// Oxidiser valve angle (rad).
    valve_rad: f64,
    /// Its rate (rad/s).
    valve_rad_s: f64,
    /// Gimbal angles, x and y in the sense of the commands; z stays 0 (rad).
    gimbal_rad: Vec3,
    /// Their rates (rad/s).
    gimbal_rad_s: Vec3,
    /// Thruster pairs' share of full thrust: x pair a, y pair b; z stays 0.
    rcs_level: Vec3,
    /// Mass that left through the nozzle (kg).
    expelled_nozzle_kg: f64,
    /// Nitrogen that left through the thrusters (kg).
    expelled_rcs_kg: f64,
    /// Gas that left through the vent (kg).
    expelled_vent_kg: f64,
    /// Nitrous oxide in that gas (kg).
    vented_vapor_kg: f64,
    /// Fuel burnt so far (kg); sets the port radius after each step.
    burnt_kg: f64,
    /// Integral of the specific force at the inertial unit, body axes (m/s).
    imu_velocity_body_m_s: Vec3,
    /// Integral of the body rate (rad).
    imu_angle_body_rad: Vec3,
}

impl State {
    /// Everything zero and upright.
    pub(crate) const EMPTY: Self = {
        const ZERO: Vec3 = Vec3::new(0.0, 0.0, 0.0);
        Self {
            position_ned_m: ZERO,
            velocity_ned_m_s: ZERO,
            q_ned_from_body: Quaternion::new(1.0, 0.0, 0.0, 0.0),
            rate_body_rad_s: ZERO,
            slosh_m: ZERO,
            slosh_m_s: ZERO,
            second_slosh_m: ZERO,
            second_slosh_m_s: ZERO,
            nitrous_kg: 0.0,
            nitrogen_kg: 0.0,
            gas: GasState {
                bottle_kg: 0.0,
                bottle_k: 0.0,
                wall_k: 0.0,
                vapor_kg: 0.0,
                ullage_k: 0.0,
                liquid_k: 0.0,
            },
            port_radius_m: 0.0,
            throat_radius_m: 0.0,
            chamber_oxidizer_kg: 0.0,
            chamber_fuel_kg: 0.0,
            manifold_kg: 0.0,
            line_kg_s: 0.0,
            fuel_flow_kg_s: 0.0,
            burning_fraction: 0.0,
            valve_rad: 0.0,
            valve_rad_s: 0.0,
            gimbal_rad: ZERO,
            gimbal_rad_s: ZERO,
            rcs_level: ZERO,
            expelled_nozzle_kg: 0.0,
            expelled_rcs_kg: 0.0,
            expelled_vent_kg: 0.0,
            vented_vapor_kg: 0.0,
            burnt_kg: 0.0,
            imu_velocity_body_m_s: ZERO,
            imu_angle_body_rad: ZERO,
        }
    };

    /// Attitude as a rotation.
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(self.q_ned_from_body)
    }

    /// Every number, in a fixed order: for hashes and for the check for finite values.
    pub fn numbers(&self) -> impl Iterator<Item = f64> {
        let vectors = [
            self.position_ned_m,
            self.velocity_ned_m_s,
            self.rate_body_rad_s,
            self.slosh_m,
            self.slosh_m_s,
            self.second_slosh_m,
            self.second_slosh_m_s,
            self.gimbal_rad,
            self.gimbal_rad_s,
            self.rcs_level,
            self.imu_velocity_body_m_s,
            self.imu_angle_body_rad,
        ];
        let scalars = [
            self.nitrous_kg,
            self.nitrogen_kg,
            self.port_radius_m,
            self.throat_radius_m,
            self.chamber_oxidizer_kg,
            self.chamber_fuel_kg,
            self.manifold_kg,
            self.line_kg_s,
            self.fuel_flow_kg_s,
            self.burning_fraction,
            self.valve_rad,
            self.valve_rad_s,
            self.expelled_nozzle_kg,
            self.expelled_rcs_kg,
            self.expelled_vent_kg,
            self.vented_vapor_kg,
            self.burnt_kg,
        ];
        let q = self.q_ned_from_body.coords;
        vectors
            .into_iter()
            .flat_map(|v| [v.x, v.y, v.z])
            .chain([q.w, q.x, q.y, q.z])
            .chain(scalars)
            .chain(self.gas.numbers())
    }
}
