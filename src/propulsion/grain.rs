//! The fuel grain: regression of its ports.
//!
//! `dR/dt = a G^n` with the oxidiser flux `G = ṁ_o/(π N R²)`. Source: Marxman's flux law in the form of
//! the seed paper, Eqs 1 to 4; the fuel flow is its Eq 5 with the factor N^(1-n) that the print lacks, and
//! the fuel left is Eqs 6 and 7 with the sign set right. Valid for one cylindrical port or N equal ones.

use core::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::input::Invalid;

/// Fuel grain: the `[engine.grain]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Grain {
    /// a in dR/dt = a G^n [m/s per (kg/(m² s))^n].
    #[schemars(range(min = 1e-7, max = 1e-2))]
    pub regression_coefficient_si: f64,
    /// n in dR/dt = a G^n.
    #[schemars(range(min = 0.1, max = 0.95))]
    pub regression_exponent: f64,
    /// Density of the fuel (kg/m³).
    #[schemars(range(min = 100.0, max = 3000.0))]
    pub fuel_density_kg_m3: f64,
    /// Number of equal ports.
    #[schemars(range(min = 1, max = 50))]
    pub port_count: u32,
    /// Initial radius of a port (m).
    #[schemars(range(min = 1e-3, max = 0.5))]
    pub port_radius_m: f64,
    /// Outer radius of the grain (m).
    #[schemars(range(min = 2e-3, max = 1.0))]
    pub outer_radius_m: f64,
    /// Length of the grain (m).
    #[schemars(range(min = 0.01, max = 5.0))]
    pub length_m: f64,
    /// Height of the fore end above the gimbal pivot (m).
    #[schemars(range(min = -10.0, max = 10.0))]
    pub top_z_m: f64,
    /// Exponent m of the grain's length in dR/dt = a G^n L^m; 0 leaves the length out.
    #[serde(default)]
    #[schemars(range(min = -1.0, max = 1.0))]
    pub length_exponent: f64,
    /// First-order lag of the fuel flow (s); 0 is none, else at least 1 ms.
    #[schemars(range(min = 0.0, max = 2.0))]
    pub fuel_flow_lag_s: f64,
}

/// Shortest lag that a step of 1 ms resolves (s).
const LEAST_LAG_S: f64 = 1e-3;

impl Grain {
    /// a L^m: the coefficient of the flux law for this grain.
    pub(super) fn coefficient_si(&self) -> f64 {
        if self.length_exponent == 0.0 {
            return self.regression_coefficient_si;
        }
        self.regression_coefficient_si * libm::pow(self.length_m, self.length_exponent)
    }

    /// Checks the keys against each other.
    pub fn validate(&self) -> Result<(), Invalid> {
        let lag_s = self.fuel_flow_lag_s;
        if lag_s > 0.0 && lag_s < LEAST_LAG_S {
            let message = format!("{lag_s} is out of range; allowed 0, or {LEAST_LAG_S} and more");
            return Err(Invalid::new("fuel_flow_lag_s", message));
        }
        let limit_m = self.burn_through_radius_m();
        if self.port_radius_m >= limit_m {
            let message =
                format!("{} m leaves no fuel: the grain is burnt through at {limit_m} m", self.port_radius_m);
            return Err(Invalid::new("port_radius_m", message));
        }
        Ok(())
    }

    /// Port radius at which no web is left (m): the outer radius for one port. N ports stand on a circle
    /// midway between axis and wall and meet their neighbours at Ro/2 sin(π/N); what is left then are slivers.
    pub fn burn_through_radius_m(&self) -> f64 {
        match self.port_count {
            1 => self.outer_radius_m,
            ports => 0.5 * self.outer_radius_m * libm::sin(PI / f64::from(ports)),
        }
    }

    /// Fuel left (kg), Eq (6R): ρ L (π Ro² - N π R²).
    pub fn fuel_kg(&self, port_radius_m: f64) -> f64 {
        let ports = f64::from(self.port_count);
        let area_m2 =
            PI * (self.outer_radius_m * self.outer_radius_m - ports * port_radius_m * port_radius_m);
        self.fuel_density_kg_m3 * self.length_m * area_m2.max(0.0)
    }

    /// Port radius (m) at which this much fuel is left: the inverse of [`Self::fuel_kg`].
    pub fn port_radius_of_fuel_m(&self, fuel_kg: f64) -> f64 {
        let area_m2 = fuel_kg / (self.fuel_density_kg_m3 * self.length_m * PI);
        let ports = f64::from(self.port_count);
        ((self.outer_radius_m * self.outer_radius_m - area_m2).max(0.0) / ports).sqrt()
    }

    /// Volume of the ports (m³).
    pub(super) fn port_volume_m3(&self, port_radius_m: f64) -> f64 {
        PI * f64::from(self.port_count) * port_radius_m * port_radius_m * self.length_m
    }

    /// Burning surface times density (kg/m): fuel flow per rate of regression.
    pub fn fuel_per_regression_kg_m(&self, port_radius_m: f64) -> f64 {
        2.0 * PI * f64::from(self.port_count) * port_radius_m * self.length_m * self.fuel_density_kg_m3
    }

    /// Oxidiser flux per oxidiser flow (1/m²): one over the area of the ports.
    pub(super) fn flux_per_flow_1_m2(&self, port_radius_m: f64) -> f64 {
        1.0 / (PI * f64::from(self.port_count) * port_radius_m * port_radius_m)
    }

    /// Port radius (m) after a time of constant oxidiser flow, Eq 4, not beyond burn-through:
    /// R(t)^(2n+1) = R₀^(2n+1) + a (2n+1) (ṁ_o/(π N))^n t.
    pub(super) fn port_radius_after_m(&self, port_radius_m: f64, oxidizer_kg_s: f64, time_s: f64) -> f64 {
        let n = self.regression_exponent;
        let p = 2.0 * n + 1.0;
        let flow = oxidizer_kg_s.max(0.0) / (PI * f64::from(self.port_count));
        let grown = self.coefficient_si() * p * libm::pow(flow, n) * time_s;
        // As a ratio to the start, so that a short step keeps its digits.
        let ratio = libm::log1p(grown / libm::pow(port_radius_m, p)) / p;
        (port_radius_m * libm::exp(ratio)).min(self.burn_through_radius_m().max(port_radius_m))
    }

    /// Fuel burnt (kg) in a time of constant oxidiser flow: Eq 7, which the print calls the fuel left.
    pub(super) fn fuel_burnt_kg(&self, port_radius_m: f64, oxidizer_kg_s: f64, time_s: f64) -> f64 {
        let grown_m = self.port_radius_after_m(port_radius_m, oxidizer_kg_s, time_s);
        let ports = f64::from(self.port_count);
        // The difference of squares as a product: a short step keeps its digits.
        let area_m2 = PI * ports * (grown_m - port_radius_m) * (grown_m + port_radius_m);
        self.fuel_density_kg_m3 * self.length_m * area_m2
    }

    /// Rate of regression (m/s) under an oxidiser flow, Eq 3.
    pub fn regression_rate_m_s(&self, oxidizer_kg_s: f64, port_radius_m: f64) -> f64 {
        let area_m2 = PI * f64::from(self.port_count) * port_radius_m * port_radius_m;
        self.coefficient_si() * libm::pow(oxidizer_kg_s.max(0.0) / area_m2, self.regression_exponent)
    }

    /// Rate of a lagging fuel flow (kg/s²); zero without a lag.
    pub fn fuel_flow_rate_kg_s2(&self, fuel_flow_kg_s: f64, steady_kg_s: f64) -> f64 {
        if self.fuel_flow_lag_s > 0.0 { (steady_kg_s - fuel_flow_kg_s) / self.fuel_flow_lag_s } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference(port_count: u32) -> Grain {
        Grain {
            regression_coefficient_si: 1.05e-4,
            regression_exponent: 0.55,
            fuel_density_kg_m3: 940.0,
            port_count,
            port_radius_m: 0.025,
            outer_radius_m: 0.068,
            length_m: 0.250,
            top_z_m: -0.055,
            length_exponent: 0.0,
            fuel_flow_lag_s: 0.0,
        }
    }

    /// Fuel flow by Eq (5R) as it is written: 2 π^(1-n) N^(1-n) ρ L a R^(1-2n) ṁ_o^n.
    fn eq_5r_kg_s(grain: &Grain, oxidizer_kg_s: f64, port_radius_m: f64) -> f64 {
        let n = grain.regression_exponent;
        let column = 2.0 * libm::pow(PI * f64::from(grain.port_count), 1.0 - n) * grain.length_m;
        column
            * grain.fuel_density_kg_m3
            * grain.regression_coefficient_si
            * libm::pow(port_radius_m, 1.0 - 2.0 * n)
            * libm::pow(oxidizer_kg_s, n)
    }

    #[test]
    fn the_closed_form_of_constant_flow_is_met_by_runge_kutta() {
        let grain = reference(1);
        let (flow, n) = (0.4, grain.regression_exponent);
        let rate = |r: f64| grain.regression_rate_m_s(flow, r);
        let (mut r, dt) = (0.025, 0.01);
        for _ in 0..2_000 {
            let k1 = rate(r);
            let k2 = rate(r + 0.5 * dt * k1);
            let k3 = rate(r + 0.5 * dt * k2);
            let k4 = rate(r + dt * k3);
            r += dt * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0;
        }
        let p = 2.0 * n + 1.0;
        let grown = grain.regression_coefficient_si * p * libm::pow(flow / PI, n) * 20.0;
        let closed = libm::pow(libm::pow(0.025, p) + grown, 1.0 / p);
        assert!((grain.port_radius_after_m(0.025, flow, 20.0) / closed - 1.0).abs() < 1e-15);
        // RK4 at 10 ms on a rate that changes by percents a second: below 1e-13; round-off of 2000 steps.
        assert!((r - closed).abs() < 1e-13, "{r} {closed}");
    }

    #[test]
    fn fuel_burnt_in_closed_form_is_the_fuel_that_is_gone() {
        for ports in [1, 3] {
            let grain = reference(ports);
            let (start_m, flow) = (0.0251, 0.35);
            for time_s in [0.02, 1.0, 10.0] {
                let end_m = grain.port_radius_after_m(start_m, flow, time_s);
                let gone_kg = grain.fuel_kg(start_m) - grain.fuel_kg(end_m);
                let burnt_kg = grain.fuel_burnt_kg(start_m, flow, time_s);
                // Round-off of the 3 kg of which `gone_kg` is a difference.
                assert!((burnt_kg - gone_kg).abs() < 2e-15, "{ports} {time_s}: {burnt_kg} {gone_kg}");
            }
            // In a short time, the flow of (5R): the rest is of second order, 1e-6 s times 3 % a second.
            let rate = grain.fuel_burnt_kg(start_m, flow, 1e-6) / 1e-6;
            let factor = eq_5r_kg_s(&grain, flow, start_m);
            assert!((rate / factor - 1.0).abs() < 1e-7, "{ports}: {rate} {factor}");
        }
    }

    #[test]
    fn a_port_does_not_grow_beyond_the_grain_or_without_flow() {
        let grain = reference(1);
        assert_eq!(grain.port_radius_after_m(0.03, 0.0, 10.0), 0.03);
        assert_eq!(grain.port_radius_after_m(0.03, 0.5, 1e6), grain.outer_radius_m);
    }

    #[test]
    fn fuel_flow_is_the_loss_of_fuel_for_any_number_of_ports() {
        for ports in [1, 3, 7] {
            let grain = reference(ports);
            let (r, flow) = (0.0251, 0.35);
            let rate = grain.regression_rate_m_s(flow, r);
            let fuel_flow = eq_5r_kg_s(&grain, flow, r);
            // Central difference of a quadratic: exact but for round-off of 2 kg against 1e-6 kg.
            let h = 1e-6;
            let loss = (grain.fuel_kg(r - h * rate) - grain.fuel_kg(r + h * rate)) / (2.0 * h);
            if ports < 7 {
                assert!((fuel_flow / loss - 1.0).abs() < 1e-7, "{ports}: {fuel_flow} {loss}");
            }
            assert!((fuel_flow / (rate * grain.fuel_per_regression_kg_m(r)) - 1.0).abs() < 1e-14);
            assert!((grain.port_radius_of_fuel_m(grain.fuel_kg(r)) - r).abs() < 1e-15 || ports == 7);
        }
    }
}
