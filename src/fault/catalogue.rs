//! What can break, and how: the one list. Validation and explanation follow from it, README's table is
//! checked against it; a new component also has three letters in the bench's `parameter.rs`.

use serde::{Deserialize, Serialize};

/// What a fault is in.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Component {
    /// Specific force of the inertial unit.
    Accelerometer,
    /// Rate of the inertial unit.
    Gyroscope,
    /// Magnetic field.
    Magnetometer,
    /// Static pressure.
    Barometer,
    /// Satellite navigation.
    Gnss,
    /// Range to the ground.
    Altimeter,
    /// The rig's tracking.
    Tracking,
    /// Transducer of the run tank.
    PressureTank,
    /// Transducer of the nitrogen bottle.
    PressureBottle,
    /// Transducer of the injector inlet.
    PressureInjectorInlet,
    /// Transducer of the chamber.
    PressureChamber,
    /// Igniter.
    Igniter,
    /// Oxidiser valve.
    Valve,
    /// Oxidiser isolation valve.
    Isolation,
    /// Gimbal servo for moments about x.
    GimbalX,
    /// Gimbal servo for moments about y.
    GimbalY,
    /// Thruster pair for positive roll.
    RcsPositive,
    /// Thruster pair for negative roll.
    RcsNegative,
    /// Nitrogen regulator.
    Regulator,
    /// Injector plate.
    Injector,
    /// Combustion.
    Combustion,
    /// Wire from the bench to the flight controller.
    WireToFc,
    /// Wire from the flight controller to the bench.
    WireFromFc,
    /// Flight controller.
    Fc,
}

/// How it is broken.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// Does nothing, gives nothing.
    Off,
    /// Stays as it is.
    Stuck,
    /// A constant error.
    Bias,
    /// An error that grows with time.
    Drift,
    /// White noise on every sample.
    Noise,
    /// Late.
    Delay,
    /// Wrong by a factor.
    Scale,
    /// A step of position.
    Jump,
    /// Blinded or fooled by the engine's plume.
    Plume,
    /// Some samples are missing.
    Intermittent,
    /// Every sample is random.
    Garbage,
    /// Ignites with a bang.
    HardStart,
    /// Moves slowly.
    Slow,
    /// Angle off its command.
    Offset,
    /// Passes what it should hold.
    Leak,
    /// Runs to its stop.
    HardOver,
    /// Play between servo and load.
    Slack,
    /// Gives less than its set pressure.
    Droop,
    /// Holes are closed.
    Blocked,
    /// Burns less well.
    EfficiencyDrop,
    /// Frames are lost.
    Drop,
    /// Frames are late, each by another time.
    Jitter,
    /// Frames come twice.
    Duplicate,
    /// Frames have a flipped bit.
    Corrupt,
    /// Nothing passes.
    Disconnect,
    /// Boots anew.
    Reboot,
    /// Has no power for a time.
    BrownOut,
}

/// What the value of a fault means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// Unit, or what it is a share or multiple of.
    pub unit: &'static str,
    /// Least allowed.
    pub least: f64,
    /// Greatest allowed.
    pub greatest: f64,
    /// In force where an entry gives none.
    pub default: f64,
}

/// One fault that can be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// In what.
    pub component: Component,
    /// How.
    pub mode: Mode,
    /// What `value` means; `None`: it takes none.
    pub value: Option<Quantity>,
    /// Whether `axis` may be given.
    pub axes: bool,
    /// What it does.
    pub effect: &'static str,
}

/// A mode of several components that mean the same by it.
struct Entry {
    components: &'static [Component],
    mode: Mode,
    value: Option<Quantity>,
    effect: &'static str,
}

/// Every fault that can be, in the order of components and modes below.
pub fn catalogue() -> impl Iterator<Item = Row> {
    ENTRIES.iter().flat_map(|entry| {
        entry.components.iter().map(|&component| Row {
            component,
            mode: entry.mode,
            value: entry.value,
            axes: component.has_axes()
                && matches!(
                    entry.mode,
                    Mode::Bias | Mode::Drift | Mode::Noise | Mode::Scale | Mode::Jump | Mode::Garbage
                ),
            effect: entry.effect,
        })
    })
}

/// The row of a component and a mode, if that can break so.
pub fn row(component: Component, mode: Mode) -> Option<Row> {
    catalogue().find(|row| row.component == component && row.mode == mode)
}

/// The rows in words, a line each: component, mode, unit and range of the value, its default, what it does.
pub fn explain() -> String {
    let line = |row: Row| {
        let value = row.value.map_or("no value".to_owned(), |q| {
            format!("{}, {} to {}, {} if absent", q.unit, q.least, q.greatest, q.default)
        });
        format!("  {:<23} {:<15} {value}: {}\n", row.component.name(), row.mode.name(), row.effect)
    };
    catalogue().map(line).collect()
}

const fn quantity(unit: &'static str, [least, greatest]: [f64; 2], default: f64) -> Option<Quantity> {
    Some(Quantity { unit, least, greatest, default })
}

const fn entry(
    components: &'static [Component],
    mode: Mode,
    value: Option<Quantity>,
    effect: &'static str,
) -> Entry {
    Entry { components, mode, value, effect }
}

const SENSORS: &[Component] = {
    use Component::*;
    &[
        Accelerometer,
        Gyroscope,
        Magnetometer,
        Barometer,
        Gnss,
        Altimeter,
        Tracking,
        PressureTank,
        PressureBottle,
        PressureInjectorInlet,
        PressureChamber,
    ]
};
/// Sensors whose reading is a number of its own, not a position.
const GAUGES: &[Component] = {
    use Component::*;
    &[
        Accelerometer,
        Gyroscope,
        Magnetometer,
        Barometer,
        Altimeter,
        PressureTank,
        PressureBottle,
        PressureInjectorInlet,
        PressureChamber,
    ]
};
const TRANSDUCERS: &[Component] = {
    use Component::*;
    &[PressureTank, PressureBottle, PressureInjectorInlet, PressureChamber]
};
const LOCATORS: &[Component] = &[Component::Gnss, Component::Tracking];
const GIMBAL: &[Component] = &[Component::GimbalX, Component::GimbalY];
const RCS: &[Component] = &[Component::RcsPositive, Component::RcsNegative];
const WIRES: &[Component] = &[Component::WireToFc, Component::WireFromFc];

const ENTRIES: &[Entry] = {
    use Component::*;
    use Mode::*;
    &[
        // Sensors.
        entry(SENSORS, Off, None, "no sample any more"),
        entry(SENSORS, Stuck, None, "repeats the sample at which it began"),
        entry(
            SENSORS,
            Delay,
            quantity("s", [0.0, 5.0], 0.5),
            "every sample is late by this much more; none until the first late one is due",
        ),
        entry(
            SENSORS,
            Intermittent,
            quantity("share of samples", [0.0, 1.0], 0.5),
            "samples are missing at random",
        ),
        entry(GAUGES, Scale, quantity("factor", [-10.0, 10.0], 1.1), "the reading times this factor"),
        entry(&[Accelerometer], Bias, quantity("m/s²", [-200.0, 200.0], 0.5), "added to the specific force"),
        entry(
            &[Accelerometer],
            Drift,
            quantity("m/s² per s", [-50.0, 50.0], 0.05),
            "added to the specific force, growing from 0",
        ),
        entry(
            &[Accelerometer],
            Noise,
            quantity("m/s²", [0.0, 200.0], 2.0),
            "standard deviation of white noise on each sample",
        ),
        entry(
            &[Accelerometer],
            Garbage,
            quantity("m/s²", [0.0, 200.0], 100.0),
            "each sample random, up to this either way",
        ),
        entry(&[Gyroscope], Bias, quantity("rad/s", [-35.0, 35.0], 0.02), "added to the rate"),
        entry(
            &[Gyroscope],
            Drift,
            quantity("rad/s per s", [-10.0, 10.0], 0.002),
            "added to the rate, growing from 0",
        ),
        entry(
            &[Gyroscope],
            Noise,
            quantity("rad/s", [0.0, 35.0], 0.1),
            "standard deviation of white noise on each sample",
        ),
        entry(
            &[Gyroscope],
            Garbage,
            quantity("rad/s", [0.0, 35.0], 10.0),
            "each sample random, up to this either way",
        ),
        entry(&[Magnetometer], Bias, quantity("T", [-1e-3, 1e-3], 10e-6), "added to the field"),
        entry(
            &[Magnetometer],
            Drift,
            quantity("T/s", [-1e-3, 1e-3], 1e-6),
            "added to the field, growing from 0",
        ),
        entry(
            &[Magnetometer],
            Noise,
            quantity("T", [0.0, 1e-3], 5e-6),
            "standard deviation of white noise on each sample",
        ),
        entry(
            &[Magnetometer],
            Garbage,
            quantity("T", [0.0, 1e-3], 1e-4),
            "each sample random, up to this either way",
        ),
        entry(&[Barometer], Bias, quantity("Pa", [-1e5, 1e5], 100.0), "added to the pressure"),
        entry(
            &[Barometer],
            Drift,
            quantity("Pa/s", [-1e4, 1e4], 10.0),
            "added to the pressure, growing from 0",
        ),
        entry(
            &[Barometer],
            Noise,
            quantity("Pa", [0.0, 1e5], 50.0),
            "standard deviation of white noise on each sample",
        ),
        entry(
            &[Barometer],
            Garbage,
            quantity("Pa", [0.0, 2e5], 1.2e5),
            "each sample random between 0 and this",
        ),
        entry(
            &[Barometer],
            Plume,
            quantity("Pa per kN", [-1e4, 1e4], -300.0),
            "added to the pressure at the pad for each kN of thrust; falls by e with each metre of height",
        ),
        entry(
            LOCATORS,
            Jump,
            quantity("m", [-1e4, 1e4], 5.0),
            "added to the position at once; velocity and claimed accuracy stay",
        ),
        entry(
            LOCATORS,
            Drift,
            quantity("m/s", [-100.0, 100.0], 0.5),
            "added to the position, growing from 0; velocity and claimed accuracy stay",
        ),
        entry(
            LOCATORS,
            Noise,
            quantity("m", [0.0, 1e3], 3.0),
            "standard deviation of white noise on each position",
        ),
        entry(
            LOCATORS,
            Garbage,
            quantity("m", [0.0, 1e4], 100.0),
            "each position random, up to this either way of the right one",
        ),
        entry(&[Altimeter], Bias, quantity("m", [-100.0, 100.0], 1.0), "added to the range"),
        entry(&[Altimeter], Drift, quantity("m/s", [-10.0, 10.0], 0.1), "added to the range, growing from 0"),
        entry(
            &[Altimeter],
            Noise,
            quantity("m", [0.0, 100.0], 0.5),
            "standard deviation of white noise on each range",
        ),
        entry(&[Altimeter], Garbage, quantity("m", [0.0, 1e3], 40.0), "each range random between 0 and this"),
        entry(
            &[Altimeter],
            Plume,
            quantity("m", [0.0, 100.0], 3.0),
            "below this height over the pad, while the engine burns, half of the readings are missing and half too short",
        ),
        entry(TRANSDUCERS, Bias, quantity("Pa", [-5e7, 5e7], 5e5), "added to the pressure"),
        entry(
            TRANSDUCERS,
            Drift,
            quantity("Pa/s", [-5e6, 5e6], 5e4),
            "added to the pressure, growing from 0",
        ),
        entry(
            TRANSDUCERS,
            Noise,
            quantity("Pa", [0.0, 5e7], 2e5),
            "standard deviation of white noise on each sample",
        ),
        entry(TRANSDUCERS, Garbage, quantity("Pa", [0.0, 5e7], 1e7), "each sample random between 0 and this"),
        // Plant and actuators.
        entry(&[Igniter], Off, None, "no light"),
        entry(&[Igniter], Delay, quantity("s", [0.0, 10.0], 1.0), "the flame comes later by this much"),
        entry(
            &[Igniter],
            HardStart,
            quantity("share", [0.0, 1.0], 0.05),
            "of the oxidiser that passes before the flame pools in the chamber and burns at once with it",
        ),
        entry(&[Valve], Stuck, None, "the angle stays, whatever the command"),
        entry(&[Valve], Slow, quantity("share", [0.01, 1.0], 0.2), "of rate and bandwidth is left"),
        entry(
            &[Valve],
            Offset,
            quantity("rad", [-0.5, 0.5], 0.05),
            "the angle is above the command by this much, within the stops",
        ),
        entry(&[Valve], Leak, quantity("share", [0.0, 1.0], 0.02), "of the full-open area passes when shut"),
        entry(&[Isolation], Stuck, None, "stays where it is"),
        entry(&[Isolation], Slow, quantity("factor", [1.0, 100.0], 5.0), "on the stroke time"),
        entry(
            GIMBAL,
            HardOver,
            quantity("share of the limit", [-1.0, 1.0], 1.0),
            "runs there, whatever the command",
        ),
        entry(GIMBAL, Stuck, None, "the angle stays, whatever the command"),
        entry(GIMBAL, Slow, quantity("share", [0.01, 1.0], 0.2), "of rate and bandwidth is left"),
        entry(GIMBAL, Slack, quantity("rad", [0.0, 0.2], 0.01), "play between servo and engine"),
        entry(
            GIMBAL,
            Offset,
            quantity("rad", [-0.2, 0.2], 0.01),
            "the angle is above the command by this much, within the stops",
        ),
        entry(RCS, Off, None, "never opens"),
        entry(RCS, Leak, quantity("share", [0.0, 1.0], 0.2), "of the full flow always passes"),
        entry(&[Regulator], Droop, quantity("Pa", [0.0, 1e7], 1e6), "below the set pressure"),
        entry(&[Injector], Blocked, quantity("share", [0.0, 0.95], 0.2), "of the area is gone"),
        entry(
            &[Combustion],
            EfficiencyDrop,
            quantity("share", [0.0, 0.9], 0.1),
            "of the combustion efficiency is gone",
        ),
        // Wire and flight controller.
        entry(WIRES, Drop, quantity("share of frames", [0.0, 1.0], 0.1), "lost"),
        entry(WIRES, Delay, quantity("s", [0.0, 5.0], 0.1), "every frame is late by this much"),
        entry(
            WIRES,
            Jitter,
            quantity("s", [0.0, 1.0], 0.02),
            "each frame is late by up to this much more, so they may overtake",
        ),
        entry(WIRES, Duplicate, quantity("share of frames", [0.0, 1.0], 0.1), "arrive twice"),
        entry(WIRES, Corrupt, quantity("share of frames", [0.0, 1.0], 0.1), "have a flipped bit"),
        entry(WIRES, Disconnect, None, "nothing passes"),
        entry(&[Fc], Reboot, None, "told to boot anew, once"),
        entry(&[Fc], BrownOut, None, "without power while it lasts, then boots"),
    ]
};

impl Component {
    /// Every one.
    pub const ALL: [Self; 24] = {
        use Component::*;
        [
            Accelerometer,
            Gyroscope,
            Magnetometer,
            Barometer,
            Gnss,
            Altimeter,
            Tracking,
            PressureTank,
            PressureBottle,
            PressureInjectorInlet,
            PressureChamber,
            Igniter,
            Valve,
            Isolation,
            GimbalX,
            GimbalY,
            RcsPositive,
            RcsNegative,
            Regulator,
            Injector,
            Combustion,
            WireToFc,
            WireFromFc,
            Fc,
        ]
    };

    /// As in a scenario.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Accelerometer => "accelerometer",
            Self::Gyroscope => "gyroscope",
            Self::Magnetometer => "magnetometer",
            Self::Barometer => "barometer",
            Self::Gnss => "gnss",
            Self::Altimeter => "altimeter",
            Self::Tracking => "tracking",
            Self::PressureTank => "pressure_tank",
            Self::PressureBottle => "pressure_bottle",
            Self::PressureInjectorInlet => "pressure_injector_inlet",
            Self::PressureChamber => "pressure_chamber",
            Self::Igniter => "igniter",
            Self::Valve => "valve",
            Self::Isolation => "isolation",
            Self::GimbalX => "gimbal_x",
            Self::GimbalY => "gimbal_y",
            Self::RcsPositive => "rcs_positive",
            Self::RcsNegative => "rcs_negative",
            Self::Regulator => "regulator",
            Self::Injector => "injector",
            Self::Combustion => "combustion",
            Self::WireToFc => "wire_to_fc",
            Self::WireFromFc => "wire_from_fc",
            Self::Fc => "fc",
        }
    }

    /// A sensor: its faults act on the measurement.
    pub fn is_sensor(self) -> bool {
        SENSORS.contains(&self)
    }

    /// Its reading has three axes: body FRD, or north, east, down.
    const fn has_axes(self) -> bool {
        matches!(
            self,
            Self::Accelerometer | Self::Gyroscope | Self::Magnetometer | Self::Gnss | Self::Tracking
        )
    }
}

impl Mode {
    /// As in a scenario.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Stuck => "stuck",
            Self::Bias => "bias",
            Self::Drift => "drift",
            Self::Noise => "noise",
            Self::Delay => "delay",
            Self::Scale => "scale",
            Self::Jump => "jump",
            Self::Plume => "plume",
            Self::Intermittent => "intermittent",
            Self::Garbage => "garbage",
            Self::HardStart => "hard_start",
            Self::Slow => "slow",
            Self::Offset => "offset",
            Self::Leak => "leak",
            Self::HardOver => "hard_over",
            Self::Slack => "slack",
            Self::Droop => "droop",
            Self::Blocked => "blocked",
            Self::EfficiencyDrop => "efficiency_drop",
            Self::Drop => "drop",
            Self::Jitter => "jitter",
            Self::Duplicate => "duplicate",
            Self::Corrupt => "corrupt",
            Self::Disconnect => "disconnect",
            Self::Reboot => "reboot",
            Self::BrownOut => "brown_out",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_component_can_break_each_way_once_and_defaults_lie_in_range() {
        let rows: Vec<Row> = catalogue().collect();
        for component in Component::ALL {
            assert!(rows.iter().any(|row| row.component == component), "{component:?}");
        }
        for (index, a) in rows.iter().enumerate() {
            let twice = rows[..index].iter().any(|b| (b.component, b.mode) == (a.component, a.mode));
            assert!(!twice, "{a:?}");
            if let Some(q) = a.value {
                assert!(q.least < q.greatest && (q.least..=q.greatest).contains(&q.default), "{a:?}");
            }
            assert!(!a.axes || a.value.is_some(), "{a:?}");
        }
        assert_eq!(explain().lines().count(), rows.len());
    }

    #[test]
    fn names_are_those_of_the_files() {
        for row in catalogue() {
            assert_eq!(serde_json::to_value(row.component).unwrap(), row.component.name());
            assert_eq!(serde_json::to_value(row.mode).unwrap(), row.mode.name());
        }
    }
}
