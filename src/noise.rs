//! Randomness: independent named streams that grow from the one seed of a run, and the processes
//! that sensor errors are made of.
//!
//! A stream belongs to a name, not to a place in a sequence, so adding a sensor moves no other
//! sensor's noise. All arithmetic is integer, IEEE-exact or from `libm`: a seed gives the same bits
//! on every platform.
//!
//! Sources: O'Neill, "PCG", Harvey Mudd HMC-CS-2014-0905; Fowler, Noll and Vo's FNV-1a hash; Steele et
//! al., "Fast splittable pseudorandom number generators", 2014 (SplitMix64); Box and Muller, Ann.
//! Math. Statist. 29 (1958) 610.

use rand_core::Rng;
use rand_pcg::Pcg64;

use crate::frame::Vec3;
use crate::hash::Fnv;

/// One independent source of random numbers.
#[derive(Clone, Debug)]
pub struct Stream {
    generator: Pcg64,
    /// The second deviate of the last pair.
    spare: Option<f64>,
}

/// The stream of that name under that seed. Names are dotted paths, such as `imu.gyro`.
pub fn stream(seed: u64, name: &str) -> Stream {
    let mut hash = Fnv::default();
    hash.add(&seed.to_le_bytes());
    hash.add(name.as_bytes());
    let mut mixed = hash.word();
    let mut word = || u128::from(split_mix(&mut mixed));
    let state = word() << 64 | word();
    let sequence = word() << 64 | word();
    Stream { generator: Pcg64::new(state, sequence), spare: None }
}

/// SplitMix64: advances the state and returns a well-mixed word.
fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Stream {
    /// Uniform on (0, 1], in steps of 2⁻⁵³.
    pub fn uniform(&mut self) -> f64 {
        ((self.generator.next_u64() >> 11) + 1) as f64 * (0.5 / (1_u64 << 52) as f64)
    }

    /// Standard normal deviate. Deviates come in pairs from two words each, never by rejection, so the
    /// place in the stream depends on their count alone.
    pub fn normal(&mut self) -> f64 {
        if let Some(deviate) = self.spare.take() {
            return deviate;
        }
        let radius = (-2.0 * libm::log(self.uniform())).sqrt();
        let (sin, cos) = libm::sincos(core::f64::consts::TAU * self.uniform());
        self.spare = Some(radius * sin);
        radius * cos
    }

    /// Three independent standard normal deviates.
    pub fn normal3(&mut self) -> Vec3 {
        let (x, y, z) = (self.normal(), self.normal(), self.normal());
        Vec3::new(x, y, z)
    }
}

/// Error of one sensor channel: white noise on a bias that was drawn once and walks since.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ChannelError {
    /// Standard deviation of the white part of one sample.
    pub white_std: f64,
    /// Growth of the bias per square root of a second.
    pub walk_per_sqrt_s: f64,
    /// The bias now.
    pub bias: f64,
}

impl ChannelError {
    /// Draws the initial bias, of standard deviation `bias_std`.
    pub fn new(white_std: f64, walk_per_sqrt_s: f64, bias_std: f64, stream: &mut Stream) -> Self {
        Self { white_std, walk_per_sqrt_s, bias: bias_std * stream.normal() }
    }

    /// Lets the bias walk for `elapsed_s` and returns the error of one sample. Draws two deviates even
    /// where a magnitude is zero, so that switching an error off leaves the other errors as they were.
    pub fn sample(&mut self, elapsed_s: f64, stream: &mut Stream) -> f64 {
        self.bias += self.walk_per_sqrt_s * elapsed_s.sqrt() * stream.normal();
        self.bias + self.white_std * stream.normal()
    }
}

/// Standard deviation of one sample at `rate_hz` of white noise with a one-sided density.
pub(crate) fn sample_std(density_per_sqrt_hz: f64, rate_hz: f64) -> f64 {
    density_per_sqrt_hz * (0.5 * rate_hz).sqrt()
}

/// First-order Gauss-Markov process: noise that forgets with a time constant, at constant variance.
///
/// Gelb, "Applied Optimal Estimation", 1974, section 3.7; the discretisation is exact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GaussMarkov {
    /// Stationary standard deviation.
    pub std: f64,
    /// Time in which the correlation falls to 1/e (s), above 0.
    pub time_constant_s: f64,
    /// The process now.
    pub value: f64,
}

impl GaussMarkov {
    /// Starts in the stationary distribution.
    pub fn new(std: f64, time_constant_s: f64, stream: &mut Stream) -> Self {
        Self { std, time_constant_s, value: std * stream.normal() }
    }

    /// Moves `elapsed_s` on and returns the new value.
    pub fn sample(&mut self, elapsed_s: f64, stream: &mut Stream) -> f64 {
        let memory = libm::exp(-elapsed_s / self.time_constant_s);
        self.value = memory * self.value + self.std * (1.0 - memory * memory).sqrt() * stream.normal();
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: usize = 200_000;

    fn mean(x: &[f64]) -> f64 {
        x.iter().sum::<f64>() / x.len() as f64
    }

    /// Pins the bits: a change here changes every recorded run. The words agree with FNV-1a, SplitMix64 and
    /// PCG XSL RR 128/64 written out in Python's integers, the deviate with its `math` module.
    #[test]
    fn a_stream_is_the_same_bits_everywhere() {
        let mut s = stream(42, "imu.gyro");
        let words = [(); 3].map(|()| s.generator.next_u64());
        assert_eq!(words, [16_316_012_584_402_850_657, 7_610_576_943_914_963_249, 2_526_639_976_421_960_673]);
        assert_eq!(stream(42, "imu.gyro").normal(), -0.422_564_248_989_554_36);
    }

    #[test]
    fn seed_and_name_both_make_a_stream() {
        let first = |seed, name| stream(seed, name).uniform();
        assert_eq!(first(1, "a"), first(1, "a"));
        assert_ne!(first(1, "a"), first(2, "a"));
        assert_ne!(first(1, "a"), first(1, "b"));
    }

    /// Bounds of five standard errors: mean 1/sqrt(n), variance sqrt(2/n), fourth moment sqrt(96/n),
    /// count beyond 3 sigma sqrt(n p). The seed is fixed, so the test cannot fail by chance later.
    #[test]
    fn deviates_are_normal() {
        let mut s = stream(7, "normal");
        let x: Vec<f64> = (0..COUNT).map(|_| s.normal()).collect();
        let n = COUNT as f64;
        let moment = |k: i32| x.iter().map(|v| v.powi(k)).sum::<f64>() / n;
        assert!(moment(1).abs() < 5.0 / n.sqrt());
        assert!((moment(2) - 1.0).abs() < 5.0 * (2.0 / n).sqrt());
        assert!((moment(4) - 3.0).abs() < 5.0 * (96.0 / n).sqrt());
        let beyond = x.iter().filter(|v| v.abs() > 3.0).count() as f64;
        let expected = 2.699_796e-3 * n;
        assert!((beyond - expected).abs() < 5.0 * expected.sqrt());
    }

    /// Correlation of independent samples is normal with 1/sqrt(n); bound of five.
    #[test]
    fn streams_do_not_know_each_other_nor_their_own_past() {
        let draw = |seed, name: &str| -> Vec<f64> {
            let mut s = stream(seed, name);
            (0..COUNT).map(|_| s.normal()).collect()
        };
        let correlation =
            |a: &[f64], b: &[f64]| mean(&a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>());
        let (a, b, c) = (draw(1, "imu.gyro.x"), draw(1, "imu.gyro.y"), draw(2, "imu.gyro.x"));
        let bound = 5.0 / (COUNT as f64).sqrt();
        assert!(correlation(&a, &b).abs() < bound);
        assert!(correlation(&a, &c).abs() < bound);
        assert!(correlation(&a[1..], &a[..COUNT - 1]).abs() < bound);
    }

    /// Over an ensemble of m runs the variance of a walk is w² t, each estimate good to sqrt(2/m); so
    /// the Allan-type growth is linear in time. Bounds of five.
    #[test]
    fn a_bias_walks_with_the_root_of_time_whatever_the_rate() {
        let (walk, runs) = (0.3, 4000);
        for (rate_hz, seconds) in [(10.0, 1.0), (10.0, 16.0), (50.0, 4.0)] {
            let mut s = stream(3, "walk");
            let ends: Vec<f64> = (0..runs)
                .map(|_| {
                    let mut error = ChannelError::new(0.0, walk, 0.0, &mut s);
                    for _ in 0..(seconds * rate_hz) as usize {
                        error.sample(1.0 / rate_hz, &mut s);
                    }
                    error.bias * error.bias
                })
                .collect();
            let ratio = mean(&ends) / (walk * walk * seconds);
            assert!(
                (ratio - 1.0).abs() < 5.0 * (2.0 / f64::from(runs)).sqrt(),
                "{rate_hz} {seconds}: {ratio}"
            );
        }
    }

    /// Stationary from the start: variance std² after any time, correlation exp(-t/T) over a lag.
    #[test]
    fn gauss_markov_keeps_its_variance_and_forgets_with_its_time_constant() {
        let (std, time_constant_s, runs) = (0.6, 200.0, 20_000);
        let mut s = stream(5, "drift");
        let (mut variance, mut covariance) = (0.0, 0.0);
        for _ in 0..runs {
            let mut process = GaussMarkov::new(std, time_constant_s, &mut s);
            let start = process.value;
            for _ in 0..4 {
                process.sample(25.0, &mut s);
            }
            variance += process.value * process.value / f64::from(runs);
            covariance += start * process.value / f64::from(runs);
        }
        let bound = 5.0 * (2.0 / f64::from(runs)).sqrt();
        assert!((variance / (std * std) - 1.0).abs() < bound);
        assert!((covariance / (std * std) - libm::exp(-0.5)).abs() < bound);
    }

    #[test]
    fn a_uniform_number_has_a_logarithm() {
        let mut s = stream(9, "uniform");
        assert!((0..COUNT).all(|_| (f64::MIN_POSITIVE..=1.0).contains(&s.uniform())));
        assert!(s.normal3().iter().all(|v| v.is_finite()));
    }
}
