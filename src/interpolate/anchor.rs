//! Logarithm and power near a place where they are known: a short series in place of a transcendental call.
//!
//! Beside an anchor `x₀` both are series in `d = x/x₀ - 1`: `ln x = ln x₀ + d - d²/2 + …`, `xⁿ = x₀ⁿ (1 + n d +
//! n(n-1)/2 d² + …)`. Within [`REACH`] seven terms leave less than half a rounding error. The anchor moves
//! only when it is out of reach, to an exact value, so that errors do not add up along a flight.

/// An abscissa and the value of a function there; the default knows nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Anchor {
    x: f64,
    per_x: f64,
    value: f64,
}

/// Relative distance that the series serve: the first term left out is d⁸/8 = 2e-18 at most.
const REACH: f64 = 1.0 / 128.0;

impl Anchor {
    fn at(x: f64, value: f64) -> Self {
        Self { x, per_x: 1.0 / x, value }
    }

    /// Relative distance of an abscissa, if it is within reach.
    #[inline]
    fn distance(&self, x: f64) -> Option<f64> {
        let distance = (x - self.x) * self.per_x;
        (self.x > 0.0 && distance.abs() < REACH).then_some(distance)
    }
}

/// ln x, near an anchor that follows it.
#[inline]
pub fn log_near(x: f64, anchor: &mut Anchor) -> f64 {
    if let Some(d) = anchor.distance(x) {
        let tail = 1.0 / 3.0 + d * (-0.25 + d * (0.2 + d * (-1.0 / 6.0 + d * (1.0 / 7.0))));
        return anchor.value + (d + d * d * (-0.5 + d * tail));
    }
    let log = libm::log(x);
    *anchor = Anchor::at(x, log);
    log
}

/// Powers of one exponent.
#[derive(Clone, Copy, Debug)]
pub struct Power {
    exponent: f64,
    /// Binomial coefficients of d to d⁷.
    series: [f64; 7],
}

impl Power {
    /// With an exponent.
    pub fn new(exponent: f64) -> Self {
        let mut coefficient = 1.0;
        let series = std::array::from_fn(|k| {
            coefficient *= (exponent - k as f64) / (k + 1) as f64;
            coefficient
        });
        Self { exponent, series }
    }

    /// The power of a number that is not negative, near an anchor that follows it.
    #[inline]
    pub fn of(&self, x: f64, anchor: &mut Anchor) -> f64 {
        if let Some(d) = anchor.distance(x) {
            let sum = self.series.iter().rev().fold(0.0, |sum, coefficient| coefficient + d * sum);
            return anchor.value + anchor.value * (d * sum);
        }
        let power = libm::exp(self.exponent * libm::log(x));
        *anchor = Anchor::at(x, power);
        power
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Along a walk of small and large strides: two roundings of the anchor's own value and one of the series.
    #[test]
    fn series_and_calls_agree_to_rounding() {
        let (mut log_anchor, mut power_anchor) = (Anchor::default(), Anchor::default());
        for exponent in [0.1, 0.55, 0.8, 0.95, 3.0] {
            let power = Power::new(exponent);
            power_anchor = Anchor { x: 0.0, ..power_anchor };
            let mut x = 1e-3;
            for k in 0..20_000 {
                x *= 1.0 + 1e-3 * libm::sin(f64::from(k)) + if k % 500 == 0 { 0.3 } else { 0.0 };
                let log_error = log_near(x, &mut log_anchor) - libm::log(x);
                assert!(log_error.abs() <= 4e-16 * (1.0 + libm::log(x).abs()), "{x}: {log_error}");
                let exact = libm::pow(x, exponent);
                let error = power.of(x, &mut power_anchor) / exact - 1.0;
                // exp doubles the rounding of its argument, n ln x.
                assert!(error.abs() <= 1e-15 * (1.0 + exponent * libm::log(x).abs()), "{x}: {error}");
            }
        }
    }

    #[test]
    fn nothing_and_what_is_no_number_find_no_anchor() {
        let mut anchor = Anchor::default();
        let power = Power::new(0.55);
        assert_eq!(power.of(0.0, &mut anchor), 0.0);
        assert_eq!(power.of(0.0, &mut anchor), 0.0);
        assert!((power.of(2.0, &mut anchor) - libm::pow(2.0, 0.55)).abs() < 1e-15);
        assert!(power.of(f64::NAN, &mut anchor).is_nan());
        assert!((power.of(2.0, &mut anchor) - libm::pow(2.0, 0.55)).abs() < 1e-15);
        assert_eq!(log_near(0.0, &mut Anchor::default()), f64::NEG_INFINITY);
    }
}
