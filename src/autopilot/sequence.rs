//! The mission sequence: which phase the flight is in, and what ends it.
//!
//! The sequence is a chain. Each phase ends on evidence from the sensors (chamber lit, height reached,
//! contact), and where evidence may never come, on time. An abort ([`super::abort`]) is the only branch: it
//! is entered from outside and joins the chain again at the terminal phase or at disarmed.

use super::mission::Mission;
use super::phase::Phase;

/// Times and thresholds of the sequence that belong to the vehicle, not to the mission.
#[derive(Clone, Debug, PartialEq)]
pub struct SequenceParameters {
    /// Chamber pressure that proves ignition (Pa).
    pub lit_pressure_pa: f64,
    /// From proven or assumed ignition to the climb: the thrust rise (s).
    pub thrust_rise_s: f64,
    /// Without a chamber transducer, ignition is assumed this long after the throttle (s).
    pub assumed_ignition_s: f64,
    /// Without proof of ignition, the start is given up after this (s).
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

/// Inputs of the sequence, estimated or measured.
#[derive(Clone, Copy, Debug)]
pub struct SequenceInputs {
    /// The filter has been aligned.
    pub aligned: bool,
    /// Newest chamber pressure, if there is a transducer (Pa).
    pub chamber_pa: Option<f64>,
    /// Height of the pivot above rest (m).
    pub height_m: f64,
    /// Speed downward (m/s).
    pub descent_speed_m_s: f64,
    /// Axial force less estimated thrust, over the weight: the share of the weight that the ground carries.
    pub unexplained_force: f64,
    /// The reference has reached the hover height.
    pub reference_at_hover: bool,
    /// The reference is over the landing point.
    pub reference_over_target: bool,
}

/// State of the sequence.
#[derive(Clone, Debug)]
pub struct Sequence {
    phase: Phase,
    time_in_phase_s: f64,
    /// Time since proof of ignition (s).
    lit_time_s: f64,
    /// Time that contact has been detected without a break (s).
    contact_time_s: f64,
}

/// Time for which contact must be detected: two inertial samples, against a single bad one (s).
const CONTACT_CONFIRMATION_S: f64 = 0.008;
/// Above the height of contact, a stop counts as contact only this long after a phase of the descent began
/// (s): before, it may be the end of braking, whose thrust the engine model follows late.
const BRAKING_IN_TERMINAL_S: f64 = 1.0;
const BRAKING_IN_DESCENT_S: f64 = 2.0;
/// Height below which the vehicle may be in contact (m).
const CONTACT_HEIGHT_M: f64 = 0.10;
/// Share of the terminal speed below which the vehicle has stopped.
const STOPPED_SHARE: f64 = 0.45;
/// Shares of the weight that the ground carries at contact, in the terminal phase and before it.
const CONTACT_FORCE_TERMINAL: f64 = 0.25;
const CONTACT_FORCE_DESCENT: f64 = 0.5;
/// From contact to engine shutdown (s).
const TOUCHDOWN_TIME_S: f64 = 0.3;
/// The hover ends at the latest this long after its time, whether the target is reached or not (s).
const TARGET_WAIT_S: f64 = 20.0;

impl Default for Sequence {
    fn default() -> Self {
        Self::starting_at(Phase::Align)
    }
}

impl Sequence {
    /// In the given phase, just entered.
    const fn starting_at(phase: Phase) -> Self {
        Self { phase, time_in_phase_s: 0.0, lit_time_s: 0.0, contact_time_s: 0.0 }
    }

    /// The present phase.
    pub const fn phase(&self) -> Phase {
        self.phase
    }

    /// Time since the present phase began (s).
    pub(crate) const fn time_in_phase_s(&self) -> f64 {
        self.time_in_phase_s
    }

    /// Enters `phase` with `elapsed_s` of it already done.
    pub fn enter(&mut self, phase: Phase, elapsed_s: f64) {
        *self = Self::starting_at(phase);
        self.time_in_phase_s = elapsed_s;
    }

    /// Advances by `dt_s`; at most one change of phase.
    pub fn step(
        &mut self,
        mission: &Mission,
        parameters: &SequenceParameters,
        e: &SequenceInputs,
        dt_s: f64,
    ) {
        self.time_in_phase_s += dt_s;
        self.update_lit_time(parameters, e, dt_s);
        self.update_contact_time(mission, e, dt_s);
        if let Some(next) = self.next_phase(mission, parameters, e) {
            self.enter(next, 0.0);
        }
    }

    fn next_phase(
        &self,
        mission: &Mission,
        parameters: &SequenceParameters,
        e: &SequenceInputs,
    ) -> Option<Phase> {
        let t = self.time_in_phase_s;
        let contact = self.contact_time_s >= CONTACT_CONFIRMATION_S;
        match self.phase {
            Phase::Align => e.aligned.then_some(Phase::Ready),
            Phase::Ready => (t >= mission.ready_s).then_some(Phase::Ignition),
            Phase::Ignition if self.lit_time_s >= parameters.thrust_rise_s => Some(Phase::Ascent),
            Phase::Ignition => (t >= parameters.ignition_timeout_s).then_some(Phase::Shutdown),
            Phase::Ascent => e.reference_at_hover.then_some(Phase::Hover),
            Phase::Hover => {
                let at_target = e.reference_over_target || t >= mission.hover_time_s + TARGET_WAIT_S;
                (t >= mission.hover_time_s && at_target).then_some(Phase::Descent)
            }
            Phase::Descent | Phase::AbortLand if contact => Some(Phase::Touchdown),
            Phase::Descent | Phase::AbortLand => {
                (e.height_m <= mission.terminal_height_m).then_some(Phase::Terminal)
            }
            Phase::Terminal => contact.then_some(Phase::Touchdown),
            Phase::Touchdown => (t >= TOUCHDOWN_TIME_S).then_some(Phase::Shutdown),
            Phase::Shutdown | Phase::AbortCut => (t >= parameters.disarm_after_s).then_some(Phase::Done),
            Phase::Done => None,
        }
    }

    fn update_lit_time(&mut self, parameters: &SequenceParameters, e: &SequenceInputs, dt_s: f64) {
        let lit = self.phase == Phase::Ignition
            && match e.chamber_pa {
                Some(p) => p >= parameters.lit_pressure_pa,
                None => self.time_in_phase_s >= parameters.assumed_ignition_s,
            };
        self.lit_time_s = if lit { self.lit_time_s + dt_s } else { 0.0 };
    }

    /// Contact is two of three signs: low, stopped against the command to descend, carried by a force other
    /// than thrust. Without the first, the phase must have lasted: on the ground the other two persist, so
    /// that this costs at most a second or two on the legs.
    fn update_contact_time(&mut self, mission: &Mission, e: &SequenceInputs, dt_s: f64) {
        let low = e.height_m < CONTACT_HEIGHT_M;
        let stopped = e.descent_speed_m_s < STOPPED_SHARE * mission.terminal_speed_m_s;
        let carried = e.unexplained_force > CONTACT_FORCE_TERMINAL;
        let contact = match self.phase {
            Phase::Terminal if low => stopped || carried,
            Phase::Terminal => self.time_in_phase_s > BRAKING_IN_TERMINAL_S && stopped && carried,
            // A vehicle that meets the ground with a wrong height estimate is stopped hard.
            Phase::Descent | Phase::AbortLand => {
                self.time_in_phase_s > BRAKING_IN_DESCENT_S
                    && stopped
                    && e.unexplained_force > CONTACT_FORCE_DESCENT
            }
            _ => false,
        };
        self.contact_time_s = if contact { self.contact_time_s + dt_s } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inputs(height_m: f64, descent_speed_m_s: f64, unexplained_force: f64) -> SequenceInputs {
        SequenceInputs {
            aligned: true,
            chamber_pa: None,
            height_m,
            descent_speed_m_s,
            unexplained_force,
            reference_at_hover: false,
            reference_over_target: false,
        }
    }

    /// Seconds in the terminal phase until contact is confirmed, up to three.
    fn contact_after_s(inputs: impl Fn(f64) -> SequenceInputs) -> Option<f64> {
        let (mission, parameters) = (Mission::default(), SequenceParameters::default());
        let mut sequence = Sequence::starting_at(Phase::Terminal);
        (1..=750).map(|i| 0.004 * f64::from(i)).find(|&t| {
            sequence.step(&mission, &parameters, &inputs(t), 0.004);
            sequence.phase() == Phase::Touchdown
        })
    }

    #[test]
    fn the_end_of_braking_is_no_touchdown() {
        // Braked too far, by thrust that the model has not followed yet, then descending as commanded.
        let braked = |t: f64| if t < 0.5 { inputs(1.5, 0.24, 0.3) } else { inputs(1.2, 0.8, 0.02) };
        assert_eq!(contact_after_s(braked), None);
        // At rest with the height estimated too high: confirmed a second later.
        let at_rest_s = contact_after_s(|_| inputs(0.8, 0.0, 0.4)).unwrap();
        assert!((at_rest_s - 1.0).abs() < 0.02, "{at_rest_s}");
        // Low, any other sign is enough, at the second sample.
        assert_eq!(contact_after_s(|_| inputs(0.05, 0.0, 0.0)), Some(0.008));
        assert_eq!(contact_after_s(|_| inputs(0.05, 0.8, 0.4)), Some(0.008));
        assert_eq!(contact_after_s(|_| inputs(0.05, 0.8, 0.0)), None);
    }
}
