//! A campaign as data: one scenario flown many times, what differs from flight to flight, and what counts as
//! success.

use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Dispersion, Expect, Outcome};
use crate::input::{Document, InputError, Invalid};

/// A campaign file. Relative paths in it start at its own folder.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CampaignFile {
    /// One line for people.
    #[serde(default)]
    pub description: String,
    /// Scenario file; the autopilot is told of this flight as it is written there.
    pub scenario: String,
    /// How many flights each variant flies; `--runs` replaces it.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub runs: u32,
    /// Seed of the first flight, the next one's is one more; `--seed` replaces it.
    #[serde(default = "first")]
    #[schemars(range(min = 0, max = 4_000_000_000_u32))]
    pub seed: u32,
    /// What is drawn anew for every flight.
    #[serde(default)]
    pub dispersion: Vec<Dispersion>,
    /// What a flight must show, and how many must show it.
    #[serde(default)]
    pub success: Success,
    /// Configurations flown on the same seeds and draws, to be compared in pairs with the first; none: the scenario alone.
    #[serde(default)]
    pub variant: Vec<Variant>,
}

fn first() -> u32 {
    1
}

/// What counts as success.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Success {
    /// Vertical speed of the centre of mass at first contact, at most (m/s).
    #[schemars(range(min = 0.0, max = 100.0))]
    pub touchdown_vertical_speed_max_m_s: f64,
    /// Horizontal speed of the centre of mass at first contact, at most (m/s).
    #[schemars(range(min = 0.0, max = 100.0))]
    pub touchdown_lateral_speed_max_m_s: f64,
    /// Tilt at first contact, at most (deg).
    #[schemars(range(min = 0.0, max = 180.0))]
    pub touchdown_tilt_max_deg: f64,
    /// Horizontal distance from the autopilot's estimate to the target at first contact, at most (m).
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub control_error_max_m: f64,
    /// Horizontal distance from the true position to the target at first contact, at most (m); absent: not judged.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub position_error_max_m: Option<f64>,
    /// Share of the fuel that must be left, at least; absent: not judged.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub fuel_left_min_fraction: Option<f64>,
    /// Share of the nitrous oxide that must be left as liquid, at least; absent: not judged.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub nitrous_left_min_fraction: Option<f64>,
    /// Share of the flights that must succeed, at least; every variant is judged.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_rate: f64,
    /// Failures that are allowed, whatever the share; absent: the share alone decides.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0))]
    pub max_failures: Option<u32>,
}

impl Default for Success {
    /// What the legs and the pad take.
    fn default() -> Self {
        Self {
            touchdown_vertical_speed_max_m_s: 1.0,
            touchdown_lateral_speed_max_m_s: 0.5,
            touchdown_tilt_max_deg: 5.0,
            control_error_max_m: 0.5,
            position_error_max_m: None,
            fuel_left_min_fraction: None,
            nitrous_left_min_fraction: None,
            min_rate: 0.99,
            max_failures: None,
        }
    }
}

impl Success {
    /// The same as expectations of a single flight, which must also land.
    pub fn expect(&self) -> Expect {
        Expect {
            outcome: Some(Outcome::Landed),
            touchdown_vertical_speed_max_m_s: Some(self.touchdown_vertical_speed_max_m_s),
            touchdown_lateral_speed_max_m_s: Some(self.touchdown_lateral_speed_max_m_s),
            touchdown_tilt_max_deg: Some(self.touchdown_tilt_max_deg),
            control_error_max_m: Some(self.control_error_max_m),
            position_error_max_m: self.position_error_max_m,
            fuel_left_min_fraction: self.fuel_left_min_fraction,
            nitrous_left_min_fraction: self.nitrous_left_min_fraction,
            ..Expect::default()
        }
    }

    /// Whether so many successes of so many flights are enough.
    pub fn passed(&self, successes: u32, flights: u32) -> bool {
        let enough = f64::from(successes) >= self.min_rate * f64::from(flights);
        let few = self.max_failures.is_none_or(|most| flights - successes <= most);
        flights > 0 && enough && few
    }
}

/// An entry `[[variant]]` of a campaign.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Variant {
    /// Name in tables and pictures: letters, digits, `-` and `_`.
    pub name: String,
    /// Values that replace those of the scenario, or behind `vehicle.` those of its vehicle: dotted keys, quoted. The autopilot knows of them.
    #[serde(default)]
    pub set: BTreeMap<String, serde_json::Value>,
}

impl CampaignFile {
    /// Reads and checks a campaign document.
    ///
    /// # Errors
    /// When a key is unknown, missing, of the wrong kind, out of range or at odds with another.
    pub fn read(document: &Document) -> Result<Self, InputError> {
        let file: Self = document.read()?;
        let mut diagnostics = Vec::new();
        // A name is a random stream: two entries of one name would draw as one.
        let (mut names, mut columns) = (BTreeSet::new(), BTreeSet::new());
        for (index, entry) in file.dispersion.iter().enumerate() {
            let within = format!("dispersion.{index}");
            if let Err(diagnostic) = entry.validate() {
                diagnostics.push(diagnostic.within(&within));
            }
            let new_columns = entry.columns().into_iter().all(|column| columns.insert(column));
            if !(names.insert(entry.name()) && new_columns) {
                let message =
                    format!("an entry above is \"{}\" too: each needs a name of its own", entry.name());
                // Without a name the key stands for it.
                let key = if entry.name.is_some() { "name" } else { "key" };
                diagnostics.push(Invalid::new(format!("{within}.{key}"), message));
            }
        }
        let mut names = BTreeSet::new();
        for (index, variant) in file.variant.iter().enumerate() {
            let within = format!("variant.{index}");
            let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
            if variant.name.is_empty() || !variant.name.chars().all(plain) {
                let message = format!("\"{}\": letters, digits, - and _ only", variant.name);
                diagnostics.push(Invalid::new(format!("{within}.name"), message));
            }
            if !names.insert(&variant.name) {
                let message = format!("an entry above is \"{}\" too", variant.name);
                diagnostics.push(Invalid::new(format!("{within}.name"), message));
            }
            if let Some((key, value)) = variant.set.iter().find(|(_, value)| value.is_object()) {
                let message = format!("quote the dotted key, as in \"{key}.KEY\" = VALUE; got {value}");
                diagnostics.push(Invalid::new(format!("{within}.set.{key}"), message));
            }
        }
        if diagnostics.is_empty() { Ok(file) } else { Err(document.error(diagnostics)) }
    }

    /// The configurations that fly: those of the file, or the scenario alone under the name "nominal".
    pub fn variants(&self) -> Vec<Variant> {
        if self.variant.is_empty() {
            vec![Variant { name: "nominal".to_owned(), set: BTreeMap::new() }]
        } else {
            self.variant.clone()
        }
    }
}
