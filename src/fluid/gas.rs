//! Nitrogen and nitrous oxide vapour over density and temperature, for gas that is a state.
//!
//! A balance of mass and energy knows how much gas is in a volume, so density and temperature are its
//! variables: bicubic tables of the compressibility Z = P/(ρ R T) and of the internal energy u. Vapour
//! denser than saturated is mist: saturated vapour and droplets at one temperature.
//!
//! Source: Span, Lemmon, Jacobsen, Wagner and Yokozeki (2000); Lemmon and Span (2006). Nitrogen 130 to 430 K
//! and to 500 kg/m³, vapour 180 to 430 K and to 300 kg/m³; outside, the edge of the table is held.
//! Energies of vapour and of the liquid of [`super::Nitrous`] count from the same state.

use std::sync::LazyLock;

use super::nitrous::Nitrous;
use crate::interpolate::{UniformCubic, UniformGrid, table::Table};

/// Gas constants of the equations of state (J/(kg K)).
const NITROGEN_J_KG_K: f64 = 296.803_895_838_717_66;
const NITROUS_J_KG_K: f64 = 188.910_316_998_691_31;
/// Densities in the tables.
const NITROGEN_DENSITIES: usize = 51;
const NITROUS_DENSITIES: usize = 41;
/// Specific heat below which no gas is taken to fall (J/(kg K)); holds beyond the edge of a table, where
/// the energy no longer rises.
const LEAST_HEAT_J_KG_K: f64 = 300.0;

/// Temperatures of the saturation table (K): short of the critical point, where slopes have no end.
const SATURATED_K: (f64, f64) = (184.0, 307.0);
const SATURATED_NODES: usize = 247;

static NITROGEN: LazyLock<RealGas> =
    LazyLock::new(|| RealGas::read(include_str!("data/n2_gas.csv"), NITROGEN_J_KG_K, NITROGEN_DENSITIES));
static VAPOR: LazyLock<NitrousVapor> = LazyLock::new(NitrousVapor::read);

/// A single-phase gas over density and temperature.
#[derive(Debug)]
pub struct RealGas {
    gas_constant_j_kg_k: f64,
    /// Z and u over temperature (slow) and density (fast).
    grid: UniformGrid<2>,
    temperatures_k: (f64, f64),
}

/// A gas at a density and temperature, with its slopes along both.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GasPoint {
    /// Pressure (Pa).
    pub pressure_pa: f64,
    /// Its slope along density (J/kg).
    pub pressure_per_density: f64,
    /// Its slope along temperature (Pa/K).
    pub pressure_per_k: f64,
    /// Specific internal energy (J/kg).
    pub energy_j_kg: f64,
    /// Its slope along density (J m³/kg²).
    pub energy_per_density: f64,
    /// Its slope along temperature (J/(kg K)).
    pub energy_per_k: f64,
    /// Specific enthalpy (J/kg).
    pub enthalpy_j_kg: f64,
}

impl RealGas {
    /// Nitrogen.
    pub fn nitrogen() -> &'static Self {
        &NITROGEN
    }

    fn read(text: &str, gas_constant_j_kg_k: f64, densities: usize) -> Self {
        let columns = ["T_K", "rho_kg_m3", "Z", "u_J_kg"];
        let table = Table::read(text, columns).expect("a committed table is whole");
        let (first, last) = (table.rows[0].1, table.rows[table.rows.len() - 1].1);
        let rows: Vec<[f64; 2]> = table.rows.iter().map(|(_, row)| [row[2], row[3]]).collect();
        let temperatures_k = (first[0], last[0]);
        let grid = UniformGrid::new(temperatures_k, (first[1], last[1]), densities, &rows);
        Self { gas_constant_j_kg_k, grid, temperatures_k }
    }

    /// Gas constant (J/(kg K)).
    pub fn gas_constant_j_kg_k(&self) -> f64 {
        self.gas_constant_j_kg_k
    }

    /// The gas at a density (kg/m³) and temperature (K).
    #[inline]
    pub fn at(&self, density_kg_m3: f64, temperature_k: f64) -> GasPoint {
        let density = density_kg_m3.max(0.0);
        let temperature = temperature_k.clamp(self.temperatures_k.0, self.temperatures_k.1);
        let sample = self.grid.at(temperature, density);
        let ([z, u], [z_t, u_t], [z_d, u_d]) = (sample.value, sample.slow_slope, sample.fast_slope);
        let rt = self.gas_constant_j_kg_k * temperature;
        GasPoint {
            pressure_pa: density * rt * z,
            pressure_per_density: rt * (z + density * z_d),
            pressure_per_k: density * self.gas_constant_j_kg_k * (z + temperature * z_t),
            energy_j_kg: u,
            energy_per_density: u_d,
            energy_per_k: u_t.max(LEAST_HEAT_J_KG_K),
            enthalpy_j_kg: u + rt * z,
        }
    }

    /// Density (kg/m³) at a pressure (Pa) and temperature (K): Newton from the ideal gas.
    pub fn density_kg_m3(&self, pressure_pa: f64, temperature_k: f64) -> f64 {
        let ideal = pressure_pa.max(0.0) / (self.gas_constant_j_kg_k * temperature_k);
        let mut density = ideal;
        for _ in 0..50 {
            let point = self.at(density, temperature_k);
            let slope = point.pressure_per_density.max(0.1 * self.gas_constant_j_kg_k * temperature_k);
            let step = (pressure_pa.max(0.0) - point.pressure_pa) / slope;
            density = (density + step).clamp(0.3 * ideal, 4.0 * ideal);
            if step.abs() <= 1e-13 * ideal {
                break;
            }
        }
        density
    }
}

/// Nitrous oxide above its liquid: vapour, mist, and the liquid's surface.
#[derive(Debug)]
pub struct NitrousVapor {
    gas: RealGas,
    /// Density of the saturated vapour, energy of evaporation at constant volume, energy of the saturated
    /// liquid, enthalpy of the saturated vapour, ln of the vapour pressure, over temperature.
    saturated: UniformCubic<5>,
}

/// The surface between liquid and vapour at one temperature.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Interface {
    /// Vapour pressure (Pa).
    pub vapor_pressure_pa: f64,
    /// Enthalpy of the saturated vapour (J/kg).
    pub vapor_enthalpy_j_kg: f64,
    /// Internal energy of the liquid (J/kg).
    pub liquid_energy_j_kg: f64,
    /// Its slope along temperature (J/(kg K)).
    pub liquid_energy_per_k: f64,
}

impl NitrousVapor {
    /// The tables, read at the first use.
    pub fn tables() -> &'static Self {
        &VAPOR
    }

    fn read() -> Self {
        let gas = RealGas::read(include_str!("data/n2o_gas.csv"), NITROUS_J_KG_K, NITROUS_DENSITIES);
        let n2o = Nitrous::tables();
        let mut saturated = UniformCubic::with_nodes(SATURATED_NODES);
        saturated.refit(SATURATED_K.0, SATURATED_K.1, |_, temperature_k| {
            let line = n2o.saturation(n2o.vapor_pressure_pa(temperature_k));
            let (rho_l, rho_v) = (line.liquid_density_kg_m3, line.vapor_density_kg_m3);
            let work = line.pressure_pa * (1.0 / rho_v - 1.0 / rho_l);
            let evaporation = line.vapor_enthalpy_j_kg - line.liquid_enthalpy_j_kg - work;
            let liquid = line.liquid_enthalpy_j_kg - line.pressure_pa / rho_l;
            [rho_v, evaporation, liquid, line.vapor_enthalpy_j_kg, libm::log(line.pressure_pa)]
        });
        Self { gas, saturated }
    }

    /// Gas constant (J/(kg K)).
    pub fn gas_constant_j_kg_k(&self) -> f64 {
        self.gas.gas_constant_j_kg_k
    }

    /// Density of the saturated vapour (kg/m³).
    pub(crate) fn saturated_density_kg_m3(&self, temperature_k: f64) -> f64 {
        self.saturated.at(temperature_k)[0]
    }

    /// The surface of a liquid at a temperature (K).
    pub fn interface(&self, temperature_k: f64) -> Interface {
        let (value, slope) = self.saturated.with_slope(temperature_k);
        Interface {
            vapor_pressure_pa: libm::exp(value[4]),
            vapor_enthalpy_j_kg: value[3],
            liquid_energy_j_kg: value[2],
            liquid_energy_per_k: slope[2].max(LEAST_HEAT_J_KG_K),
        }
    }

    /// Vapour or mist at a density (kg/m³) and temperature (K).
    pub fn at(&self, density_kg_m3: f64, temperature_k: f64) -> GasPoint {
        if temperature_k >= SATURATED_K.1 {
            return self.gas.at(density_kg_m3, temperature_k);
        }
        let (line, line_per_k) = self.saturated.with_slope(temperature_k);
        let [saturated, evaporation, ..] = line;
        let [saturated_per_k, evaporation_per_k, ..] = line_per_k;
        if density_kg_m3 <= saturated {
            return self.gas.at(density_kg_m3, temperature_k);
        }
        // Droplets take no room: what is denser than saturated vapour has given its energy of evaporation.
        let vapor = self.gas.at(saturated, temperature_k);
        let share = saturated / density_kg_m3;
        let along_line = |per_k: f64, per_density: f64| per_k + per_density * saturated_per_k;
        let energy_j_kg = vapor.energy_j_kg - (1.0 - share) * evaporation;
        let energy_per_k = along_line(vapor.energy_per_k, vapor.energy_per_density)
            - (1.0 - share) * evaporation_per_k
            + saturated_per_k * evaporation / density_kg_m3;
        GasPoint {
            pressure_pa: vapor.pressure_pa,
            pressure_per_density: 0.0,
            pressure_per_k: along_line(vapor.pressure_per_k, vapor.pressure_per_density),
            energy_j_kg,
            energy_per_density: -share * evaporation / density_kg_m3,
            energy_per_k: energy_per_k.max(LEAST_HEAT_J_KG_K),
            enthalpy_j_kg: energy_j_kg + vapor.pressure_pa / density_kg_m3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::nitrogen::Nitrogen;
    use super::*;

    /// The table over pressure and the table over density come from one equation of state.
    #[test]
    fn both_tables_of_nitrogen_agree() {
        let (by_pressure, by_density) = (Nitrogen::tables(), RealGas::nitrogen());
        let mut worst = (0.0f64, 0.0f64);
        for temperature_k in [202.5, 226.0, 263.0, 290.0, 331.0] {
            for bar in [1.0, 17.0, 65.0, 121.0, 233.0, 299.0] {
                let density = by_pressure.density_kg_m3(bar * 1e5, temperature_k);
                let point = by_density.at(density, temperature_k);
                worst.0 = worst.0.max((point.pressure_pa / (bar * 1e5) - 1.0).abs());
                let energy = by_pressure.internal_energy_j_kg(bar * 1e5, temperature_k);
                worst.1 = worst.1.max((point.energy_j_kg - energy).abs());
                let back = by_density.density_kg_m3(bar * 1e5, temperature_k);
                assert!((back / density - 1.0).abs() < 3e-6, "{temperature_k} K {bar} bar: {back}");
            }
        }
        // Two bicubic tables, each 1e-6 of Z from its equation at the cold end.
        assert!(worst.0 < 3e-6 && worst.1 < 1.0, "{worst:?}");
    }

    #[test]
    fn vapour_ends_on_the_saturation_line_of_the_liquid() {
        let (vapor, n2o) = (NitrousVapor::tables(), Nitrous::tables());
        for temperature_k in [200.0, 231.0, 262.0, 290.0, 302.0] {
            let density = vapor.saturated_density_kg_m3(temperature_k);
            let point = vapor.at(density, temperature_k);
            let interface = vapor.interface(temperature_k);
            let boiling_pa = n2o.vapor_pressure_pa(temperature_k);
            assert!((point.pressure_pa / boiling_pa - 1.0).abs() < 2e-4, "{temperature_k}: {point:?}");
            assert!((interface.vapor_pressure_pa / boiling_pa - 1.0).abs() < 1e-9);
            assert!((point.enthalpy_j_kg - interface.vapor_enthalpy_j_kg).abs() < 60.0, "{temperature_k}");
            // Mist begins without a step.
            let mist = vapor.at(density * (1.0 + 1e-9), temperature_k);
            assert!((mist.energy_j_kg - point.energy_j_kg).abs() < 1e-2);
            assert!((mist.pressure_pa - point.pressure_pa).abs() < 1.0);
        }
    }

    #[test]
    fn slopes_are_those_of_the_values() {
        let (nitrogen, vapor) = (RealGas::nitrogen(), NitrousVapor::tables());
        let check = |at: &dyn Fn(f64, f64) -> GasPoint, density: f64, temperature: f64| {
            let (d, t) = (1e-4, 1e-4);
            let point = at(density, temperature);
            let along_d = (at(density + d, temperature), at(density - d, temperature));
            let along_t = (at(density, temperature + t), at(density, temperature - t));
            let close = |slope: f64, difference: f64, scale: f64| {
                assert!((slope - difference).abs() < 1e-5 * scale, "{slope} {difference}");
            };
            let p = point.pressure_pa;
            close(
                point.pressure_per_density,
                (along_d.0.pressure_pa - along_d.1.pressure_pa) / (2.0 * d),
                1e5,
            );
            close(
                point.pressure_per_k,
                (along_t.0.pressure_pa - along_t.1.pressure_pa) / (2.0 * t),
                p / 100.0,
            );
            close(point.energy_per_density, (along_d.0.energy_j_kg - along_d.1.energy_j_kg) / (2.0 * d), 1e3);
            close(point.energy_per_k, (along_t.0.energy_j_kg - along_t.1.energy_j_kg) / (2.0 * t), 1e3);
        };
        check(&|d, t| nitrogen.at(d, t), 203.0, 241.0);
        check(&|d, t| vapor.at(d, t), 61.0, 288.0);
        check(&|d, t| vapor.at(d, t), 190.0, 277.0); // mist
    }

    #[test]
    fn nothing_is_not_finite() {
        for density in [0.0, 1e-9, 40.0, 700.0, 1e6] {
            for temperature in [0.0, 129.0, 184.0, 306.999, 307.0, 5000.0] {
                for point in [
                    RealGas::nitrogen().at(density, temperature),
                    NitrousVapor::tables().at(density, temperature),
                ] {
                    let all = [
                        point.pressure_pa,
                        point.pressure_per_density,
                        point.pressure_per_k,
                        point.energy_j_kg,
                        point.energy_per_density,
                        point.energy_per_k,
                        point.enthalpy_j_kg,
                    ];
                    assert!(all.iter().all(|x| x.is_finite()), "{density} {temperature}: {point:?}");
                }
            }
        }
    }
}
