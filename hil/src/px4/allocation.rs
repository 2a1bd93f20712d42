//! Which PX4 actuator each channel of a vehicle's map is, and the rows of the allocation that follow.

use hopbench::controls::{Channel, Controls, ThrottleKind};
use hopbench::input::Invalid;

/// Output functions of PX4.
const MOTOR_1: i32 = 101;
const SERVO_1: i32 = 201;

/// The channels of a vehicle as outputs of PX4.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Outputs {
    /// Function of each output channel in use, by its index from 0: (index, function, what it moves).
    pub functions: Vec<(usize, i32, &'static str)>,
    /// +1, or -1 where the vehicle's map reverses: gimbal about x, about y, thrusters about z.
    pub polarity: [f64; 3],
    /// Thrusters each way on a channel of their own.
    pub two_roll_channels: bool,
}

/// Assigns an output function of PX4 to each channel of a vehicle.
///
/// # Errors
/// When the map holds what PX4 does not send.
pub(super) fn outputs(controls: &Controls) -> Result<Outputs, Invalid> {
    if controls.throttle == Some(ThrottleKind::Valve) {
        let message = "\"valve\": PX4 computes a thrust, and the valve's angle is far from linear in it; \
                       allowed \"thrust\", or absent";
        return Err(Invalid::new("controls.throttle", message));
    }
    let c = &controls.channels;
    let two_roll_channels = c.rcs_roll_negative.is_some();
    let unit = [0.0, 1.0];
    let both_ways = [-1.0, 1.0];
    let roll_range = if two_roll_channels { unit } else { both_ways };
    let mut needed = vec![
        ("throttle", &c.throttle, unit, MOTOR_1, "the engine"),
        ("gimbal_x", &c.gimbal_x, both_ways, SERVO_1, "gimbal, moment about FRD x"),
        ("gimbal_y", &c.gimbal_y, both_ways, SERVO_1 + 1, "gimbal, moment about FRD y"),
    ];
    if let Some(negative) = &c.rcs_roll_negative {
        needed.push(("rcs_roll", &c.rcs_roll, roll_range, MOTOR_1 + 1, "thrusters, moment about +FRD z"));
        needed.push(("rcs_roll_negative", negative, unit, MOTOR_1 + 2, "thrusters, moment about -FRD z"));
    } else {
        needed.push(("rcs_roll", &c.rcs_roll, roll_range, SERVO_1 + 2, "thrusters, moment about FRD z"));
    }
    let mut functions = Vec::new();
    for (name, channel, range, function, what) in needed {
        check_range(name, channel, range)?;
        functions.push((channel.index, function, what));
    }
    functions.sort_unstable();
    let sign = |channel: &Channel| f64::from(channel.polarity);
    Ok(Outputs {
        functions,
        polarity: [sign(&c.gimbal_x), sign(&c.gimbal_y), sign(&c.rcs_roll)],
        two_roll_channels,
    })
}

/// Refuses a range that PX4 does not send: motors 0 to 1, servos -1 to 1.
fn check_range(name: &str, channel: &Channel, range: [f64; 2]) -> Result<(), Invalid> {
    if channel.range == range {
        return Ok(());
    }
    let ([low, high], [from, to]) = (channel.range, range);
    let message =
        format!("[{low}, {high}]: PX4 sends {from} to {to} on this channel; allowed [{from:.1}, {to:.1}]");
    Err(Invalid::new(format!("controls.channels.{name}.range"), message))
}
