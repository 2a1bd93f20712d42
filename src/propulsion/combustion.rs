//! Combustion products against O/F and chamber pressure.
//!
//! `Y(OF, Pc) = Y₂₀(OF) + k_Y(OF) ln(Pc/P_ref)`, both interpolated in O/F by a shape-preserving cubic, O/F
//! held at the ends of the table. The reference map reduces an equilibrium calculation (NASA CEA); its
//! values are ideal, efficiencies are applied by the nozzle.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::interpolate::{
    Anchor, Monotone, Place, log_near,
    table::{Table, TableError},
};

/// Propulsion map: the `[engine.map]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Map {
    /// Table of the map, beside the vehicle file.
    pub file: String,
    /// Pressure at which the table's first columns hold (Pa).
    #[schemars(range(min = 1e4, max = 1e8))]
    pub reference_pressure_pa: f64,
}

/// Columns of the map's table; the order is that of [`CombustionMap::products`].
const COLUMNS: [&str; 10] = [
    "OF",
    "Isp_vac20_s",
    "k_Isp_vac_s",
    "Cstar20_m_s",
    "k_Cstar_m_s",
    "T_c20_K",
    "k_T_c_K",
    "MW20_g_mol",
    "k_MW_g_mol",
    "gamma_t20",
];
const SPECIFIC_IMPULSE: usize = 0;
const C_STAR: usize = 2;
const TEMPERATURE: usize = 4;
const MOLAR_MASS: usize = 6;
const GAMMA: usize = 8;

/// Widest range of |ln(Pc/P_ref)| in which every quantity of a map must stay positive: 0.05 to 20 times
/// the reference pressure.
const LOG_RANGE: f64 = 3.0;

/// The map, read and checked.
#[derive(Clone, Debug)]
pub struct CombustionMap {
    products: Monotone<9>,
    per_reference_pa: f64,
    gamma_span: (f64, f64),
}

/// Combustion products of one mixture ratio, as functions of pressure.
#[derive(Clone, Copy, Debug)]
pub struct Mixture<'a> {
    map: &'a CombustionMap,
    place: Place,
    c_star: [f64; 2],
}

impl CombustionMap {
    /// From the text of the map's table.
    pub fn read(text: &str, reference_pressure_pa: f64) -> Result<Self, TableError> {
        let table = Table::read(text, COLUMNS)?;
        table.require_increasing(0)?;
        table.require(0, "must be positive", |of| of > 0.0)?;
        table.require(9, "must lie in 1.02..1.66", |gamma| (1.02..=1.66).contains(&gamma))?;
        for (line, row) in &table.rows {
            for column in [1, 3, 5, 7] {
                // Also bounds the slope of the fixed point in Pc well below 1.
                if row[column] <= 2.0 * LOG_RANGE * row[column + 1].abs() {
                    return Err(TableError::BadValue {
                        line: *line,
                        column: COLUMNS[column].into(),
                        value: row[column],
                        rule: "must exceed 6 times the magnitude of its pressure coefficient",
                    });
                }
            }
        }
        let knots: Vec<f64> = table.rows.iter().map(|(_, row)| row[0]).collect();
        let rows: Vec<[f64; 9]> =
            table.rows.iter().map(|(_, row)| std::array::from_fn(|k| row[k + 1])).collect();
        let gammas = rows.iter().map(|row| row[GAMMA]);
        let gamma_span = gammas.fold((f64::MAX, f64::MIN), |(low, high), g| (g.min(low), g.max(high)));
        Ok(Self {
            products: Monotone::new(&knots, &rows),
            per_reference_pa: 1.0 / reference_pressure_pa,
            gamma_span,
        })
    }

    /// Products at a mixture ratio, clamped to the table.
    #[inline]
    pub fn mixture(&self, of_ratio: f64) -> Mixture<'_> {
        let place = self.products.locate(of_ratio);
        let c_star = [self.products.column(C_STAR, place), self.products.column(C_STAR + 1, place)];
        Mixture { map: self, place, c_star }
    }

    /// ln(P/P_ref), the variable of pressure.
    #[inline]
    pub fn log_pressure(&self, pressure_pa: f64) -> f64 {
        libm::log(pressure_pa * self.per_reference_pa)
    }

    /// The same by a series around the last pressure where that is near.
    #[inline]
    pub(super) fn log_pressure_near(&self, pressure_pa: f64, anchor: &mut Anchor) -> f64 {
        log_near(pressure_pa * self.per_reference_pa, anchor)
    }

    /// Least and greatest isentropic exponent; the interpolant does not leave them.
    pub(super) fn gamma_span(&self) -> (f64, f64) {
        self.gamma_span
    }

    /// Mixture ratios of the table's ends.
    pub(super) fn of_span(&self) -> (f64, f64) {
        self.products.span()
    }
}

impl Mixture<'_> {
    /// Ideal characteristic velocity (m/s) at ln(P/P_ref).
    #[inline]
    pub fn c_star_m_s(&self, log_pressure: f64) -> f64 {
        self.c_star[0] + self.c_star[1] * bounded(log_pressure)
    }

    /// Ideal vacuum specific impulse (s) at ln(P/P_ref).
    #[inline]
    pub fn vacuum_isp_s(&self, log_pressure: f64) -> f64 {
        self.at(SPECIFIC_IMPULSE, log_pressure)
    }

    /// Flame temperature (K) at ln(P/P_ref).
    pub fn temperature_k(&self, log_pressure: f64) -> f64 {
        self.at(TEMPERATURE, log_pressure)
    }

    /// Molar mass (kg/mol) at ln(P/P_ref).
    pub fn molar_mass_kg_mol(&self, log_pressure: f64) -> f64 {
        1e-3 * self.at(MOLAR_MASS, log_pressure) // g -> kg
    }

    /// Isentropic exponent at the throat.
    #[inline]
    pub fn gamma(&self) -> f64 {
        self.map.products.column(GAMMA, self.place)
    }

    /// Relative slope d ln c*/d ln P.
    #[inline]
    pub(super) fn c_star_exponent(&self, c_star_m_s: f64) -> f64 {
        self.c_star[1] / c_star_m_s
    }

    #[inline]
    fn at(&self, column: usize, log_pressure: f64) -> f64 {
        let products = &self.map.products;
        products.column(column, self.place) + products.column(column + 1, self.place) * bounded(log_pressure)
    }
}

/// Twice the checked range at most, so that no quantity can change its sign.
#[inline]
fn bounded(log_pressure: f64) -> f64 {
    log_pressure.clamp(-2.0 * LOG_RANGE, 2.0 * LOG_RANGE)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference() -> CombustionMap {
        CombustionMap::read(include_str!("../../scenarios/vehicles/cea_reference_fit.csv"), 20e5).unwrap()
    }

    #[test]
    fn rows_of_the_table_are_returned_at_the_reference_pressure() {
        let map = reference();
        let mixture = map.mixture(5.25);
        assert_eq!(mixture.c_star_m_s(0.0), 1562.537);
        assert_eq!(mixture.vacuum_isp_s(0.0), 245.7347);
        assert_eq!(mixture.gamma(), 1.221022);
        assert_eq!(map.mixture(99.0).vacuum_isp_s(0.0), 230.5624);
    }

    #[test]
    fn a_map_without_a_column_or_with_a_bad_value_is_refused() {
        let error = CombustionMap::read("OF,Isp_vac20_s\n1,2\n2,3\n", 20e5).unwrap_err();
        assert!(matches!(error, TableError::MissingColumn { .. }), "{error}");
    }
}
