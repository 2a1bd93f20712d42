//! Aborts: the triggers that end a mission early, and the decision.
//!
//! There are two kinds. [`AbortKind::Land`] gives up the mission: a controlled landing where the vehicle is.
//! [`AbortKind::Cut`] gives up the vehicle: engine off, wherever it is. Every trigger has a name, a limit in
//! the `[mission.abort]` table and a time for which its condition has to hold without a break. A decision is
//! latched: after an abort landing the mission is not resumed, and after a cut the engine is not restarted.
//!
//! The conditions are kinematic and few, so that a recording shows them. They compare the navigation's
//! estimate, not the truth.

use super::mission::{AbortLimits, Mission};
use super::phase::Phase;
pub use crate::event::AbortReason;
use crate::time::SimTime;

/// How a mission ends early.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AbortKind {
    /// Controlled landing where the vehicle is.
    Land,
    /// Engine off.
    Cut,
}

impl AbortReason {
    /// Kind of abort.
    pub const fn kind(self) -> AbortKind {
        match self {
            Self::Toppling | Self::FlightVolume | Self::CannotStop | Self::Runaway | Self::Inertial => {
                AbortKind::Cut
            }
            _ => AbortKind::Land,
        }
    }

    /// Time for which the condition has to hold (s).
    fn confirmation_s(self, limits: &AbortLimits) -> f64 {
        match self {
            Self::Tilt => limits.tilt_s,
            Self::Wind => 1.0,
            Self::OffReference | Self::Runaway => 0.5,
            // The silence is its own confirmation.
            Self::Inertial => 0.0,
            Self::CannotStop | Self::FlightVolume => 0.2,
            Self::Toppling | Self::Propellant | Self::Navigation | Self::Guidance => 0.1,
        }
    }
}

/// A decision to abort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Abort {
    /// Kind of abort.
    pub kind: AbortKind,
    /// Trigger.
    pub reason: AbortReason,
    /// Time of the decision, on the flight computer's clock.
    pub time: SimTime,
}

/// Inputs of the abort watch, all of them estimates.
#[derive(Clone, Copy, Debug)]
pub struct AbortInputs {
    /// Propellant lasts no longer than the way down and the reserve.
    pub propellant_low: bool,
    /// Angle between the long axis and the vertical (rad).
    pub tilt_rad: f64,
    /// Satellite fixes refused in succession.
    pub gnss_refused: u32,
    /// Time since the last fix that was used (s).
    pub gnss_silence_s: f64,
    /// Time since the last range that was used (s).
    pub altimeter_silence_s: f64,
    /// Lateral acceleration by the wind (m/s²).
    pub wind_m_s2: f64,
    /// Guidance has no trajectory and no fallback left.
    pub guidance_exhausted: bool,
    /// Distance from the reference (m).
    pub off_reference_m: f64,
    /// Horizontal distance from the starting point (m).
    pub from_start_m: f64,
    /// Height of the pivot above rest (m).
    pub height_m: f64,
    /// Speed downward (m/s).
    pub descent_speed_m_s: f64,
    /// Upward acceleration under full thrust, upright (m/s²).
    pub full_thrust_m_s2: f64,
    /// Axial force less estimated thrust, over the weight.
    pub unexplained_force: f64,
}

/// The altimeter counts as lost after this silence (s).
const ALTIMETER_SILENCE_S: f64 = 1.0;
/// Least climb rate of a runaway (m/s): on the ground the legs carry a part of the weight.
const RUNAWAY_CLIMB_M_S: f64 = 1.0;
/// Least descent speed of a fall (m/s).
const FALL_M_S: f64 = 1.0;
/// Default flight volume: margin beyond the landing point and above the hover (m).
const VOLUME_BEYOND_TARGET_M: f64 = 30.0;
const VOLUME_OVER_HOVER_M: f64 = 20.0;

/// State of the abort watch over one flight.
#[derive(Clone, Debug)]
pub struct AbortWatch {
    radius_m: f64,
    ceiling_m: f64,
    /// The vehicle has been inside the flight volume.
    was_inside: bool,
    /// Time for which each condition has held, in the order of [`AbortReason::ALL`] (s).
    condition_time_s: [f64; AbortReason::ALL.len()],
    abort: Option<Abort>,
}

impl AbortWatch {
    /// Before the flight; the volume is that of the mission as it was loaded.
    pub fn new(mission: &Mission) -> Self {
        let [north, east] = mission.target_north_east_m;
        let limits = &mission.abort;
        Self {
            radius_m: limits.radius_m.unwrap_or(libm::hypot(north, east) + VOLUME_BEYOND_TARGET_M),
            ceiling_m: limits.ceiling_m.unwrap_or(mission.hover_height_m + VOLUME_OVER_HOVER_M),
            was_inside: false,
            condition_time_s: [0.0; AbortReason::ALL.len()],
            abort: None,
        }
    }

    /// The decision in force.
    pub const fn abort(&self) -> Option<Abort> {
        self.abort
    }

    /// Sets a decision that was made outside [`Self::step`].
    pub(crate) fn declare(&mut self, reason: AbortReason, time: SimTime) {
        self.abort = Some(Abort { kind: reason.kind(), reason, time });
    }

    /// One step in a phase; returns a decision in the step in which it is made.
    pub fn step(
        &mut self,
        limits: &AbortLimits,
        phase: Phase,
        inputs: &AbortInputs,
        time: SimTime,
        dt_s: f64,
    ) -> Option<Abort> {
        if !phase.is_flight() {
            return None;
        }
        let outside = inputs.from_start_m > self.radius_m || inputs.height_m > self.ceiling_m;
        let mut decided = None;
        for (reason, condition_time_s) in AbortReason::ALL.into_iter().zip(&mut self.condition_time_s) {
            let condition = match reason {
                // Leaving counts: after a hand-over outside the volume the vehicle is not cut for what
                // another pilot did.
                AbortReason::FlightVolume => self.was_inside && outside,
                _ => condition_holds(reason, limits, inputs),
            };
            let triggered = condition && may_abort(reason, limits, phase, inputs, self.abort);
            *condition_time_s = if triggered { *condition_time_s + dt_s } else { 0.0 };
            if triggered && *condition_time_s >= reason.confirmation_s(limits) && decided.is_none() {
                decided = Some(Abort { kind: reason.kind(), reason, time });
            }
        }
        self.was_inside |= !outside;
        self.abort = decided.or(self.abort);
        decided
    }
}

/// Whether a trigger may decide in this phase, after the decision made before.
fn may_abort(
    reason: AbortReason,
    limits: &AbortLimits,
    phase: Phase,
    inputs: &AbortInputs,
    decided: Option<Abort>,
) -> bool {
    match (reason.kind(), decided) {
        (AbortKind::Cut, Some(Abort { kind: AbortKind::Cut, .. })) | (AbortKind::Land, Some(_)) => false,
        (AbortKind::Cut, _) => inputs.height_m >= limits.cut_height_m,
        // A descent is already the shortest way to the ground.
        (AbortKind::Land, None) if reason == AbortReason::Propellant => {
            matches!(phase, Phase::Ascent | Phase::Hover)
        }
        (AbortKind::Land, None) => matches!(phase, Phase::Ascent | Phase::Hover | Phase::Descent),
    }
}

/// Whether the condition of a trigger holds now.
fn condition_holds(reason: AbortReason, limits: &AbortLimits, s: &AbortInputs) -> bool {
    match reason {
        AbortReason::Propellant => s.propellant_low,
        AbortReason::Tilt => s.tilt_rad > limits.tilt_rad,
        AbortReason::Navigation => {
            let no_satellites =
                s.gnss_refused >= limits.gnss_refused || s.gnss_silence_s > limits.gnss_silence_s;
            no_satellites && s.altimeter_silence_s > ALTIMETER_SILENCE_S
        }
        AbortReason::Wind => s.wind_m_s2 > limits.wind_m_s2,
        AbortReason::Guidance => s.guidance_exhausted,
        AbortReason::OffReference => s.off_reference_m > limits.tube_m,
        AbortReason::Toppling => s.tilt_rad > limits.cut_tilt_rad,
        // Decided by the watch and by the autopilot.
        AbortReason::FlightVolume | AbortReason::Inertial => false,
        AbortReason::CannotStop => {
            // v² - 2 a h is the square of the speed left at the ground.
            let v = s.descent_speed_m_s;
            let left = v * v - 2.0 * s.full_thrust_m_s2 * s.height_m;
            v > FALL_M_S
                && s.height_m > limits.ballistic_height_m
                && left > limits.impact_speed_m_s * limits.impact_speed_m_s
        }
        AbortReason::Runaway => {
            s.unexplained_force > limits.runaway_share && s.descent_speed_m_s < -RUNAWAY_CLIMB_M_S
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calm() -> AbortInputs {
        AbortInputs {
            propellant_low: false,
            tilt_rad: 0.1,
            gnss_refused: 0,
            gnss_silence_s: 0.1,
            altimeter_silence_s: 10.0,
            wind_m_s2: 0.2,
            guidance_exhausted: false,
            off_reference_m: 0.5,
            from_start_m: 1.0,
            height_m: 30.0,
            descent_speed_m_s: 0.0,
            full_thrust_m_s2: 4.0,
            unexplained_force: 0.05,
        }
    }

    /// Reason and time of what `inputs` lead to within five seconds of a phase.
    fn decision(phase: Phase, inputs: &AbortInputs) -> Option<(AbortReason, f64)> {
        let mission = Mission::default();
        let mut watch = AbortWatch::new(&mission);
        watch.step(&mission.abort, phase, &calm(), SimTime::ZERO, 0.004);
        (1..=1250).find_map(|i| {
            let time = SimTime::from_us(4000 * i);
            watch.step(&mission.abort, phase, inputs, time, 0.004).map(|a| (a.reason, a.time.s()))
        })
    }

    #[test]
    fn every_trigger_fires_at_its_limit_after_its_time() {
        let silent = AbortInputs { gnss_silence_s: 6.1, ..calm() };
        let falling = AbortInputs { descent_speed_m_s: 16.0, ..calm() };
        // Expected times in steps of 4 ms: the first that is no shorter than the confirmation.
        let cases = [
            (AbortInputs { tilt_rad: 0.263, ..calm() }, AbortReason::Tilt, 0.3),
            (AbortInputs { tilt_rad: 0.62, ..calm() }, AbortReason::Toppling, 0.1),
            (silent, AbortReason::Navigation, 0.1),
            (AbortInputs { gnss_refused: 3, ..calm() }, AbortReason::Navigation, 0.1),
            (AbortInputs { wind_m_s2: 0.86, ..calm() }, AbortReason::Wind, 1.0),
            (AbortInputs { guidance_exhausted: true, ..calm() }, AbortReason::Guidance, 0.1),
            (AbortInputs { off_reference_m: 5.1, ..calm() }, AbortReason::OffReference, 0.5),
            (AbortInputs { propellant_low: true, ..calm() }, AbortReason::Propellant, 0.1),
            (AbortInputs { from_start_m: 30.1, ..calm() }, AbortReason::FlightVolume, 0.2),
            (AbortInputs { height_m: 70.1, ..calm() }, AbortReason::FlightVolume, 0.2),
            // 16² - 2·4·30 = 16 = 4²: over the 3 m/s that are allowed.
            (falling, AbortReason::CannotStop, 0.2),
            (
                AbortInputs { unexplained_force: 0.4, descent_speed_m_s: -2.0, ..calm() },
                AbortReason::Runaway,
                0.5,
            ),
        ];
        for (inputs, reason, after_s) in cases {
            let (found, at_s) = decision(Phase::Hover, &inputs).unwrap_or_else(|| panic!("{reason:?}"));
            assert_eq!(found, reason);
            assert!(at_s >= after_s - 1e-9 && at_s < after_s + 0.005, "{reason:?} after {at_s} s");
        }
    }

    #[test]
    fn what_lies_inside_every_limit_fires_nothing() {
        let still_fine = [
            calm(),
            AbortInputs { tilt_rad: 0.26, ..calm() },
            AbortInputs { gnss_silence_s: 60.0, gnss_refused: 20, altimeter_silence_s: 0.1, ..calm() },
            // 15.4² - 240 is under 0: it stops.
            AbortInputs { descent_speed_m_s: 15.4, ..calm() },
            AbortInputs { descent_speed_m_s: 12.0, height_m: 4.0, ..calm() },
            AbortInputs { unexplained_force: 1.0, descent_speed_m_s: 0.0, ..calm() },
            AbortInputs { tilt_rad: f64::NAN, wind_m_s2: f64::NAN, from_start_m: f64::NAN, ..calm() },
        ];
        for inputs in still_fine {
            assert_eq!(decision(Phase::Hover, &inputs), None, "{inputs:?}");
        }
        // On the pad and after contact nothing is judged, low down nothing cuts.
        let bad = AbortInputs { tilt_rad: 1.0, propellant_low: true, ..calm() };
        for phase in [Phase::Ignition, Phase::Touchdown, Phase::Shutdown, Phase::AbortCut] {
            assert_eq!(decision(phase, &bad), None);
        }
        assert_eq!(decision(Phase::Terminal, &AbortInputs { height_m: 0.4, ..bad }), None);
    }

    #[test]
    fn an_interrupted_condition_starts_again() {
        let mission = Mission::default();
        let mut watch = AbortWatch::new(&mission);
        for i in 0..10_000u64 {
            let inputs = AbortInputs { tilt_rad: if i % 70 == 0 { 0.1 } else { 0.3 }, ..calm() };
            let time = SimTime::from_us(4000 * i);
            // 69 steps of 4 ms are 276 ms of the 300 ms that it takes.
            assert_eq!(watch.step(&mission.abort, Phase::Hover, &inputs, time, 0.004), None);
        }
    }

    #[test]
    fn a_decision_stands_and_only_a_cut_comes_over_a_landing() {
        let mission = Mission::default();
        let mut watch = AbortWatch::new(&mission);
        let mut run = |phase, inputs: AbortInputs| {
            (0..500).find_map(|i| {
                watch
                    .step(&mission.abort, phase, &inputs, SimTime::from_us(4000 * i), 0.004)
                    .map(|a| a.reason)
            })
        };
        assert_eq!(run(Phase::Hover, AbortInputs { wind_m_s2: 1.0, ..calm() }), Some(AbortReason::Wind));
        assert_eq!(run(Phase::AbortLand, AbortInputs { guidance_exhausted: true, ..calm() }), None);
        assert_eq!(
            run(Phase::AbortLand, AbortInputs { tilt_rad: 0.7, ..calm() }),
            Some(AbortReason::Toppling)
        );
        assert_eq!(run(Phase::AbortCut, AbortInputs { from_start_m: 99.0, ..calm() }), None);
        assert_eq!(watch.abort().map(|a| a.reason), Some(AbortReason::Toppling));
    }

    #[test]
    fn who_takes_over_outside_the_volume_is_not_cut() {
        let mission = Mission::default();
        let mut watch = AbortWatch::new(&mission);
        for i in 0..1000 {
            let inputs = AbortInputs { from_start_m: 80.0, ..calm() };
            let time = SimTime::from_us(4000 * i);
            assert_eq!(watch.step(&mission.abort, Phase::Hover, &inputs, time, 0.004), None);
        }
    }
}
