//! Engine and propellant estimate: thrust behind its command, propellant used, mass, and the trim between the
//! thrust of the model and the thrust that the accelerometer measures.

use super::allocation::ThrustMap;
use super::rigid_body::MassProperties;

/// Engine and propellants as the flight computer knows them.
#[derive(Clone, Debug, PartialEq)]
pub struct PropellantParameters {
    /// Mass properties with full tanks.
    pub full: MassProperties,
    /// Mass properties without propellant.
    pub empty: MassProperties,
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
    /// From throttle to ignition (s).
    pub ignition_delay_s: f64,
    /// Time constant of the thrust rise after ignition (s).
    pub rise_s: f64,
    /// Lower end of the thrust band (N).
    pub thrust_min_n: f64,
    /// Upper end of the thrust band (N).
    pub thrust_max_n: f64,
    /// Demands below this thrust shut the engine down (N).
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
    /// Measured thrust over the thrust of the model.
    pub trim: f64,
    /// Oxidiser flow (kg/s).
    pub oxidizer_kg_s: f64,
    /// Thrust demand behind dead time and lag (N).
    lagged_n: f64,
    /// Share of the thrust that the ignition transient has reached.
    rise: f64,
    /// Time since the engine was demanded (s).
    demand_time_s: f64,
    /// Demands of the last steps, newest first (N).
    delay_line_n: [f64; DELAY_LINE],
}

/// Longest dead time that can be represented, in steps of the IMU.
const DELAY_LINE: usize = 64;
/// Time constant of the trim: slow against the valve, fast against the flight (s).
const TRIM_TIME_S: f64 = 0.5;
/// Bound of the trim: it corrects an engine off its map, not a broken one.
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
            demand_time_s: 0.0,
            delay_line_n: [0.0; DELAY_LINE],
        }
    }

    /// Estimated thrust (N).
    pub fn thrust_n(&self) -> f64 {
        self.trim * self.lagged_n * self.rise
    }

    /// Mass properties at the estimated mass: linear between full and empty.
    pub(crate) fn mass_properties(&self, parameters: &PropellantParameters) -> MassProperties {
        let (full, empty) = (&parameters.full, &parameters.empty);
        let span = full.mass_kg - empty.mass_kg;
        let u = if span > 0.0 { (full.mass_kg - self.mass_kg) / span } else { 0.0 }.clamp(0.0, 1.2);
        let mut inertia = full.inertia_kg_m2;
        for (i, value) in inertia.iter_mut().enumerate() {
            *value += u * (empty.inertia_kg_m2[i] - full.inertia_kg_m2[i]);
        }
        MassProperties {
            mass_kg: self.mass_kg,
            com_body_m: full.com_body_m + (empty.com_body_m - full.com_body_m) * u,
            inertia_kg_m2: inertia,
        }
    }

    /// Time that oxidiser and fuel last at the flow of a hover (s).
    pub(crate) fn endurance_s(
        &self,
        parameters: &PropellantParameters,
        map: &ThrustMap,
        gravity_m_s2: f64,
    ) -> f64 {
        let (ox, fuel) = map.flows_kg_s(self.mass_kg * gravity_m_s2, self.port_radius_m);
        let lasts_s = |loaded: f64, used: f64, flow: f64| {
            if flow > 0.0 { (loaded - used).max(0.0) / flow } else { f64::INFINITY }
        };
        lasts_s(parameters.oxidizer_kg, self.oxidizer_used_kg, ox).min(lasts_s(
            parameters.fuel_kg,
            self.fuel_used_kg,
            fuel,
        ))
    }

    /// One step under a thrust demand; `chamber_lit` is `None` without a pressure transducer.
    pub fn step(
        &mut self,
        parameters: &PropellantParameters,
        map: &ThrustMap,
        demand_n: f64,
        chamber_lit: Option<bool>,
        dt_s: f64,
    ) {
        let steps =
            (parameters.delay_s / dt_s.max(1e-4)).round().clamp(0.0, (DELAY_LINE - 1) as f64) as usize;
        self.delay_line_n.rotate_right(1);
        self.delay_line_n[0] = demand_n;
        let demand_n = self.delay_line_n[steps];

        let on = demand_n > parameters.thrust_shut_n;
        self.demand_time_s = if on { self.demand_time_s + dt_s } else { 0.0 };
        let target_n =
            if on { demand_n.clamp(parameters.thrust_min_n, parameters.thrust_max_n) } else { 0.0 };
        self.lagged_n += (target_n - self.lagged_n) * share(dt_s, parameters.lag_s);
        let lit = chamber_lit.unwrap_or(self.demand_time_s > parameters.ignition_delay_s);
        if lit {
            self.rise += (1.0 - self.rise) * share(dt_s, parameters.rise_s);
        } else if !on || chamber_lit == Some(false) {
            // The thrust decays with the time constant of its rise.
            self.rise -= self.rise * share(dt_s, parameters.rise_s);
        }

        let (ox, fuel) = if self.lagged_n > 1.0 {
            map.flows_kg_s(self.thrust_n().max(parameters.thrust_min_n), self.port_radius_m)
        } else {
            (0.0, 0.0)
        };
        // Below the thrust band the flow is in proportion to the thrust.
        let part = (self.thrust_n() / parameters.thrust_min_n).clamp(0.0, 1.0);
        self.oxidizer_kg_s = ox * part;
        self.oxidizer_used_kg += ox * part * dt_s;
        self.fuel_used_kg += fuel * part * dt_s;
        let burnt_m2 = self.fuel_used_kg / (core::f64::consts::PI * parameters.fuel_kg_per_m2.max(1e-3));
        self.port_radius_m = (parameters.port_radius_m * parameters.port_radius_m + burnt_m2).sqrt();
        let used = self.oxidizer_used_kg + self.fuel_used_kg;
        self.mass_kg = (parameters.full.mass_kg - used).max(0.5 * parameters.full.mass_kg);
    }

    /// Slow trim from the measured force along the long axis (N). Only in free flight.
    pub(crate) fn trim_step(&mut self, parameters: &PropellantParameters, axial_force_n: f64, dt_s: f64) {
        let expected = self.thrust_n();
        if expected < 0.8 * parameters.thrust_min_n || self.rise < 0.9 {
            return;
        }
        let error = ((axial_force_n - expected) / expected).clamp(-0.2, 0.2);
        self.trim =
            (self.trim * (1.0 + error * share(dt_s, TRIM_TIME_S))).clamp(1.0 - TRIM_LIMIT, 1.0 + TRIM_LIMIT);
    }
}

/// Share of a first-order response after `dt_s`.
fn share(dt_s: f64, time_constant_s: f64) -> f64 {
    if time_constant_s > 0.0 { 1.0 - libm::exp(-dt_s / time_constant_s) } else { 1.0 }
}
