//! The plant: what the vehicle does with its commands, from the valve to the feet.
//!
//! [`Plant::step`] is the block diagram. [`Plant::evaluate`] is its continuous part, pure, called once
//! per stage of the integrator: servos, feed, combustion, mass, loads, balance of momentum. Whatever is
//! discrete happens between steps: commands and their delays, the ignition sequence, strokes of the
//! isolation and vent valves, contact anchors, pulses of the thrusters, events.

mod sequence;
pub mod signs;
mod state;

pub use sequence::{Events, PlantEvent};
pub use state::{Rate, State};

use nalgebra::{UnitQuaternion, Vector2};

use crate::actuator::{DelayLine, Servo, ServoState, StrokeValve};
use crate::dynamics::landing_gear::{Contact, PadAnchors};
use crate::dynamics::mass::{Contents, ContentsRate, FlowTerms, MassProperties, Outflow};
use crate::dynamics::rigid_body::{self, Acceleration, Balance, GimbalMotion, Swing, thrust_direction_body};
use crate::dynamics::slosh::SloshState;
use crate::dynamics::Load;
use crate::environment::Environment;
use crate::frame::{Mat3, Vec3, quaternion_rate, structural_from_frd};
use crate::input::Invalid;
use crate::integrator::rk4_step;
use crate::propulsion::{EngineCondition, FeedMap, Guess, OperatingPoint, PressurantState};
use crate::scenario::{EngineStart, GimbalActuator, Place, Scenario};
use crate::signal::{ActuatorCommand, Throttle};
use crate::time::SimTime;
use crate::vehicle::Vehicle;

use sequence::Sequence;

/// The plant's step [us].
pub const STEP: SimTime = SimTime::from_us(1_000);

/// The vehicle in its world.
pub struct Plant {
    vehicle: Vehicle,
    environment: Environment,
    options: Options,
    time: SimTime,
    state: State,
    held: Held,
    sequence: Sequence,
    initial_mass_kg: f64,
}

/// What a scenario idealises.
#[derive(Clone, Copy, Debug)]
struct Options {
    /// There is ground to stand on.
    ground: bool,
    /// A stand holds the vehicle for the whole run.
    clamped: bool,
    /// Valve and thrusters follow at once.
    ideal: bool,
    /// The gimbal follows at once.
    ideal_gimbal: bool,
}

/// Everything discrete: constant inside a step.
#[derive(Clone, Debug)]
struct Held {
    /// Valve angle that the servo is told [rad].
    valve_command_rad: f64,
    /// Gimbal angles that the servos are told [rad].
    gimbal_command_rad: Vector2<f64>,
    valve_delay: DelayLine<f64>,
    gimbal_delay: DelayLine<[f64; 2]>,
    /// Gimbal angles behind the play [rad].
    gimbal_play_rad: Vector2<f64>,
    valve_play_rad: f64,
    /// Openings, 0 shut to 1 open.
    isolation: f64,
    vent: f64,
    /// A stand or the hold-down keeps the vehicle where it is.
    fixed: bool,
    anchors: PadAnchors,
    feed: FeedMap,
    guess: Guess,
    /// Thruster pairs that are told to fire.
    rcs_on: [bool; 2],
    /// Thrust that the command asks for [N], for the record.
    thrust_command_n: f64,
    /// Gas that follows the liquid limits the oxidiser flow.
    nitrous_depleted: bool,
    /// How the burning fraction moves: toward 1 when lit, toward 0 in a tail.
    flame: Flame,
}

/// How the burning fraction moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Flame {
    /// No flame.
    Out,
    /// Rising to the whole flow with a time constant [s].
    Lit(f64),
    /// Dying for want of fuel with a time constant [s].
    Tail(f64),
}

/// Everything that [`Plant::evaluate`] finds at one instant.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// Time derivative of the state.
    pub rate: Rate,
    /// Engine.
    pub engine: OperatingPoint,
    /// Open area of the oxidiser valve [m²].
    pub valve_area_m2: f64,
    /// Bottle and run tank.
    pub pressurant: PressurantState,
    /// Mass properties about the pivot, liquid at rest, engine at zero gimbal.
    pub mass: MassProperties,
    /// Accelerations and slosh force.
    pub acceleration: Acceleration,
    /// Legs.
    pub contact: Contact,
    /// Fuel left [kg].
    pub fuel_kg: f64,
    /// Velocity of the air [m/s].
    pub wind_ned_m_s: Vec3,
}
