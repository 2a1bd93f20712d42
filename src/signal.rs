//! What crosses between the vehicle and whatever flies it: [`Measurement`] out, [`ActuatorCommand`] in.
//!
//! Both are exactly what a flight computer sees and emits, in SI units; codecs in the bench turn them
//! into bytes, and the built-in autopilot takes nothing else.

use crate::frame::Vec3;
use crate::time::SimTime;

/// Throttle demand, in one of the two languages a flight computer may speak.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Throttle {
    /// Thrust (N); the plant's engine controller finds the valve angle.
    ThrustN(f64),
    /// Physical angle of the oxidiser valve (rad), 0 closed.
    ValveRad(f64),
}

/// One command to the actuators. Signs: a positive value gives a positive moment about body FRD x, y, z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActuatorCommand {
    /// Without it everything below is ignored and the vehicle is safed.
    pub armed: bool,
    /// Throttle demand.
    pub throttle: Throttle,
    /// Gimbal angle that gives a moment about FRD x (rad).
    pub gimbal_x_rad: f64,
    /// Gimbal angle that gives a moment about FRD y (rad).
    pub gimbal_y_rad: f64,
    /// Roll demand about FRD z, -1..1 of the thruster pair.
    pub rcs_roll: f64,
    /// Discrete commands; ignored when the scenario's sequence is automatic.
    pub discrete: Discrete,
}

/// Valves and pyrotechnics that a flight computer may command itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Discrete {
    /// Fires the igniter.
    pub igniter: bool,
    /// Opens the oxidiser isolation valve.
    pub isolation_open: bool,
    /// Shuts the run-tank vent; where it goes without power, the vehicle file says.
    pub vent_shut: bool,
    /// Releases the hold-down.
    pub hold_down_released: bool,
}

impl Discrete {
    /// Nothing commanded: igniter off, isolation shut, vent open, held down. Where the valves go without
    /// power, the vehicle file says.
    pub const SAFE: Self =
        Self { igniter: false, isolation_open: false, vent_shut: false, hold_down_released: false };
    /// Everything as it is in flight.
    pub const FLIGHT: Self =
        Self { igniter: true, isolation_open: true, vent_shut: true, hold_down_released: true };
}

impl ActuatorCommand {
    /// Disarmed, nothing moves.
    pub const SAFE: Self = Self {
        armed: false,
        throttle: Throttle::ValveRad(0.0),
        gimbal_x_rad: 0.0,
        gimbal_y_rad: 0.0,
        rcs_roll: 0.0,
        discrete: Discrete::SAFE,
    };
}

/// What the sensors delivered at one instant. A field is `None` when that sensor had nothing new.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurement {
    /// Time of delivery, the flight computer's clock.
    pub time: SimTime,
    /// Inertial measurement unit; present in every measurement of the wire's fast group while the unit is
    /// sound.
    pub imu: Option<ImuSample>,
    /// What the inertial unit still delivers instead while a half of it, or both, gives nothing.
    pub broken_imu: Option<BrokenImu>,
    /// Satellite navigation.
    pub gnss: Option<GnssFix>,
    /// Static pressure.
    pub barometer: Option<BarometerSample>,
    /// Magnetic field in body FRD (T).
    pub magnetic_field_body_t: Option<Vec3>,
    /// Distance to the ground along the body's +z axis.
    pub altimeter: Option<AltimeterSample>,
    /// Pressures of the propulsion system.
    pub pressures: Pressures,
    /// Position tracking by the test rig, if it has one.
    pub tracking: Option<TrackingSample>,
}

/// Mean specific force and mean rate over the sample interval, body FRD, at the unit's position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Specific force (m/s²); at rest upright z is -9.81.
    pub specific_force_body_m_s2: Vec3,
    /// Angular rate (rad/s).
    pub rate_body_rad_s: Vec3,
    /// Length of the averaging interval (s).
    pub interval_s: f64,
    /// Temperature of the unit (K).
    pub temperature_k: f64,
}

/// What is left of an inertial sample; never both halves. Nothing to navigate by, but the unit's beat goes
/// on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrokenImu {
    /// As in [`ImuSample`].
    pub specific_force_body_m_s2: Option<Vec3>,
    /// As in [`ImuSample`].
    pub rate_body_rad_s: Option<Vec3>,
    /// As in [`ImuSample`].
    pub interval_s: f64,
    /// As in [`ImuSample`].
    pub temperature_k: f64,
}

/// One fix of satellite navigation, of the antenna, already late by the receiver's delay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GnssFix {
    /// Geodetic latitude (rad).
    pub latitude_rad: f64,
    /// Longitude (rad).
    pub longitude_rad: f64,
    /// Height above mean sea level (m).
    pub altitude_m: f64,
    /// Velocity over ground (m/s).
    pub velocity_ned_m_s: Vec3,
    /// Accuracy that the receiver reports, horizontal (m).
    pub horizontal_accuracy_m: f64,
    /// Accuracy that the receiver reports, vertical (m).
    pub vertical_accuracy_m: f64,
    /// 3: three-dimensional fix; 6: RTK fixed.
    pub fix_type: u8,
    /// Satellites in use.
    pub satellites: u8,
}

/// Static pressure and the altitude that the standard atmosphere gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BarometerSample {
    /// Absolute pressure (Pa).
    pub pressure_pa: f64,
    /// Pressure altitude in the standard atmosphere (m).
    pub pressure_altitude_m: f64,
    /// Temperature of the sensor (K).
    pub temperature_k: f64,
}

/// One reading of the downward altimeter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AltimeterSample {
    /// Slant range along the beam (m); `None` when nothing valid came back.
    pub range_m: Option<f64>,
    /// Least range it can give (m).
    pub minimum_m: f64,
    /// Greatest range it can give (m).
    pub maximum_m: f64,
}

/// Pressure transducers; `None` where there is no new sample or no such transducer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pressures {
    /// Run-tank ullage (Pa).
    pub tank_pa: Option<f64>,
    /// Nitrogen bottle (Pa).
    pub bottle_pa: Option<f64>,
    /// Injector inlet, P2 (Pa).
    pub injector_inlet_pa: Option<f64>,
    /// Combustion chamber (Pa).
    pub chamber_pa: Option<f64>,
}

/// Pose from outside tracking (motion capture, ultra-wide band), noisy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackingSample {
    /// Pivot position in NED from the pad (m).
    pub position_ned_m: Vec3,
    /// Velocity in NED (m/s).
    pub velocity_ned_m_s: Vec3,
    /// Attitude, scalar first.
    pub q_ned_from_body: [f64; 4],
    /// Body rate (rad/s).
    pub rate_body_rad_s: Vec3,
}
