//! The feed system's parts after the run tank: line, manifold, isolation and vent valves.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::gas_orifice::gas_flux_kg_m2_s;

/// Pipe between valve and injector: the `[feed.manifold]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Manifold {
    /// Volume between valve and injector (m³).
    #[schemars(range(min = 1e-7, max = 0.1))]
    pub volume_m3: f64,
    /// Whether the pressure P2 is a state.
    pub model: ManifoldModel,
    /// Lag of P2 below which the implicit model takes one stage a step instead of two (s): quasi-steady but for
    /// what the manifold stores in the step, so that nothing jumps.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub quasi_steady_below_s: f64,
}

/// Whether the pressure between valve and injector is a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ManifoldModel {
    /// The flows of valve and injector are equal at every instant.
    QuasiSteady,
    /// The content is a state, and the pressure with it; integrated implicitly.
    Implicit,
}

/// Liquid column between tank and valve: the `[feed.line]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Length of the column (m).
    #[schemars(range(min = 0.0, max = 20.0))]
    pub length_m: f64,
    /// Cross-section (m²).
    #[schemars(range(min = 1e-6, max = 0.01))]
    pub area_m2: f64,
    /// Whether the weight of the liquid adds to the pressure at the valve.
    #[serde(default)]
    pub static_head: bool,
    /// Height of the tank's floor above the valve (m), for the static head.
    #[serde(default)]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub drop_m: f64,
}

/// What line and manifold store, as the equations need it.
#[derive(Clone, Copy, Debug)]
pub(super) struct FeedStores {
    /// Volume of the manifold (m³); 0 is quasi-steady.
    pub(super) volume_m3: f64,
    /// Lag of P2 below which a step is a backward Euler step (s).
    pub(super) backward_euler_below_s: f64,
    /// Length over cross-section of the line (1/m); 0 is none.
    pub(super) inertance_1_m: f64,
    /// Height of the tank's floor above the valve (m), if the liquid's weight counts.
    pub(super) head_m: Option<f64>,
}

impl FeedStores {
    pub(super) fn new(manifold: &Manifold, line: Option<&Line>) -> Self {
        let implicit = manifold.model == ManifoldModel::Implicit;
        Self {
            volume_m3: if implicit { manifold.volume_m3 } else { 0.0 },
            backward_euler_below_s: manifold.quasi_steady_below_s,
            inertance_1_m: line.map_or(0.0, |line| line.length_m / line.area_m2),
            head_m: line.and_then(|line| line.static_head.then_some(line.drop_m)),
        }
    }
}

/// Isolation valve: the `[feed.isolation]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Isolation {
    /// Time from shut to open; the area is linear in time (s).
    #[schemars(range(min = 0.0, max = 120.0))]
    pub stroke_time_s: f64,
    /// Area when open (m²); larger than the throttle valve's, then it costs nothing.
    #[schemars(range(min = 1e-7, max = 0.1))]
    pub area_m2: f64,
    /// Where the valve goes without power.
    pub open_without_power: bool,
}

impl Isolation {
    /// Open area of throttle valve and isolation valve in series (m²), the latter open by `opened`, 0..1: the lesser.
    pub(crate) fn limited_area_m2(&self, throttle_area_m2: f64, opened: f64) -> f64 {
        throttle_area_m2.min(self.area_m2 * opened.clamp(0.0, 1.0))
    }
}

/// Vent of the run tank's gas: the `[feed.vent]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Vent {
    /// Time from shut to open; the area is linear in time (s).
    #[schemars(range(min = 0.0, max = 120.0))]
    pub stroke_time_s: f64,
    /// Area when open (m²).
    #[schemars(range(min = 1e-9, max = 0.01))]
    pub area_m2: f64,
    /// Discharge coefficient.
    #[schemars(range(min = 0.1, max = 1.0))]
    pub discharge_coefficient: f64,
    /// Where the valve goes without power.
    pub open_without_power: bool,
}

/// Gas in front of the vent.
#[derive(Clone, Copy, Debug)]
pub struct VentedGas {
    /// Pressure (Pa).
    pub pressure_pa: f64,
    /// Density (kg/m³).
    pub density_kg_m3: f64,
    /// Ambient pressure (Pa).
    pub ambient_pa: f64,
}

impl Vent {
    /// Flow of gas (kg/s), `opened` 0..1.
    pub fn flow_kg_s(&self, gas: &VentedGas, opened: f64) -> f64 {
        let area_m2 = self.discharge_coefficient * self.area_m2 * opened.clamp(0.0, 1.0);
        area_m2 * gas_flux_kg_m2_s(gas.pressure_pa, gas.density_kg_m3, gas.ambient_pa)
    }
}
