//! Lateral sloshing modes of the liquid: masses that move across the tank on springs.
//!
//! Frequency, mass and station come from linear potential flow in an upright flat-floored cylinder
//! (Abramson, NASA SP-106, 1966; Dodge, The New Dynamic Behavior of Liquids in Moving Containers,
//! 2000; Ibrahim, Liquid Sloshing Dynamics, 2005), with `ξ = 1.8412, 5.3314` the zeros of J1', R the tank
//! radius and h the liquid's height:
//!
//! ```text
//! ω²  = g_eff ξ/R tanh(ξ h/R)                g_eff = axial specific force, not gravity
//! m_s = m 2 R tanh(ξ h/R) / (ξ (ξ² - 1) h)
//! z_s = h - (2R/ξ) tanh(ξ h/(2R))            above the floor
//! ```
//!
//! The station follows from the mode's potential J1(k r) cos θ cosh(k z), k = ξ/R. Its pressure on the wall
//! gives the side force F ~ sinh(kh)/k, and on wall and floor the moment about the floor's centre M ~ h
//! sinh(kh)/k - (cosh(kh) - 2)/k². The spring's force at z_s and the weight of the displaced mass must give
//! the same, M = F z_s + F g/ω², hence z_s = h - 2 (cosh(kh) - 1)/(k sinh(kh)): the line above, for every
//! mode. `tests/reference/slosh.rs` has the modes of a Ritz solution that knows no Bessel function. The share
//! of mode n falls as 2/(ξ² - 1) in a shallow tank (0.84, 0.07) and all shares together are the whole liquid.
//!
//! The spring hardens with the cube of the displacement (Duffing): along each axis for itself, as the seed
//! paper writes it, or with the distance from the axis, which in a round tank is the law that gives no moment
//! about the axis: then the two directions exchange energy, and planar motion that is driven beyond the
//! amplitude (2 f/α)^(1/3), f the driving acceleration, α the cubic stiffness per mass, goes over into rotary
//! motion. A ring baffle damps the first mode by an amount that grows with the root of the wave's height η at
//! the wall, `ζ = ζ_b (η/R)^(1/2)` (Miles, Ring Damping of Free Surface Oscillations in a Circular Tank, J.
//! Appl. Mech. 25, 1958, whose ζ_b is 2.83 (A/(π R²))^(3/2) exp(-4.6 d/R) for a ring of area A at depth d).
//! The wave η cos θ pushes the wall with π ρ g R² η tanh(ξ h/R)/ξ, the mass m_s displaced by a with m_s ω² a,
//! so
//!
//! ```text
//! η/a = m_s ξ²/(π ρ R³) = 2 ξ tanh(ξ h/R)/(ξ² - 1)         1.541 deep        a² = s² + (s'/ω)²
//! ```
//!
//! The second mode keeps its damping ratio: that depth law is the first mode's, 2.5 ξ d/R, and another mode
//! would need the depth itself; its wave is a quarter as high (η/a = 0.389), and dies 2.9 times as fast with
//! depth.
//!
//! Damping has a floor, and beyond
//! `stop_fraction` of the radius a damped stop pushes the liquid back: in free fall there is no gravity
//! mode and nothing else would keep it in the tank. Valid for displacements small against R; the stop is
//! numerical, not a model of impact.
//!
//! Two couplings exist. *Two-way* takes the sloshing mass out of the rigid body and solves both together
//! ([`super::rigid_body`]): momentum holds. *One-way* is the seed paper's form: the whole liquid stays
//! frozen in the body and the oscillator's force is added, which counts that mass twice; kept for
//! comparison.

use super::mass::TankGeometry;
use crate::environment::atmosphere::STANDARD_GRAVITY_M_S2;
use nalgebra::Vector2;

/// Modes that can run at once.
pub(crate) const MODES: usize = 2;
/// First zeros of the derivative of the Bessel function J1.
const XI: [f64; MODES] = [1.841_183_781_340_659_4, 5.331_442_773_525_033];

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

/// How the spring of a mode hardens.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize, schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum HardeningLaw {
    /// With the cube of each axis's own displacement, α (x³, y³): the seed paper's form.
    #[default]
    PerAxis,
    /// With the distance from the tank's axis, α (x² + y²) (x, y): rotary sloshing is possible.
    Radial,
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
    /// How it hardens: each axis for itself, or with the distance from the tank's axis.
    #[serde(default)]
    pub hardening_law: HardeningLaw,
    /// Second lateral mode beside the first, in the two-way form.
    #[serde(default)]
    pub second_mode: bool,
    /// Damping ratio that a ring baffle would add to the first mode at a wave as high, at the wall, as the tank's radius; it grows with the root of that height. 0: no baffle.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 2.0))]
    pub baffle_damping_ratio: f64,
    /// Least damping rate 2ζω (1/s), which acts alone in free fall.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub minimum_damping_rate_1_s: f64,
    /// Where the stop begins, as a fraction of the tank radius.
    #[schemars(range(min = 0.05, max = 1.0))]
    pub stop_fraction: f64,
    /// Natural frequency of the sloshing mass on the stop (rad/s); a softer one would let a turning vehicle throw the liquid out.
    #[schemars(range(min = 20.0, max = 500.0))]
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
    /// Damping rate of the baffle over the root of the amplitude's speed ω a (1/s per (m/s)^(1/2)); the first mode's.
    pub baffle_rate: f64,
    /// Cubic stiffness over mass (1/(m² s²)).
    pub hardening_1_m2_s2: f64,
    /// What the cube is of.
    pub hardening_law: HardeningLaw,
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
    /// The modes of so much liquid under an axial specific force (m/s²), every applied force but gravity
    /// over mass, positive when it presses the liquid on the floor; `None` where a mode does not run.
    #[inline]
    pub fn modes(
        &self,
        tank: &TankGeometry,
        nitrous_kg: f64,
        nitrous_density_kg_m3: f64,
        axial_specific_force_m_s2: f64,
    ) -> [Option<Mode>; MODES] {
        let mode = |xi| self.mode(xi, tank, nitrous_kg, nitrous_density_kg_m3, axial_specific_force_m_s2);
        let second = self.second_mode && self.model == SloshModel::TwoWay;
        [mode(XI[0]), if second { mode(XI[1]) } else { None }]
    }

    #[inline]
    fn mode(
        &self,
        xi: f64,
        tank: &TankGeometry,
        nitrous_kg: f64,
        nitrous_density_kg_m3: f64,
        axial_specific_force_m_s2: f64,
    ) -> Option<Mode> {
        let radius = tank.radius_m;
        let height = (nitrous_kg * tank.height_per_kg(nitrous_density_kg_m3)).clamp(0.0, tank.length_m);
        // tanh(x) from tanh(x/2), the one transcendental call.
        let wave_number = xi / radius; // [1/m]
        let x = wave_number * height;
        let half = libm::tanh(0.5 * x);
        let full = 2.0 * half / (1.0 + half * half);
        let station_z_body_m = -(tank.floor_z_m + height - (2.0 / xi) * radius * half);

        let (coupling, mass_kg, g_eff) = match self.model {
            SloshModel::Frozen => return None,
            SloshModel::TwoWay => {
                let slope = if x > 1e-9 { full / x } else { 1.0 }; // tanh(x)/x
                let mass_kg = nitrous_kg.max(0.0) * slope * (2.0 / (xi * xi - 1.0));
                (Coupling::TwoWay, mass_kg, axial_specific_force_m_s2.max(0.0))
            }
            SloshModel::OneWayPaper => {
                let mass_kg = 0.5 * self.paper_mass_fraction * nitrous_kg.max(0.0);
                (Coupling::OneWay, mass_kg, STANDARD_GRAVITY_M_S2) // whatever the vehicle feels
            }
        };
        let stiffness_1_s2 = g_eff * wave_number * full;
        let floor_1_s = match coupling {
            Coupling::TwoWay => self.minimum_damping_rate_1_s,
            Coupling::OneWay => 0.0,
        };
        Some(Mode {
            mass_kg,
            station_z_body_m,
            stiffness_1_s2,
            damping_rate_1_s: (2.0 * self.damping_ratio * stiffness_1_s2.sqrt()).max(floor_1_s),
            baffle_rate: if self.baffle_damping_ratio > 0.0 && xi == XI[0] {
                let cube = core::f64::consts::PI * radius * radius * radius;
                let wave_per_m = mass_kg * xi * xi / (nitrous_density_kg_m3 * cube); // η/a
                2.0 * self.baffle_damping_ratio * (stiffness_1_s2.sqrt() * wave_per_m / radius).sqrt()
            } else {
                0.0
            },
            hardening_1_m2_s2: self.hardening * stiffness_1_s2 / (radius * radius),
            hardening_law: self.hardening_law,
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
    #[inline]
    pub fn restoring_m_s2(&self, state: &SloshState) -> Vector2<f64> {
        let (s, v) = (state.displacement_body_m, state.velocity_body_m_s);
        let distance_squared = s.dot(&s);
        let cube = match self.hardening_law {
            HardeningLaw::PerAxis => s.component_mul(&s).component_mul(&s),
            HardeningLaw::Radial => s * distance_squared,
        };
        let mut damping_rate_1_s = self.damping_rate_1_s;
        if self.baffle_rate > 0.0 {
            // 2 ω ζ_b (η/R)^(1/2) with (ω a)² = ω² s² + s'².
            let amplitude_speed_m_s = (self.stiffness_1_s2 * distance_squared + v.dot(&v)).sqrt();
            damping_rate_1_s += self.baffle_rate * amplitude_speed_m_s.sqrt();
        }
        let mut restoring = -(s * self.stiffness_1_s2 + cube * self.hardening_1_m2_s2 + v * damping_rate_1_s);
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
        let fourth = match self.hardening_law {
            HardeningLaw::PerAxis => s2.dot(&s2),
            HardeningLaw::Radial => (s2.x + s2.y) * (s2.x + s2.y),
        };
        let beyond = (displacement_body_m.norm() - self.stop_radius_m).max(0.0);
        self.mass_kg
            * (0.5 * self.stiffness_1_s2 * (s2.x + s2.y)
                + 0.25 * self.hardening_1_m2_s2 * fourth
                + 0.5 * self.stop_stiffness_1_s2 * beyond * beyond)
    }
}
