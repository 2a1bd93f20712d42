//! What the engine is believed to do: thrust behind its servo, propellant used, mass, and the trim
//! between the thrust commanded and the thrust that the accelerometer shows.

use super::allocation::ThrustMap;
use crate::frame::Vec3;

/// Mass properties at one mass; between two such points the estimate is linear in mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassPoint {
    /// Mass (kg).
    pub mass_kg: f64,
    /// Centre of mass in body FRD, from the pivot (m).
    pub com_body_m: Vec3,
    /// Principal moments about the centre of mass, FRD x, y, z (kg m²).
    pub inertia_kg_m2: [f64; 3],
}

/// Numbers of the engine and the propellants that a flight computer carries.
#[derive(Clone, Debug, PartialEq)]
pub struct PropellantParameters {
    /// Ready to fly.
    pub full: MassPoint,
    /// At the end of the nominal flight, or burnt out.
    pub empty: MassPoint,
    /// Usable oxidiser at the start (kg).
    pub oxidizer_kg: f64,
    /// Usable fuel at the start (kg).
    pub fuel_kg: f64,
    /// Port radius at the start (m).
    pub port_radius_m: f64,
    /// Fuel density times grain length: volume to radius (kg/m).
    pub fuel_kg_per_m2: f64,
    /// Dead time from command to valve motion (s).
    pub delay_s: f64,
    /// First-order time constant of the thrust behind the command: the servo's 2 ζ/ω (s).
    pub lag_s: f64,
    /// From throttle to the flame (s).
    pub ignition_delay_s: f64,
    /// Time constant of the thrust rise after the flame (s).
    pub rise_s: f64,
    /// Thrust between here and the upper end holds once lit (N).
    pub thrust_min_n: f64,
    /// Upper end (N).
    pub thrust_max_n: f64,
    /// Demands under this thrust shut the engine (N).
    pub thrust_shut_n: f64,
}

/// Estimated state of engine and tanks.
#[derive(Clone, Debug)]
pub struct PropellantEstimate {
    /// Mass of the vehicle (kg).
    pub mass_kg: f64,
    /// Oxidiser used (kg).
    pub oxidizer_used_kg: f64,
    /// Fuel used (kg).
    pub fuel_used_kg: f64,
    /// Port radius (m).
    pub port_radius_m: f64,
    /// Thrust over the thrust the model expects.
    pub trim: f64,
    /// Oxidiser flow now (kg/s).
    pub oxidizer_kg_s: f64,
    lagged_n: f64,
    rise: f64,
    demanded_for_s: f64,
    pipeline_n: [f64; PIPELINE],
}

/// Longest dead time that can be represented, in steps of the IMU.
const PIPELINE: usize = 64;
/// Time constant of the trim: slow against the valve, fast against the flight (s).
const TRIM_TIME_S: f64 = 0.5;
/// The trim corrects an engine off its map, not a broken one.
const TRIM_LIMIT: f64 = 0.08;

impl PropellantEstimate {
    /// Full tanks, engine off.
    pub fn new(parameters: &PropellantParameters) -> Self {
        Self {
            mass_kg: parameters.full.mass_kg,
            oxidizer_used_kg: 0.0,
            fuel_used_kg: 0.0,
            port_radius_m: parameters.port_radius_m,
            trim: 1.0,
            oxidizer_kg_s: 0.0,
            lagged_n: 0.0,
            rise: 0.0,
            demanded_for_s: 0.0,
            pipeline_n: [0.0; PIPELINE],
        }
    }

    /// Estimated thrust (N).
    pub fn thrust_n(&self) -> f64 {
        self.trim * self.lagged_n * self.rise
    }

    /// Mass properties at the estimated mass.
    pub fn mass_properties(&self, parameters: &PropellantParameters) -> MassPoint {
        let (full, empty) = (&parameters.full, &parameters.empty);
        let span = full.mass_kg - empty.mass_kg;
        let u = if span > 0.0 { (full.mass_kg - self.mass_kg) / span } else { 0.0 }.clamp(0.0, 1.2);
        let mut inertia = full.inertia_kg_m2;
        for (i, value) in inertia.iter_mut().enumerate() {
            *value += u * (empty.inertia_kg_m2[i] - full.inertia_kg_m2[i]);
        }
        MassPoint {
            mass_kg: self.mass_kg,
            com_body_m: full.com_body_m + (empty.com_body_m - full.com_body_m) * u,
            inertia_kg_m2: inertia,
        }
    }

    /// Time that the oxidiser or the fuel lasts at the present mean consumption of a hover (s).
    pub fn endurance_s(&self, parameters: &PropellantParameters, map: &ThrustMap, gravity_m_s2: f64) -> f64 {
        let (ox, fuel) = map.flows_kg_s(self.mass_kg * gravity_m_s2, self.port_radius_m);
        let left = |have: f64, used: f64, flow: f64| {
            if flow > 0.0 { (have - used).max(0.0) / flow } else { f64::INFINITY }
        };
        left(parameters.oxidizer_kg, self.oxidizer_used_kg, ox).min(left(
            parameters.fuel_kg,
            self.fuel_used_kg,
            fuel,
        ))
    }

    /// One step with the thrust demanded of the engine; `chamber_lit` is `None` without a transducer.
    pub fn step(
        &mut self,
        parameters: &PropellantParameters,
        map: &ThrustMap,
        demand_n: f64,
        chamber_lit: Option<bool>,
        dt_s: f64,
    ) {
        let steps = (parameters.delay_s / dt_s.max(1e-4)).round().clamp(0.0, (PIPELINE - 1) as f64) as usize;
        self.pipeline_n.rotate_right(1);
        self.pipeline_n[0] = demand_n;
        let demand_n = self.pipeline_n[steps];

        let on = demand_n > parameters.thrust_shut_n;
        self.demanded_for_s = if on { self.demanded_for_s + dt_s } else { 0.0 };
        let target_n =
            if on { demand_n.clamp(parameters.thrust_min_n, parameters.thrust_max_n) } else { 0.0 };
        self.lagged_n += (target_n - self.lagged_n) * share(dt_s, parameters.lag_s);
        let lit = chamber_lit.unwrap_or(self.demanded_for_s > parameters.ignition_delay_s);
        if lit {
            self.rise += (1.0 - self.rise) * share(dt_s, parameters.rise_s);
        } else if !on || chamber_lit == Some(false) {
            // Goes out as fast as it would have come.
            self.rise -= self.rise * share(dt_s, parameters.rise_s);
        }

        let (ox, fuel) = if self.lagged_n > 1.0 {
            map.flows_kg_s(self.thrust_n().max(parameters.thrust_min_n), self.port_radius_m)
        } else {
            (0.0, 0.0)
        };
        // The servo's tail below the table's edge: flow in proportion to thrust.
        let part = (self.thrust_n() / parameters.thrust_min_n).clamp(0.0, 1.0);
        self.oxidizer_kg_s = ox * part;
        self.oxidizer_used_kg += ox * part * dt_s;
        self.fuel_used_kg += fuel * part * dt_s;
        let burnt_m2 = self.fuel_used_kg / (core::f64::consts::PI * parameters.fuel_kg_per_m2.max(1e-3));
        self.port_radius_m = (parameters.port_radius_m * parameters.port_radius_m + burnt_m2).sqrt();
        let used = self.oxidizer_used_kg + self.fuel_used_kg;
        self.mass_kg = (parameters.full.mass_kg - used).max(0.5 * parameters.full.mass_kg);
    }

    /// Slow trim: the force seen along the long axis (N) against the thrust expected. Only in free flight.
    pub fn trim_step(&mut self, parameters: &PropellantParameters, axial_force_n: f64, dt_s: f64) {
        let expected = self.thrust_n();
        if expected < 0.8 * parameters.thrust_min_n || self.rise < 0.9 {
            return;
        }
        let error = ((axial_force_n - expected) / expected).clamp(-0.2, 0.2);
        self.trim =
            (self.trim * (1.0 + error * share(dt_s, TRIM_TIME_S))).clamp(1.0 - TRIM_LIMIT, 1.0 + TRIM_LIMIT);
    }
}

/// Share of a first-order step done in `dt_s`.
fn share(dt_s: f64, time_constant_s: f64) -> f64 {
    if time_constant_s > 0.0 { 1.0 - libm::exp(-dt_s / time_constant_s) } else { 1.0 }
}
