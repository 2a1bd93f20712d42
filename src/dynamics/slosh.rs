//! First lateral sloshing mode of the liquid: a mass that moves across the tank on a spring.
//!
//! Frequency, mass and station come from linear potential flow in an upright flat-floored cylinder
//! (Abramson, NASA SP-106, 1966; Dodge, The New Dynamic Behavior of Liquids in Moving Containers,
//! 2000), with `ξ = 1.8412` the first zero of J1', R the tank radius and h the liquid's height:
//!
//! ```text
//! ω²  = g_eff ξ/R tanh(ξ h/R)                g_eff = axial specific force, not gravity
//! m_s = m 2 R tanh(ξ h/R) / (ξ (ξ² - 1) h)
//! z_s = h - (2R/ξ) tanh(ξ h/(2R))            above the floor
//! ```
//!
//! The spring hardens with the cube of the displacement (Duffing), damping has a floor, and beyond
//! `stop_fraction` of the radius a damped stop pushes the liquid back: in free fall there is no gravity
//! mode and nothing else would keep it in the tank. Valid for displacements small against R; the stop is
//! numerical, not a model of impact.
//!
//! Two couplings exist. *Two-way* takes the sloshing mass out of the rigid body and solves both together
//! ([`super::rigid_body`]): momentum holds. *One-way* is the seed paper's form: the whole liquid stays
//! frozen in the body and the oscillator's force is added, which counts that mass twice; kept for
//! comparison.

use super::mass::TankGeometry;
use nalgebra::Vector2;

/// First zero of the derivative of the Bessel function J1.
const XI: f64 = 1.841_183_781_340_659_4;
/// Standard gravity (m/s²), which the one-way form uses whatever the vehicle feels.
const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// Which slosh model the plant runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SloshModel {
    /// Liquid and vehicle solved together.
    TwoWay,
    /// The seed paper's oscillator beside a frozen liquid.
    OneWayPaper,
    /// The liquid is a solid column.
    Frozen,
}

/// Slosh parameters, the `[slosh]` table of a vehicle file.
#[derive(Clone, Debug, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Slosh {
    /// Which model runs.
    pub model: SloshModel,
    /// Damping ratio of the mode.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub damping_ratio: f64,
    /// Hardening: cubic stiffness over linear stiffness, times the tank radius squared.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub hardening: f64,
    /// Least damping rate 2ζω (1/s), which acts alone in free fall.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub minimum_damping_rate_1_s: f64,
    /// Where the stop begins, as a fraction of the tank radius.
    #[schemars(range(min = 0.05, max = 1.0))]
    pub stop_fraction: f64,
    /// Natural frequency of the sloshing mass on the stop (rad/s).
    #[schemars(range(min = 0.0, max = 500.0))]
    pub stop_natural_frequency_rad_s: f64,
    /// Damping ratio of the sloshing mass on the stop.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub stop_damping_ratio: f64,
    /// Share of the liquid that the one-way form takes, of which it moves half.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub paper_mass_fraction: f64,
    /// Share of the liquid's own inertia about the long axis that turns with the tank.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub roll_inertia_factor: f64,
}

/// How the mode meets the rigid body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coupling {
    /// The sloshing mass is part of the vehicle's mass and moves in it.
    TwoWay,
    /// The oscillator is driven by the vehicle and its force added to it; no mass is taken out.
    OneWay,
}

/// The mode at one instant, per unit of sloshing mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Sloshing mass (kg).
    pub mass_kg: f64,
    /// Where it sits on the long axis, body FRD z from the pivot (m).
    pub station_z_body_m: f64,
    /// ω² (1/s²).
    pub stiffness_1_s2: f64,
    /// 2ζω, not below its floor (1/s).
    pub damping_rate_1_s: f64,
    /// Cubic stiffness over mass (1/(m² s²)).
    pub hardening_1_m2_s2: f64,
    /// Displacement at which the stop begins (m).
    pub stop_radius_m: f64,
    /// ω² of the stop (1/s²).
    pub stop_stiffness_1_s2: f64,
    /// 2ζω of the stop (1/s).
    pub stop_damping_rate_1_s: f64,
    /// How it meets the rigid body.
    pub coupling: Coupling,
}

/// Displacement of the sloshing mass across the tank and its rate, body FRD x and y.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SloshState {
    /// Displacement from the axis (m).
    pub displacement_body_m: Vector2<f64>,
    /// Its rate in the body frame (m/s).
    pub velocity_body_m_s: Vector2<f64>,
}

impl Slosh {
    /// The mode of so much liquid under an axial specific force (m/s²), every applied force but gravity
    /// over mass, positive when it presses the liquid on the floor; `None` when the liquid is frozen.
    pub fn mode(
        &self,
        tank: &TankGeometry,
        nitrous_kg: f64,
        nitrous_density_kg_m3: f64,
        axial_specific_force_m_s2: f64,
    ) -> Option<Mode> {
        let radius = tank.radius_m;
        let height = (nitrous_kg * tank.height_per_kg(nitrous_density_kg_m3)).clamp(0.0, tank.length_m);
        // tanh(x) from tanh(x/2), the one transcendental call.
        let x = XI * height / radius;
        let half = libm::tanh(0.5 * x);
        let full = 2.0 * half / (1.0 + half * half);
        let station_z_body_m = -(tank.floor_z_m + height - 2.0 * radius / XI * half);

        let (coupling, mass_kg, g_eff) = match self.model {
            SloshModel::Frozen => return None,
            SloshModel::TwoWay => {
                let slope = if x > 1e-9 { full / x } else { 1.0 }; // tanh(x)/x
                let mass_kg = nitrous_kg.max(0.0) * 2.0 * slope / (XI * XI - 1.0);
                (Coupling::TwoWay, mass_kg, axial_specific_force_m_s2.max(0.0))
            }
            SloshModel::OneWayPaper => {
                let mass_kg = 0.5 * self.paper_mass_fraction * nitrous_kg.max(0.0);
                (Coupling::OneWay, mass_kg, STANDARD_GRAVITY_M_S2)
            }
        };
        let stiffness_1_s2 = g_eff * XI / radius * full;
        let floor_1_s = match coupling {
            Coupling::TwoWay => self.minimum_damping_rate_1_s,
            Coupling::OneWay => 0.0,
        };
        Some(Mode {
            mass_kg,
            station_z_body_m,
            stiffness_1_s2,
            damping_rate_1_s: (2.0 * self.damping_ratio * stiffness_1_s2.sqrt()).max(floor_1_s),
            hardening_1_m2_s2: self.hardening * stiffness_1_s2 / (radius * radius),
            stop_radius_m: self.stop_fraction * radius,
            stop_stiffness_1_s2: self.stop_natural_frequency_rad_s * self.stop_natural_frequency_rad_s,
            stop_damping_rate_1_s: 2.0 * self.stop_damping_ratio * self.stop_natural_frequency_rad_s,
            coupling,
        })
    }
}

impl Mode {
    /// What spring, damper and stop give the liquid, per unit of its mass (m/s²). The vehicle feels the
    /// opposite, times [`Mode::mass_kg`].
    pub fn restoring_m_s2(&self, state: &SloshState) -> Vector2<f64> {
        let (s, v) = (state.displacement_body_m, state.velocity_body_m_s);
        let mut restoring = -(s * self.stiffness_1_s2
            + s.component_mul(&s).component_mul(&s) * self.hardening_1_m2_s2
            + v * self.damping_rate_1_s);
        let distance_squared = s.dot(&s);
        if distance_squared > self.stop_radius_m * self.stop_radius_m {
            let distance = distance_squared.sqrt();
            let outward = s / distance;
            let push = self.stop_stiffness_1_s2 * (distance - self.stop_radius_m)
                + self.stop_damping_rate_1_s * v.dot(&outward);
            restoring -= outward * push.max(0.0); // it never pulls
        }
        restoring
    }

    /// Potential energy of spring and stop (J), for audits.
    pub fn potential_energy_j(&self, displacement_body_m: Vector2<f64>) -> f64 {
        let s2 = displacement_body_m.component_mul(&displacement_body_m);
        let beyond = (displacement_body_m.norm() - self.stop_radius_m).max(0.0);
        self.mass_kg
            * (0.5 * self.stiffness_1_s2 * (s2.x + s2.y)
                + 0.25 * self.hardening_1_m2_s2 * s2.dot(&s2)
                + 0.5 * self.stop_stiffness_1_s2 * beyond * beyond)
    }
}
