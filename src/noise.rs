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

/// One independent source of random numbers.
#[derive(Clone, Debug)]
pub struct Stream(Pcg64);

/// The stream of that name under that seed. Names are dotted paths, such as `imu.gyro`.
pub fn stream(seed: u64, name: &str) -> Stream {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64; // FNV-1a, 64 bit: offset basis
    for byte in seed.to_le_bytes().into_iter().chain(name.bytes()) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3); // and its prime
    }
    let mut word = || u128::from(split_mix(&mut hash));
    let state = word() << 64 | word();
    let sequence = word() << 64 | word();
    Stream(Pcg64::new(state, sequence))
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
        ((self.0.next_u64() >> 11) + 1) as f64 * (0.5 / (1_u64 << 52) as f64)
    }

    /// Standard normal deviate. Always takes two words, so the count of draws never depends on values.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(self.uniform())).sqrt();
        radius * libm::cos(core::f64::consts::TAU * self.uniform())
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
pub fn sample_std(density_per_sqrt_hz: f64, rate_hz: f64) -> f64 {
    density_per_sqrt_hz * (0.5 * rate_hz).sqrt()
}

/// First-order Gauss-Markov process: noise that forgets with a time constant, at constant variance.
///
/// Gelb, "Applied Optimal Estimation", 1974, section 3.7; the discretisation is exact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GaussMarkov {
    /// Stationary standard deviation.
    pub std: f64,
    /// Time in which the correlation falls to 1/e [s], above 0.
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
