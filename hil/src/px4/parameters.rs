//! The parameters of PX4, each with its reason.

use hopbench::frame::{Vec3, frd_from_structural};
use hopbench::vehicle::Vehicle;
use serde::Serialize;

use super::allocation::Outputs;
use super::budget::{Budget, JERK_M_S3, TAKEOFF_RAMP_S, TAKEOFF_SPEED_M_S};
use super::lander::Lander;
use super::tuning::{DIFFERENTIAL_CUTOFF_HZ, Tuning};
use crate::wire::profile::{PX4_HITL, PX4_SITL};

/// Which kind of PX4 the parameters are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// In software, in lockstep.
    Sitl,
    /// On its own board, in real time.
    Hitl,
}

/// A parameter of PX4.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Parameter {
    /// Name, at most 16 characters.
    pub name: String,
    /// Value, in PX4's unit and type.
    pub value: Value,
    /// Where the value comes from.
    pub why: String,
}

/// A value as PX4 stores it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// INT32.
    Integer(i32),
    /// FLOAT, rounded to what is worth writing.
    Real(f64),
}

impl Value {
    /// MAVLink's number of its type, as parameter files write it.
    pub(super) fn mavlink_type(self) -> u8 {
        match self {
            Self::Integer(_) => 6,
            Self::Real(_) => 9,
        }
    }

    /// The value as parameter files write it; a real keeps its decimal point.
    pub fn text(self) -> String {
        match self {
            Self::Integer(value) => value.to_string(),
            Self::Real(value) => format!("{value:?}"),
        }
    }
}

/// What the parameters follow from.
pub(super) struct Inputs<'a> {
    /// The vehicle file.
    pub vehicle: &'a Vehicle,
    /// The vehicle at hover.
    pub lander: &'a Lander,
    /// Gains and limits.
    pub tuning: &'a Tuning,
    /// Propellant and pace.
    pub budget: &'a Budget,
    /// Channels.
    pub outputs: &'a Outputs,
    /// Where PX4 runs.
    pub target: Target,
}

/// Every parameter, in the order in which a reader wants them.
pub(super) fn list(inputs: &Inputs<'_>) -> Vec<Parameter> {
    let mut list = List(Vec::new());
    allocation(inputs, &mut list);
    outputs(inputs, &mut list);
    attitude(inputs, &mut list);
    gyro_filter(inputs.tuning, &mut list);
    thrust_and_velocity(inputs, &mut list);
    pace(inputs, &mut list);
    estimator(inputs, &mut list);
    failsafes(&mut list);
    match inputs.target {
        Target::Sitl => sitl(&mut list),
        Target::Hitl => hitl(&mut list),
    }
    list.0
}

struct List(Vec<Parameter>);

impl List {
    fn integer(&mut self, name: impl Into<String>, value: i32, why: impl Into<String>) {
        self.0.push(Parameter { name: name.into(), value: Value::Integer(value), why: why.into() });
    }

    /// A real, rounded to four decimals.
    fn real(&mut self, name: impl Into<String>, value: f64, why: impl Into<String>) {
        // No minus before what rounds to nothing.
        let rounded = (value * 1e4).round() / 1e4 + 0.0;
        self.0.push(Parameter { name: name.into(), value: Value::Real(rounded), why: why.into() });
    }
}

/// Thrusters that are motors: place beside the axis (m) and thrust coefficient, as flown. Their product is
/// 0.5, so that a pair of opposed thrusters takes the whole torque setpoint.
const THRUSTER_PLACE_M: f64 = 0.15;
const THRUSTER_CT: f64 = 10.0 / 3.0;

fn allocation(inputs: &Inputs<'_>, list: &mut List) {
    let outputs = inputs.outputs;
    let rotors = if outputs.two_roll_channels { 3 } else { 1 };
    list.integer("CA_AIRFRAME", 9, "custom: pseudo-inverse, clipped, no normalisation of torques");
    list.integer(
        "CA_ROTOR_COUNT",
        rotors,
        "the engine; beside it the thrusters, where each way has a channel of its own",
    );
    for axis in ["PX", "PY", "PZ"] {
        list.real(
            format!("CA_ROTOR0_{axis}"),
            0.0,
            "exactly 0: anything else makes the allocator cancel a moment that is not there",
        );
    }
    for (axis, value) in [("AX", 0.0), ("AY", 0.0), ("AZ", -1.0)] {
        list.real(format!("CA_ROTOR0_{axis}"), value, "thrust along FRD -z");
    }
    list.real("CA_ROTOR0_CT", 6.5, "PX4's own; cancels with one engine");
    list.real("CA_ROTOR0_KM", 0.0, "no moment about the thrust");
    if outputs.two_roll_channels {
        for (rotor, way) in [(1, 1.0), (2, -1.0)] {
            let why = "thruster of one way: PX times AY is its sense about FRD z, PX times CT is 0.5";
            list.real(format!("CA_ROTOR{rotor}_PX"), way * THRUSTER_PLACE_M, why);
            for (axis, value) in [("PY", 0.0), ("PZ", 0.0), ("AX", 0.0), ("AY", 1.0), ("AZ", 0.0)] {
                list.real(format!("CA_ROTOR{rotor}_{axis}"), value, why);
            }
            list.real(format!("CA_ROTOR{rotor}_CT"), THRUSTER_CT, why);
            list.real(format!("CA_ROTOR{rotor}_KM"), 0.0, why);
        }
    }
    let servos = if outputs.two_roll_channels { 2 } else { 3 };
    list.integer(
        "CA_SV_CS_COUNT",
        servos,
        "gimbal about x and y; thrusters about z, where one channel moves both ways",
    );
    for servo in 0..servos as usize {
        list.integer(format!("CA_SV_CS{servo}_TYPE"), 12, "custom");
        for (axis, letter) in ["R", "P", "Y"].into_iter().enumerate() {
            let value = if axis == servo { outputs.polarity[axis] } else { 0.0 };
            let why =
                "servo = torque setpoint over this; 1 or, for polarity -1, -1: below 0.1 PX4 drops the row";
            list.real(format!("CA_SV_CS{servo}_TRQ_{letter}"), value, why);
        }
    }
    list.real("THR_MDL_FAC", 0.0, "throttle is thrust: the plant's engine controller is linear");
}

fn outputs(inputs: &Inputs<'_>, list: &mut List) {
    let name = match inputs.target {
        Target::Sitl => "PWM_MAIN_FUNC",
        Target::Hitl => "HIL_ACT_FUNC",
    };
    for (index, function, what) in &inputs.outputs.functions {
        list.integer(format!("{name}{}", index + 1), *function, format!("controls[{index}]: {what}"));
    }
}

fn attitude(inputs: &Inputs<'_>, list: &mut List) {
    let (lander, tuning) = (inputs.lander, inputs.tuning);
    for (axis, (long, short)) in [("ROLL", "RR"), ("PITCH", "PR"), ("YAW", "YR")].into_iter().enumerate() {
        let (gains, effect) = (&tuning.rate[axis], tuning.unit_effect_rad_s2[axis]);
        let bandwidth = gains.p * effect;
        let from = if axis < 2 {
            format!(
                "{bandwidth:.1} rad/s over {effect:.3} rad/s² a unit: {:.0} N x {:.3} m \
                 x sin {:.1} deg / {:.2} kg m²",
                lander.weight_n(),
                lander.lever_m,
                lander.gimbal_limit_rad.to_degrees(),
                lander.inertia_kg_m2[axis]
            )
        } else {
            format!(
                "{bandwidth:.1} rad/s over {effect:.3} rad/s² a unit: {:.2} N m / {:.3} kg m²",
                lander.roll_moment_n_m, lander.inertia_kg_m2[axis]
            )
        };
        list.real(format!("MC_{long}RATE_P"), gains.p, from);
        list.real(format!("MC_{long}RATE_I"), gains.i, "share of P that flew");
        let why = if gains.d > 0.0 || axis == 2 {
            "share of P that flew"
        } else {
            "none: with it the swinging engine makes the loop oscillate"
        };
        list.real(format!("MC_{long}RATE_D"), gains.d, why);
        list.real(format!("MC_{long}RATE_K"), 1.0, "the gains stand as they are");
        list.real(format!("MC_{long}RATE_FF"), 0.0, "none");
        list.real(
            format!("MC_{short}_INT_LIM"),
            gains.integral_limit,
            "0.15, and the trim of a centre of mass beside the axis",
        );
        list.real(
            format!("MC_{long}_P"),
            tuning.attitude_p_1_s[axis],
            "2.4 about x and y under a rate loop of 7 rad/s, 1 about z",
        );
        list.real(
            format!("MC_{long}RATE_MAX"),
            tuning.rate_max_deg_s[axis],
            "deg/s; what a full command brakes within the attitude loop",
        );
    }
}

/// Where the gyro filter's cutoff comes from.
fn gyro_filter(tuning: &Tuning, list: &mut List) {
    let why = match tuning.swing_zero_rad_s {
        None => "Hz; PX4's own".to_owned(),
        Some(zero) => format!(
            "Hz; from {zero:.1} rad/s on the swinging engine works backward: \
             gain margin {:.1} with this filter",
            tuning.gain_margin
        ),
    };
    list.real("IMU_GYRO_CUTOFF", tuning.gyro_cutoff_hz, why);
    list.real(
        "IMU_DGYRO_CUTOFF",
        DIFFERENTIAL_CUTOFF_HZ,
        "Hz; PX4's own, with which the gain margin is computed",
    );
}

fn thrust_and_velocity(inputs: &Inputs<'_>, list: &mut List) {
    let (lander, tuning) = (inputs.lander, inputs.tuning);
    let [hover, least, most] = tuning.throttle_hover_min_max;
    let carried =
        format!("{:.1} kg at the start of the hover over {} N", lander.mass_kg, lander.thrust_rated_n);
    list.real("MPC_THR_HOVER", hover, carried);
    list.real("MPC_THR_MIN", least, "least thrust of the lit engine over the rated one; in flight only");
    list.real("MPC_THR_MAX", most.min(1.0), "greatest thrust over the rated one");
    list.integer("MPC_USE_HTE", 1, "the hover throttle is estimated on: the vehicle loses mass");
    list.real("MPC_XY_P", tuning.position_xy_1_s, "0.4 under a velocity loop of 1");
    let [p, i, d] = tuning.velocity_xy;
    list.real("MPC_XY_VEL_P_ACC", p, "1 under an attitude loop of 2.4");
    list.real("MPC_XY_VEL_I_ACC", i, "as flown");
    list.real("MPC_XY_VEL_D_ACC", d, "as flown");
    list.real("MPC_Z_P", tuning.position_z_1_s, "as flown, with thrust lags of 0.15 and 0.35 s");
    let [p, i, d] = tuning.velocity_z;
    list.real("MPC_Z_VEL_P_ACC", p, "as flown");
    list.real("MPC_Z_VEL_I_ACC", i, "as flown; takes up what the engine gives off its map");
    list.real("MPC_Z_VEL_D_ACC", d, "as flown");
    list.real("MPC_TILTMAX_AIR", 12.0, "deg; costs 2 % of thrust");
    list.real("MPC_TILTMAX_LND", 6.0, "deg; the feet come down together");
}

fn pace(inputs: &Inputs<'_>, list: &mut List) {
    let (pace, [up, down]) = (&inputs.budget.pace, inputs.tuning.acceleration_up_down_m_s2);
    let burn = format!(
        "the hop burns {:.1} s and leaves {:.0} % of nitrous oxide, {:.0} % of fuel",
        inputs.budget.burn_s,
        100.0 * inputs.budget.nitrous_left_fraction,
        100.0 * inputs.budget.fuel_left_fraction
    );
    list.real("MPC_Z_VEL_MAX_UP", pace.climb_m_s, burn.clone());
    list.real("MPC_Z_V_AUTO_UP", pace.climb_m_s, burn.clone());
    list.real("MPC_Z_VEL_MAX_DN", pace.sink_m_s, burn.clone());
    list.real("MPC_Z_V_AUTO_DN", pace.sink_m_s, burn);
    list.real("MPC_ACC_UP_MAX", up, "m/s²; at most 0.6 of what the engine has above the weight");
    list.real("MPC_ACC_DOWN_MAX", down, "m/s²; at most 0.6 of what the least thrust leaves below it");
    list.real("MPC_LAND_SPEED", pace.land_m_s, "m/s; contact at 0.6 flew");
    list.real(
        "MPC_LAND_CRWL",
        pace.land_m_s,
        "m/s; PX4's 0.3 with an altimeter would burn 2 s more over the last metre",
    );
    list.real("MPC_LAND_ALT1", pace.slow_from_m, "m; PX4's 10 would slow the whole descent");
    list.real("MPC_LAND_ALT2", pace.land_from_m, "m; PX4's 5 would cost some 5 s of burn more");
    list.real("MPC_TKO_RAMP_T", TAKEOFF_RAMP_S, "s; PX4's 3 would burn 2 s more on the pad");
    list.real("MPC_TKO_SPEED", TAKEOFF_SPEED_M_S, "m/s; as flown");
    list.real("COM_SPOOLUP_TIME", 1.0, "s at throttle 0 after arming: the isolation valve opens");
    list.real("MIS_TAKEOFF_ALT", inputs.budget.height_m, "m; the hop");
    list.real("MPC_XY_VEL_MAX", 3.0, "m/s; as flown");
    list.real("MPC_XY_CRUISE", 2.0, "m/s; as flown");
    list.real("MPC_VEL_MANUAL", 2.0, "m/s; above MPC_XY_VEL_MAX it would be a critical message at boot");
    list.real("MPC_ACC_HOR", 1.0, "m/s²; as flown");
    list.real("MPC_ACC_HOR_MAX", 1.5, "m/s²; 9 deg of tilt, under MPC_TILTMAX_AIR");
    list.real("MPC_JERK_AUTO", JERK_M_S3, "m/s³; as flown");
    list.real("MPC_JERK_MAX", 2.0, "m/s³; as flown");
    list.real(
        "MPC_XY_ERR_MAX",
        5.0,
        "m; beyond this error PX4 neither climbs nor lands, \
         and PX4's 2 is less than a gust and its GNSS wander",
    );
    list.integer("MPC_YAW_MODE", 5, "heading fixed: turned toward a waypoint, a slow axis spirals");
    list.real(
        "MPC_YAWRAUTO_MAX",
        inputs.tuning.rate_max_deg_s[2].min(20.0),
        "deg/s; as flown, or what the thrusters brake",
    );
}

fn estimator(inputs: &Inputs<'_>, list: &mut List) {
    let (profile, what) = match inputs.target {
        Target::Sitl => (&PX4_SITL, "ms; as the bench delays it in lockstep"),
        Target::Hitl => (&PX4_HITL, "ms; as the bench delays it in real time"),
    };
    list.real("EKF2_GPS_DELAY", 1e3 * profile.gnss_delay_s.unwrap_or_default(), what);
    let sensors = &inputs.vehicle.sensors;
    let com = Vec3::new(inputs.lander.offset_m[0], inputs.lander.offset_m[1], -inputs.lander.lever_m);
    for (name, position_m, what) in [
        ("EKF2_IMU_POS", sensors.imu.position_m, "inertial unit"),
        ("EKF2_GPS_POS", sensors.gnss.antenna_position_m, "antenna"),
        ("EKF2_RNG_POS", sensors.altimeter.position_m, "altimeter"),
    ] {
        let from_com = frd_from_structural(position_m) - com;
        for (axis, value) in ["X", "Y", "Z"].into_iter().zip(from_com.iter()) {
            list.real(format!("{name}_{axis}"), *value, format!("m from the centre of mass, FRD: {what}"));
        }
    }
}

fn failsafes(list: &mut List) {
    list.real("COM_DISARM_LAND", 2.0, "s from landed to disarmed");
    list.real("COM_DISARM_PRFLT", 10.0, "s; disarms what was armed and not flown");
    list.real("COM_OF_LOSS_T", 1.0, "s without offboard setpoints");
    list.integer("COM_OBL_RC_ACT", 4, "then land: propellant is for one landing");
    list.integer(
        "COM_DL_LOSS_T",
        10,
        "s without a ground station; times the speed factor when faster than real time",
    );
    list.integer("NAV_DLL_ACT", 0, "and go on: a hop is shorter than a return");
    list.integer("NAV_RCL_ACT", 3, "without radio control land, outside the modes of COM_RCL_EXCEPT");
    list.integer("COM_RCL_EXCEPT", 7, "mission, hold and offboard need no radio control");
    list.real("COM_FAIL_ACT_T", 1.0, "s of hover before a failsafe acts: PX4's 5 are propellant");
    list.integer("COM_LOW_BAT_ACT", 0, "warn: PX4 makes the battery up");
}

fn sitl(list: &mut List) {
    list.integer("COM_RC_IN_MODE", 1, "sticks by MAVLink alone: no radio control is there");
}

fn hitl(list: &mut List) {
    list.integer("SYS_HITL", 1, "sensors from the bench; needs a reboot");
    list.integer(
        "MAV_0_RATE",
        0,
        "B/s: half of the baud rate over ten. PX4's 1200 is under the 5000 below which it sends no controls",
    );
    list.integer("SER_TEL1_BAUD", 921_600, "the bench's own; 115200 carries no 250 Hz");
    list.integer("COM_RC_IN_MODE", 1, "sticks by MAVLink alone: no radio control is there");
    list.integer("COM_PREARM_MODE", 0, "no safety switch");
    list.integer("CBRK_IO_SAFETY", 22_027, "no safety switch");
    list.integer("CBRK_USB_CHK", 197_848, "arms on USB");
    list.integer("CBRK_SUPPLY_CHK", 894_281, "arms without a power module");
}
