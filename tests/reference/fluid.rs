//! Fluid tables against the equations of state they were made from, at points between the grid lines.
//!
//! `tests/reference/fluid_points.csv` is written by `tools/reference/make_fluid_tables.py` (CoolProp; version
//! and command in its heading).

use hopbench::fluid::{Nitrogen, Nitrous};

const POINTS: &str = include_str!("fluid_points.csv");

fn points(kind: &str) -> Vec<Vec<f64>> {
    let rows = POINTS.lines().filter(|line| line.split(',').next() == Some(kind));
    rows.map(|line| line.split(',').skip(1).filter(|f| !f.is_empty()).map(|f| f.parse().unwrap()).collect())
        .collect()
}

/// Greatest deviation of any point, in units of `scale`.
struct Worst(f64, String);

impl Worst {
    fn new() -> Self {
        Self(0.0, String::new())
    }

    fn see(&mut self, got: f64, expected: f64, scale: f64, row: &[f64]) {
        let error = (got - expected).abs() / scale;
        if error > self.0 || error.is_nan() {
            *self = Self(error, format!("{got} for {expected} at {row:?}"));
        }
    }

    fn stays_below(&self, limit: f64, what: &str) {
        assert!(self.0 < limit, "{what}: {} ({})", self.0, self.1);
    }
}

#[test]
fn saturation_line_of_nitrous_oxide() {
    let (mut energy, mut density) = (Worst::new(), Worst::new());
    let rows = points("saturation");
    assert_eq!(rows.len(), 59);
    for row in &rows {
        let line = Nitrous::tables().saturation(row[0]);
        // Energies in units of the latent heat at 290 K, about 170 kJ/kg, and that over 290 K.
        energy.see(line.temperature_k, row[1], 290.0, row);
        energy.see(line.liquid_enthalpy_j_kg, row[2], 170e3, row);
        energy.see(line.vapor_enthalpy_j_kg, row[3], 170e3, row);
        energy.see(line.liquid_entropy_j_kg_k, row[6], 590.0, row);
        energy.see(line.vapor_entropy_j_kg_k, row[7], 590.0, row);
        density.see(line.liquid_density_kg_m3, row[4], row[4], row);
        density.see(line.vapor_density_kg_m3, row[5], row[5], row);
    }
    // Spacing 1/128 of x: h⁴/384 is 1e-11, times fourth derivatives of up to some tens.
    energy.stays_below(1e-8, "saturation, energies");
    density.stays_below(1e-8, "saturation, densities");
}

#[test]
fn compressed_liquid_nitrous_oxide() {
    let (mut energy, mut density) = (Worst::new(), Worst::new());
    let rows = points("liquid");
    assert_eq!(rows.len(), 59);
    for row in &rows {
        let liquid = Nitrous::tables().liquid(row[0], row[1]);
        density.see(liquid.density_kg_m3, row[2], row[2], row);
        energy.see(liquid.enthalpy_j_kg, row[3], 170e3, row);
        energy.see(liquid.entropy_j_kg_k, row[4], 590.0, row);
    }
    // Twelve pressures up to 85 bar: near the critical point the compressibility varies fast, 1e-5 there.
    density.stays_below(2e-5, "liquid, density");
    energy.stays_below(2e-5, "liquid, energies");
}

#[test]
fn real_gas_nitrogen() {
    let (mut energy, mut density) = (Worst::new(), Worst::new());
    let rows = points("nitrogen");
    assert_eq!(rows.len(), 59);
    for row in &rows {
        let (n2, p, t) = (Nitrogen::tables(), row[0], row[1]);
        density.see(n2.density_kg_m3(p, t), row[2], row[2], row);
        density.see(n2.pressure_pa(row[2], t), p, p, row);
        // In units of R T and R at 290 K.
        energy.see(n2.enthalpy_j_kg(p, t), row[3], 86e3, row);
        energy.see(n2.entropy_j_kg_k(p, t), row[4], 297.0, row);
        energy.see(n2.internal_energy_j_kg(p, t), row[5], 86e3, row);
    }
    // 5 bar and 5 K: 1e-5 at the cold end, where Z turns within 50 bar.
    density.stays_below(1e-5, "nitrogen, density");
    energy.stays_below(1e-5, "nitrogen, energies");
}
