//! Mission and sequence: what is to be flown, and which part of it the vehicle is in.
//!
//! The sequence is a chain, from alignment on the pad to disarmed on the pad. Each step is left on evidence
//! from the sensors (chamber lit, height reached, contact), and where evidence may never come, on time.
//! An abort ([`super::abort`]) is the only branch: it is entered from outside and joins the chain again at
//! the last metres or at disarmed.

use super::abort::AbortLimits;
pub use crate::event::Phase;
use serde::{Deserialize, Serialize};

impl Phase {
    /// Thrust and attitude are under feedback.
    pub const fn is_flight(self) -> bool {
        matches!(self, Self::Ascent | Self::Hover | Self::Descent | Self::Terminal | Self::AbortLand)
    }

    /// Before the engine is commanded to lift: the vehicle certainly stands where it was put.
    pub const fn is_before_lift_off(self) -> bool {
        matches!(self, Self::Align | Self::Ready | Self::Ignition)
    }
}

/// What kind of flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MissionKind {
    /// Up, hover, down.
    #[default]
    Hop,
}

/// What the autopilot believes of the vehicle's mass properties.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MassKnowledge {
    /// They follow the propellant that its engine model says is gone.
    #[default]
    Live,
    /// They stay as they were loaded, to see what the knowledge is worth.
    Liftoff,
}

/// What lays out the way up and the way down.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GuidanceLaw {
    /// Least fuel for 1.2 times the least flight time under the engine's thrust band, by lossless convexification; replanned on the way down. Ramps at the speed limits are shorter and use less.
    #[default]
    Lcvx,
    /// Closed-form ramps of the accelerations below.
    Ramps,
}

/// What turns a reference into thrust and moments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ControlLaw {
    /// Model-predictive control with the cascade as its last rung.
    #[default]
    Predictive,
    /// The cascaded loops alone.
    Cascaded,
}

/// The `[mission]` table of a scenario. Heights are of the pivot above its rest height.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mission {
    /// Kind of flight.
    pub kind: MissionKind,
    /// What the autopilot believes of mass, centre of mass and inertia in flight.
    pub mass_knowledge: MassKnowledge,
    /// What lays out climb and descent.
    pub guidance: GuidanceLaw,
    /// What follows the reference.
    pub control: ControlLaw,
    /// Greatest speed of the climb (m/s).
    #[schemars(range(min = 0.2, max = 20.0))]
    pub ascent_speed_m_s: f64,
    /// Height of the hover above rest (m).
    #[schemars(range(min = 0.5, max = 500.0))]
    pub hover_height_m: f64,
    /// Time at the hover height (s).
    #[schemars(range(min = 0.0, max = 120.0))]
    pub hover_time_s: f64,
    /// Greatest speed of the descent (m/s).
    #[schemars(range(min = 0.2, max = 20.0))]
    pub descent_speed_m_s: f64,
    /// Height above rest at which the constant final speed begins (m).
    #[schemars(range(min = 0.3, max = 20.0))]
    pub terminal_height_m: f64,
    /// Greatest speed from there to contact (m/s).
    #[schemars(range(min = 0.2, max = 2.0))]
    pub terminal_speed_m_s: f64,
    /// Vertical acceleration of every ramp (m/s²).
    #[schemars(range(min = 0.1, max = 4.0))]
    pub acceleration_m_s2: f64,
    /// Greatest sideways speed (m/s).
    #[schemars(range(min = 0.1, max = 10.0))]
    pub lateral_speed_m_s: f64,
    /// Sideways acceleration of every ramp (m/s²).
    #[schemars(range(min = 0.1, max = 3.0))]
    pub lateral_acceleration_m_s2: f64,
    /// Landing point, north and east of the starting point (m).
    #[schemars(inner(range(min = -500.0, max = 500.0)))]
    pub target_north_east_m: [f64; 2],
    /// Greatest tilt that may be commanded (rad).
    #[schemars(range(min = 0.02, max = 0.6))]
    pub tilt_limit_rad: f64,
    /// Time at rest that the alignment averages over (s).
    #[schemars(range(min = 1.0, max = 60.0))]
    pub alignment_s: f64,
    /// Time between arming and throttle, for the isolation valve (s).
    #[schemars(range(min = 0.0, max = 60.0))]
    pub ready_s: f64,
    /// What ends the mission early.
    pub abort: AbortLimits,
}

impl Default for Mission {
    fn default() -> Self {
        Self {
            kind: MissionKind::Hop,
            mass_knowledge: MassKnowledge::default(),
            guidance: GuidanceLaw::default(),
            control: ControlLaw::default(),
            ascent_speed_m_s: 6.0,
            hover_height_m: 50.0,
            hover_time_s: 10.0,
            descent_speed_m_s: 5.0,
            terminal_height_m: 1.5,
            terminal_speed_m_s: 0.8,
            acceleration_m_s2: 1.6,
            lateral_speed_m_s: 2.0,
            lateral_acceleration_m_s2: 0.8,
            target_north_east_m: [0.0, 0.0],
            tilt_limit_rad: 0.21,
            alignment_s: 3.0,
            ready_s: 1.5,
            abort: AbortLimits::default(),
        }
    }
}

/// Times and thresholds of the sequence that belong to the vehicle, not to the mission.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceParameters {
    /// Chamber pressure that proves a flame (Pa).
    pub lit_pressure_pa: f64,
    /// Wait between proof of flame (or the time below) and the climb: the thrust rise (s).
    pub thrust_rise_s: f64,
    /// Without a chamber transducer, the flame is assumed this long after the throttle (s).
    pub assumed_ignition_s: f64,
    /// With one, the attempt is given up after this (s).
    pub ignition_timeout_s: f64,
    /// From engine off to disarmed (s).
    pub disarm_after_s: f64,
}

impl Default for SequenceParameters {
    fn default() -> Self {
        Self {
            lit_pressure_pa: 4.0e5,
            thrust_rise_s: 0.6,
            assumed_ignition_s: 0.5,
            ignition_timeout_s: 5.0,
            disarm_after_s: 2.0,
        }
    }
}

/// What the sequence decides on, all of it estimated or measured.
#[derive(Clone, Copy, Debug)]
pub struct Evidence {
    /// The filter has been aligned.
    pub aligned: bool,
    /// Newest chamber pressure, if there is a transducer (Pa).
    pub chamber_pa: Option<f64>,
    /// Height of the pivot above rest (m).
    pub height_m: f64,
    /// Speed downward (m/s).
    pub descent_speed_m_s: f64,
    /// Axial specific force times mass, less the thrust that is expected, over the weight: the share
    /// of the weight that something else carries.
    pub unexplained_force: f64,
    /// The reference stands at the hover height.
    pub reference_at_hover: bool,
    /// The reference stands over the landing point.
    pub reference_over_target: bool,
}

/// The running sequence.
#[derive(Clone, Debug)]
pub struct Sequence {
    phase: Phase,
    time_in_phase_s: f64,
    flame_for_s: f64,
    contact_for_s: f64,
}

/// Contact has to be seen for this long: two IMU samples, against a single bad one.
const CONTACT_CONFIRMATION_S: f64 = 0.008;
/// Without a low height, a stop counts as contact only so long after a phase of the descent began: before, it may
/// be the end of the braking, whose thrust the engine model follows late.
const SETTLED_IN_TERMINAL_S: f64 = 1.0;
const SETTLED_IN_DESCENT_S: f64 = 2.0;
/// The hover ends at the latest this long after its time, target reached or not.
const TARGET_WAIT_S: f64 = 20.0;

impl Default for Sequence {
    fn default() -> Self {
        Self::starting_at(Phase::Align)
    }
}

impl Sequence {
    /// In the given phase, just entered.
    pub const fn starting_at(phase: Phase) -> Self {
        Self { phase, time_in_phase_s: 0.0, flame_for_s: 0.0, contact_for_s: 0.0 }
    }

    /// The present phase.
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// Time since the present phase began (s).
    pub const fn time_in_phase_s(&self) -> f64 {
        self.time_in_phase_s
    }

    /// Enters `phase` with `elapsed_s` of it already done.
    pub fn enter(&mut self, phase: Phase, elapsed_s: f64) {
        *self = Self::starting_at(phase);
        self.time_in_phase_s = elapsed_s;
    }

    /// Advances by `dt_s`; at most one change of phase.
    pub fn step(&mut self, mission: &Mission, parameters: &SequenceParameters, e: &Evidence, dt_s: f64) {
        self.time_in_phase_s += dt_s;
        self.watch_flame(parameters, e, dt_s);
        self.watch_contact(mission, e, dt_s);
        if let Some(next) = self.next_phase(mission, parameters, e) {
            self.enter(next, 0.0);
        }
    }

    fn next_phase(&self, mission: &Mission, parameters: &SequenceParameters, e: &Evidence) -> Option<Phase> {
        let t = self.time_in_phase_s;
        let contact = self.contact_for_s >= CONTACT_CONFIRMATION_S;
        match self.phase {
            Phase::Align => e.aligned.then_some(Phase::Ready),
            Phase::Ready => (t >= mission.ready_s).then_some(Phase::Ignition),
            Phase::Ignition if self.flame_for_s >= parameters.thrust_rise_s => Some(Phase::Ascent),
            Phase::Ignition => (t >= parameters.ignition_timeout_s).then_some(Phase::Shutdown),
            Phase::Ascent => e.reference_at_hover.then_some(Phase::Hover),
            Phase::Hover => {
                let there = e.reference_over_target || t >= mission.hover_time_s + TARGET_WAIT_S;
                (t >= mission.hover_time_s && there).then_some(Phase::Descent)
            }
            Phase::Descent | Phase::AbortLand if contact => Some(Phase::Touchdown),
            Phase::Descent | Phase::AbortLand => {
                (e.height_m <= mission.terminal_height_m).then_some(Phase::Terminal)
            }
            Phase::Terminal => contact.then_some(Phase::Touchdown),
            Phase::Touchdown => (t >= 0.3).then_some(Phase::Shutdown),
            Phase::Shutdown | Phase::AbortCut => (t >= parameters.disarm_after_s).then_some(Phase::Done),
            Phase::Done => None,
        }
    }

    fn watch_flame(&mut self, parameters: &SequenceParameters, e: &Evidence, dt_s: f64) {
        let burning = self.phase == Phase::Ignition
            && match e.chamber_pa {
                Some(p) => p >= parameters.lit_pressure_pa,
                None => self.time_in_phase_s >= parameters.assumed_ignition_s,
            };
        self.flame_for_s = if burning { self.flame_for_s + dt_s } else { 0.0 };
    }

    /// Two of three: low, stopped though told to sink, carried by something that is not thrust. Who is not low must
    /// have had time to sink. On the ground both signs last, so waiting costs a second on its feet at most.
    fn watch_contact(&mut self, mission: &Mission, e: &Evidence, dt_s: f64) {
        let low = e.height_m < 0.10;
        let stopped = e.descent_speed_m_s < 0.45 * mission.terminal_speed_m_s;
        let carried = e.unexplained_force > 0.25;
        let contact = match self.phase {
            Phase::Terminal if low => stopped || carried,
            Phase::Terminal => self.time_in_phase_s > SETTLED_IN_TERMINAL_S && stopped && carried,
            // A vehicle that meets the ground while it believes to be high is stopped hard.
            Phase::Descent | Phase::AbortLand => {
                self.time_in_phase_s > SETTLED_IN_DESCENT_S && stopped && e.unexplained_force > 0.5
            }
            _ => false,
        };
        self.contact_for_s = if contact { self.contact_for_s + dt_s } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(height_m: f64, descent_speed_m_s: f64, unexplained_force: f64) -> Evidence {
        Evidence {
            aligned: true,
            chamber_pa: None,
            height_m,
            descent_speed_m_s,
            unexplained_force,
            reference_at_hover: false,
            reference_over_target: false,
        }
    }

    /// Seconds in the terminal phase until contact is believed, up to three.
    fn contact_after_s(evidence: impl Fn(f64) -> Evidence) -> Option<f64> {
        let (mission, parameters) = (Mission::default(), SequenceParameters::default());
        let mut sequence = Sequence::starting_at(Phase::Terminal);
        (1..=750).map(|i| 0.004 * f64::from(i)).find(|&t| {
            sequence.step(&mission, &parameters, &evidence(t), 0.004);
            sequence.phase() == Phase::Touchdown
        })
    }

    #[test]
    fn the_end_of_braking_is_no_touchdown() {
        // Braked too far, by thrust that the model has not followed yet, then sinking as told.
        let braked = |t: f64| if t < 0.5 { seen(1.5, 0.24, 0.3) } else { seen(1.2, 0.8, 0.02) };
        assert_eq!(contact_after_s(braked), None);
        // Standing where the estimate has it too high: believed, a second later.
        let standing = contact_after_s(|_| seen(0.8, 0.0, 0.4)).unwrap();
        assert!((standing - 1.0).abs() < 0.02, "{standing}");
        // Low, any other sign is enough, at the second sample.
        assert_eq!(contact_after_s(|_| seen(0.05, 0.0, 0.0)), Some(0.008));
        assert_eq!(contact_after_s(|_| seen(0.05, 0.8, 0.4)), Some(0.008));
        assert_eq!(contact_after_s(|_| seen(0.05, 0.8, 0.0)), None);
    }
}
