//! What the feed system stores: oxidiser between valve and injector, and momentum of the liquid before the
//! valve.
//!
//! Content m of the manifold and flow w of the line obey `dm/dt = w - ṁ_injector` and
//! `L/A dw/dt = P1 + ρ g h - P2 - ΔP_valve(w)`, P2 follows from m by `ρ(P2, h1) = m/V`: the valve throttles,
//! and what is stored keeps the tank's enthalpy. While it boils, dρ/dP is some hundred times the liquid's, and filling the 25 mL of
//! the reference vehicle takes 30 to 50 ms; the lag of P2, `V (dρ/dP)_h/(dṁ_injector/dP2 - dṁ_valve/dP2)`,
//! falls to 1 ms and less where the flow is liquid. Without a line w is the valve's steady flow; with one,
//! `ΔP_valve = (P1 - P2) (w/w_steady)²`: exact for liquid, a quadratic through the steady flow of the
//! flashing valve otherwise. A column that would flow back stops: w ≥ 0, and the injector passes nothing
//! against the pressure.
//!
//! Stiff, so implicit: from the beginning of the plant's step to each instant of it at which the rate is
//! evaluated, by SDIRK2, the L-stable method of two stages and second order of Alexander (SIAM J. Numer.
//! Anal. 14, 1977), γ = 1 - 1/√2. Each stage is the root in P2 of the steady engine with one term more, what
//! the manifold takes up; so it tends to the steady engine when the volume or the lag vanishes. One step errs
//! by `(4 - 3√2)/6·z³ = -0.040 z³` of a deviation, z = step/lag: 1 ms at 40 ms makes 6e-7 a step. Where the
//! lag is below a limit, one stage is enough (backward Euler, z²/2): its error lasts a step or two. Whoever
//! takes the step moves the change of m from tank to manifold: mass is kept to round-off whatever the error
//! of the method.
//!
//! Source: the seed paper's feed system, which is steady; balances of mass and momentum.

use super::engine::{Engine, INLET_TOLERANCE};
use super::feed_grid::Feed;
use super::feed_map::Inlet;
use super::feed_state::{FeedInput, FeedPoint, FeedState, FeedStep, ImplicitMethod};
use super::operating_point::{ChamberWarmStart, OperatingPoint, WarmStart};
use super::thrust_chamber::{FilledChamber, HotFlow, InletRoot, ThrustChamberAtCondition};
use crate::fluid::Nitrous;
use crate::interpolate::{Bracket, RootStatus, bracketed_root};

/// γ of SDIRK2: stages at γ h and h.
const GAMMA: f64 = 1.0 - core::f64::consts::FRAC_1_SQRT_2;
/// (1 - γ)/γ: share of the first stage's gain in the second stage's start.
const SECOND_STAGE_SHARE: f64 = 1.0 + core::f64::consts::SQRT_2;

/// Accuracy of P2 in a stage, relative to the tank's pressure: 65 µPa; boiling content to 1e-12 kg.
const STAGE_TOLERANCE: f64 = 1e-2 * INLET_TOLERANCE;
/// Accuracy of a flow through the injector at a given P2 (kg/s).
const FLOW_TOLERANCE_KG_S: f64 = 1e-11;
/// Behind a shut valve the manifold is at rest when its content exceeds that at the chamber's pressure by
/// less than this share: 0.1 Pa.
const AT_REST: f64 = 1e-6;

/// One implicit equation: `m = m_from + span (w - ṁ_injector)`, and the same for the line.
#[derive(Clone, Copy, Debug)]
struct Stage {
    span_s: f64,
    from: FeedState,
}

/// Solution of a stage.
struct StageSolution<'a> {
    /// P2 and the slope of the balance there.
    inlet_pa: f64,
    slope_kg_s_pa: f64,
    quality: f64,
    state: FeedState,
    tank_kg_s: f64,
    injected_kg_s: f64,
    hot: Option<HotFlow<'a>>,
    chamber: ChamberWarmStart,
    status: RootStatus,
}

impl Engine {
    /// Whether the feed system has a state; without one [`Engine::operating_point`] is all there is.
    pub fn feed_has_state(&self) -> bool {
        self.stores.volume_m3 > 0.0 || self.stores.inertance_1_m > 0.0 || self.stores.head_m.is_some()
    }

    /// Pressure (Pa) of the liquid's weight at the valve, `liquid_m` above the tank's floor.
    pub fn static_head_pa<'f>(
        &self,
        feed: impl Into<Feed<'f>>,
        liquid_m: f64,
        specific_force_m_s2: f64,
    ) -> f64 {
        let feed = &feed.into();
        let weight =
            |drop_m: f64| feed.tank().density_kg_m3 * specific_force_m_s2.max(0.0) * (liquid_m + drop_m);
        self.stores.head_m.map_or(0.0, weight)
    }

    /// The feed system at rest: vapour at a pressure (Pa) fills the manifold.
    pub fn feed_at_rest<'f>(&self, feed: impl Into<Feed<'f>>, pressure_pa: f64) -> FeedState {
        let feed = &feed.into();
        let density_kg_m3 = feed.inlet(pressure_pa.max(Nitrous::LEAST_PA)).state.density_kg_m3;
        FeedState { manifold_kg: self.stores.volume_m3 * density_kg_m3, line_kg_s: 0.0 }
    }

    /// The feed system in the steady state of an operating point.
    pub fn feed_steady<'f>(&self, feed: impl Into<Feed<'f>>, point: &OperatingPoint) -> FeedState {
        let feed = &feed.into();
        let rest = self.feed_at_rest(feed, point.injector_inlet_pa);
        let line_kg_s = if self.stores.inertance_1_m > 0.0 { point.tank_kg_s } else { 0.0 };
        FeedState { line_kg_s, ..rest }
    }

    /// Lag of P2, its time constant (s), at an inlet and a chamber pressure: `V (dρ/dP)_h/(dṁ_injector/dP2 -
    /// dṁ_valve/dP2)`.
    pub fn manifold_lag_s<'f>(
        &self,
        feed: impl Into<Feed<'f>>,
        valve_area_m2: f64,
        inlet_pa: f64,
        chamber_pa: f64,
    ) -> f64 {
        let feed = &feed.into();
        let low_pa = (inlet_pa - 20.0).max(Nitrous::LEAST_PA);
        let (below, above) = (feed.inlet(low_pa), feed.inlet(low_pa + 40.0));
        let valve_m2 = self.valve_discharge_coefficient * valve_area_m2;
        let injected = |inlet: &Inlet| self.injector_area_m2 * feed.injector_flux_kg_m2_s(inlet, chamber_pa);
        let valve = |inlet: &Inlet| valve_m2 * inlet.valve_flux_kg_m2_s;
        let slope = injected(&above) - injected(&below) - (valve(&above) - valve(&below));
        self.stores.volume_m3 * (above.state.density_kg_m3 - below.state.density_kg_m3) / slope
    }

    /// Method that a step needs where the inlet and the chamber have these pressures.
    pub fn implicit_method<'f>(
        &self,
        feed: impl Into<Feed<'f>>,
        valve_area_m2: f64,
        inlet_pa: f64,
        chamber_pa: f64,
    ) -> ImplicitMethod {
        let feed = &feed.into();
        let limit_s = self.stores.backward_euler_below_s;
        let stiff = self.stores.volume_m3 > 0.0
            && limit_s > 0.0
            && self.manifold_lag_s(feed, valve_area_m2, inlet_pa, chamber_pa) < limit_s;
        if stiff { ImplicitMethod::BackwardEuler } else { ImplicitMethod::Sdirk2 }
    }

    /// Engine and feed system some time after a step began; `now` is what drives them then.
    pub fn feed_point<'f>(
        &self,
        feed: impl Into<Feed<'f>>,
        step: &FeedStep,
        now: &FeedInput,
        elapsed_s: f64,
        warm_start: WarmStart,
    ) -> FeedPoint {
        let feed = &feed.into();
        let at_condition = self.thrust_chamber.at_condition(&now.condition);
        let mut chamber = warm_start.chamber;
        let filled = now.condition.chamber_gas.map(|gas| at_condition.filled_chamber(gas, &mut chamber));
        let warm_start = WarmStart { chamber, ..warm_start };
        let rest_pa = filled.as_ref().map_or(now.condition.ambient_pa, |filled| filled.pressure.pa);
        if self.valve_m2(now) <= 0.0 {
            let rest = self.feed_at_rest(feed, rest_pa);
            if step.from.manifold_kg <= rest.manifold_kg * (1.0 + AT_REST) {
                let state = FeedState { line_kg_s: 0.0, ..step.from };
                return FeedPoint { engine: at_condition.no_flow_point(filled, chamber), state };
            }
        }
        let solved = if elapsed_s > 0.0 {
            self.advance(feed, step, now, (&at_condition, filled.as_ref()), elapsed_s, warm_start)
        } else {
            self.at_step_start(feed, step, now, (&at_condition, filled.as_ref()), warm_start)
        };
        let inlet = InletRoot {
            injector_inlet_pa: solved.inlet_pa,
            quality: solved.quality,
            solved: solved.status != RootStatus::Invalid,
            warm_start: WarmStart {
                injector_inlet_pa: solved.inlet_pa,
                slope_kg_s_pa: solved.slope_kg_s_pa,
                chamber: solved.chamber,
            },
        };
        let mut engine = match filled {
            Some(filled) => at_condition.filling_point(solved.injected_kg_s, &filled, inlet),
            None => at_condition.steady_point(solved.injected_kg_s, solved.hot, inlet),
        };
        engine.injector_inlet_pa = solved.inlet_pa;
        engine.quality = solved.quality;
        engine.tank_kg_s = solved.tank_kg_s;
        FeedPoint { engine, state: solved.state }
    }

    /// Effective area of the valve (m²); none when the tank gives nothing.
    fn valve_m2(&self, input: &FeedInput) -> f64 {
        if input.condition.oxidizer_flow_limit_kg_s > 0.0 {
            self.valve_discharge_coefficient * input.valve_area_m2.max(0.0)
        } else {
            0.0
        }
    }

    /// The feed system some time into the step, by the step's method.
    fn advance<'a>(
        &'a self,
        feed: &Feed<'_>,
        step: &FeedStep,
        now: &FeedInput,
        (at_condition, filled): (&ThrustChamberAtCondition<'a>, Option<&FilledChamber<'a>>),
        elapsed_s: f64,
        warm_start: WarmStart,
    ) -> StageSolution<'a> {
        let from = step.from;
        let whole = Stage { span_s: elapsed_s, from };
        if step.method == ImplicitMethod::BackwardEuler {
            return self.solve_stage(feed, now, &whole, (at_condition, filled), warm_start);
        }
        let span_s = GAMMA * elapsed_s;
        let between = step.start.interpolated(now, GAMMA);
        let first = {
            let at_condition = self.thrust_chamber.at_condition(&between.condition);
            let mut chamber = warm_start.chamber;
            let filled =
                between.condition.chamber_gas.map(|gas| at_condition.filled_chamber(gas, &mut chamber));
            let stage = Stage { span_s, ..whole };
            let solved =
                self.solve_stage(feed, &between, &stage, (&at_condition, filled.as_ref()), warm_start);
            (solved.state, solved.injected_kg_s > 0.0, solved.slope_kg_s_pa, solved.status)
        };
        let (first_state, flows, slope_kg_s_pa, status) = first;
        if status == RootStatus::Solved {
            let stage = Stage { span_s, from: from.extrapolated(&first_state, SECOND_STAGE_SHARE) };
            let warm_start = WarmStart { slope_kg_s_pa, ..warm_start };
            let second = self.solve_stage(feed, now, &stage, (at_condition, filled), warm_start);
            if second.status == RootStatus::Solved && (second.injected_kg_s > 0.0 || !flows) {
                return second;
            }
        }
        // The second stage left what a manifold can hold, or passed the end of its flow: backward Euler does
        // neither.
        self.solve_stage(feed, now, &whole, (at_condition, filled), warm_start)
    }

    /// One implicit equation: the root in P2 of the steady engine, less what the manifold takes up.
    fn solve_stage<'a>(
        &'a self,
        feed: &Feed<'_>,
        input: &FeedInput,
        stage: &Stage,
        (at_condition, filled): (&ThrustChamberAtCondition<'a>, Option<&FilledChamber<'a>>),
        warm_start: WarmStart,
    ) -> StageSolution<'a> {
        let volume_m3 = self.stores.volume_m3;
        let injector_m2 = self.injector_m2(at_condition.condition);
        let tank_pa = feed.tank().pressure_pa;
        let least_pa = if volume_m3 > 0.0 {
            Nitrous::LEAST_PA.min(tank_pa)
        } else {
            filled.map_or(input.condition.ambient_pa, |filled| filled.pressure.pa)
        };
        let mut chamber = warm_start.chamber;
        let (mut inlet, mut hot) = (feed.inlet(tank_pa), None);
        let (mut tank_kg_s, mut passed_kg_s, mut driven_kg_s) = (0.0, 0.0, 0.0);
        // Flow that the injector would pass less flow that is left for it: rises with P2.
        let balance = |inlet_pa: f64| {
            inlet = feed.inlet(inlet_pa);
            tank_kg_s = self.valve_flow_kg_s(feed, &inlet, input, stage);
            passed_kg_s =
                tank_kg_s - (volume_m3 * inlet.state.density_kg_m3 - stage.from.manifold_kg) / stage.span_s;
            let chamber_pa = match filled {
                Some(filled) => filled.pressure.pa,
                None => {
                    hot = at_condition.hot_flow_if_lit(passed_kg_s, &mut chamber);
                    at_condition.mixed_pa(passed_kg_s.max(0.0), hot.as_ref())
                }
            };
            driven_kg_s = injector_m2 * feed.injector_flux_kg_m2_s(&inlet, chamber_pa);
            driven_kg_s - passed_kg_s
        };
        // Without a store the engine as it stands is shut off.
        if volume_m3 <= 0.0 && least_pa >= tank_pa {
            return StageSolution {
                inlet_pa: least_pa,
                slope_kg_s_pa: 0.0,
                quality: 0.0,
                state: FeedState::default(),
                tank_kg_s: 0.0,
                injected_kg_s: 0.0,
                hot: None,
                chamber: warm_start.chamber,
                status: RootStatus::AtHigh,
            };
        }
        let bracket = Bracket {
            low: least_pa,
            high: tank_pa,
            guess: warm_start.injector_inlet_pa,
            slope: Some(warm_start.slope_kg_s_pa),
            tolerance: STAGE_TOLERANCE * tank_pa,
        };
        let root = bracketed_root(bracket, balance);
        let mut solved = StageSolution {
            inlet_pa: root.x,
            slope_kg_s_pa: root.slope,
            quality: inlet.quality,
            state: FeedState {
                manifold_kg: volume_m3 * inlet.state.density_kg_m3,
                line_kg_s: if self.stores.inertance_1_m > 0.0 { tank_kg_s } else { 0.0 },
            },
            tank_kg_s,
            injected_kg_s: if driven_kg_s > 0.0 { passed_kg_s.max(0.0) } else { 0.0 },
            hot,
            chamber,
            status: root.status,
        };
        if volume_m3 > 0.0 && root.status != RootStatus::Solved {
            // P2 stands at an end of its range: it alone drives what passes, and the tank makes up the rest.
            self.inject(feed, &inlet, at_condition, filled, &mut solved);
        }
        solved
    }

    /// Flow of the valve into an inlet (kg/s): steady, or of the column before it.
    #[inline]
    fn valve_flow_kg_s(&self, feed: &Feed<'_>, inlet: &Inlet, input: &FeedInput, stage: &Stage) -> f64 {
        let limit_kg_s = input.condition.oxidizer_flow_limit_kg_s;
        let valve_m2 = self.valve_m2(input);
        let steady_kg_s = valve_m2 * inlet.valve_flux_kg_m2_s;
        let inertia_pa_s_kg = self.stores.inertance_1_m / stage.span_s;
        if valve_m2 <= 0.0 || (inertia_pa_s_kg == 0.0 && input.head_pa == 0.0) {
            return steady_kg_s.min(limit_kg_s);
        }
        // B (w - w0) = drop + head - drop (w/w_steady)², the root that is not negative.
        let tank = feed.tank();
        let drop_pa = (tank.pressure_pa - inlet.state.pressure_pa).max(0.0);
        let loss = if drop_pa > 1.0 && steady_kg_s > 0.0 {
            drop_pa / (steady_kg_s * steady_kg_s)
        } else {
            0.5 / (tank.density_kg_m3 * valve_m2 * valve_m2)
        };
        let push_pa = drop_pa + input.head_pa + inertia_pa_s_kg * stage.from.line_kg_s;
        if push_pa <= 0.0 {
            return 0.0;
        }
        let root = (inertia_pa_s_kg * inertia_pa_s_kg + 4.0 * loss * push_pa).sqrt();
        (2.0 * push_pa / (inertia_pa_s_kg + root)).min(limit_kg_s)
    }

    /// The engine at the state in which the step begins.
    fn at_step_start<'a>(
        &'a self,
        feed: &Feed<'_>,
        step: &FeedStep,
        now: &FeedInput,
        (at_condition, filled): (&ThrustChamberAtCondition<'a>, Option<&FilledChamber<'a>>),
        warm_start: WarmStart,
    ) -> StageSolution<'a> {
        let (tank_pa, from) = (feed.tank().pressure_pa, step.from);
        let has_line = self.stores.inertance_1_m > 0.0;
        let tolerance = STAGE_TOLERANCE * tank_pa;
        let bracket = Bracket {
            low: Nitrous::LEAST_PA.min(tank_pa),
            high: tank_pa,
            guess: warm_start.injector_inlet_pa,
            slope: None,
            tolerance,
        };
        if self.stores.volume_m3 <= 0.0 {
            // Nothing is stored: the injector passes what the line brings, or without inertia the steady
            // flow.
            let stage = Stage { span_s: f64::INFINITY, from };
            if !has_line {
                return self.solve_stage(feed, now, &stage, (at_condition, filled), warm_start);
            }
            let mut chamber = warm_start.chamber;
            let passed_kg_s = from.line_kg_s.min(now.condition.oxidizer_flow_limit_kg_s).max(0.0);
            let hot = match filled {
                Some(_) => None,
                None => at_condition.hot_flow_if_lit(passed_kg_s, &mut chamber),
            };
            let chamber_pa = filled.map_or_else(
                || at_condition.mixed_pa(passed_kg_s, hot.as_ref()),
                |filled| filled.pressure.pa,
            );
            let low = chamber_pa.min(tank_pa);
            let injector_m2 = self.injector_m2(at_condition.condition);
            let root = bracketed_root(
                Bracket { low, slope: Some(warm_start.slope_kg_s_pa), ..bracket },
                |inlet_pa| {
                    injector_m2 * feed.injector_flux_kg_m2_s(&feed.inlet(inlet_pa), chamber_pa) - passed_kg_s
                },
            );
            return StageSolution {
                inlet_pa: root.x,
                slope_kg_s_pa: warm_start.slope_kg_s_pa,
                quality: feed.inlet(root.x).quality,
                state: from,
                tank_kg_s: passed_kg_s,
                injected_kg_s: passed_kg_s,
                hot,
                chamber,
                status: root.status,
            };
        }
        let density_kg_m3 = from.manifold_kg / self.stores.volume_m3;
        let near_pa = warm_start.injector_inlet_pa.clamp(bracket.low, tank_pa - 20.0);
        let density = |inlet_pa: f64| feed.inlet(inlet_pa).state.density_kg_m3;
        let slope = Some(0.1 * (density(near_pa + 10.0) - density(near_pa)));
        let root = bracketed_root(Bracket { slope, ..bracket }, |inlet_pa| density(inlet_pa) - density_kg_m3);
        let inlet = feed.inlet(root.x);
        let stage = Stage { span_s: f64::INFINITY, from };
        let mut solved = StageSolution {
            inlet_pa: root.x,
            slope_kg_s_pa: warm_start.slope_kg_s_pa,
            quality: inlet.quality,
            state: from,
            tank_kg_s: if has_line {
                from.line_kg_s
            } else {
                self.valve_flow_kg_s(feed, &inlet, now, &stage)
            },
            injected_kg_s: 0.0,
            hot: None,
            chamber: warm_start.chamber,
            status: root.status,
        };
        self.inject(feed, &inlet, at_condition, filled, &mut solved);
        solved
    }

    /// Flow through the injector at a given inlet: against the chamber's gas where that is a state, else
    /// against the steady pressure of the flow itself.
    fn inject<'a>(
        &'a self,
        feed: &Feed<'_>,
        inlet: &Inlet,
        at_condition: &ThrustChamberAtCondition<'a>,
        filled: Option<&FilledChamber<'a>>,
        solved: &mut StageSolution<'a>,
    ) {
        let injector_m2 = self.injector_m2(at_condition.condition);
        let flow = |chamber_pa: f64| injector_m2 * feed.injector_flux_kg_m2_s(inlet, chamber_pa);
        if let Some(filled) = filled {
            solved.injected_kg_s = flow(filled.pressure.pa);
            return;
        }
        let most_kg_s = flow(at_condition.condition.ambient_pa);
        let (mut chamber, mut hot) = (solved.chamber, None);
        solved.injected_kg_s = if most_kg_s > 0.0 {
            let bracket = Bracket {
                low: 0.0,
                high: most_kg_s,
                // Near two fifths of P2 over most of the range.
                guess: flow(0.4 * inlet.state.pressure_pa),
                slope: Some(1.2),
                tolerance: FLOW_TOLERANCE_KG_S,
            };
            bracketed_root(bracket, |passed_kg_s| {
                hot = at_condition.hot_flow_if_lit(passed_kg_s, &mut chamber);
                passed_kg_s - flow(at_condition.mixed_pa(passed_kg_s, hot.as_ref()))
            })
            .x
        } else {
            0.0
        };
        (solved.chamber, solved.hot) = (chamber, hot);
    }
}
