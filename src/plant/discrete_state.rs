//! What is discrete in the plant: constant inside a step, changed between steps.
//!
//! [`StepInputs`] is what the rate of the continuous state is a function of, beside the state itself;
//! [`SolverState`] is read by the rate too, but not compared; [`DiscreteState`] is read by no stage of the
//! integrator.

use nalgebra::Vector2;

use super::fault::{FaultMemory, FaultState};
use crate::actuator::{DelayLine, ServoMemory};
use crate::disturbance::Effect;
use crate::dynamics::landing_gear::{Anchors, Grip};
use crate::propulsion::{FeedGrid, FeedInput, Flame, ImplicitMethod, Modulator, PairLevels, WarmStart};
use crate::signal::Throttle;
use crate::time::SimTime;

/// Discrete inputs of the rate of the state: with equal inputs, time and wind a state has the same rate,
/// which is what [`super::CachedRate`] rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StepInputs {
    /// Valve angle and gimbal angles as they reach the servos (rad).
    pub(super) valve_command_rad: f64,
    pub(super) gimbal_command_rad: Vector2<f64>,
    /// Play and friction of the servos.
    pub(super) valve_memory: ServoMemory,
    pub(super) gimbal_memory: [ServoMemory; 2],
    /// Openings, 0 shut to 1 open.
    pub(super) isolation_opening: f64,
    pub(super) vent_opening: f64,
    /// Share of the step in which the valves of each thruster pair are open.
    pub(super) rcs_duty: PairLevels,
    pub(super) grip: Grip,
    pub(super) anchors: Anchors,
    /// The grain burns.
    pub(super) lit: bool,
    pub(super) ignition_time: Option<SimTime>,
    /// Usable fuel below which the flame fades (kg); zero while there is plenty.
    pub(super) fading_fuel_kg: f64,
    pub(super) nitrous_depleted: bool,
    /// Weight of the liquid at the valve when the step began (Pa).
    pub(super) static_head_pa: f64,
    pub(super) disturbance: Effect,
    pub(super) faults: FaultState,
}

/// What solvers carry from step to step. Whoever moves the grid drops the cached rate. The warm start moves a
/// solution by less than its tolerance; but a tank outlet that draws gas has its gas share from the last
/// inlet pressure, and the first stage of a step sees that one step older than the others do.
#[derive(Clone, Debug)]
pub(super) struct SolverState {
    pub(super) feed: FeedGrid,
    pub(super) feed_start: FeedStart,
    pub(super) warm_start: WarmStartPredictor,
}

/// What the sequence, the controllers and the events remember.
#[derive(Clone, Debug)]
pub(super) struct DiscreteState {
    pub(super) valve_delay: DelayLine<f64>,
    pub(super) gimbal_delay: DelayLine<[f64; 2]>,
    pub(super) modulator: Modulator,
    /// What the engine controller made of the throttle.
    pub(super) demand: Demand,
    pub(super) igniter_on: bool,
    pub(super) flame: Flame,
    /// Fuel flow of the fully burning oxidiser at the last step (kg/s).
    pub(super) fully_lit_fuel_kg_s: f64,
    pub(super) burnt_through: bool,
    pub(super) bottle_low: bool,
    pub(super) tank_high: bool,
    /// When the engine controller last could not give what was asked for.
    pub(super) last_saturation: Option<SimTime>,
    /// The balance of momentum had no solution.
    pub(super) balance_singular: bool,
    pub(super) fault_memory: FaultMemory,
}

/// What the feed system's own steps start from, with a feed that stores. It acts after the beginning of a
/// step only.
#[derive(Clone, Copy, Debug)]
pub(super) struct FeedStart {
    /// What drove the feed system when the step began.
    pub(super) input: FeedInput,
    /// How finely it is resolved.
    pub(super) method: ImplicitMethod,
    /// Growth of the liquid's weight in a step (Pa).
    pub(super) head_trend_pa: f64,
}

/// Where the engine's solver begins: the last solution, extrapolated by Newton's backward differences.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WarmStartPredictor {
    pub(super) last: WarmStart,
    /// First and second differences per step of the two pressures (Pa), injector inlet and chamber.
    trend_pa: [[f64; 2]; 2],
}

/// What the engine controller made of the throttle, and when.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demand {
    pub(super) throttle: Throttle,
    pub(super) solved_at: Option<SimTime>,
    pub(super) valve_rad: f64,
    pub(super) thrust_n: f64,
}

impl WarmStartPredictor {
    /// `step_fraction` of a step after the last solution.
    pub(super) fn at(&self, step_fraction: f64) -> WarmStart {
        let mut start = self.last;
        let (first, second) = (step_fraction, 0.5 * step_fraction * (step_fraction + 1.0));
        let [inlet, chamber] = &self.trend_pa;
        start.injector_inlet_pa += first * inlet[0] + second * inlet[1];
        start.chamber.pressure.pa += first * chamber[0] + second * chamber[1];
        start
    }

    /// Takes in the solution at the end of a step.
    pub(super) fn update(&mut self, next: WarmStart) {
        let both_flow = self.last.injector_inlet_pa > 0.0 && next.injector_inlet_pa > 0.0;
        let before = [self.last.injector_inlet_pa, self.last.chamber.pressure.pa];
        let now = [next.injector_inlet_pa, next.chamber.pressure.pa];
        self.trend_pa = if both_flow {
            std::array::from_fn(|k| {
                let first = now[k] - before[k];
                [first, first - self.trend_pa[k][0]]
            })
        } else {
            Default::default()
        };
        self.last = next;
    }
}
