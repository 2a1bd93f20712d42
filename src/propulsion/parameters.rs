//! The tables of a vehicle file that an engine is made of.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::chamber::Chamber;
use super::combustion::Map;
use super::feed::{Isolation, Line, Manifold, Vent};
use super::grain::Grain;
use super::ignition::{Depletion, Ignition};
use super::injector::Injector;
use super::nozzle::Nozzle;
use super::tank::Tank;
use super::valve::Valve;
use crate::input::Invalid;

/// The engine proper: the `[engine]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EngineParameters {
    /// Fuel grain.
    pub grain: Grain,
    /// Propulsion map.
    pub map: Map,
    /// Combustion chamber.
    pub chamber: Chamber,
    /// Nozzle.
    pub nozzle: Nozzle,
    /// Ignition and extinction.
    pub ignition: Ignition,
    /// Ends of propellant.
    pub depletion: Depletion,
}

/// The feed system: the `[feed]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FeedParameters {
    /// Run tank.
    pub tank: Tank,
    /// Throttle valve and its servo.
    pub valve: Valve,
    /// Pipe between tank and valve; without it no inertia and no static head.
    #[serde(default)]
    pub line: Option<Line>,
    /// Pipe between valve and injector.
    pub manifold: Manifold,
    /// Injector.
    pub injector: Injector,
    /// Isolation valve.
    pub isolation: Isolation,
    /// Vent of the run tank.
    pub vent: Vent,
}

/// Limits of the inverse problem, and the seed paper's scheme: the `[paper_mode]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PaperMode {
    /// Least oxidiser flow of a thrust demand (kg/s).
    #[schemars(range(min = 1e-6, max = 100.0))]
    pub oxidizer_flow_min_kg_s: f64,
    /// Greatest oxidiser flow of a thrust demand (kg/s).
    #[schemars(range(min = 1e-5, max = 100.0))]
    pub oxidizer_flow_max_kg_s: f64,
    /// Step of the explicit Euler scheme (s).
    #[schemars(range(min = 1e-4, max = 1.0))]
    pub step_s: f64,
    /// Points of the flow sweep.
    #[schemars(range(min = 2, max = 1000000))]
    pub sweep_points: u32,
    /// Degree of the polynomials Isp(O/F) and c*(O/F), fitted to the vehicle's own map at its reference pressure.
    #[serde(default = "polynomial_degree")]
    #[schemars(range(min = 1, max = 12))]
    pub polynomial_degree: u32,
    /// O/F between which they are fitted, rising, at least 0.25 of it inside the map's own range; held at the ends
    /// beyond.
    #[serde(default = "polynomial_of_range")]
    #[schemars(inner(range(min = 0.1, max = 40.0)))]
    pub polynomial_of_range: [f64; 2],
    /// Factor on the ideal sea-level Isp of Eq 10: 1 as in the print; `c_star_efficiency` times `thrust_efficiency`
    /// makes thrust and chamber pressure agree.
    #[serde(default = "one")]
    #[schemars(range(min = 0.5, max = 1.0))]
    pub specific_impulse_efficiency: f64,
}

impl PaperMode {
    /// Spacing in O/F of the points that the polynomials are fitted to.
    pub(super) const FIT_SPACING: f64 = 0.25;

    /// Least and greatest oxidiser flow of a thrust demand (kg/s).
    pub(super) fn demand_kg_s(&self) -> Result<(f64, f64), Invalid> {
        let (least, most) = (self.oxidizer_flow_min_kg_s, self.oxidizer_flow_max_kg_s);
        if least >= most {
            let message = format!("{most} kg/s is not above oxidizer_flow_min_kg_s = {least} kg/s");
            return Err(Invalid::new("paper_mode.oxidizer_flow_max_kg_s", message));
        }
        Ok((least, most))
    }

    /// The part of the map that the polynomials are fitted to, from the O/F between which the map has data.
    pub(super) fn fitted_of_range(&self, (low, high): (f64, f64)) -> (f64, f64) {
        let [from, to] = self.polynomial_of_range;
        (from.clamp(low, high), to.clamp(low, high))
    }

    /// Refuses a range of the polynomials that leaves nothing of the map to fit.
    pub(super) fn validate_of_range(&self, map_span: (f64, f64)) -> Result<(), Invalid> {
        let fitted = self.fitted_of_range(map_span);
        if fitted.1 - fitted.0 >= Self::FIT_SPACING {
            return Ok(());
        }
        let ([from, to], (low, high)) = (self.polynomial_of_range, map_span);
        let message = format!(
            "{from} to {to} is no range to fit: it must rise by {} or more within the map's {low} to {high}",
            Self::FIT_SPACING
        );
        Err(Invalid::new("paper_mode.polynomial_of_range", message))
    }
}

fn polynomial_degree() -> u32 {
    8
}

fn polynomial_of_range() -> [f64; 2] {
    [1.0, 12.0]
}

fn one() -> f64 {
    1.0
}
