//! Root of a continuous function in a bracket: secant steps, kept inside the bracket, bisection when
//! they do not shrink it. It always ends, and says how.

/// Where a root is sought. The function is negative (or zero) at `low`, positive (or zero) at `high`;
/// that is the caller's knowledge, so that a warm start costs no evaluation at the ends.
#[derive(Clone, Copy, Debug)]
pub struct Bracket {
    /// Abscissa at which the function is not positive.
    pub low: f64,
    /// Abscissa at which the function is not negative.
    pub high: f64,
    /// First abscissa tried; the middle is taken when it is not inside.
    pub guess: f64,
    /// Slope expected at the guess, positive; without it the second trial bisects.
    pub slope: Option<f64>,
    /// Accuracy wanted of the abscissa.
    pub tolerance: f64,
}

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RootStatus {
    /// The abscissa is within the tolerance.
    Solved,
    /// The function was not positive anywhere tried: the root is at `high` or beyond.
    AtHigh,
    /// The function was not negative anywhere tried: the root is at `low` or beyond.
    AtLow,
    /// The function is not a number, or the bracket is empty.
    Invalid,
}

/// End of a search. `x` is the last abscissa at which the function was evaluated.
#[derive(Clone, Copy, Debug)]
pub struct Root {
    /// The root, the end of the bracket nearest to it, or the best known abscissa.
    pub x: f64,
    /// Slope of the last secant, a good guess for the next search.
    pub slope: f64,
    /// How the search ended.
    pub status: RootStatus,
}

/// Evaluations after which bisection alone would have reached round-off three times over.
const LIMIT: usize = 200;

/// Finds the root of `f` in a bracket.
pub fn bracketed_root(bracket: Bracket, mut f: impl FnMut(f64) -> f64) -> Root {
    let Bracket { mut low, mut high, guess, slope, tolerance } = bracket;
    let (low_end, high_end) = (low, high);
    let mut x = if guess > low && guess < high { guess } else { 0.5 * (low + high) };
    let mut slope = slope.filter(|s| *s > 0.0).unwrap_or(0.0);
    if low > high || low.is_nan() || high.is_nan() {
        return Root { x: low, slope, status: RootStatus::Invalid };
    }
    let mut previous: Option<(f64, f64)> = None;
    let mut width_before = high - low;
    for trial in 0..LIMIT {
        let y = f(x);
        if y.is_nan() {
            return Root { x, slope, status: RootStatus::Invalid };
        }
        if y < 0.0 {
            low = x
        } else {
            high = x
        }
        if let Some((x0, y0)) = previous {
            let secant = (y - y0) / (x - x0);
            // A secant through round-off says nothing.
            if secant.is_finite() && secant > 0.0 {
                slope = secant;
            }
        }
        if y == 0.0 || (slope > 0.0 && y.abs() <= slope * tolerance) || high - low <= tolerance {
            let status = match y {
                _ if y < 0.0 && high == high_end && high - x <= tolerance => RootStatus::AtHigh,
                _ if y > 0.0 && low == low_end && x - low <= tolerance => RootStatus::AtLow,
                _ => RootStatus::Solved,
            };
            return Root { x, slope, status };
        }
        previous = Some((x, y));
        let step = if slope > 0.0 { x - y / slope } else { f64::NAN };
        // Every third trial the bracket must have halved, or it is halved.
        let slow = trial % 3 == 2 && high - low > 0.5 * width_before;
        if trial % 3 == 2 {
            width_before = high - low;
        }
        let middle = 0.5 * (low + high);
        x = if step > low && step < high && !slow { step } else { middle };
        if x <= low || x >= high {
            // Neighbouring floating-point numbers: nothing left to try.
            return Root { x, slope, status: RootStatus::Solved };
        }
    }
    Root { x, slope, status: RootStatus::Invalid }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(f: impl FnMut(f64) -> f64, low: f64, high: f64) -> Root {
        bracketed_root(Bracket { low, high, guess: f64::NAN, slope: None, tolerance: 1e-12 }, f)
    }

    #[test]
    fn smooth_steep_and_flat_functions_are_solved() {
        type F = fn(f64) -> f64;
        let cases: [(F, f64, f64, f64); 4] = [
            (|x| libm::exp(x) - 2.0, 0.0, 3.0, core::f64::consts::LN_2),
            (|x| if x < 0.7 { -libm::sqrt(0.7 - x) } else { 1e3 * (x - 0.7) }, 0.0, 1.0, 0.7),
            (|x| (x - 0.3) * (x - 0.3) * (x - 0.3), -1.0, 1.0, 0.3),
            (|x| if x < 0.123 { -1.0 } else { 1.0 }, 0.0, 1.0, 0.123),
        ];
        for (i, (f, low, high, root)) in cases.into_iter().enumerate() {
            let found = search(f, low, high);
            // A triple root is only as sharp as the cube root of the residual.
            let tolerance = if i == 2 { 1e-4 } else { 1e-11 };
            assert!((found.x - root).abs() < tolerance, "case {i}: {found:?}");
            assert_eq!(found.status, RootStatus::Solved, "case {i}");
        }
    }

    #[test]
    fn a_missing_root_and_a_nan_are_reported() {
        assert_eq!(search(|x| x - 2.0, 0.0, 1.0).status, RootStatus::AtHigh);
        assert_eq!(search(|x| x + 2.0, 0.0, 1.0).status, RootStatus::AtLow);
        assert_eq!(search(|_| f64::NAN, 0.0, 1.0).status, RootStatus::Invalid);
        assert_eq!(search(|x| x, 1.0, 0.0).status, RootStatus::Invalid);
    }

    #[test]
    fn a_good_guess_takes_three_trials() {
        let mut trials = 0;
        let bracket = Bracket { low: 0.0, high: 10.0, guess: 2.0001, slope: Some(4.1), tolerance: 1e-9 };
        let found = bracketed_root(bracket, |x| {
            trials += 1;
            x * x - 4.0
        });
        assert!((found.x - 2.0).abs() < 1e-9 && trials <= 3, "{trials} {found:?}");
    }
}
