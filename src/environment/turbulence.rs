//! Dryden turbulence close to the ground.
//!
//! Three independent stationary processes ride on the mean wind: along it, across it (level), and down. Their
//! intensities and lengths follow from the height h and the wind at 20 ft (h in feet, 10 to 1000):
//!
//! ```text
//! σ_w = 0.1 W20               L_w = h
//! σ_u = σ_v = σ_w/b^0.4       L_u = L_v = h/b^1.2           b = 0.177 + 0.000823 h
//! ```
//!
//! Their spectra are those of white noise through `1/(1 + T s)` along the wind and `(1 + √3 T s)/(1 + T s)²`
//! across it and down, `T = L/V`, so their autocorrelations are `σ² e^(-τ/T)` and `σ² (1 - τ/(2T)) e^(-τ/T)`.
//! Source: MIL-F-8785C, 1980, section 3.7; MIL-HDBK-1797 writes the same spectra with half the lengths across
//! and down and `2 L` where this has L.
//!
//! **V.** The spectra are those that a vehicle meets as it flies through air that is frozen at that instant,
//! with V its airspeed. A lander hangs in one place or drifts with the wind, and slow flight through frozen
//! air would stop the turbulence; what then passes is carried by the wind. So V is the greater of the speed
//! of the vehicle against the mean wind and the wind at 20 ft.
//!
//! The processes move between steps of the plant, and hold during one. The discretisation is exact for any
//! step, and the variance stays where it is whatever T does from step to step. No gradient over the vehicle:
//! all of it meets the same air, right for lengths far above its size.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::frame::Vec3;
use crate::noise::{Stream, stream};

const FOOT_M: f64 = 0.3048;
/// Height of the wind that sets the intensity (m): 20 ft.
pub(crate) const INTENSITY_HEIGHT_M: f64 = 20.0 * FOOT_M;
/// Heights for which the lengths and intensities are meant (ft).
const VALID_FT: [f64; 2] = [10.0, 1000.0];

/// Turbulence of a flight: the `[wind.turbulence]` table of a scenario. An empty table turns it on.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TurbulenceParameters {
    /// Wind at 20 ft, which sets the intensity (m/s); absent: what mean wind and profile give there. By the specification 7.7 is light, 15.4 moderate, 23.2 severe.
    #[schemars(range(min = 0.0, max = 60.0))]
    pub wind_at_20_ft_m_s: Option<f64>,
}

/// Intensity and length of turbulence at a height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scales {
    /// Standard deviation along and across the mean wind (m/s).
    pub level_std_m_s: f64,
    /// Standard deviation downward (m/s).
    pub vertical_std_m_s: f64,
    /// Length along and across the mean wind (m).
    pub level_length_m: f64,
    /// Length downward (m).
    pub vertical_length_m: f64,
}

impl Scales {
    /// At a height above the ground, held within the model's validity.
    pub fn at(wind_at_20_ft_m_s: f64, height_m: f64) -> Self {
        let height_ft = (height_m / FOOT_M).clamp(VALID_FT[0], VALID_FT[1]);
        let root = libm::pow(0.177 + 0.000_823 * height_ft, 0.4);
        let vertical_std_m_s = 0.1 * wind_at_20_ft_m_s;
        Self {
            level_std_m_s: vertical_std_m_s / root,
            vertical_std_m_s,
            level_length_m: height_ft * FOOT_M / (root * root * root),
            vertical_length_m: height_ft * FOOT_M,
        }
    }
}

/// Turbulent air over the pad.
#[derive(Clone, Debug)]
pub struct Turbulence {
    wind_at_20_ft_m_s: f64,
    /// Direction that the mean wind blows to, and the one to its right.
    axes_ned: [Vec3; 2],
    along: f64,
    across: SecondOrder,
    down: SecondOrder,
    stream: Stream,
    velocity_ned_m_s: Vec3,
}

impl Turbulence {
    /// In its stationary distribution; `toward_ned` is where the mean wind blows to, level and of length one.
    pub fn new(wind_at_20_ft_m_s: f64, toward_ned: Vec3, seed: u64) -> Self {
        let mut stream = stream(seed, "wind.turbulence");
        Self {
            wind_at_20_ft_m_s,
            axes_ned: [toward_ned, Vec3::new(-toward_ned.y, toward_ned.x, 0.0)],
            along: stream.normal(),
            across: SecondOrder::stationary(&mut stream),
            down: SecondOrder::stationary(&mut stream),
            stream,
            velocity_ned_m_s: Vec3::zeros(),
        }
    }

    /// Moves on by a time (s), for a vehicle at a height that moves against the mean wind at a speed (m/s).
    pub fn advance(&mut self, dt_s: f64, height_m: f64, airspeed_m_s: f64) {
        let scales = Scales::at(self.wind_at_20_ft_m_s, height_m);
        let travelled_m = dt_s * airspeed_m_s.max(self.wind_at_20_ft_m_s);
        let level = travelled_m / scales.level_length_m;
        let memory = libm::exp(-level);
        self.along = memory * self.along + (1.0 - memory * memory).sqrt() * self.stream.normal();
        self.across.advance(level, &mut self.stream);
        self.down.advance(travelled_m / scales.vertical_length_m, &mut self.stream);
        self.velocity_ned_m_s = (self.axes_ned[0] * self.along + self.axes_ned[1] * self.across.value())
            * scales.level_std_m_s
            + Vec3::z() * (scales.vertical_std_m_s * self.down.value());
    }

    /// What it adds to the wind (m/s).
    pub fn velocity_ned_m_s(&self) -> Vec3 {
        self.velocity_ned_m_s
    }
}

/// White noise through `(1 + √3 T s)/(1 + T s)²`, at unit variance.
///
/// Two lags in a row, `T a' = n - a`, `T b' = a - b`, with n such that a has unit variance; then cov(a, b) = var b =
/// 1/2, and `(b + √3 T b')/√2 = (√3 a + (1 - √3) b)/√2` has the numerator and unit variance.
#[derive(Clone, Copy, Debug)]
struct SecondOrder {
    a: f64,
    b: f64,
}

impl SecondOrder {
    fn stationary(stream: &mut Stream) -> Self {
        let a = stream.normal();
        // b given a: mean a/2, variance 1/2 - 1/4.
        Self { a, b: 0.5 * a + 0.5 * stream.normal() }
    }

    /// Moves on by `x` time constants: `a, b -> e a, e (b + x a)` with `e = exp(-x)`, and noise that makes up for
    /// the lost covariance.
    fn advance(&mut self, x: f64, stream: &mut Stream) {
        let (e, lost) = (libm::exp(-x), -libm::expm1(-2.0 * x)); // lost = 1 - e²
        let e2 = e * e;
        let (aa, ab, bb) = (lost, 0.5 * lost - e2 * x, 0.5 * lost - e2 * x * (1.0 + x));
        let std_a = aa.sqrt();
        let b_of_a = if std_a > 0.0 { ab / std_a } else { 0.0 };
        let std_b = (bb - b_of_a * b_of_a).max(0.0).sqrt(); // x³/6, below rounding for the least x
        let (n1, n2) = (stream.normal(), stream.normal());
        let (a, b) = (self.a, self.b);
        self.a = e * a + std_a * n1;
        self.b = e * (b + x * a) + b_of_a * n1 + std_b * n2;
    }

    fn value(&self) -> f64 {
        let root3 = 3.0_f64.sqrt();
        (root3 * self.a + (1.0 - root3) * self.b) * core::f64::consts::FRAC_1_SQRT_2
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of the specification's formulas worked by hand: at 100 ft b = 0.2593, at 1000 ft b = 1.
    #[test]
    fn scales_are_those_of_the_specification() {
        let at = |height_ft: f64| Scales::at(10.0, height_ft * FOOT_M);
        let low = at(100.0);
        assert!((low.vertical_std_m_s - 1.0).abs() < 1e-15);
        assert!((low.vertical_length_m - 30.48).abs() < 1e-12);
        assert!((low.level_std_m_s - 1.715_8).abs() < 1e-3, "{}", low.level_std_m_s);
        assert!((low.level_length_m / FOOT_M - 505.2).abs() < 1.0, "{}", low.level_length_m / FOOT_M);
        let top = at(1000.0);
        assert!((top.level_std_m_s - 1.0).abs() < 1e-12 && (top.level_length_m - 304.8).abs() < 1e-9);
        assert_eq!(at(-5.0), at(10.0));
        assert_eq!(at(5000.0), at(1000.0));
    }

    /// Autocorrelations from the spectra (Wiener-Khinchin), over an ensemble: each estimate of a variance is good
    /// to sqrt(2/n), of a covariance to sqrt((1 + c²)/n); bounds of five. Steps and airspeed vary on the
    /// way: the exact discretisation must not mind.
    #[test]
    fn variance_and_autocorrelation_are_those_of_the_spectra() {
        const RUNS: usize = 40_000;
        let (w20, height_m) = (8.0, 40.0);
        let scales = Scales::at(w20, height_m);
        let toward = Vec3::new(0.6, 0.8, 0.0);
        for times in [&[0.5, 2.0, 1.0][..], &[4.0; 6][..], &[0.01; 40][..]] {
            let (mut variance, mut covariance) = (Vec3::zeros(), Vec3::zeros());
            let mut cross = 0.0;
            let mut travelled_m = 0.0;
            for run in 0..RUNS {
                let mut air = Turbulence::new(w20, toward, run as u64);
                let seen = |air: &Turbulence| {
                    let v = air.velocity_ned_m_s();
                    Vec3::new(0.6 * v.x + 0.8 * v.y, -0.8 * v.x + 0.6 * v.y, v.z)
                };
                air.advance(0.0, height_m, 0.0);
                let start = seen(&air);
                travelled_m = 0.0;
                for (k, dt_s) in times.iter().enumerate() {
                    // Slower than the wind at 20 ft counts as that wind.
                    let airspeed_m_s = if k % 2 == 0 { 3.0 } else { 14.0 };
                    air.advance(*dt_s, height_m, airspeed_m_s);
                    travelled_m += dt_s * f64::max(airspeed_m_s, w20);
                }
                let end = seen(&air);
                variance += end.component_mul(&end) / RUNS as f64;
                covariance += end.component_mul(&start) / RUNS as f64;
                cross += end.x * end.y / RUNS as f64;
            }
            let (u, w) = (scales.level_std_m_s, scales.vertical_std_m_s);
            let (x, z) = (travelled_m / scales.level_length_m, travelled_m / scales.vertical_length_m);
            let expected = [libm::exp(-x), (1.0 - 0.5 * x) * libm::exp(-x), (1.0 - 0.5 * z) * libm::exp(-z)];
            for (axis, std) in [u, u, w].into_iter().enumerate() {
                let n = RUNS as f64;
                let ratio = variance[axis] / (std * std);
                assert!((ratio - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "axis {axis}: variance {ratio}");
                let found = covariance[axis] / (std * std);
                let bound = 5.0 * ((1.0 + expected[axis] * expected[axis]) / n).sqrt();
                assert!((found - expected[axis]).abs() < bound, "axis {axis}: {found}, {expected:?}");
            }
            assert!((cross / (u * u)).abs() < 5.0 / (RUNS as f64).sqrt());
        }
    }

    /// The same through the plant's steps over one long run: at 1 ms no rounding may eat or feed the variance. With
    /// T = L/V = 3.05 m/8 m/s downward and N = 4000 s there are about N/T independent values, each estimate of the
    /// variance is good to sqrt(2 T/N) of itself or better; bound of five.
    #[test]
    fn variance_holds_at_the_step_of_the_plant() {
        let mut air = Turbulence::new(8.0, Vec3::x(), 5);
        let (mut sum, steps) = (0.0, 4_000_000);
        for _ in 0..steps {
            air.advance(1e-3, 0.0, 0.0);
            sum += air.velocity_ned_m_s().z * air.velocity_ned_m_s().z;
        }
        let ratio = sum / f64::from(steps) / (0.8 * 0.8);
        let bound = 5.0 * (2.0 * (3.048 / 8.0) / 4000.0_f64).sqrt();
        assert!((ratio - 1.0).abs() < bound, "{ratio}, {bound}");
    }

    #[test]
    fn no_wind_no_turbulence_and_a_seed_makes_it() {
        let mut calm = Turbulence::new(0.0, Vec3::x(), 1);
        calm.advance(1.0, 10.0, 5.0);
        assert_eq!(calm.velocity_ned_m_s().norm(), 0.0);
        let at = |seed| {
            let mut air = Turbulence::new(5.0, Vec3::x(), seed);
            air.advance(1.0, 10.0, 5.0);
            air.velocity_ned_m_s()
        };
        assert_eq!(at(1), at(1));
        assert_ne!(at(1), at(2));
    }
}
