//! The bench's parameters, as the MAVLink parameter protocol lists them: the run, the plant, and one for each
//! fault.
//!
//! All are 32-bit floats. A fault's name follows from the catalogue, `F_` + three letters of its component +
//! `_` + up to ten of its mode; 0 means that it does not act, another number is its value, and one that takes
//! no value is 1.

use hopbench::fault::{Component, Row, catalogue};

/// One parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// At most 16 letters.
    pub name: String,
    /// What it sets.
    pub what: What,
    /// Least allowed.
    pub least: f64,
    /// Greatest allowed.
    pub greatest: f64,
    /// Unit and meaning.
    pub unit: &'static str,
}

/// What a parameter sets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What {
    /// Simulated seconds to a second of the wall clock.
    Speed,
    /// Whether simulated time stands.
    Pause,
    /// Steps of the plant to make while it stands.
    Step,
    /// Begins a new flight.
    Reset,
    /// Seed of the next flight.
    Seed,
    /// Wind toward the north on top of the scenario's.
    WindNorth,
    /// Wind toward the east on top of the scenario's.
    WindEast,
    /// Share of thrust more or less than the model's.
    ThrustBias,
    /// Angle of the thrust line about x or y.
    Misalignment(usize),
    /// Force at the gimbal pivot along x, y or z.
    Force(usize),
    /// A fault of the catalogue.
    Fault(Row),
}

/// Greatest seed that a 32-bit float holds exactly.
const SEED_MOST: f64 = 16_777_216.0;
/// Letters of a name.
const NAME: usize = 16;

/// Every parameter, in the order of the list.
pub fn parameters() -> Vec<Parameter> {
    let own = [
        ("SIM_SPEED", What::Speed, [0.1, 20.0], "x real time"),
        ("SIM_PAUSE", What::Pause, [0.0, 1.0], "1 time stands"),
        ("SIM_STEP", What::Step, [0.0, 1e6], "steps to make while paused"),
        ("SIM_RESET", What::Reset, [0.0, 1.0], "1 begins a new flight"),
        ("SIM_SEED", What::Seed, [0.0, SEED_MOST], "of the next flight"),
        ("WIND_N", What::WindNorth, [-30.0, 30.0], "m/s toward the north, added"),
        ("WIND_E", What::WindEast, [-30.0, 30.0], "m/s toward the east, added"),
        ("THRUST_BIAS", What::ThrustBias, [-0.5, 0.5], "share of thrust, added"),
        ("MISALIGN_X", What::Misalignment(0), [-0.1, 0.1], "rad, thrust line"),
        ("MISALIGN_Y", What::Misalignment(1), [-0.1, 0.1], "rad, thrust line"),
        ("FORCE_X", What::Force(0), [-1000.0, 1000.0], "N at the pivot, body"),
        ("FORCE_Y", What::Force(1), [-1000.0, 1000.0], "N at the pivot, body"),
        ("FORCE_Z", What::Force(2), [-1000.0, 1000.0], "N at the pivot, body"),
    ];
    let own = own.into_iter().map(|(name, what, [least, greatest], unit)| Parameter {
        name: name.to_owned(),
        what,
        least,
        greatest,
        unit,
    });
    own.chain(catalogue().map(of_fault)).collect()
}

fn of_fault(row: Row) -> Parameter {
    let (range, unit) = match row.value {
        Some(quantity) => ([quantity.least, quantity.greatest], quantity.unit),
        None => ([0.0, 1.0], "1 acts"),
    };
    Parameter { name: name(&row), what: What::Fault(row), least: range[0], greatest: range[1], unit }
}

impl Parameter {
    /// Whether the value may be set; 0 takes a fault away, whatever its range.
    pub fn allows(&self, value: f64) -> bool {
        (self.least..=self.greatest).contains(&value) || (value == 0.0 && matches!(self.what, What::Fault(_)))
    }
}

/// Name of a fault's parameter.
fn name(row: &Row) -> String {
    let mode = row.mode.name().to_ascii_uppercase();
    let letters = NAME - "F_XXX_".len();
    format!("F_{}_{}", code(row.component), &mode[..mode.len().min(letters)])
}

const fn code(component: Component) -> &'static str {
    match component {
        Component::Accelerometer => "ACC",
        Component::Gyroscope => "GYR",
        Component::Magnetometer => "MAG",
        Component::Barometer => "BAR",
        Component::Gnss => "GNS",
        Component::Altimeter => "ALT",
        Component::Tracking => "TRK",
        Component::PressureTank => "PTK",
        Component::PressureBottle => "PBT",
        Component::PressureInjectorInlet => "PIN",
        Component::PressureChamber => "PCH",
        Component::Igniter => "IGN",
        Component::Valve => "VLV",
        Component::Isolation => "ISO",
        Component::GimbalX => "GBX",
        Component::GimbalY => "GBY",
        Component::RcsPositive => "RCP",
        Component::RcsNegative => "RCN",
        Component::Regulator => "REG",
        Component::Injector => "INJ",
        Component::Combustion => "CMB",
        Component::WireToFc => "WTO",
        Component::WireFromFc => "WFR",
        Component::Fc => "FCU",
    }
}

/// A 32-bit float as the decimal number that it was typed as: 0.3 and not 0.30000001.
pub fn as_typed(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_and_differ_and_every_fault_has_one() {
        let all = parameters();
        let names: std::collections::BTreeSet<_> = all.iter().map(|p| p.name.as_str()).collect();
        assert_eq!(names.len(), all.len());
        assert!(names.iter().all(|name| name.len() <= NAME && name.is_ascii()));
        assert_eq!(all.iter().filter(|p| matches!(p.what, What::Fault(_))).count(), catalogue().count());
        for expected in ["SIM_SPEED", "F_GBX_HARD_OVER", "F_CMB_EFFICIENCY", "F_GYR_OFF", "F_WTO_DROP"] {
            assert!(names.contains(expected), "{expected}");
        }
    }

    #[test]
    fn ranges_are_ranges() {
        for p in parameters() {
            assert!(p.least < p.greatest && p.least.is_finite() && p.greatest.is_finite(), "{p:?}");
        }
    }

    #[test]
    fn a_float_is_read_as_it_was_typed() {
        for typed in [0.3, -0.05, 1e-6, 20.0, 1e6, 0.0] {
            assert_eq!(as_typed(typed as f32), typed);
        }
    }
}
