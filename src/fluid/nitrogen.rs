//! Nitrogen as a real gas, 0 to 360 bar and 160 to 340 K.
//!
//! Source: Span, Lemmon, Jacobsen, Wagner and Yokozeki (2000), through a bicubic table of the
//! compressibility factor Z, the enthalpy, and s + R ln(P/P₀), which is finite at zero pressure.
//! Outside its range the table holds its edge: Z tends to the ideal gas downward and stays bounded upward.

use std::sync::LazyLock;

use crate::interpolate::{Bracket, UniformCubic, UniformGrid, bracketed_root, table::Table};

/// Gas constant of nitrogen (J/(kg K)), of the equation of state.
const GAS_CONSTANT: f64 = 296.803_895_838_717_66;
/// Pressure at which the tabulated entropy is the entropy (Pa).
const NORMAL_PA: f64 = 101_325.0;
/// Pressures in the table.
const PRESSURES: usize = 73;
/// Least pressure that a state has here (Pa); keeps logarithms and quotients finite.
const LEAST_PA: f64 = 1.0;

static TABLES: LazyLock<Nitrogen> = LazyLock::new(Nitrogen::read);

/// Real-gas nitrogen.
#[derive(Debug)]
pub struct Nitrogen {
    /// Z, h, s + R ln(P/P₀) over temperature (slow) and pressure (fast).
    grid: UniformGrid<3>,
}

impl Nitrogen {
    /// The tables, read at the first use.
    pub fn tables() -> &'static Self {
        &TABLES
    }

    fn read() -> Self {
        let columns = ["T_K", "P_Pa", "Z", "h_J_kg", "s_plus_R_lnP_J_kgK"];
        let table = Table::read(include_str!("data/n2.csv"), columns).expect("a committed table is whole");
        let (first, last) = (table.rows[0].1, table.rows[table.rows.len() - 1].1);
        let rows: Vec<[f64; 3]> = table.rows.iter().map(|(_, r)| [r[2], r[3], r[4]]).collect();
        Self { grid: UniformGrid::new((first[0], last[0]), (first[1], last[1]), PRESSURES, &rows) }
    }

    /// Density (kg/m³).
    pub fn density_kg_m3(&self, pressure_pa: f64, temperature_k: f64) -> f64 {
        let [z, ..] = self.grid.at(temperature_k, pressure_pa).value;
        pressure_pa / (z * GAS_CONSTANT * temperature_k)
    }

    /// Pressure (Pa) of a density: the inverse of [`Self::density_kg_m3`], zero for none.
    pub fn pressure_pa(&self, density_kg_m3: f64, temperature_k: f64) -> f64 {
        let ideal_pa = density_kg_m3 * GAS_CONSTANT * temperature_k;
        if ideal_pa <= 0.0 || ideal_pa.is_nan() {
            return 0.0;
        }
        // P = ideal Z(P); dZ/dP ideal < 1 wherever compression raises density, so Newton is safe.
        let mut pressure_pa = ideal_pa;
        for _ in 0..20 {
            let sample = self.grid.at(temperature_k, pressure_pa);
            let residual_pa = pressure_pa - ideal_pa * sample.value[0];
            let step_pa = residual_pa / (1.0 - ideal_pa * sample.fast_slope[0]).max(0.1);
            pressure_pa = (pressure_pa - step_pa).clamp(0.3 * ideal_pa, 3.0 * ideal_pa);
            if step_pa.abs() <= 1e-12 * ideal_pa {
                return pressure_pa;
            }
        }
        let bracket = Bracket {
            low: 0.0,
            high: 3.0 * ideal_pa,
            guess: pressure_pa,
            slope: None,
            tolerance: 1e-12 * ideal_pa,
        };
        bracketed_root(bracket, |p| p - ideal_pa * self.grid.at(temperature_k, p).value[0]).x
    }

    /// Specific enthalpy (J/kg).
    pub fn enthalpy_j_kg(&self, pressure_pa: f64, temperature_k: f64) -> f64 {
        self.grid.at(temperature_k, pressure_pa).value[1]
    }

    /// Specific internal energy (J/kg).
    pub fn internal_energy_j_kg(&self, pressure_pa: f64, temperature_k: f64) -> f64 {
        let [z, h, _] = self.grid.at(temperature_k, pressure_pa).value;
        h - z * GAS_CONSTANT * temperature_k
    }

    /// Specific entropy (J/(kg K)).
    pub fn entropy_j_kg_k(&self, pressure_pa: f64, temperature_k: f64) -> f64 {
        let [_, _, s] = self.grid.at(temperature_k, pressure_pa).value;
        s - GAS_CONSTANT * libm::log(pressure_pa.max(LEAST_PA) / NORMAL_PA)
    }
}

/// Nitrogen at one temperature: density against pressure and back, a look-up each.
///
/// Both tables hold the compressibility Z = P/(ρ R T), smooth and near 1; against [`Nitrogen`] they agree
/// to 1e-9.
#[derive(Clone, Debug)]
pub struct Isotherm {
    /// R T (J/kg).
    rt: f64,
    of_pressure: UniformCubic<1>,
    of_density: UniformCubic<1>,
}

/// Nodes of an isotherm, 1.2 bar apart.
const ISOTHERM_NODES: usize = 289;

impl Isotherm {
    /// Tabulates the whole pressure range of the tables.
    pub fn new(temperature_k: f64) -> Self {
        let n2 = Nitrogen::tables();
        let rt = GAS_CONSTANT * temperature_k;
        let (_, most_pa) = n2.grid.fast_span();
        let most_kg_m3 = n2.density_kg_m3(most_pa, temperature_k);
        let last = (ISOTHERM_NODES - 1) as f64;
        let mut of_pressure = UniformCubic::with_nodes(ISOTHERM_NODES);
        of_pressure
            .refit(0.0, most_pa, |i, _| [n2.grid.at(temperature_k, most_pa * i as f64 / last).value[0]]);
        let mut of_density = UniformCubic::with_nodes(ISOTHERM_NODES);
        of_density.refit(0.0, most_kg_m3, |i, _| {
            let density = most_kg_m3 * i as f64 / last;
            if i == 0 { [1.0] } else { [n2.pressure_pa(density, temperature_k) / (density * rt)] }
        });
        Self { rt, of_pressure, of_density }
    }

    /// Density (kg/m³).
    #[inline]
    pub fn density_kg_m3(&self, pressure_pa: f64) -> f64 {
        pressure_pa / (self.of_pressure.at(pressure_pa)[0] * self.rt)
    }

    /// Pressure (Pa).
    #[inline]
    pub fn pressure_pa(&self, density_kg_m3: f64) -> f64 {
        density_kg_m3 * self.rt * self.of_density.at(density_kg_m3)[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_isotherm_is_the_table_it_was_made_of() {
        let n2 = Nitrogen::tables();
        for t in [220.0, 290.0, 315.0] {
            let isotherm = Isotherm::new(t);
            for i in 1..=349 {
                let p = 1e5 * f64::from(i);
                let rho = n2.density_kg_m3(p, t);
                // Cubic interpolation of a function that bends by 1e-4 over a node.
                assert!((isotherm.density_kg_m3(p) / rho - 1.0).abs() < 1e-8, "{t} {p}");
                assert!((isotherm.pressure_pa(rho) / p - 1.0).abs() < 1e-7, "{t} {p}");
            }
        }
    }

    #[test]
    fn the_run_tank_gas_has_the_density_of_the_vehicle_file() {
        // Node of the table, so only its 12 printed digits count.
        let density = Nitrogen::tables().density_kg_m3(65e5, 290.0);
        assert!((density - 76.049_069_4).abs() < 1e-7, "{density}");
    }

    #[test]
    fn pressure_inverts_density_and_vacuum_is_vacuum() {
        let n2 = Nitrogen::tables();
        for (p, t) in [(1e5, 290.0), (65e5, 283.3), (177.7e5, 290.0), (355e5, 170.0), (10.0, 200.0)] {
            let back = n2.pressure_pa(n2.density_kg_m3(p, t), t);
            assert!((back / p - 1.0).abs() < 1e-10, "{p} {t} {back}");
        }
        assert_eq!(n2.pressure_pa(0.0, 290.0), 0.0);
    }
}
