//! Ignition, extinction and depletion: what makes the flow burn.
//!
//! The burning fraction is the share of the oxidiser that burns at the steady O/F. It is a state of the
//! plant: 0 cold, rising to 1 after the flame with a first-order lag. Whether there is a flame changes
//! between steps, here.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::time::SimTime;

/// Igniter and flame: the `[engine.ignition]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Ignition {
    /// Igniter command to flame, with oxidiser flowing (s).
    #[schemars(range(min = 0.0, max = 20.0))]
    pub igniter_delay_s: f64,
    /// Time the igniter's flame can light the grain (s).
    #[schemars(range(min = 0.0, max = 600.0))]
    pub igniter_burn_s: f64,
    /// Oxidiser flow below which nothing lights (kg/s).
    #[schemars(range(min = 0.0, max = 10.0))]
    pub minimum_oxidizer_flow_kg_s: f64,
    /// Lag of the burning fraction after the flame (s).
    #[schemars(range(min = 1e-3, max = 10.0))]
    pub rise_time_constant_s: f64,
    /// Chamber pressure under which a lit engine goes out (Pa).
    #[schemars(range(min = 0.0, max = 1e8))]
    pub extinction_pressure_pa: f64,
    /// Time it must stay under that pressure (s).
    #[schemars(range(min = 0.0, max = 10.0))]
    pub extinction_time_s: f64,
    /// A lit engine commanded between shut-down and the least thrust.
    pub below_minimum: BelowMinimum,
    /// Commands under this share of rated thrust shut the valve.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub shutdown_fraction: f64,
    /// Whether it may be lit again.
    pub relight: bool,
    /// Specific impulse of unlit nitrous flow (s).
    #[schemars(range(min = 0.0, max = 100.0))]
    pub cold_flow_isp_s: f64,
    /// Characteristic velocity of unlit nitrous flow (m/s).
    #[schemars(range(min = 50.0, max = 1000.0))]
    pub cold_flow_c_star_m_s: f64,
}

/// What a lit engine does with a command under the least thrust.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BelowMinimum {
    /// Holds the least thrust.
    Hold,
    /// Follows the command.
    Follow,
}

/// Ends of propellant: the `[engine.depletion]` table.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Depletion {
    /// Decay of the thrust once the liquid is gone or the grain burnt through (s).
    #[schemars(range(min = 1e-3, max = 30.0))]
    pub tail_time_constant_s: f64,
    /// What the outlet draws once the liquid no longer covers it.
    #[serde(default)]
    pub model: DepletionModel,
}

/// What the tank's outlet draws once the liquid no longer covers it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DepletionModel {
    /// The rest of the liquid, with `tail_time_constant_s`.
    #[default]
    TimeConstant,
    /// Liquid and the gas above it, through valve and injector.
    TwoPhase,
}

/// Igniter and flame between steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flame {
    /// Whether the grain burns.
    pub lit: bool,
    /// Whether it has ever burnt.
    pub was_lit: bool,
    /// When the igniter was fired; `None` before, and after its command has been withdrawn.
    pub igniter_fired: Option<SimTime>,
    /// Since when the chamber has been below the extinction pressure.
    pub low_pressure_since: Option<SimTime>,
}

/// What decides whether the flame lights or goes out.
#[derive(Clone, Copy, Debug)]
pub struct FlameConditions {
    /// Now.
    pub time: SimTime,
    /// Whether the igniter is commanded.
    pub igniter: bool,
    /// Oxidiser flow (kg/s).
    pub oxidizer_kg_s: f64,
    /// Chamber pressure (Pa).
    pub chamber_pa: f64,
    /// Whether fuel is left.
    pub fuel_left: bool,
    /// How much later than its delay the igniter's flame comes (s).
    pub late_s: f64,
}

impl Ignition {
    /// Whether the igniter's flame burns, `late_s` later than it should.
    fn igniter_burns(&self, flame: &Flame, time: SimTime, late_s: f64) -> bool {
        flame.igniter_fired.is_some_and(|fired| {
            let age = time.since(fired);
            let from = SimTime::from_s(self.igniter_delay_s + late_s);
            let long = SimTime::from_s(self.igniter_burn_s);
            age >= from && age <= from + long
        })
    }

    /// The flame after a step. It lights while the igniter burns and enough oxidiser flows; it goes out
    /// without oxidiser or fuel, or when the pressure stays low while no igniter holds it.
    pub fn advance(&self, flame: &Flame, now: &FlameConditions) -> Flame {
        let mut next = *flame;
        next.igniter_fired = if now.igniter { flame.igniter_fired.or(Some(now.time)) } else { None };
        let igniter_burns = self.igniter_burns(&next, now.time, now.late_s);
        if flame.lit {
            let low = now.chamber_pa < self.extinction_pressure_pa && !igniter_burns;
            next.low_pressure_since = if low { flame.low_pressure_since.or(Some(now.time)) } else { None };
            let starved = next
                .low_pressure_since
                .is_some_and(|since| now.time.since(since) >= SimTime::from_s(self.extinction_time_s));
            next.lit = !starved && now.oxidizer_kg_s > 0.0 && now.fuel_left;
        } else {
            let allowed = self.relight || !flame.was_lit;
            let enough = now.oxidizer_kg_s >= self.minimum_oxidizer_flow_kg_s && now.oxidizer_kg_s > 0.0;
            next.lit = allowed && igniter_burns && enough && now.fuel_left;
            next.low_pressure_since = None;
        }
        next.was_lit |= next.lit;
        next
    }

    /// Rate of the burning fraction (1/s): rises toward 1 while lit; falls with the depletion's tail when the
    /// grain is gone. The fraction itself is set to zero by whoever sees the flame go out otherwise.
    pub(crate) fn burning_rate_1_s(&self, burning_fraction: f64, lit: bool, depletion: &Depletion) -> f64 {
        if lit {
            (1.0 - burning_fraction) / self.rise_time_constant_s
        } else {
            -burning_fraction / depletion.tail_time_constant_s
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference() -> Ignition {
        Ignition {
            igniter_delay_s: 0.3,
            igniter_burn_s: 2.0,
            minimum_oxidizer_flow_kg_s: 0.02,
            rise_time_constant_s: 0.25,
            extinction_pressure_pa: 2e5,
            extinction_time_s: 0.1,
            below_minimum: BelowMinimum::Hold,
            shutdown_fraction: 0.02,
            relight: true,
            cold_flow_isp_s: 40.0,
            cold_flow_c_star_m_s: 420.0,
        }
    }

    fn conditions(ms: u64, igniter: bool, oxidizer_kg_s: f64, chamber_pa: f64) -> FlameConditions {
        FlameConditions {
            time: SimTime::from_us(1000 * ms),
            igniter,
            oxidizer_kg_s,
            chamber_pa,
            fuel_left: true,
            late_s: 0.0,
        }
    }

    #[test]
    fn flame_follows_the_igniter_by_its_delay_and_needs_flow() {
        let ignition = reference();
        let mut flame = Flame::default();
        let mut lit_ms = None;
        for ms in 0..1000 {
            let flow = if ms < 500 { 0.01 } else { 0.15 };
            flame = ignition.advance(&flame, &conditions(ms, true, flow, 3e5));
            if flame.lit && lit_ms.is_none() {
                lit_ms = Some(ms);
            }
        }
        assert_eq!(lit_ms, Some(500));
    }

    #[test]
    fn a_spent_igniter_lights_nothing_and_low_pressure_puts_out() {
        let ignition = reference();
        let fired = Flame { igniter_fired: Some(SimTime::ZERO), ..Flame::default() };
        assert!(!ignition.advance(&fired, &conditions(2301, true, 0.2, 1e5)).lit);
        let mut flame = Flame { lit: true, was_lit: true, ..Flame::default() };
        flame = ignition.advance(&flame, &conditions(0, false, 0.05, 1.9e5));
        flame = ignition.advance(&flame, &conditions(99, false, 0.05, 1.9e5));
        assert!(flame.lit);
        assert!(!ignition.advance(&flame, &conditions(100, false, 0.05, 1.9e5)).lit);
        // A moment above the pressure starts the count again.
        let saved = ignition.advance(&flame, &conditions(99, false, 0.05, 2.1e5));
        assert!(ignition.advance(&saved, &conditions(100, false, 0.05, 1.9e5)).lit);
    }
}
