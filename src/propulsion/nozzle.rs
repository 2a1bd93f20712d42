//! The nozzle: thrust and flow from full to off.
//!
//! One variable, the Mach number at which the jet leaves the wall, joins four states: full, separated (where
//! p = pa/M on the wall, which tends to pa at the throat: no jump where the nozzle unchokes), unchoked, off.
//! Perfect-gas relations with the throat's isentropic exponent.
//!
//! Source: Stark, "Flow separation in rocket nozzles", AIAA 2005-3940, for the separation rule; thrust of
//! the full nozzle is the seed paper's Eq 10 with the vacuum impulse, both efficiencies and g₀.

use core::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::combustion::Mixture;
use crate::environment::atmosphere::STANDARD_GRAVITY_M_S2;
use crate::interpolate::{Bracket, bracketed_root};

/// Nozzle: the `[engine.nozzle]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Nozzle {
    /// Initial diameter of the throat (m).
    #[schemars(range(min = 1e-3, max = 0.5))]
    pub throat_diameter_m: f64,
    /// Exit area over initial throat area; the exit stays as the throat grows.
    #[schemars(range(min = 1.05, max = 50.0))]
    pub expansion_ratio: f64,
    /// Discharge coefficient of the throat.
    #[schemars(range(min = 0.5, max = 1.0))]
    pub discharge_coefficient: f64,
    /// Efficiency of the vacuum thrust.
    #[schemars(range(min = 0.5, max = 1.0))]
    pub thrust_efficiency: f64,
    /// Growth of the throat's radius at `erosion_pressure_pa` (m/s).
    #[schemars(range(min = 0.0, max = 1e-2))]
    pub erosion_rate_m_s: f64,
    /// Chamber pressure at which `erosion_rate_m_s` holds (Pa).
    #[schemars(range(min = 1e4, max = 1e8))]
    pub erosion_pressure_pa: f64,
    /// Exponent of the chamber pressure in the growth.
    #[schemars(range(min = 0.0, max = 3.0))]
    pub erosion_exponent: f64,
    /// Height of the exit plane above the gimbal pivot (m).
    #[schemars(range(min = -10.0, max = 10.0))]
    pub exit_z_m: f64,
}

/// Flow regime of the nozzle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NozzleFlow {
    /// No flow at all.
    Off,
    /// Subsonic throughout.
    Unchoked,
    /// Choked; the jet leaves the wall before the exit.
    Separated,
    /// Choked, full to the exit.
    Full,
}

impl Nozzle {
    /// Initial radius of the throat (m).
    pub fn throat_radius_m(&self) -> f64 {
        0.5 * self.throat_diameter_m
    }

    /// Exit area (m²).
    pub(super) fn exit_area_m2(&self) -> f64 {
        let radius_m = self.throat_radius_m();
        self.expansion_ratio * PI * radius_m * radius_m
    }

    /// Throat radius at which the nozzle has become a straight pipe (m); erosion stops there.
    pub fn greatest_throat_radius_m(&self) -> f64 {
        self.throat_radius_m() * self.expansion_ratio.sqrt()
    }

    /// Thrust (N) and state of the flow at a chamber pressure.
    #[inline]
    pub(super) fn thrust(
        &self,
        throat: &Throat,
        mixture: &Mixture<'_>,
        chamber: ChamberPressure,
    ) -> (f64, NozzleFlow) {
        let ratio = chamber.pa / throat.ambient_pa;
        if ratio >= throat.full_above {
            return (self.full_n(throat, mixture, chamber).max(0.0), NozzleFlow::Full);
        }
        if ratio <= 1.0 {
            return (0.0, NozzleFlow::Off);
        }
        self.thrust_near_separation(throat, mixture, chamber)
    }

    /// The same of a nozzle that may flow full, separated or unchoked.
    #[inline(never)]
    fn thrust_near_separation(
        &self,
        throat: &Throat,
        mixture: &Mixture<'_>,
        chamber: ChamberPressure,
    ) -> (f64, NozzleFlow) {
        let ratio = chamber.pa / throat.ambient_pa;
        let full_n = |c| self.full_n(throat, mixture, c);
        let gas = PerfectGas { gamma: mixture.gamma() };
        let exit_mach = gas.supersonic_mach(throat.exit_area_m2 / throat.area_m2);
        let separation_ratio = gas.total_over_static(exit_mach) / exit_mach;
        if ratio >= separation_ratio {
            return (full_n(chamber).max(0.0), NozzleFlow::Full);
        }
        // (10S): the onset of separation at this mixture, scaled by the ideal thrust.
        let onset = ChamberPressure {
            pa: separation_ratio * throat.ambient_pa,
            log: chamber.log + libm::log(separation_ratio / ratio),
        };
        let onset_n = full_n(onset).max(0.0);
        let onset_tau = gas.ideal_thrust(exit_mach);
        let (mach, flow) = if ratio >= gas.total_over_static(1.0) {
            (gas.separation_mach(ratio, exit_mach), NozzleFlow::Separated)
        } else {
            (gas.subsonic_mach(ratio), NozzleFlow::Unchoked)
        };
        // A pipe without divergence has its onset at the throat: both are then the same thrust.
        let share = if onset_tau > 0.0 { gas.ideal_thrust(mach) / onset_tau } else { 0.0 };
        ((onset_n * share).max(0.0), flow)
    }

    /// Thrust of a nozzle that flows full (N); below zero where it cannot.
    #[inline]
    fn full_n(&self, throat: &Throat, mixture: &Mixture<'_>, chamber: ChamberPressure) -> f64 {
        let log = chamber.log;
        let velocity = STANDARD_GRAVITY_M_S2 * mixture.vacuum_isp_s(log) / mixture.c_star_m_s(log);
        self.thrust_efficiency * self.discharge_coefficient * chamber.pa * throat.area_m2 * velocity
            - throat.ambient_pa * throat.exit_area_m2
    }

    /// Least Pc/pa at which the nozzle surely flows full, for exponents within `gammas` and a throat not
    /// smaller than the initial one; spares the running flow every root.
    pub(super) fn surely_full_above(&self, gammas: (f64, f64)) -> f64 {
        let ratio = |gamma: f64| {
            let gas = PerfectGas { gamma };
            let mach = gas.supersonic_mach(self.expansion_ratio);
            gas.total_over_static(mach) / mach
        };
        let samples = (0..=32).map(|i| gammas.0 + (gammas.1 - gammas.0) * f64::from(i) / 32.0);
        // 2 %: a smooth function sampled 33 times cannot hide more.
        1.02 * samples.map(ratio).fold(1.0, f64::max)
    }
}

/// Throat, exit and surroundings of one evaluation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Throat {
    /// Throat area (m²).
    pub(super) area_m2: f64,
    /// Exit area (m²).
    pub(super) exit_area_m2: f64,
    /// Ambient pressure (Pa).
    pub(super) ambient_pa: f64,
    /// Pc/pa from which on the nozzle surely flows full; infinite when that is not known.
    pub(super) full_above: f64,
}

/// A chamber pressure with its logarithm, which costs as much as the rest of an evaluation.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChamberPressure {
    /// Pressure (Pa).
    pub(super) pa: f64,
    /// ln(P/P_ref) of the map.
    pub(super) log: f64,
}

/// Isentropic flow of a perfect gas.
#[derive(Clone, Copy, Debug)]
pub(super) struct PerfectGas {
    /// Isentropic exponent, above 1.
    pub(super) gamma: f64,
}

impl PerfectGas {
    /// p₀/p, the inverse of π(M) of the textbook.
    pub(super) fn total_over_static(&self, mach: f64) -> f64 {
        let g = self.gamma;
        libm::pow(1.0 + 0.5 * (g - 1.0) * mach * mach, g / (g - 1.0))
    }

    /// A/A* at a Mach number.
    pub(super) fn area_ratio(&self, mach: f64) -> f64 {
        let g = self.gamma;
        let stretch = 2.0 / (g + 1.0) * (1.0 + 0.5 * (g - 1.0) * mach * mach);
        libm::pow(stretch, 0.5 * (g + 1.0) / (g - 1.0)) / mach
    }

    /// Supersonic Mach number of an area ratio; 1 for a ratio of 1 or less.
    fn supersonic_mach(&self, area_ratio: f64) -> f64 {
        if area_ratio <= 1.0 {
            return 1.0;
        }
        let bracket = Bracket { low: 1.0, high: 20.0, guess: 2.4, slope: None, tolerance: 1e-13 };
        bracketed_root(bracket, |mach| self.area_ratio(mach) - area_ratio).x
    }

    /// Mach number at which the jet leaves the wall: p₀/pa = π⁻¹(M)/M, between 1 and the exit's.
    fn separation_mach(&self, total_over_ambient: f64, exit_mach: f64) -> f64 {
        let guess = 0.5 * (1.0 + exit_mach);
        let bracket = Bracket { low: 1.0, high: exit_mach, guess, slope: None, tolerance: 1e-13 };
        bracketed_root(bracket, |mach| self.total_over_static(mach) / mach - total_over_ambient).x
    }

    /// Mach number of a subsonic jet at ambient pressure.
    fn subsonic_mach(&self, total_over_ambient: f64) -> f64 {
        let g = self.gamma;
        // expm1 keeps the digits of a pressure just above ambient.
        let stretch = libm::expm1((g - 1.0) / g * libm::log(total_over_ambient));
        (2.0 / (g - 1.0) * stretch).max(0.0).sqrt()
    }

    /// Ideal thrust over ambient pressure and throat area of a jet that leaves the wall at this Mach
    /// number: τ(M) of (10S).
    fn ideal_thrust(&self, mach: f64) -> f64 {
        let m2 = mach * mach;
        if mach < 1.0 {
            self.gamma * m2
        } else {
            self.area_ratio(mach) * ((1.0 + self.gamma * m2) / mach - 1.0)
        }
    }

    /// Pc/pa of an unchoked throat whose flow would need this much if it were choked; (11S) in closed form:
    /// with K = ṁ c*/(A C_d) and B = ((γ+1)/2)^((γ+1)/(2(γ-1))), M² (1 + (γ-1)/2 M²) = (K/(pa B))².
    pub(super) fn unchoked_pressure_ratio(&self, choked_ratio: f64) -> f64 {
        let g = self.gamma;
        let b = libm::pow(0.5 * (g + 1.0), 0.5 * (g + 1.0) / (g - 1.0));
        let q2 = (choked_ratio / b) * (choked_ratio / b);
        // (sqrt(1 + 2 (γ-1) q²) - 1)/(γ-1), without cancellation.
        let m2 = 2.0 * q2 / (1.0 + (1.0 + 2.0 * (g - 1.0) * q2).sqrt());
        self.total_over_static(m2.sqrt().min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn isentropic_relations_have_their_textbook_values() {
        let air = PerfectGas { gamma: 1.4 };
        // NACA 1135: M = 2: p0/p = 7.8244, A/A* = 1.6875.
        assert!((air.total_over_static(2.0) - 7.824_45).abs() < 1e-5);
        assert!((air.area_ratio(2.0) - 1.6875).abs() < 1e-12);
        assert!((air.supersonic_mach(1.6875) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_unchoked_law_meets_the_choked_one_at_mach_one() {
        let gas = PerfectGas { gamma: 1.25 };
        let critical = gas.total_over_static(1.0);
        assert!((gas.unchoked_pressure_ratio(critical) / critical - 1.0).abs() < 1e-14);
        assert!((gas.unchoked_pressure_ratio(0.0) - 1.0).abs() < 1e-15);
        assert!((gas.ideal_thrust(1.0 - 1e-13) / gas.ideal_thrust(1.0) - 1.0).abs() < 1e-12);
    }
}
