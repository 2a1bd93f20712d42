//! What no model of the vehicle accounts for, and when: thrust that is biased, noisy or off its axis, pulses
//! of force and moment.
//!
//! Each entry has a window of mission time, in which it adds its effect; effects add where windows overlap.
//! The plant takes the sum between steps and holds it during one, so a pulse whose ends lie on the step has
//! its exact impulse. Noise of the thrust is relative, a Gauss-Markov process whose spectrum is flat up to a
//! corner frequency and falls by 20 dB a decade above. Without thrust there is nothing to be noisy: a dead
//! engine stays at zero.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::frame::Vec3;
use crate::input::Invalid;
use crate::noise::{GaussMarkov, Stream, stream};

/// An entry `[[disturbance]]` of a scenario.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Disturbance {
    /// Name in the list of events; its noise follows from the seed and this name.
    pub name: String,
    /// Mission time at which it begins, that is since ignition (s).
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub start_s: f64,
    /// How long it lasts (s); absent: to the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 86400.0))]
    pub duration_s: Option<f64>,
    /// Thrust above or below what the engine model gives, as a share of it: 0.03 is 3 % more.
    #[schemars(range(min = -1.0, max = 1.0))]
    pub thrust_bias: f64,
    /// Standard deviation of thrust noise, as a share of the thrust.
    #[schemars(range(min = 0.0, max = 0.5))]
    pub thrust_noise_std: f64,
    /// Corner frequency of that noise (Hz).
    #[schemars(range(min = 0.01, max = 200.0))]
    pub thrust_noise_corner_hz: f64,
    /// Fixed angles of the thrust line at zero gimbal, in the sense of the gimbal commands x and y (rad).
    #[schemars(inner(range(min = -0.2, max = 0.2)))]
    pub misalignment_rad: [f64; 2],
    /// Sideways offset of the thrust line from the gimbal pivot, body FRD x and y (m).
    #[schemars(inner(range(min = -1.0, max = 1.0)))]
    pub thrust_offset_m: [f64; 2],
    /// Force, body FRD (N), at `point_m`.
    #[schemars(inner(range(min = -1e5, max = 1e5)))]
    pub force_body_n: [f64; 3],
    /// Where that force acts, body FRD from the gimbal pivot (m).
    #[schemars(inner(range(min = -20.0, max = 20.0)))]
    pub point_m: [f64; 3],
    /// Moment, body FRD (N m).
    #[schemars(inner(range(min = -1e5, max = 1e5)))]
    pub moment_body_n_m: [f64; 3],
}

impl Default for Disturbance {
    fn default() -> Self {
        Self {
            name: String::new(),
            start_s: 0.0,
            duration_s: None,
            thrust_bias: 0.0,
            thrust_noise_std: 0.0,
            thrust_noise_corner_hz: 10.0,
            misalignment_rad: [0.0; 2],
            thrust_offset_m: [0.0; 2],
            force_body_n: [0.0; 3],
            point_m: [0.0; 3],
            moment_body_n_m: [0.0; 3],
        }
    }
}

impl Disturbance {
    /// Stream of its noise, by its name or else its place.
    fn stream(&self, index: usize) -> String {
        if self.name.is_empty() {
            format!("disturbance.{index}")
        } else {
            format!("disturbance.{}", self.name)
        }
    }

    /// # Errors
    /// When the entry does nothing.
    pub fn validate(&self) -> Result<(), Invalid> {
        let idle = Self {
            name: self.name.clone(),
            start_s: self.start_s,
            duration_s: self.duration_s,
            thrust_noise_corner_hz: self.thrust_noise_corner_hz,
            point_m: self.point_m,
            ..Self::default()
        };
        if self.duration_s == Some(0.0) {
            return Err(Invalid::new(
                "duration_s",
                "0 disturbs nothing: give it a time, or none for all of the flight",
            ));
        }
        if *self == idle {
            return Err(Invalid::new(
                "",
                "disturbs nothing: give it a bias, noise, misalignment, force or moment",
            ));
        }
        Ok(())
    }

    fn acts_at(&self, mission_s: f64) -> bool {
        let since_s = mission_s - self.start_s;
        since_s >= 0.0 && self.duration_s.is_none_or(|duration_s| since_s < duration_s)
    }
}

/// Checks the entries of a scenario, each and beside each other.
///
/// # Errors
/// When one does nothing, or two have one name.
pub fn validate(entries: &[Disturbance]) -> Result<(), Invalid> {
    for (index, entry) in entries.iter().enumerate() {
        entry.validate().map_err(|invalid| invalid.within(&index.to_string()))?;
        let stream = entry.stream(index);
        if let Some(first) = (0..index).find(|&first| entries[first].stream(first) == stream) {
            return Err(Invalid::new(
                format!("{index}.name"),
                format!(
                    "entry {first} has this name too, and the noise that follows from it: each needs its own"
                ),
            ));
        }
    }
    Ok(())
}

/// The sum of all that acts now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effect {
    /// Thrust over that of the model, less one.
    pub thrust_share: f64,
    /// Angles added to the gimbal's (rad).
    pub misalignment_rad: [f64; 2],
    /// Offset of the thrust line, body FRD x and y (m).
    pub thrust_offset_m: [f64; 2],
    /// Force, body FRD (N).
    pub force_body_n: Vec3,
    /// Moment about the gimbal pivot, body FRD (N m).
    pub moment_body_n_m: Vec3,
}

impl Effect {
    /// What becomes of a thrust (N); never negative.
    pub fn thrust_n(&self, thrust_n: f64) -> f64 {
        (thrust_n * (1.0 + self.thrust_share)).max(0.0)
    }
}

/// The disturbances of a flight, in time.
#[derive(Clone, Debug)]
pub struct Disturbances {
    running: Vec<Running>,
    constant: Option<ConstantDisturbance>,
}

/// A constant disturbance without a window of time, as somebody at a bench sets it in mid-run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ConstantDisturbance {
    /// Thrust above or below what the engine model gives, as a share of it.
    pub thrust_bias: f64,
    /// Angles of the thrust line at zero gimbal (rad).
    pub misalignment_rad: [f64; 2],
    /// Force at the gimbal pivot, body FRD (N).
    pub force_body_n: Vec3,
}

#[derive(Clone, Debug)]
struct Running {
    entry: Disturbance,
    noise: GaussMarkov,
    stream: Stream,
    acts: bool,
}

impl Disturbances {
    /// From the entries of a scenario and the seed of the run.
    pub fn new(entries: &[Disturbance], seed: u64) -> Self {
        let running = entries.iter().enumerate().map(|(index, entry)| {
            let mut stream = stream(seed, &entry.stream(index));
            let time_constant_s = 1.0 / (core::f64::consts::TAU * entry.thrust_noise_corner_hz);
            let noise = GaussMarkov::new(entry.thrust_noise_std, time_constant_s, &mut stream);
            Running { entry: entry.clone(), noise, stream, acts: false }
        });
        Self { running: running.collect(), constant: None }
    }

    /// Sets what acts beside the scenario's disturbances from now on.
    pub(crate) fn set_constant(&mut self, constant: Option<ConstantDisturbance>) {
        self.constant = constant;
    }

    /// Moves on by a step (s) to a mission time (`None` before ignition) and gives what acts from there on.
    /// `changed` hears the name of every entry that begins (`true`) or ends.
    pub fn advance(
        &mut self,
        dt_s: f64,
        mission_s: Option<f64>,
        mut changed: impl FnMut(&str, bool),
    ) -> Effect {
        let mut sum = Effect::default();
        for running in &mut self.running {
            let entry = &running.entry;
            let noise = if entry.thrust_noise_std > 0.0 {
                running.noise.sample(dt_s, &mut running.stream)
            } else {
                0.0
            };
            let acts = mission_s.is_some_and(|mission_s| entry.acts_at(mission_s));
            if acts != running.acts {
                running.acts = acts;
                changed(&entry.name, acts);
            }
            if !acts {
                continue;
            }
            sum.thrust_share += entry.thrust_bias + noise;
            for axis in 0..2 {
                sum.misalignment_rad[axis] += entry.misalignment_rad[axis];
                sum.thrust_offset_m[axis] += entry.thrust_offset_m[axis];
            }
            let force = Vec3::from(entry.force_body_n);
            sum.force_body_n += force;
            sum.moment_body_n_m +=
                Vec3::from(entry.moment_body_n_m) + Vec3::from(entry.point_m).cross(&force);
        }
        if let Some(constant) = &self.constant {
            sum.thrust_share += constant.thrust_bias;
            for axis in 0..2 {
                sum.misalignment_rad[axis] += constant.misalignment_rad[axis];
            }
            sum.force_body_n += constant.force_body_n;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn effects_add_where_windows_overlap() {
        let mut all = Disturbances::new(
            &[
                Disturbance { thrust_bias: 0.03, misalignment_rad: [0.01, 0.0], ..Default::default() },
                Disturbance {
                    name: "push".to_owned(),
                    start_s: 5.0,
                    duration_s: Some(2.0),
                    thrust_bias: -0.05,
                    force_body_n: [10.0, 0.0, 0.0],
                    point_m: [0.0, 0.0, -0.8],
                    moment_body_n_m: [0.0, 1.0, 0.0],
                    ..Default::default()
                },
            ],
            1,
        );
        let mut seen = Vec::new();
        let mut at =
            |mission_s| all.advance(1e-3, mission_s, |name, begins| seen.push((name.to_owned(), begins)));
        assert_eq!(at(None), Effect::default());
        let alone = at(Some(4.999));
        assert_eq!((alone.thrust_share, alone.misalignment_rad), (0.03, [0.01, 0.0]));
        assert_eq!(alone.force_body_n, Vec3::zeros());
        let both = at(Some(5.0));
        assert!((both.thrust_n(1000.0) - 980.0).abs() < 1e-9);
        assert_eq!(both.force_body_n.x, 10.0);
        // (0, 0, -0.8) x (10, 0, 0) = (0, -8, 0)
        assert_eq!(both.moment_body_n_m, Vec3::new(0.0, -7.0, 0.0));
        assert_eq!(at(Some(7.0)), alone);
        let push = |begins| ("push".to_owned(), begins);
        assert_eq!(seen, [(String::new(), true), push(true), push(false)]);
    }

    #[test]
    fn what_stands_acts_before_ignition_too_until_it_is_taken_away() {
        let mut all = Disturbances::new(&[], 1);
        let at = |all: &mut Disturbances| all.advance(1e-3, None, |_, _| {});
        all.set_constant(Some(ConstantDisturbance {
            thrust_bias: -0.1,
            force_body_n: Vec3::x(),
            ..Default::default()
        }));
        let effect = at(&mut all);
        assert_eq!((effect.thrust_share, effect.force_body_n), (-0.1, Vec3::x()));
        all.set_constant(None);
        assert_eq!(at(&mut all), Effect::default());
    }

    #[test]
    fn thrust_is_never_negative_and_nothing_stays_nothing() {
        let effect = Effect { thrust_share: -1.7, ..Effect::default() };
        assert_eq!(effect.thrust_n(500.0), 0.0);
        assert_eq!(Effect { thrust_share: 0.3, ..effect }.thrust_n(0.0), 0.0);
    }

    /// Variance and correlation over one time constant, 1/(2 π f), of 20 000 ensemble members: sqrt(2/n), bound of five.
    #[test]
    fn noise_has_its_deviation_and_corner() {
        let (n, std, corner_hz) = (20_000, 0.02, 5.0);
        let (mut variance, mut covariance) = (0.0, 0.0);
        for seed in 0..n {
            let entry = Disturbance {
                thrust_noise_std: std,
                thrust_noise_corner_hz: corner_hz,
                ..Default::default()
            };
            let mut one = Disturbances::new(&[entry], seed);
            let mut sample = |dt_s| one.advance(dt_s, Some(0.0), |_, _| {}).thrust_share;
            let first = sample(0.01);
            let second = sample(1.0 / (core::f64::consts::TAU * corner_hz));
            variance += second * second / (n as f64 * std * std);
            covariance += first * second / (n as f64 * std * std);
        }
        let bound = 5.0 * (2.0 / n as f64).sqrt();
        assert!((variance - 1.0).abs() < bound, "{variance}");
        assert!((covariance - libm::exp(-1.0)).abs() < bound, "{covariance}");
    }

    /// Adding an entry moves no other's noise, as long as they have names.
    #[test]
    fn a_named_entry_keeps_its_noise() {
        let noisy =
            |name: &str| Disturbance { name: name.to_owned(), thrust_noise_std: 0.1, ..Default::default() };
        let share = |entries: &[Disturbance]| {
            Disturbances::new(entries, 3).advance(1e-3, Some(0.0), |_, _| {}).thrust_share
        };
        let (a, b) = (share(&[noisy("a")]), share(&[noisy("b")]));
        assert_ne!(a, b);
        assert!((share(&[noisy("b"), noisy("a")]) - (a + b)).abs() < 1e-15);
    }

    /// One name is one stream of noise: two such entries would add as 2 σ, not as √2 σ.
    #[test]
    fn names_differ() {
        let noisy =
            |name: &str| Disturbance { name: name.to_owned(), thrust_noise_std: 0.1, ..Default::default() };
        assert!(validate(&[noisy("a"), noisy("b"), noisy(""), noisy("")]).is_ok());
        assert_eq!(validate(&[noisy("b"), noisy("a"), noisy("b")]).unwrap_err().key, "2.name");
        // Nameless, the second is "1".
        assert_eq!(validate(&[noisy("1"), noisy("")]).unwrap_err().key, "1.name");
    }

    #[test]
    fn an_entry_that_does_nothing_is_a_mistake() {
        let idle = Disturbance { name: "x".to_owned(), point_m: [1.0, 0.0, 0.0], ..Default::default() };
        assert!(idle.validate().is_err());
        let biased = Disturbance { thrust_bias: 0.01, ..idle };
        assert!(biased.validate().is_ok());
        let brief = Disturbance { duration_s: Some(0.0), ..biased };
        assert_eq!(brief.validate().unwrap_err().key, "duration_s");
    }
}
