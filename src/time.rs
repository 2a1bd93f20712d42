//! Run time: integer microseconds since step 0, so that a sum of steps never drifts.

use std::ops::{Add, Sub};

/// An instant of a run, counted from step 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SimTime(u64);

impl SimTime {
    /// Step 0.
    pub const ZERO: Self = Self(0);

    /// From whole microseconds.
    pub const fn from_us(us: u64) -> Self {
        Self(us)
    }

    /// From seconds, rounded to the nearest microsecond; a negative or non-finite value gives zero.
    pub fn from_s(s: f64) -> Self {
        // `as` saturates: NaN and negatives become 0.
        Self((s * 1e6).round() as u64)
    }

    /// Whole microseconds.
    pub const fn us(self) -> u64 {
        self.0
    }

    /// Seconds, for equations and reports.
    pub fn s(self) -> f64 {
        self.0 as f64 * 1e-6
    }

    /// Time elapsed since `earlier`, zero if that is later.
    pub const fn since(self, earlier: Self) -> Self {
        Self(self.0.saturating_sub(earlier.0))
    }
}

impl Add for SimTime {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl Sub for SimTime {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.since(other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_million_millisecond_steps_are_exactly_a_thousand_seconds() {
        let mut t = SimTime::ZERO;
        for _ in 0..1_000_000 {
            t = t + SimTime::from_us(1_000);
        }
        assert_eq!(t, SimTime::from_s(1_000.0));
    }

    #[test]
    fn seconds_that_are_no_time_become_zero() {
        for s in [-1.0, f64::NAN, f64::NEG_INFINITY] {
            assert_eq!(SimTime::from_s(s), SimTime::ZERO);
        }
    }
}
