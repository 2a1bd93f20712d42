//! The engine of the seed paper: a sweep of oxidiser flows, each with its thrust, and the valve area behind
//! it.
//!
//! For every candidate flow of Eq 8 the port grows by the closed form of Eq 4 over one step; the fuel burnt
//! on the way gives O/F, O/F alone gives Isp and c* (polynomials), these give thrust (Eq 10) and chamber
//! pressure (Eq 11). The candidate nearest to the commanded thrust is taken; Eq 15 gives its P2, Eq 16 its
//! valve area. Driven from the valve, as a plant is, the candidate whose area is nearest to the valve's is
//! taken: for a demand that went through the sweep this is the same one.
//!
//! Source: the seed paper, Eqs 4 to 16. What the print says and what is computed here:
//!
//! | Eq | print | here |
//! |---|---|---|
//! | 5 | lacks N^(1-n) | fuel of Eqs 4 and 6 over the step, for any N |
//! | 6, 7 | called fuel left, are fuel burnt | burnt |
//! | 10 | no g₀ | g₀ Isp, no efficiency unless `specific_impulse_efficiency` says so |
//! | 10, 11 | polynomials not given | least squares through the vehicle's map at its reference pressure |
//! | 14 | κ not given | κ² = (P2 - P3)/(Pv - P3) |
//! | 14 | injector isenthalpic: no equilibrium flux | isentropic: equilibrium flux at P3, not choked |
//! | 16 | Φ "using pressure drop" | √(2 ρ₁ (P1 - P2)) |
//!
//! The sea-level Isp has no knowledge of chamber pressure, separation or an unchoked throat: thrust goes to
//! zero with the flow only because the flow does.

use nalgebra::{DMatrix, DVector};

use super::engine::Engine;
use super::feed_grid::Feed;
use super::feed_map::throttled_state;
use super::injector::{OrificePressures, flashing_flux_kg_m2_s};
use super::inverse::Inverse;
use super::nozzle::NozzleFlow;
use super::operating_point::{EngineCondition, OperatingPoint, WarmStart};
use super::parameters::{EngineParameters, PaperMode};
use crate::environment::atmosphere::STANDARD_GRAVITY_M_S2;
use crate::fluid::Nitrous;
use crate::interpolate::{Bracket, bracketed_root};

/// Sea level of the paper's specific impulse (Pa).
const SEA_LEVEL_PA: f64 = 101_325.0;
/// Accuracy of P2 (Pa).
const INLET_TOLERANCE_PA: f64 = 0.01;

/// The engine as the seed paper computes it.
#[derive(Clone, Debug)]
pub struct PaperEngine {
    flows_kg_s: (f64, f64),
    points: u32,
    step_s: f64,
    isp_efficiency: f64,
    c_star_efficiency: f64,
    cold_isp_s: f64,
    cold_c_star_m_s: f64,
    isp_s: Polynomial,
    c_star_m_s: Polynomial,
}

/// One candidate flow of the sweep, all of it burning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepPoint {
    /// Oxidiser (kg/s).
    pub oxidizer_kg_s: f64,
    /// Fuel, mean over the step (kg/s).
    pub fuel_kg_s: f64,
    /// Port radius at the end of the step (m), Eq 4.
    pub port_radius_m: f64,
    /// Oxidiser over fuel.
    pub of_ratio: f64,
    /// Thrust (N), Eq 10.
    pub thrust_n: f64,
    /// Chamber pressure (Pa), Eq 11, not below ambient.
    pub chamber_pa: f64,
}

impl PaperEngine {
    /// From an engine, its parameters and the numbers of the scheme. Allocates: for set-up.
    pub fn new(engine: &Engine, parameters: &EngineParameters, paper: &PaperMode) -> Self {
        let map = &engine.thrust_chamber.map;
        let nozzle = engine.nozzle();
        let span = paper.fitted_of_range(map.of_span());
        let c_star = |of: f64| map.mixture(of).c_star_m_s(0.0);
        let lost_m2 = SEA_LEVEL_PA * nozzle.expansion_ratio / parameters.map.reference_pressure_pa;
        let isp = |of: f64| map.mixture(of).vacuum_isp_s(0.0) - lost_m2 * c_star(of) / STANDARD_GRAVITY_M_S2;
        Self {
            flows_kg_s: (paper.oxidizer_flow_min_kg_s, paper.oxidizer_flow_max_kg_s),
            points: paper.sweep_points,
            step_s: paper.step_s,
            isp_efficiency: paper.specific_impulse_efficiency,
            c_star_efficiency: parameters.chamber.c_star_efficiency,
            cold_isp_s: parameters.ignition.cold_flow_isp_s,
            cold_c_star_m_s: parameters.ignition.cold_flow_c_star_m_s,
            isp_s: Polynomial::fit(span, paper.polynomial_degree, isp),
            c_star_m_s: Polynomial::fit(span, paper.polynomial_degree, c_star),
        }
    }

    /// Ideal sea-level specific impulse (s) of the polynomial.
    pub fn specific_impulse_s(&self, of_ratio: f64) -> f64 {
        self.isp_s.at(of_ratio)
    }

    /// Ideal characteristic velocity (m/s) of the polynomial.
    pub fn c_star_m_s(&self, of_ratio: f64) -> f64 {
        self.c_star_m_s.at(of_ratio)
    }

    /// A flow of the sweep's grid (kg/s).
    pub fn flow_kg_s(&self, point: u32) -> f64 {
        let (least, most) = self.flows_kg_s;
        least + (most - least) * f64::from(point) / f64::from(self.points - 1)
    }

    /// One candidate: what an oxidiser flow gives within a step, Eqs 4, 6, 9, 10, 11.
    pub fn sweep_point(
        &self,
        engine: &Engine,
        condition: &EngineCondition,
        oxidizer_kg_s: f64,
    ) -> SweepPoint {
        let grain = engine.grain();
        let radius_m = condition.port_radius_m.min(grain.burn_through_radius_m());
        let grown_m = grain.port_radius_after_m(radius_m, oxidizer_kg_s, self.step_s);
        let fuel_kg_s = grain.fuel_burnt_kg(radius_m, oxidizer_kg_s, self.step_s) / self.step_s;
        let of_ratio = if fuel_kg_s > 0.0 { oxidizer_kg_s / fuel_kg_s } else { f64::MAX };
        let total_kg_s = oxidizer_kg_s + fuel_kg_s;
        let left = 1.0 - condition.damage.efficiency_drop_share;
        let isp_s = left * self.isp_efficiency * self.isp_s.at(of_ratio);
        let pressure_pa = total_kg_s * self.c_star_m_s.at(of_ratio) * (left * self.c_star_efficiency)
            / engine.thrust_chamber.open_throat_m2(condition);
        SweepPoint {
            oxidizer_kg_s,
            fuel_kg_s,
            port_radius_m: grown_m,
            of_ratio,
            thrust_n: STANDARD_GRAVITY_M_S2 * isp_s * total_kg_s,
            chamber_pa: pressure_pa.max(condition.ambient_pa),
        }
    }

    /// The sweep of Eq 8: the candidate whose thrust is nearest to the demand.
    pub fn sweep(&self, engine: &Engine, condition: &EngineCondition, thrust_n: f64) -> SweepPoint {
        let candidate = |point| self.sweep_point(engine, condition, self.flow_kg_s(point));
        let miss = |c: &SweepPoint| (c.thrust_n - thrust_n).abs();
        (1..self.points)
            .map(candidate)
            .fold(candidate(0), |best, next| if miss(&next) < miss(&best) { next } else { best })
    }

    /// P2 (Pa) and quality behind the valve for a flow into a chamber pressure (Pa), Eqs 14 and 15; `None`
    /// when the injector cannot pass it at the tank's pressure.
    pub fn inlet<'f>(
        &self,
        engine: &Engine,
        feed: impl Into<Feed<'f>>,
        condition: &EngineCondition,
        (oxidizer_kg_s, chamber_pa): (f64, f64),
    ) -> Option<(f64, f64)> {
        let feed = &feed.into();
        let tank_pa = feed.tank().pressure_pa;
        let injector_m2 = engine.injector_m2(condition);
        let behind_valve = |inlet_pa: f64| {
            let flashing = inlet_pa < feed.flash_pa();
            throttled_state(Nitrous::tables(), inlet_pa, feed.tank().enthalpy_j_kg, flashing)
        };
        let excess_kg_s = |inlet_pa: f64| {
            let (state, _) = behind_valve(inlet_pa);
            let pressures = OrificePressures {
                upstream_pa: inlet_pa,
                downstream_pa: chamber_pa,
                vapor_pa: state.vapor_pressure_pa,
            };
            let flux = flashing_flux_kg_m2_s(pressures, state.density_kg_m3, || {
                Nitrous::tables().equilibrium_flux_kg_m2_s(&state, chamber_pa)
            });
            injector_m2 * flux - oxidizer_kg_s
        };
        if chamber_pa >= tank_pa || excess_kg_s(tank_pa) <= 0.0 {
            return None;
        }
        let bracket = Bracket {
            low: chamber_pa,
            high: tank_pa,
            guess: f64::NAN,
            slope: None,
            tolerance: INLET_TOLERANCE_PA,
        };
        let inlet_pa = bracketed_root(bracket, excess_kg_s).x;
        Some((inlet_pa, behind_valve(inlet_pa).1))
    }

    /// Valve area (m²) that passes a flow at P2, Eq 16.
    pub fn valve_area_m2<'f>(
        &self,
        engine: &Engine,
        feed: impl Into<Feed<'f>>,
        oxidizer_kg_s: f64,
        inlet_pa: f64,
    ) -> f64 {
        let feed = &feed.into();
        let tank = feed.tank();
        let flux = (2.0 * tank.density_kg_m3 * (tank.pressure_pa - inlet_pa).max(0.0)).sqrt();
        oxidizer_kg_s / (engine.valve_discharge_coefficient * flux)
    }

    /// The forward answer: the candidate whose valve area is nearest to the one that is open.
    pub fn operating_point<'f>(
        &self,
        engine: &Engine,
        feed: impl Into<Feed<'f>>,
        valve_area_m2: f64,
        condition: &EngineCondition,
    ) -> OperatingPoint {
        let feed = &feed.into();
        let limit_kg_s = condition.oxidizer_flow_limit_kg_s;
        let ambient_pa = condition.ambient_pa;
        if !(valve_area_m2 > 0.0 && limit_kg_s > 0.0 && feed.tank().pressure_pa > ambient_pa) {
            return OperatingPoint::no_flow(ambient_pa, WarmStart::default());
        }
        let area = |point: u32| {
            let flow_kg_s = self.flow_kg_s(point);
            let chamber_pa = self.partly_burning(engine, condition, flow_kg_s).chamber_pa;
            self.inlet(engine, feed, condition, (flow_kg_s, chamber_pa))
                .map_or(f64::INFINITY, |(inlet_pa, _)| self.valve_area_m2(engine, feed, flow_kg_s, inlet_pa))
        };
        // The area rises with the flow: halve the grid instead of walking it.
        let (mut below, mut above) = (0, self.points - 1);
        while above - below > 1 {
            let middle = below + (above - below) / 2;
            if area(middle) <= valve_area_m2 { below = middle } else { above = middle }
        }
        let nearest = if valve_area_m2 - area(below) <= area(above) - valve_area_m2 { below } else { above };
        let point = self.partly_burning(engine, condition, self.flow_kg_s(nearest).min(limit_kg_s));
        let total_kg_s = point.oxidizer_kg_s + point.fuel_kg_s;
        let inlet = self.inlet(engine, feed, condition, (point.oxidizer_kg_s, point.chamber_pa));
        let (injector_inlet_pa, quality) = inlet.unwrap_or((feed.tank().pressure_pa, 0.0));
        let radius_m = condition.port_radius_m.min(engine.grain().burn_through_radius_m());
        OperatingPoint {
            oxidizer_kg_s: point.oxidizer_kg_s,
            tank_kg_s: point.oxidizer_kg_s,
            fuel_kg_s: point.fuel_kg_s,
            steady_fuel_kg_s: point.fuel_kg_s,
            nozzle_kg_s: total_kg_s,
            of_ratio: if point.fuel_kg_s > 0.0 { point.oxidizer_kg_s / point.fuel_kg_s } else { 0.0 },
            chamber_pa: point.chamber_pa,
            injector_inlet_pa,
            quality,
            thrust_n: point.thrust_n,
            isp_s: point.thrust_n / (STANDARD_GRAVITY_M_S2 * total_kg_s),
            regression_rate_m_s: (point.port_radius_m - radius_m) / self.step_s,
            throat_erosion_m_s: engine.thrust_chamber.erosion_m_s(condition, point.chamber_pa),
            nozzle_flow: NozzleFlow::Full,
            solved: inlet.is_some(),
            ..OperatingPoint::no_flow(ambient_pa, WarmStart::default())
        }
    }

    /// The inverse answer: sweep, P2, valve area, angle.
    pub fn inverse<'f>(
        &self,
        engine: &Engine,
        feed: impl Into<Feed<'f>>,
        thrust_n: f64,
        condition: &EngineCondition,
    ) -> Inverse {
        let feed = &feed.into();
        let chosen = self.sweep(engine, condition, thrust_n);
        let (_, open_m2) = engine.valve_area().fully_open();
        let area_m2 = self
            .inlet(engine, feed, condition, (chosen.oxidizer_kg_s, chosen.chamber_pa))
            .map_or(f64::INFINITY, |(inlet_pa, _)| {
                self.valve_area_m2(engine, feed, chosen.oxidizer_kg_s, inlet_pa)
            });
        let valve_rad = engine.valve_area().angle_rad(area_m2.min(open_m2));
        let valve_area_m2 = engine.valve_area().area_m2(valve_rad);
        let end = chosen.oxidizer_kg_s <= self.flows_kg_s.0 || chosen.oxidizer_kg_s >= self.flows_kg_s.1;
        let point = self.operating_point(engine, feed, valve_area_m2, condition);
        Inverse { valve_rad, valve_area_m2, point, saturated: end || area_m2 > open_m2 }
    }

    /// A flow of which some burns and the rest passes cold: no part of the paper, which has no ignition.
    fn partly_burning(&self, engine: &Engine, condition: &EngineCondition, oxidizer_kg_s: f64) -> SweepPoint {
        let hot = self.sweep_point(engine, condition, oxidizer_kg_s);
        let f = condition.burning_fraction.clamp(0.0, 1.0);
        let cold_n = STANDARD_GRAVITY_M_S2 * self.cold_isp_s * oxidizer_kg_s;
        let cold_pa = (self.cold_c_star_m_s * oxidizer_kg_s
            / engine.thrust_chamber.open_throat_m2(condition))
        .max(condition.ambient_pa);
        let radius_m = condition.port_radius_m.min(engine.grain().burn_through_radius_m());
        SweepPoint {
            fuel_kg_s: f * hot.fuel_kg_s,
            port_radius_m: radius_m + f * (hot.port_radius_m - radius_m),
            thrust_n: f * hot.thrust_n + (1.0 - f) * cold_n,
            chamber_pa: f * hot.chamber_pa + (1.0 - f) * cold_pa,
            ..hot
        }
    }
}

/// A polynomial in O/F by its Chebyshev coefficients, held at the ends of its range.
#[derive(Clone, Debug)]
struct Polynomial {
    span: (f64, f64),
    coefficients: Vec<f64>,
}

impl Polynomial {
    /// Least squares through a function at equal steps. Chebyshev polynomials, because the equations of
    /// powers of O/F are nearly singular at degree 8.
    fn fit(span: (f64, f64), degree: u32, f: impl Fn(f64) -> f64) -> Self {
        let terms = degree as usize + 1;
        let samples = (((span.1 - span.0) / PaperMode::FIT_SPACING).round() as usize + 1).max(2 * terms);
        let at = |i: usize| span.0 + (span.1 - span.0) * i as f64 / (samples - 1) as f64;
        let basis = DMatrix::from_fn(samples, terms, |row, column| chebyshev(scaled(span, at(row)), column));
        let values = DVector::from_fn(samples, |row, _| f(at(row)));
        let normal = basis.transpose() * &basis;
        let right = basis.transpose() * values;
        let solved = normal.cholesky().expect("distinct points outnumber the terms").solve(&right);
        Self { span, coefficients: solved.iter().copied().collect() }
    }

    /// Value at a mixture ratio, by Clenshaw's recurrence.
    fn at(&self, of_ratio: f64) -> f64 {
        let x = scaled(self.span, of_ratio.clamp(self.span.0, self.span.1));
        let (mut b1, mut b2) = (0.0, 0.0);
        for &c in self.coefficients[1..].iter().rev() {
            (b1, b2) = (c + 2.0 * x * b1 - b2, b1);
        }
        self.coefficients[0] + x * b1 - b2
    }
}

/// From a range to -1 to 1.
fn scaled((low, high): (f64, f64), x: f64) -> f64 {
    (2.0 * x - low - high) / (high - low)
}

/// Chebyshev polynomial of the first kind.
fn chebyshev(x: f64, order: usize) -> f64 {
    let (mut now, mut next) = (1.0, x);
    for _ in 0..order {
        (now, next) = (next, 2.0 * x * next - now);
    }
    now
}
