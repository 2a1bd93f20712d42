//! What differs from flight to flight of a campaign: values drawn at random and put in place of those of the
//! scenario and its vehicle.
//!
//! Each entry draws from a stream of its own, named by the entry under the seed of the flight, so that adding
//! one moves no other. One draw may go to several keys, `*` standing for every entry of a list: all parts of
//! a vehicle are then heavier together.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use crate::input::Invalid;
use crate::noise::stream;

/// An entry `[[dispersion]]` of a campaign.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Dispersion {
    /// Name of its random stream and, with the key, of its column: letters, digits, blanks, `-` and `_`, and no other entry's; absent: the key.
    pub name: Option<String>,
    /// What is drawn: the dotted path in the scenario file, or `vehicle.` and the dotted path in the vehicle file; a number indexes a list, `*` is every entry of it.
    pub key: String,
    /// Further keys that get the same draw.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also: Vec<String>,
    /// How it is drawn.
    pub distribution: Distribution,
    /// What the draw does to the value in force.
    #[serde(default)]
    pub mode: Mode,
    /// Standard deviation of "normal".
    #[schemars(range(min = 0.0, max = 1e9))]
    pub std: Option<f64>,
    /// Three times the standard deviation of "normal", instead of `std`.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub three_sigma: Option<f64>,
    /// Lower end of "uniform".
    #[schemars(range(min = -1e9, max = 1e9))]
    pub low: Option<f64>,
    /// Upper end of "uniform".
    #[schemars(range(min = -1e9, max = 1e9))]
    pub high: Option<f64>,
    /// Values of "choice", all equally likely.
    #[schemars(inner(range(min = -1e9, max = 1e9)))]
    pub values: Option<Vec<f64>>,
    /// Length of "circle", greatest length of "disc".
    #[schemars(range(min = 0.0, max = 1e9))]
    pub radius: Option<f64>,
    /// Where the figures come from.
    pub source: String,
}

/// How a value is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// Gauss's, of mean zero, with `std` or `three_sigma`.
    Normal,
    /// Even between `low` and `high`.
    Uniform,
    /// One of `values`.
    Choice,
    /// Two numbers: a vector of length `radius` in any direction, for the first two entries of a list.
    Circle,
    /// Two numbers: a vector anywhere within `radius`, even over the area, for the first two entries of a list.
    Disc,
}

/// What a draw does to the value in force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// It is added.
    #[default]
    Offset,
    /// It is a share: 0.02 makes the value, or every number of a list, 2 % greater.
    Factor,
    /// It takes the value's place.
    Value,
}

impl Distribution {
    fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Uniform => "uniform",
            Self::Choice => "choice",
            Self::Circle => "circle",
            Self::Disc => "disc",
        }
    }

    /// Keys that it takes; of "normal" one of the two.
    fn takes(self) -> &'static [&'static str] {
        match self {
            Self::Normal => &["std", "three_sigma"],
            Self::Uniform => &["low", "high"],
            Self::Choice => &["values"],
            Self::Circle | Self::Disc => &["radius"],
        }
    }
}

impl Dispersion {
    /// Name of the stream and of the column.
    pub fn name(&self) -> &str {
        self.name.as_deref().unwrap_or(&self.key)
    }

    fn keys(&self) -> impl Iterator<Item = &String> {
        std::iter::once(&self.key).chain(&self.also)
    }

    /// Names of the numbers that one draw has: the entry's, and in brackets the key, whose end is their unit, or of
    /// what they are a share.
    pub fn columns(&self) -> Vec<String> {
        let unit = match (self.mode, &self.name) {
            (Mode::Factor, _) => format!(" [share of {}]", self.key),
            (_, Some(_)) => format!(" [{}]", self.key),
            (_, None) => String::new(),
        };
        let name = self.name();
        match self.distribution {
            Distribution::Normal | Distribution::Uniform | Distribution::Choice => {
                vec![format!("{name}{unit}")]
            }
            Distribution::Circle | Distribution::Disc => {
                (0..2).map(|axis| format!("{name}.{axis}{unit}")).collect()
            }
        }
    }

    /// What no single range can tell.
    ///
    /// # Errors
    /// When the figures are not those of the distribution, or the key is no business of chance.
    pub fn validate(&self) -> Result<(), Invalid> {
        if let Some(name) = &self.name {
            let plain = |c: char| c.is_ascii_alphanumeric() || [' ', '-', '_'].contains(&c);
            if name.is_empty() || name.trim() != name || !name.chars().all(plain) {
                let message = format!("\"{name}\": letters, digits, - and _ only, and blanks between them");
                return Err(Invalid::new("name", message));
            }
        }
        let takes = self.distribution.takes();
        let given: Vec<&str> = [
            ("std", self.std.is_some()),
            ("three_sigma", self.three_sigma.is_some()),
            ("low", self.low.is_some()),
            ("high", self.high.is_some()),
            ("values", self.values.is_some()),
            ("radius", self.radius.is_some()),
        ]
        .iter()
        .filter_map(|&(key, is)| is.then_some(key))
        .collect();
        let name = self.distribution.name();
        if let Some(stray) = given.iter().find(|key| !takes.contains(key)) {
            let message = format!("\"{name}\" does not take it; it takes {}", takes.join(", "));
            return Err(Invalid::new(*stray, message));
        }
        let either = self.distribution == Distribution::Normal;
        if given.len() != if either { 1 } else { takes.len() } {
            let joint = if either { " or " } else { " and " };
            return Err(Invalid::new("distribution", format!("\"{name}\" needs {}", takes.join(joint))));
        }
        if let (Some(low), Some(high)) = (self.low, self.high)
            && low >= high
        {
            return Err(Invalid::new("low", format!("{low} must lie under high, {high}")));
        }
        if self.values.as_ref().is_some_and(Vec::is_empty) {
            return Err(Invalid::new("values", "expected at least 1 entry, got 0"));
        }
        if matches!(self.distribution, Distribution::Circle | Distribution::Disc) && self.mode == Mode::Factor
        {
            return Err(Invalid::new("mode", format!("\"factor\" means nothing beside \"{name}\"")));
        }
        // The autopilot flies the mission as written, and a flight is judged by the campaign.
        for key in self.keys() {
            let top = key.split('.').next().unwrap_or_default();
            if ["mission", "expect", "seed", "vehicle_set", "physics", "fidelity"].contains(&top) {
                return Err(Invalid::new("key", format!("{key} is not left to chance")));
            }
        }
        if self.source.trim().is_empty() {
            return Err(Invalid::new("source", "empty: say where the figures come from"));
        }
        Ok(())
    }

    /// Draws for one flight: one number, or the two of a vector.
    pub fn draw(&self, seed: u32) -> Vec<f64> {
        let mut stream = stream(u64::from(seed), &format!("dispersion.{}", self.name()));
        let figure = |value: Option<f64>| value.unwrap_or(0.0);
        match self.distribution {
            Distribution::Normal => {
                let std = self.std.unwrap_or(figure(self.three_sigma) / 3.0);
                vec![std * stream.normal()]
            }
            Distribution::Uniform => {
                let (low, high) = (figure(self.low), figure(self.high));
                vec![low + (high - low) * stream.uniform()]
            }
            Distribution::Choice => {
                let values = self.values.as_deref().unwrap_or_default();
                // A stream's uniform numbers are on (0, 1].
                let index = (stream.uniform() * values.len() as f64).ceil() as usize;
                vec![values.get(index.saturating_sub(1)).copied().unwrap_or(0.0)]
            }
            Distribution::Circle | Distribution::Disc => {
                let share = stream.uniform();
                let (sin, cos) = libm::sincos(core::f64::consts::TAU * share);
                let length = match self.distribution {
                    Distribution::Disc => figure(self.radius) * stream.uniform().sqrt(),
                    _ => figure(self.radius),
                };
                vec![length * cos, length * sin]
            }
        }
    }

    /// What a draw makes of the values in force, `nominal`: a scenario with its vehicle file at `vehicle`. One
    /// value per key that the entry reaches, by dotted path.
    ///
    /// # Errors
    /// When the key is not there, or the value there is not of a kind that the draw can change.
    pub fn changes(&self, draw: &[f64], nominal: &Json) -> Result<Vec<(String, toml::Value)>, Invalid> {
        let mut paths = Vec::new();
        for key in self.keys() {
            paths.extend(expand(key, nominal)?);
        }
        let change = |path: String| {
            let now = at(nominal, &path).filter(|value| !value.is_null());
            let diagnostic = |message: String| Invalid::new("key", format!("{path}: {message}"));
            let changed = match (now, self.mode, draw) {
                (_, Mode::Value, &[value]) if now.is_none_or(|now| !now.is_array()) => {
                    toml::Value::Float(value)
                }
                (None, ..) => {
                    return Err(diagnostic("unknown key, or one without a value in force".to_owned()));
                }
                (Some(now), Mode::Factor, &[share]) => scaled(now, 1.0 + share)
                    .ok_or_else(|| diagnostic(format!("{now} is neither a number nor a list of numbers")))?,
                (Some(now), Mode::Offset, &[offset]) => {
                    let number = now.as_f64().ok_or_else(|| {
                        diagnostic(format!("{now} is no number; an entry of a list has its index in the key"))
                    })?;
                    toml::Value::Float(number + offset)
                }
                (Some(now), mode, draw) => {
                    let mut list: Vec<f64> = now
                        .as_array()
                        .and_then(|list| list.iter().map(Json::as_f64).collect())
                        .unwrap_or_default();
                    if draw.len() != 2 || list.len() < 2 {
                        return Err(diagnostic(format!(
                            "{now} is no list whose first two entries could change"
                        )));
                    }
                    for (entry, x) in list.iter_mut().zip(draw) {
                        *entry = if mode == Mode::Value { *x } else { *entry + x };
                    }
                    toml::Value::Array(list.into_iter().map(toml::Value::Float).collect())
                }
            };
            Ok((path, changed))
        };
        paths.into_iter().map(change).collect()
    }
}

/// The dotted paths that a key with `*` stands for.
fn expand(key: &str, nominal: &Json) -> Result<Vec<String>, Invalid> {
    let mut paths = vec![String::new()];
    for part in key.split('.') {
        let mut longer = Vec::new();
        for path in &paths {
            let join = |part: &str| if path.is_empty() { part.to_owned() } else { format!("{path}.{part}") };
            if part == "*" {
                let list = at(nominal, path).and_then(Json::as_array);
                let list = list.ok_or_else(|| Invalid::new("key", format!("{path} is no list")))?;
                longer.extend((0..list.len()).map(|index| join(&index.to_string())));
            } else {
                longer.push(join(part));
            }
        }
        paths = longer;
    }
    Ok(paths)
}

fn at<'a>(json: &'a Json, path: &str) -> Option<&'a Json> {
    json.pointer(&format!("/{}", path.replace('.', "/")))
}

/// A number, or every number of a list, times a factor.
fn scaled(value: &Json, factor: f64) -> Option<toml::Value> {
    match value {
        Json::Array(list) => {
            list.iter().map(|item| scaled(item, factor)).collect::<Option<_>>().map(toml::Value::Array)
        }
        _ => value.as_f64().map(|number| toml::Value::Float(number * factor)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const RUNS: u32 = 20_000;

    fn entry(distribution: Distribution) -> Dispersion {
        Dispersion {
            name: None,
            key: "wind.mean_speed_m_s".to_owned(),
            also: Vec::new(),
            distribution,
            mode: Mode::Offset,
            std: None,
            three_sigma: None,
            low: None,
            high: None,
            values: None,
            radius: None,
            source: "a test".to_owned(),
        }
    }

    fn mean(values: impl Iterator<Item = f64>) -> f64 {
        values.sum::<f64>() / f64::from(RUNS)
    }

    /// Mean and variance against the closed forms; the mean of n draws strays by σ/√n, the variance of normal
    /// draws by σ² √(2/n), of uniform ones by less. Bounds of five.
    #[test]
    fn moments_are_those_of_the_distributions() {
        let root = f64::from(RUNS).sqrt();
        let normal = Dispersion { three_sigma: Some(0.6), ..entry(Distribution::Normal) };
        let uniform = Dispersion { low: Some(-1.0), high: Some(2.0), ..entry(Distribution::Uniform) };
        for (entry, expected_mean, variance) in [(normal, 0.0, 0.04), (uniform, 0.5, 0.75)] {
            let draws: Vec<f64> = (0..RUNS).map(|seed| entry.draw(seed)[0]).collect();
            let m = mean(draws.iter().copied());
            let v = mean(draws.iter().map(|x| (x - m) * (x - m)));
            let std = f64::sqrt(variance);
            assert!((m - expected_mean).abs() < 5.0 * std / root, "{m}");
            assert!((v / variance - 1.0).abs() < 5.0 * std::f64::consts::SQRT_2 / root, "{v}");
        }
    }

    /// Each of three values a third of the times, binomial deviation √(2/9/n), bound of five.
    #[test]
    fn a_choice_takes_every_value_alike() {
        let choice = Dispersion { values: Some(vec![-1.0, 0.0, 5.0]), ..entry(Distribution::Choice) };
        for value in [-1.0, 0.0, 5.0] {
            let share = mean((0..RUNS).map(|seed| f64::from(choice.draw(seed)[0] == value)));
            assert!((share - 1.0 / 3.0).abs() < 5.0 * f64::sqrt(2.0 / 9.0 / f64::from(RUNS)), "{share}");
        }
    }

    /// A direction has mean zero and mean square R²/2 an axis; within a disc the mean square length is R²/2.
    #[test]
    fn a_circle_has_one_length_and_a_disc_all_of_them() {
        let root = f64::from(RUNS).sqrt();
        let circle = Dispersion { radius: Some(2.0), ..entry(Distribution::Circle) };
        let disc = Dispersion { radius: Some(2.0), ..entry(Distribution::Disc) };
        for seed in 0..RUNS {
            let v = circle.draw(seed);
            assert!((libm::hypot(v[0], v[1]) - 2.0).abs() < 1e-15 * 4.0);
            let v = disc.draw(seed);
            assert!(libm::hypot(v[0], v[1]) <= 2.0 + 1e-15 * 4.0);
        }
        for axis in 0..2 {
            let m = mean((0..RUNS).map(|seed| circle.draw(seed)[axis]));
            assert!(m.abs() < 5.0 * std::f64::consts::SQRT_2 / root, "{m}");
        }
        // The square is uniform on (0, 4): mean 2, deviation 4/√12.
        let square = mean((0..RUNS).map(|seed| disc.draw(seed).iter().map(|x| x * x).sum()));
        assert!((square - 2.0).abs() < 5.0 * 4.0 / f64::sqrt(12.0) / root, "{square}");
    }

    /// A stream belongs to a name: the same under another key, another under another name or seed.
    #[test]
    fn a_draw_follows_from_seed_and_name_alone() {
        let one = Dispersion { std: Some(1.0), name: Some("a".to_owned()), ..entry(Distribution::Normal) };
        let other_key = Dispersion { key: "site.altitude_m".to_owned(), ..one.clone() };
        let other_name = Dispersion { name: Some("b".to_owned()), ..one.clone() };
        assert_eq!(one.draw(7), other_key.draw(7));
        assert_ne!(one.draw(7), other_name.draw(7));
        assert_ne!(one.draw(7), one.draw(8));
    }

    #[test]
    fn a_draw_reaches_numbers_lists_and_every_entry_of_a_list() {
        let nominal = json!({
            "wind": { "mean_speed_m_s": 4.0 },
            "initial": { "nitrous_kg": null },
            "vehicle": { "component": [
                { "mass_kg": 2.0, "position_m": [0.1, 0.2, 0.3], "inertia_kg_m2": [[1.0, 0.0], [0.0, 2.0]] },
                { "mass_kg": 3.0, "position_m": [0.0, 0.0, 0.0], "inertia_kg_m2": [[4.0, 0.0], [0.0, 4.0]] },
            ] },
        });
        let changes = |key: &str, mode, draw: &[f64]| {
            let entry = Dispersion { key: key.to_owned(), mode, ..entry(Distribution::Normal) };
            let changes = entry.changes(draw, &nominal);
            changes.map(|all| all.iter().map(|(key, value)| format!("{key}={value}")).collect::<Vec<_>>())
        };
        assert_eq!(
            changes("wind.mean_speed_m_s", Mode::Offset, &[1.5]).unwrap(),
            ["wind.mean_speed_m_s=5.5"]
        );
        assert_eq!(
            changes("vehicle.component.*.mass_kg", Mode::Factor, &[0.5]).unwrap(),
            ["vehicle.component.0.mass_kg=3.0", "vehicle.component.1.mass_kg=4.5"]
        );
        assert_eq!(
            changes("vehicle.component.1.inertia_kg_m2", Mode::Factor, &[-0.5]).unwrap(),
            ["vehicle.component.1.inertia_kg_m2=[[2.0, 0.0], [0.0, 2.0]]"]
        );
        assert_eq!(
            changes("vehicle.component.0.position_m", Mode::Offset, &[0.5, -0.25]).unwrap(),
            ["vehicle.component.0.position_m=[0.6, -0.04999999999999999, 0.3]"]
        );
        assert_eq!(
            changes("vehicle.component.0.position_m.2", Mode::Value, &[0.5]).unwrap(),
            ["vehicle.component.0.position_m.2=0.5"]
        );
        assert_eq!(changes("initial.nitrous_kg", Mode::Value, &[9.0]).unwrap(), ["initial.nitrous_kg=9.0"]);
        for (key, mode, draw) in [
            ("initial.nitrous_kg", Mode::Offset, &[1.0][..]),
            ("wind.speed", Mode::Factor, &[1.0]),
            ("vehicle.component.0.position_m", Mode::Offset, &[1.0]),
            ("vehicle.component.0.position_m", Mode::Value, &[1.0]),
            ("wind.mean_speed_m_s", Mode::Offset, &[1.0, 2.0]),
            ("wind.*.x", Mode::Offset, &[1.0]),
        ] {
            assert!(changes(key, mode, draw).is_err(), "{key}");
        }
    }

    #[test]
    fn figures_must_be_those_of_the_distribution() {
        let diagnostic = |entry: Dispersion| entry.validate().unwrap_err().to_string();
        assert_eq!(
            diagnostic(entry(Distribution::Normal)),
            "distribution: \"normal\" needs std or three_sigma"
        );
        assert_eq!(
            diagnostic(Dispersion { low: Some(1.0), ..entry(Distribution::Uniform) }),
            "distribution: \"uniform\" needs low and high"
        );
        assert_eq!(
            diagnostic(Dispersion { std: Some(1.0), ..entry(Distribution::Circle) }),
            "std: \"circle\" does not take it; it takes radius"
        );
        assert_eq!(
            diagnostic(Dispersion { low: Some(2.0), high: Some(1.0), ..entry(Distribution::Uniform) }),
            "low: 2 must lie under high, 1"
        );
        let judged = Dispersion {
            std: Some(1.0),
            key: "mission.hover_height_m".to_owned(),
            ..entry(Distribution::Normal)
        };
        assert_eq!(diagnostic(judged), "key: mission.hover_height_m is not left to chance");
    }
}
