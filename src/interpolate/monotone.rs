//! Shape-preserving cubic interpolation on arbitrary knots.
//!
//! Source: Fritsch and Butland, "A method for constructing local monotone piecewise cubic interpolants"
//! (SIAM J. Sci. Stat. Comput. 5, 1984): the slope at a knot is a weighted harmonic mean of the chords
//! beside it, zero at an extremum; three-point slopes, limited to keep the shape, at the ends.

/// `N` functions of one variable on the same increasing knots.
#[derive(Clone, Debug)]
pub struct Monotone<const N: usize> {
    knots: Vec<f64>,
    /// Per segment and column, the coefficients of 1, t, t², t³ with t counted in x from the left knot.
    segments: Vec<[[f64; 4]; N]>,
    /// The segment in which each of equally wide buckets begins: where the search for a segment starts.
    first: Vec<u32>,
    /// Buckets per unit of x.
    density: f64,
}

/// Buckets per segment: with knots that are not far from uniform a bucket holds one knot at most.
const BUCKETS: usize = 4;

/// Where an abscissa lies among the knots; found once, used for every column.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    segment: usize,
    t: f64,
}

impl<const N: usize> Monotone<N> {
    /// Through `rows[i]` at `knots[i]`; at least two knots, strictly increasing: the caller has checked.
    pub fn new(knots: &[f64], rows: &[[f64; N]]) -> Self {
        let last = knots.len() - 1;
        let width = |i: usize| knots[i + 1] - knots[i];
        let segments = (0..last)
            .map(|i| {
                std::array::from_fn(|column| {
                    let chord = |j: usize| (rows[j + 1][column] - rows[j][column]) / width(j);
                    let (left, right) = (slope(i, last, &width, &chord), slope(i + 1, last, &width, &chord));
                    let (h, c) = (width(i), chord(i));
                    let cubic = (left + right - 2.0 * c) / (h * h);
                    [rows[i][column], left, (3.0 * c - 2.0 * left - right) / h, cubic]
                })
            })
            .collect();
        let buckets = BUCKETS * last;
        let density = buckets as f64 / (knots[last] - knots[0]);
        let mut first = vec![0; buckets];
        for segment in 0..last {
            // The bucket of this knot begins before it; every later one begins in this segment or behind.
            let bucket = bucket(knots[segment] - knots[0], density, buckets);
            first[bucket + 1..].fill(segment as u32);
        }
        Self { knots: knots.to_vec(), segments, first, density }
    }

    /// Finds the segment of `x`, clamped to the knots. Hardly a search unless knots crowd somewhere.
    #[inline]
    pub(crate) fn locate(&self, x: f64) -> Place {
        let last = self.segments.len() - 1;
        let x = x.clamp(self.knots[0], self.knots[last + 1]);
        let mut segment = self.first[bucket(x - self.knots[0], self.density, self.first.len())] as usize;
        while segment < last && x >= self.knots[segment + 1] {
            segment += 1;
        }
        Place { segment, t: x - self.knots[segment] }
    }

    /// One column at a place.
    #[inline]
    pub fn column(&self, column: usize, at: Place) -> f64 {
        let [a, b, c, d] = self.segments[at.segment][column];
        a + at.t * (b + at.t * (c + at.t * d))
    }

    /// One column at `x`.
    pub fn at(&self, column: usize, x: f64) -> f64 {
        self.column(column, self.locate(x))
    }

    /// First and last knot.
    pub fn span(&self) -> (f64, f64) {
        (self.knots[0], self.knots[self.knots.len() - 1])
    }

    /// The abscissa at which an increasing column takes `value`, clamped to the knots. The exact inverse
    /// of [`Self::at`], by Newton steps kept inside the segment.
    pub fn inverse(&self, column: usize, value: f64) -> f64 {
        let start = |i: usize| self.segments[i][column][0];
        let (mut low, mut high) = (0, self.segments.len());
        while high - low > 1 {
            let middle = (low + high) / 2;
            if start(middle) <= value { low = middle } else { high = middle }
        }
        let [a, b, c, d] = self.segments[low][column];
        let width = self.knots[low + 1] - self.knots[low];
        let error = |t: f64| a + t * (b + t * (c + t * d)) - value;
        if error(0.0) >= 0.0 {
            return self.knots[low];
        }
        if error(width) <= 0.0 {
            return self.knots[low + 1];
        }
        let (mut below, mut above, mut t) = (0.0, width, 0.5 * width);
        for _ in 0..80 {
            let e = error(t);
            if e < 0.0 {
                below = t
            } else {
                above = t
            }
            let newton = t - e / (b + t * (2.0 * c + t * 3.0 * d));
            let next = if newton > below && newton < above { newton } else { 0.5 * (below + above) };
            if (next - t).abs() <= 1e-15 * width {
                break;
            }
            t = next;
        }
        self.knots[low] + t
    }
}

/// Bucket of a distance from the first knot.
#[inline]
fn bucket(distance: f64, density: f64, count: usize) -> usize {
    ((distance * density) as usize).min(count - 1)
}

/// Slope at knot `i`.
fn slope(i: usize, last: usize, width: &impl Fn(usize) -> f64, chord: &impl Fn(usize) -> f64) -> f64 {
    if last == 1 {
        return chord(0);
    }
    if i == 0 {
        return end_slope([width(0), width(1)], [chord(0), chord(1)]);
    }
    if i == last {
        return end_slope([width(last - 1), width(last - 2)], [chord(last - 1), chord(last - 2)]);
    }
    let (before, after) = (chord(i - 1), chord(i));
    if before * after <= 0.0 {
        return 0.0;
    }
    let (w_before, w_after) = (2.0 * width(i) + width(i - 1), width(i) + 2.0 * width(i - 1));
    (w_before + w_after) / (w_before / before + w_after / after)
}

/// Three-point slope at an end, from the two nearest segments, limited to keep the shape.
fn end_slope([h0, h1]: [f64; 2], [c0, c1]: [f64; 2]) -> f64 {
    let d = ((2.0 * h0 + h1) * c0 - h0 * c1) / (h0 + h1);
    if d * c0 <= 0.0 {
        0.0
    } else if c0 * c1 <= 0.0 && d.abs() > 3.0 * c0.abs() {
        3.0 * c0
    } else {
        d
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_a_line_and_the_inverse_inverts() {
        let knots = [0.0, 0.5, 2.0, 2.1, 7.0];
        let rows: Vec<[f64; 2]> = knots.iter().map(|x| [3.0 * x - 1.0, x * x]).collect();
        let f = Monotone::new(&knots, &rows);
        for i in 0..=70 {
            let x = 0.1 * i as f64;
            assert!((f.at(0, x) - (3.0 * x - 1.0)).abs() < 1e-13);
            assert!((f.inverse(1, f.at(1, x)) - x).abs() < 1e-9, "{x}");
        }
        assert_eq!((f.inverse(1, -1.0), f.inverse(1, 99.0)), (0.0, 7.0));
    }

    #[test]
    fn monotone_data_stay_monotone_and_steps_do_not_overshoot() {
        let knots: Vec<f64> = (0..8).map(f64::from).collect();
        let rows: Vec<[f64; 1]> = [0.0, 0.0, 0.01, 5.0, 5.0, 5.1, 9.0, 9.0].map(|y| [y]).to_vec();
        let f = Monotone::new(&knots, &rows);
        let values: Vec<f64> = (0..=700).map(|i| f.at(0, 0.01 * i as f64)).collect();
        assert!(values.windows(2).all(|w| w[1] >= w[0] - 1e-14));
        assert!(values.iter().all(|v| (0.0..=9.0 + 1e-12).contains(v)));
    }

    /// Slopes worked by hand from the formula: chords 1 and 3 with widths 1 and 2 give w = 5, 4 and 9/(5/1 +
    /// 4/3).
    #[test]
    fn the_slope_at_a_knot_is_the_weighted_harmonic_mean() {
        let f = Monotone::new(&[0.0, 1.0, 3.0], &[[0.0], [1.0], [7.0]]);
        let slope = (f.at(0, 1.0 + 1e-7) - f.at(0, 1.0)) / 1e-7;
        assert!((slope - 9.0 / (5.0 + 4.0 / 3.0)).abs() < 1e-6, "{slope}");
    }
}
