//! Bounds and tests on counts of flights: what they prove, and no more.
//!
//! Bounds of a rate: Clopper and Pearson, Biometrika 26 (1934) 404, exact, from the quantiles of the beta
//! distribution; never narrower than they say. Two configurations flown on the same seeds: McNemar's test in
//! its exact form, the binomial law of the pairs that disagree (McNemar, Psychometrika 12 (1947) 153), and an
//! interval of the median difference between order statistics (Conover, Practical Nonparametric Statistics,
//! section 3.2).

use serde::Serialize;
use statrs::distribution::{Beta, Binomial, ContinuousCDF, DiscreteCDF};

/// Confidence of every bound.
const CONFIDENCE: f64 = 0.95;

/// Bounds of the rate of success behind a count.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RateBounds {
    /// Two-sided interval, confidence 95 %.
    pub two_sided_95: [f64; 2],
    /// The rate is at least this, confidence 95 %, one-sided.
    pub one_sided_95_lower: f64,
}

impl RateBounds {
    /// Bounds for so many successes in so many flights; without flights from 0 to 1.
    pub fn new(successes: u32, flights: u32) -> Self {
        let tail = 1.0 - CONFIDENCE;
        Self {
            two_sided_95: [
                lower(successes, flights, 0.5 * tail),
                1.0 - lower(flights - successes, flights, 0.5 * tail),
            ],
            one_sided_95_lower: lower(successes, flights, tail),
        }
    }
}

/// The rate at which so many successes or more come up with probability `tail`.
fn lower(successes: u32, flights: u32, tail: f64) -> f64 {
    if successes == 0 {
        return 0.0;
    }
    let (a, b) = (f64::from(successes), f64::from(flights - successes) + 1.0);
    Beta::new(a, b).map_or(0.0, |beta| bisect(|rate| beta.cdf(rate) - tail))
}

/// Root on (0, 1) of a function that rises through it, to the last bit but one.
fn bisect(f: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if f(middle) < 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Probability that pairs disagree as unevenly as this, or more so, if neither side is better: two-sided.
pub(super) fn mcnemar_p(only_first: u32, only_second: u32) -> f64 {
    let pairs = u64::from(only_first) + u64::from(only_second);
    if pairs == 0 {
        return 1.0;
    }
    let fewer = u64::from(only_first.min(only_second));
    Binomial::new(0.5, pairs).map_or(1.0, |law| (2.0 * law.cdf(fewer)).min(1.0))
}

/// Median of a sample, and where the median of what it was drawn from lies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Median {
    /// Of the sample.
    pub value: f64,
    /// Of what it was drawn from, confidence 95 % or more; null for fewer than six values.
    pub interval_95: Option<[f64; 2]>,
    /// Size of the sample.
    pub count: usize,
}

impl Median {
    /// Median of values in any order; `None` without values.
    pub fn new(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let value = quantile(&values, 0.5)?;
        let count = values.len();
        let tail = 0.5 * (1.0 - CONFIDENCE);
        let law = Binomial::new(0.5, count as u64).ok()?;
        // The greatest rank from either end that the median lies outside of with probability `tail` at most.
        let rank = (0..count / 2).take_while(|&k| law.cdf(k as u64) <= tail).count();
        let interval_95 = (rank > 0).then(|| [values[rank - 1], values[count - rank]]);
        Some(Self { value, interval_95, count })
    }
}

/// Quantile of sorted values, interpolated between the two neighbours; `None` without values.
pub(super) fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let at = share.clamp(0.0, 1.0) * last as f64;
    let below = at.floor() as usize;
    let above = (below + 1).min(last);
    Some(sorted[below] + (at - below as f64) * (sorted[above] - sorted[below]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without failure the one-sided bound is tail^(1/n), without success it is 0; 299 flights without one
    /// prove 99 %, and 298 do not. With four failures a thousand flights do: the table every reliability
    /// handbook has.
    #[test]
    fn bounds_of_a_rate_are_those_of_clopper_and_pearson() {
        for n in [1, 10, 299, 1109] {
            let bound = RateBounds::new(n, n).one_sided_95_lower;
            let exact = libm::pow(0.05, 1.0 / f64::from(n));
            assert!((bound - exact).abs() < 1e-12, "{n}: {bound} {exact}");
        }
        let proves = |failures: u32, flights: u32| {
            RateBounds::new(flights - failures, flights).one_sided_95_lower >= 0.99
        };
        for (failures, flights) in [(0, 299), (1, 473), (2, 628), (4, 1000), (12, 2000)] {
            assert!(proves(failures, flights), "{failures} of {flights}");
        }
        assert!(!proves(0, 298) && !proves(1, 472) && !proves(2, 627) && !proves(5, 1000));
        // 5 of 10: 0.18709 to 0.81291, printed in every textbook.
        let [low, high] = RateBounds::new(5, 10).two_sided_95;
        assert!((low - 0.187_086).abs() < 1e-6 && (high - 0.812_914).abs() < 1e-6, "{low} {high}");
        assert_eq!(RateBounds::new(0, 20).two_sided_95[0], 0.0);
        assert_eq!(RateBounds::new(20, 20).two_sided_95[1], 1.0);
        assert_eq!(RateBounds::new(0, 0).two_sided_95, [0.0, 1.0]);
    }

    /// By hand: 1 and 7 of eight pairs, 2 (1 + 8)/2⁸; the incomplete beta function behind it is good to
    /// 1e-13.
    #[test]
    fn mcnemar_counts_the_pairs_that_disagree() {
        assert!((mcnemar_p(1, 7) - 18.0 / 256.0).abs() < 1e-12);
        assert_eq!(mcnemar_p(1, 7), mcnemar_p(7, 1));
        assert_eq!(mcnemar_p(0, 0), 1.0);
        assert!((mcnemar_p(3, 3) - 1.0).abs() < 1e-12);
        assert!((mcnemar_p(0, 6) - 2.0 / 64.0).abs() < 1e-12);
    }

    /// Of six values the interval is their whole span, 1 - 2/2⁶ = 96.9 %; of five it would be 93.8 %. Of ten
    /// it runs from the second to the ninth, 1 - 2 (1 + 10)/2¹⁰ = 97.9 %.
    #[test]
    fn a_median_lies_between_order_statistics() {
        let of = |n: i32| Median::new((0..n).rev().map(f64::from).collect());
        assert_eq!(of(0), None);
        assert_eq!(of(5).unwrap().interval_95, None);
        assert_eq!(of(6).unwrap(), Median { value: 2.5, interval_95: Some([0.0, 5.0]), count: 6 });
        assert_eq!(of(10).unwrap().interval_95, Some([1.0, 8.0]));
    }

    #[test]
    fn quantiles_interpolate() {
        let sorted = [1.0, 2.0, 4.0];
        assert_eq!(quantile(&sorted, 0.0), Some(1.0));
        assert_eq!(quantile(&sorted, 0.75), Some(3.0));
        assert_eq!(quantile(&sorted, 1.0), Some(4.0));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
