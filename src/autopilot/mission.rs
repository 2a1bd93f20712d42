//! The `[mission]` table of a scenario: what is to be flown, and what ends it early.

use serde::{Deserialize, Serialize};

/// Kind of flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MissionKind {
    /// Up, hover, down.
    #[default]
    Hop,
}

/// How the autopilot estimates the mass properties in flight.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MassKnowledge {
    /// From the propellant used, by the engine model.
    #[default]
    Live,
    /// Constant, as at lift-off; for studies of what the estimate is worth.
    Liftoff,
}

/// Guidance of climb and descent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GuidanceLaw {
    /// Least fuel over 1.2 times the least flight time, by lossless convexification; replanned during the descent.
    #[default]
    Lcvx,
    /// Closed-form ramps at the accelerations below. At the speed limits they take less time and less fuel.
    Ramps,
}

/// Tracking control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ControlLaw {
    /// Model-predictive control; the cascaded loops are its last fallback.
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
    /// How the autopilot estimates mass, centre of mass and inertia in flight.
    pub mass_knowledge: MassKnowledge,
    /// Guidance of climb and descent.
    pub guidance: GuidanceLaw,
    /// Tracking control.
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

/// The `[mission.abort]` table: limits of the flight. Heights are of the pivot above its rest height.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AbortLimits {
    /// `propellant`, a landing: endurance kept beyond the time of the descent (s).
    #[schemars(range(min = 0.0, max = 60.0))]
    pub reserve_s: f64,
    /// `tilt`, a landing: greatest tilt (rad); must exceed `mission.tilt_limit_rad`.
    #[schemars(range(min = 0.05, max = 1.5))]
    pub tilt_rad: f64,
    /// `tilt`: time above it (s).
    #[schemars(range(min = 0.0, max = 5.0))]
    pub tilt_s: f64,
    /// `navigation`, a landing: satellite fixes refused in succession while the altimeter is silent.
    #[schemars(range(min = 1, max = 100))]
    pub gnss_refused: u32,
    /// `navigation`, a landing: time without a used satellite fix while the altimeter is silent (s).
    #[schemars(range(min = 0.2, max = 60.0))]
    pub gnss_silence_s: f64,
    /// `wind`, a landing: greatest lateral acceleration by the wind, for a second (m/s²).
    #[schemars(range(min = 0.05, max = 10.0))]
    pub wind_m_s2: f64,
    /// `off_reference`, a landing: greatest distance from the reference (m).
    #[schemars(range(min = 0.5, max = 200.0))]
    pub tube_m: f64,
    /// `toppling`, a cut: greatest tilt (rad).
    #[schemars(range(min = 0.1, max = 3.0))]
    pub cut_tilt_rad: f64,
    /// `flight_volume`, a cut: radius about the starting point (m); absent: 30 m beyond the landing point.
    #[schemars(range(min = 1.0, max = 5000.0))]
    pub radius_m: Option<f64>,
    /// `flight_volume`, a cut: height of its ceiling (m); absent: 20 m over the hover.
    #[schemars(range(min = 1.0, max = 5000.0))]
    pub ceiling_m: Option<f64>,
    /// `cannot_stop`, a cut: greatest speed at the ground after braking with full thrust (m/s).
    #[schemars(range(min = 0.5, max = 50.0))]
    pub impact_speed_m_s: f64,
    /// `cannot_stop`: height below which the engine stays on, to brake (m).
    #[schemars(range(min = 0.0, max = 500.0))]
    pub ballistic_height_m: f64,
    /// `runaway`, a cut: excess of thrust over its command in a climb, as a share of the weight.
    #[schemars(range(min = 0.05, max = 5.0))]
    pub runaway_share: f64,
    /// `inertial`, a cut: time without an inertial sample (s); after 60 ms thrust equals the weight.
    #[schemars(range(min = 0.1, max = 5.0))]
    pub inertial_silence_s: f64,
    /// Height below which no trigger cuts the engine (m).
    #[schemars(range(min = 0.0, max = 50.0))]
    pub cut_height_m: f64,
}

impl Default for AbortLimits {
    fn default() -> Self {
        Self {
            reserve_s: 2.0,
            tilt_rad: 0.262,
            tilt_s: 0.3,
            gnss_refused: 3,
            gnss_silence_s: 6.0,
            wind_m_s2: 0.85,
            tube_m: 5.0,
            cut_tilt_rad: 0.61,
            radius_m: None,
            ceiling_m: None,
            impact_speed_m_s: 3.0,
            ballistic_height_m: 5.0,
            runaway_share: 0.35,
            inertial_silence_s: 0.5,
            cut_height_m: 0.5,
        }
    }
}
