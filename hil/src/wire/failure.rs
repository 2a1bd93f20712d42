//! MAV_CMD_INJECT_FAILURE: the standard's words for failures, and what of the catalogue they mean.
//!
//! Parameters 1 to 3 are unit, type and instance. Instance 0 means all of a unit's parts.
//!
//! | unit | parts | off | stuck | garbage | wrong | slow | delayed | intermittent | drift |
//! |---|---|---|---|---|---|---|---|---|---|
//! | gyro, accel, mag, baro, distance sensor | the sensor | off | stuck | garbage | bias | - | delay | intermittent | drift |
//! | gps, vio (the rig's tracking) | the sensor | off | stuck | garbage | jump | - | delay | intermittent | drift |
//! | motor | 1 oxidiser valve | - | stuck | - | offset | slow | - | - | - |
//! | motor | 2, 3 thruster pairs for positive and negative roll | off | - | - | - | - | - | - | - |
//! | servo | 1 gimbal x, 2 gimbal y | - | stuck | - | offset | slow | - | - | - |
//! | mavlink signal | 1 to the flight controller, 2 from it | disconnect | - | corrupt | - | - | delay | drop | - |
//!
//! A dash, and every other unit, is MAV_RESULT_UNSUPPORTED. So is instance 0 where not all parts can fail in
//! that way: a command that did half of what it says would be a lie. An instance beyond the parts is
//! MAV_RESULT_DENIED. Type OK mends what acts in the parts, whoever broke it. The values are the catalogue's
//! defaults; other values: by parameter.

use hopbench::fault::{Component, Mode, row};

/// What a command means.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Failure {
    /// These are to break.
    Break(Vec<(Component, Mode)>),
    /// These are to be mended.
    Mend(Vec<Component>),
    /// The unit has no such part; it has so many.
    NoSuchInstance(usize),
    /// The bench has nothing of that kind.
    Unsupported,
}

/// FAILURE_TYPE_OK
const OK: u32 = 0;

/// What unit, type and instance of the command mean; what is not a whole number means nothing.
pub(crate) fn failure(unit: f32, kind: f32, instance: f32) -> Failure {
    let whole = |number: f32| (number >= 0.0 && number.fract() == 0.0).then_some(number as u32);
    // Senders leave parameters that they do not use at 0 or NaN.
    let instance = if instance.is_nan() { 0.0 } else { instance };
    let (Some(unit), Some(kind)) = (whole(unit), whole(kind)) else { return Failure::Unsupported };
    let parts = parts(unit);
    if parts.is_empty() || kind > 8 {
        return Failure::Unsupported;
    }
    let meant = match whole(instance) {
        Some(0) => parts,
        Some(one) if (one as usize) <= parts.len() => &parts[one as usize - 1..one as usize],
        _ => return Failure::NoSuchInstance(parts.len()),
    };
    if kind == OK {
        return Failure::Mend(meant.to_vec());
    }
    let broken: Option<Vec<_>> =
        meant.iter().map(|&component| mode(component, kind).map(|mode| (component, mode))).collect();
    broken.map_or(Failure::Unsupported, Failure::Break)
}

/// Parts of a FAILURE_UNIT, in the order of their instances.
fn parts(unit: u32) -> &'static [Component] {
    match unit {
        0 => &[Component::Gyroscope],
        1 => &[Component::Accelerometer],
        2 => &[Component::Magnetometer],
        3 => &[Component::Barometer],
        4 => &[Component::Gnss],
        6 => &[Component::Tracking],
        7 => &[Component::Altimeter],
        101 => &[Component::Valve, Component::RcsPositive, Component::RcsNegative],
        102 => &[Component::GimbalX, Component::GimbalY],
        105 => &[Component::WireToFc, Component::WireFromFc],
        _ => &[],
    }
}

/// How a part fails by a FAILURE_TYPE, if the catalogue has that.
fn mode(component: Component, kind: u32) -> Option<Mode> {
    let wire = matches!(component, Component::WireToFc | Component::WireFromFc);
    let mode = match (kind, component) {
        (1, _) if wire => Mode::Disconnect,
        (1, _) => Mode::Off,
        (2, _) => Mode::Stuck,
        (3, _) if wire => Mode::Corrupt,
        (3, _) => Mode::Garbage,
        (4, Component::Gnss | Component::Tracking) => Mode::Jump,
        (4, Component::Valve | Component::GimbalX | Component::GimbalY) => Mode::Offset,
        (4, _) => Mode::Bias,
        (5, _) => Mode::Slow,
        (6, _) => Mode::Delay,
        (7, _) if wire => Mode::Drop,
        (7, _) => Mode::Intermittent,
        (8, _) => Mode::Drift,
        _ => return None,
    };
    row(component, mode).map(|row| row.mode)
}

#[cfg(test)]
mod tests {
    use super::*;
    use Component::*;

    /// The units and types of the `common` dialect, by number.
    const UNITS: [u32; 17] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 100, 101, 102, 103, 104, 105, 106, 107];

    fn meaning(unit: u32, kind: u32, instance: u32) -> Failure {
        failure(unit as f32, kind as f32, instance as f32)
    }

    /// Every unit and type of the standard, instance 1, spelled out once more: the table of the module.
    #[test]
    fn every_word_of_the_standard_means_what_the_table_says() {
        use Mode::*;
        let gauge = [
            Some(Off),
            Some(Stuck),
            Some(Garbage),
            Some(Bias),
            None,
            Some(Delay),
            Some(Intermittent),
            Some(Drift),
        ];
        let locator = [
            Some(Off),
            Some(Stuck),
            Some(Garbage),
            Some(Jump),
            None,
            Some(Delay),
            Some(Intermittent),
            Some(Drift),
        ];
        let servo = [None, Some(Stuck), None, Some(Offset), Some(Slow), None, None, None];
        let thruster = [Some(Off), None, None, None, None, None, None, None];
        let wire = [Some(Disconnect), None, Some(Corrupt), None, None, Some(Delay), Some(Drop), None];
        let table = [
            (0, 1, Gyroscope, gauge),
            (1, 1, Accelerometer, gauge),
            (2, 1, Magnetometer, gauge),
            (3, 1, Barometer, gauge),
            (7, 1, Altimeter, gauge),
            (4, 1, Gnss, locator),
            (6, 1, Tracking, locator),
            (101, 1, Valve, servo),
            (101, 2, RcsPositive, thruster),
            (101, 3, RcsNegative, thruster),
            (102, 1, GimbalX, servo),
            (102, 2, GimbalY, servo),
            (105, 1, WireToFc, wire),
            (105, 2, WireFromFc, wire),
        ];
        for (unit, instance, component, modes) in table {
            assert_eq!(meaning(unit, 0, instance), Failure::Mend(vec![component]));
            for (kind, mode) in (1..=8).zip(modes) {
                let expected =
                    mode.map_or(Failure::Unsupported, |mode| Failure::Break(vec![(component, mode)]));
                assert_eq!(
                    meaning(unit, kind, instance),
                    expected,
                    "unit {unit} type {kind} instance {instance}"
                );
            }
        }
        for unit in UNITS.into_iter().filter(|unit| !table.iter().any(|row| row.0 == *unit)) {
            for kind in 0..=8 {
                assert_eq!(meaning(unit, kind, 0), Failure::Unsupported, "unit {unit} type {kind}");
            }
        }
    }

    #[test]
    fn instance_0_is_all_or_nothing_and_there_are_no_more_than_there_are() {
        assert_eq!(meaning(102, 2, 0), Failure::Break(vec![(GimbalX, Mode::Stuck), (GimbalY, Mode::Stuck)]));
        // The valve cannot be off.
        assert_eq!(meaning(101, 1, 0), Failure::Unsupported);
        assert_eq!(meaning(105, 0, 0), Failure::Mend(vec![WireToFc, WireFromFc]));
        assert_eq!(meaning(0, 1, 2), Failure::NoSuchInstance(1));
        assert_eq!(meaning(102, 0, 3), Failure::NoSuchInstance(2));
    }

    #[test]
    fn what_is_no_number_of_the_standard_is_not_supported() {
        for (unit, kind, instance) in
            [(f32::NAN, 1.0, 0.0), (0.5, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 9.0, 0.0)]
        {
            assert_eq!(failure(unit, kind, instance), Failure::Unsupported);
        }
        assert_eq!(failure(0.0, 1.0, f32::NAN), Failure::Break(vec![(Gyroscope, Mode::Off)]));
        assert_eq!(failure(0.0, 1.0, f32::INFINITY), Failure::NoSuchInstance(1));
    }
}
