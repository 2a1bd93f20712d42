//! Nitrous oxide: saturation line, compressed liquid, isentropes.
//!
//! Source: Lemmon and Span (2006), short Helmholtz equation of state, through cubic tables that stand on
//! variables in which the properties are smooth up to the critical point. Valid from 0.88 bar (just above
//! the triple point) to 72.2 bar on the saturation line, 183 to 307.5 K and up to 85 bar in the liquid;
//! beyond, the edge of the table is held. Enthalpy and entropy are zero at saturated liquid at the normal
//! boiling point: only differences have a meaning.

use std::sync::LazyLock;

use crate::interpolate::{Bracket, UniformCubic, UniformGrid, bracketed_root, table::Table};

/// Critical pressure of the equation of state (Pa).
const CRITICAL_PA: f64 = 7_244_816.701_607_16;
/// Critical temperature of the equation of state (K).
const CRITICAL_K: f64 = 309.520_678_231_462_85;
/// Greatest pressure of the liquid table (Pa).
const TOP_PA: f64 = 85e5;
/// Pressures in the liquid table.
const LIQUID_PRESSURES: usize = 13;

static TABLES: LazyLock<Nitrous> = LazyLock::new(Nitrous::read);

/// Properties of nitrous oxide.
#[derive(Debug)]
pub struct Nitrous {
    /// T, hL, hV, rhoL, rhoV, sL, sV over x = sqrt(ln(P_critical/P)).
    saturation: UniformCubic<7>,
    /// ln Psat over theta = sqrt(1 - T/T_critical).
    log_vapor_pressure: UniformCubic<1>,
    /// rho, h, s over theta (slow) and xi = (P - Psat)/(TOP - Psat) (fast).
    liquid: UniformGrid<3>,
}

/// Both phases on the saturation line.
#[derive(Clone, Copy, Debug)]
pub struct Saturation {
    /// Pressure.
    pub pressure_pa: f64,
    /// Temperature.
    pub temperature_k: f64,
    /// Specific enthalpy of the liquid.
    pub liquid_enthalpy_j_kg: f64,
    /// Specific enthalpy of the vapour.
    pub vapor_enthalpy_j_kg: f64,
    /// Density of the liquid.
    pub liquid_density_kg_m3: f64,
    /// Density of the vapour.
    pub vapor_density_kg_m3: f64,
    /// Specific entropy of the liquid.
    pub liquid_entropy_j_kg_k: f64,
    /// Specific entropy of the vapour.
    pub vapor_entropy_j_kg_k: f64,
}

impl Saturation {
    /// Vapour mass fraction of a mixture of this enthalpy, 0..1.
    pub fn quality_of_enthalpy(&self, enthalpy_j_kg: f64) -> f64 {
        let span = self.vapor_enthalpy_j_kg - self.liquid_enthalpy_j_kg;
        ((enthalpy_j_kg - self.liquid_enthalpy_j_kg) / span).clamp(0.0, 1.0)
    }

    /// Vapour mass fraction of a mixture of this entropy, 0..1.
    fn quality_of_entropy(&self, entropy_j_kg_k: f64) -> f64 {
        let span = self.vapor_entropy_j_kg_k - self.liquid_entropy_j_kg_k;
        ((entropy_j_kg_k - self.liquid_entropy_j_kg_k) / span).clamp(0.0, 1.0)
    }

    /// Density of the homogeneous mixture (kg/m³).
    pub fn density_kg_m3(&self, quality: f64) -> f64 {
        1.0 / ((1.0 - quality) / self.liquid_density_kg_m3 + quality / self.vapor_density_kg_m3)
    }

    /// Specific entropy of the mixture (J/(kg K)).
    pub fn entropy_j_kg_k(&self, quality: f64) -> f64 {
        self.liquid_entropy_j_kg_k + quality * (self.vapor_entropy_j_kg_k - self.liquid_entropy_j_kg_k)
    }

    /// Specific enthalpy of the mixture (J/kg).
    pub fn enthalpy_j_kg(&self, quality: f64) -> f64 {
        self.liquid_enthalpy_j_kg + quality * (self.vapor_enthalpy_j_kg - self.liquid_enthalpy_j_kg)
    }
}

/// A state of the liquid.
#[derive(Clone, Copy, Debug)]
pub struct Liquid {
    /// Temperature.
    pub temperature_k: f64,
    /// Density.
    pub density_kg_m3: f64,
    /// Specific enthalpy.
    pub enthalpy_j_kg: f64,
    /// Specific entropy.
    pub entropy_j_kg_k: f64,
}

/// State at rest upstream of an orifice, from which an isentrope starts.
#[derive(Clone, Copy, Debug)]
pub struct Stagnation {
    /// Pressure.
    pub pressure_pa: f64,
    /// Pressure at which this temperature boils; the pressure itself when it is two-phase.
    pub vapor_pressure_pa: f64,
    /// Density.
    pub density_kg_m3: f64,
    /// Specific enthalpy.
    pub enthalpy_j_kg: f64,
    /// Specific entropy.
    pub entropy_j_kg_k: f64,
}

/// Choked flow: the greatest homogeneous-equilibrium flux along an isentrope.
#[derive(Clone, Copy, Debug)]
pub struct CriticalFlow {
    /// Pressure at which it occurs.
    pub pressure_pa: f64,
    /// Mass flux per unit area.
    pub flux_kg_m2_s: f64,
    /// Pressure at which the isentrope meets the saturation line; the stagnation pressure if it starts
    /// inside.
    pub saturation_pa: f64,
    /// Mach number at the saturation line with the sound speed just inside it, squared; from 1 on the
    /// flux peaks at the line itself. Zero when the isentrope starts inside.
    pub onset_mach2: f64,
}

impl Nitrous {
    /// Least pressure of the saturation table (Pa).
    pub(crate) const LEAST_PA: f64 = 0.88e5;

    /// The tables, read at the first use.
    pub fn tables() -> &'static Self {
        &TABLES
    }

    fn read() -> Self {
        const WHOLE: &str = "a committed table is whole";
        let columns = ["x", "T_K", "hL_J_kg", "hV_J_kg", "rhoL_kg_m3", "rhoV_kg_m3", "sL_J_kgK", "sV_J_kgK"];
        let line = Table::read(include_str!("data/n2o_saturation.csv"), columns).expect(WHOLE);
        let (first, last) = (line.rows[0].1[0], line.rows[line.rows.len() - 1].1[0]);
        let rows: Vec<[f64; 7]> = line.rows.iter().map(|(_, r)| std::array::from_fn(|k| r[k + 1])).collect();
        let saturation = UniformCubic::new(first, (last - first) / (rows.len() - 1) as f64, &rows);

        let columns = ["theta", "xi", "P_Pa", "rho_kg_m3", "h_J_kg", "s_J_kgK"];
        let grid = Table::read(include_str!("data/n2o_liquid.csv"), columns).expect(WHOLE);
        let thetas = (grid.rows[0].1[0], grid.rows[grid.rows.len() - 1].1[0]);
        let rows: Vec<[f64; 3]> = grid.rows.iter().map(|(_, r)| [r[3], r[4], r[5]]).collect();
        let logs: Vec<[f64; 1]> =
            grid.rows.iter().step_by(LIQUID_PRESSURES).map(|(_, r)| [libm::log(r[2])]).collect();
        Self {
            saturation,
            log_vapor_pressure: UniformCubic::new(
                thetas.0,
                (thetas.1 - thetas.0) / (logs.len() - 1) as f64,
                &logs,
            ),
            liquid: UniformGrid::new(thetas, (0.0, 1.0), LIQUID_PRESSURES, &rows),
        }
    }

    /// Both phases at a pressure.
    #[inline]
    pub fn saturation(&self, pressure_pa: f64) -> Saturation {
        let [t, h_l, h_v, rho_l, rho_v, s_l, s_v] = self.saturation.at(saturation_abscissa(pressure_pa));
        Saturation {
            pressure_pa,
            temperature_k: t,
            liquid_enthalpy_j_kg: h_l,
            vapor_enthalpy_j_kg: h_v,
            liquid_density_kg_m3: rho_l,
            vapor_density_kg_m3: rho_v,
            liquid_entropy_j_kg_k: s_l,
            vapor_entropy_j_kg_k: s_v,
        }
    }

    /// Vapour pressure (Pa) at a temperature.
    pub fn vapor_pressure_pa(&self, temperature_k: f64) -> f64 {
        libm::exp(self.log_vapor_pressure.at(theta(temperature_k))[0])
    }

    /// Liquid at a pressure and temperature; below the vapour pressure, the saturated liquid.
    pub fn liquid(&self, pressure_pa: f64, temperature_k: f64) -> Liquid {
        let boiling_pa = self.vapor_pressure_pa(temperature_k);
        let xi = (pressure_pa - boiling_pa) / (TOP_PA - boiling_pa);
        let [rho, h, s] = self.liquid.at(theta(temperature_k), xi).value;
        Liquid { temperature_k, density_kg_m3: rho, enthalpy_j_kg: h, entropy_j_kg_k: s }
    }

    /// Liquid at a pressure and enthalpy.
    pub(crate) fn liquid_of_enthalpy(&self, pressure_pa: f64, enthalpy_j_kg: f64) -> Liquid {
        // dh/dT is near 2 kJ/(kg K) well below the critical point.
        self.liquid_where(pressure_pa, 2e3, |liquid| liquid.enthalpy_j_kg - enthalpy_j_kg)
    }

    /// Liquid at a pressure and entropy.
    fn liquid_of_entropy(&self, pressure_pa: f64, entropy_j_kg_k: f64) -> Liquid {
        self.liquid_where(pressure_pa, 7.0, |liquid| liquid.entropy_j_kg_k - entropy_j_kg_k)
    }

    /// Liquid at a pressure where an excess that rises with temperature vanishes.
    fn liquid_where(&self, pressure_pa: f64, slope: f64, excess: impl Fn(&Liquid) -> f64) -> Liquid {
        let low = 183.0;
        let high = self.saturation(pressure_pa).temperature_k.min(307.5).max(low);
        let end = self.liquid(pressure_pa, high);
        if excess(&end) <= 0.0 {
            return end;
        }
        let guess = high - excess(&end) / slope;
        let bracket = Bracket { low, high, guess, slope: Some(slope), tolerance: 1e-9 };
        let root = bracketed_root(bracket, |t| excess(&self.liquid(pressure_pa, t)));
        self.liquid(pressure_pa, root.x)
    }

    /// Pressure (Pa) at which an isenthalp of the liquid meets the saturation line.
    pub(crate) fn flash_pressure_pa(&self, enthalpy_j_kg: f64) -> f64 {
        self.bubble_pressure_pa(|line| line.liquid_enthalpy_j_kg - enthalpy_j_kg)
    }

    /// Pressure (Pa) at which an isentrope of the liquid meets the saturation line.
    fn isentropic_flash_pressure_pa(&self, entropy_j_kg_k: f64) -> f64 {
        self.bubble_pressure_pa(|line| line.liquid_entropy_j_kg_k - entropy_j_kg_k)
    }

    /// Pressure on the saturation line where an excess that rises with pressure vanishes.
    fn bubble_pressure_pa(&self, excess: impl Fn(&Saturation) -> f64) -> f64 {
        let log = |pa: f64| libm::log(pa);
        let bracket = Bracket {
            low: log(Self::LEAST_PA),
            high: log(CRITICAL_PA * 0.9975),
            guess: log(40e5),
            slope: None,
            tolerance: 1e-13,
        };
        libm::exp(bracketed_root(bracket, |p| excess(&self.saturation(libm::exp(p)))).x)
    }

    /// Homogeneous-equilibrium mass flux (kg/(m² s)) from rest to a pressure along the isentrope.
    pub fn equilibrium_flux_kg_m2_s(&self, from: &Stagnation, to_pa: f64) -> f64 {
        let (density, drop_j_kg) = self.expanded(from, to_pa);
        density * (2.0 * drop_j_kg.max(0.0)).sqrt()
    }

    /// Density (kg/m³) and drop of enthalpy (J/kg) after an isentropic expansion.
    pub(crate) fn expanded(&self, from: &Stagnation, to_pa: f64) -> (f64, f64) {
        let line = self.saturation(to_pa);
        if from.entropy_j_kg_k > line.liquid_entropy_j_kg_k {
            let quality = line.quality_of_entropy(from.entropy_j_kg_k);
            (line.density_kg_m3(quality), from.enthalpy_j_kg - line.enthalpy_j_kg(quality))
        } else {
            let liquid = self.liquid_of_entropy(to_pa, from.entropy_j_kg_k);
            (liquid.density_kg_m3, from.enthalpy_j_kg - liquid.enthalpy_j_kg)
        }
    }

    /// Greatest flux along the isentrope. `guess_pa` is where to look first.
    ///
    /// The flux rises as the pressure falls while the velocity is below the sound speed,
    /// 2 Δh (dρ/dP)_s < 1. A liquid that reaches the saturation line faster than the much lower
    /// two-phase sound speed peaks there, at the kink.
    pub fn critical(&self, from: &Stagnation, guess_pa: f64) -> CriticalFlow {
        let boils_at_rest = from.vapor_pressure_pa >= from.pressure_pa;
        let saturation_pa = if boils_at_rest {
            from.pressure_pa
        } else {
            self.isentropic_flash_pressure_pa(from.entropy_j_kg_k).min(from.pressure_pa)
        };
        let mach2 = |pa: f64| {
            let (_, drop_j_kg, density_slope) = self.two_phase_expansion(from, pa);
            2.0 * drop_j_kg * density_slope
        };
        let onset_mach2 = if boils_at_rest { 0.0 } else { mach2(saturation_pa) };
        let pressure_pa = if onset_mach2 >= 1.0 {
            saturation_pa
        } else {
            let bracket = Bracket {
                low: Self::LEAST_PA.min(saturation_pa),
                high: saturation_pa,
                guess: guess_pa,
                slope: None,
                tolerance: 1e-9 * saturation_pa,
            };
            bracketed_root(bracket, |pa| 1.0 - mach2(pa)).x
        };
        let (density, drop_j_kg, _) = self.two_phase_expansion(from, pressure_pa);
        CriticalFlow {
            pressure_pa,
            flux_kg_m2_s: density * (2.0 * drop_j_kg.max(0.0)).sqrt(),
            saturation_pa,
            onset_mach2,
        }
    }

    /// Density (kg/m³), drop of enthalpy (J/kg) and isentropic slope of density (kg/(m³ Pa)) of the
    /// two-phase mixture on an isentrope.
    fn two_phase_expansion(&self, from: &Stagnation, to_pa: f64) -> (f64, f64, f64) {
        let x = saturation_abscissa(to_pa);
        let ([_, h_l, h_v, rho_l, rho_v, s_l, s_v], [_, _, _, drho_l, drho_v, ds_l, ds_v]) =
            self.saturation.with_slope(x);
        let quality = ((from.entropy_j_kg_k - s_l) / (s_v - s_l)).clamp(0.0, 1.0);
        let (v_l, v_v) = (1.0 / rho_l, 1.0 / rho_v);
        let density = 1.0 / (v_l + quality * (v_v - v_l));
        let dquality = -(ds_l + quality * (ds_v - ds_l)) / (s_v - s_l);
        let (dv_l, dv_v) = (-drho_l * v_l * v_l, -drho_v * v_v * v_v);
        let dv = dv_l + quality * (dv_v - dv_l) + dquality * (v_v - v_l);
        // dP/dx = -2 x P.
        let density_slope = -density * density * dv / (-2.0 * x * to_pa);
        (density, from.enthalpy_j_kg - (h_l + quality * (h_v - h_l)), density_slope)
    }
}

/// Abscissa of the saturation table.
#[inline]
fn saturation_abscissa(pressure_pa: f64) -> f64 {
    let log = libm::log(CRITICAL_PA / pressure_pa.max(1.0));
    log.max(0.0).sqrt()
}

/// Abscissa of the liquid table.
fn theta(temperature_k: f64) -> f64 {
    (1.0 - temperature_k / CRITICAL_K).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tank_state_is_that_of_the_vehicle_file() {
        let n2o = Nitrous::tables();
        for (t, density, flash_bar) in
            [(290.0, 834.318_138_7, 45.43), (288.0, 847.88, 43.39), (293.0, 812.17, 48.68)]
        {
            let liquid = n2o.liquid(65e5, t);
            // The last printed digit; the first density is printed to ten.
            let tolerance = if t == 290.0 { 1e-5 } else { 0.006 };
            assert!((liquid.density_kg_m3 - density).abs() < tolerance, "{}", liquid.density_kg_m3);
            let flash = n2o.flash_pressure_pa(liquid.enthalpy_j_kg);
            assert!((flash * 1e-5 - flash_bar).abs() < 0.006, "{flash}");
        }
        assert!((n2o.vapor_pressure_pa(290.0) * 1e-5 - 47.01).abs() < 0.006);
    }

    #[test]
    fn the_liquid_table_ends_on_the_saturation_line() {
        let n2o = Nitrous::tables();
        for t in [190.0, 230.0, 270.0, 290.0, 303.3] {
            let line = n2o.saturation(n2o.vapor_pressure_pa(t));
            let liquid = n2o.liquid(line.pressure_pa, t);
            // ln Psat on its own nodes: 4e-8 of the pressure at the cold end, dT/dlnP near 17 K.
            assert!((line.temperature_k - t).abs() < 5e-6, "{} {t}", line.temperature_k);
            assert!((liquid.density_kg_m3 / line.liquid_density_kg_m3 - 1.0).abs() < 1e-7);
            assert!((liquid.enthalpy_j_kg - line.liquid_enthalpy_j_kg).abs() < 0.05);
        }
    }

    #[test]
    fn enthalpy_and_entropy_of_the_liquid_invert() {
        let n2o = Nitrous::tables();
        let a = n2o.liquid(60e5, 285.0);
        assert!((n2o.liquid_of_enthalpy(60e5, a.enthalpy_j_kg).temperature_k - 285.0).abs() < 1e-8);
        assert!((n2o.liquid_of_entropy(60e5, a.entropy_j_kg_k).temperature_k - 285.0).abs() < 1e-8);
    }
}
