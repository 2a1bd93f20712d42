//! Cubic Hermite interpolation on uniform nodes, several columns at once.

/// Values and slopes (per node spacing) of `N` columns at one node.
#[derive(Clone, Copy, Debug)]
struct Node<const N: usize> {
    value: [f64; N],
    slope: [f64; N],
}

/// `N` functions of one variable on the same uniform nodes.
#[derive(Clone, Debug)]
pub struct UniformCubic<const N: usize> {
    start: f64,
    step: f64,
    per_step: f64,
    nodes: Vec<Node<N>>,
}

/// Fewest nodes that a difference of fourth order needs.
const FEWEST: usize = 5;

impl<const N: usize> UniformCubic<N> {
    /// Through `rows[i]` at `start + i * step`. At least five rows, step not zero: programmer's duty.
    pub fn new(start: f64, step: f64, rows: &[[f64; N]]) -> Self {
        let mut table = Self::with_nodes(rows.len());
        table.refit(start, start + step * (table.nodes.len() - 1) as f64, |i, _| rows[i.min(rows.len() - 1)]);
        table
    }

    /// All zero on 0..1 with room for `count` nodes, to be filled by [`Self::refit`].
    pub(crate) fn with_nodes(count: usize) -> Self {
        let count = count.max(FEWEST);
        let nodes = vec![Node { value: [0.0; N], slope: [0.0; N] }; count];
        let step = 1.0 / (count - 1) as f64;
        Self { start: 0.0, step, per_step: 1.0 / step, nodes }
    }

    /// Without nodes and without allocation, to stand in for a table that is being refitted.
    pub(crate) fn placeholder() -> Self {
        Self { start: 0.0, step: 0.0, per_step: 0.0, nodes: Vec::new() }
    }

    /// Puts the nodes uniformly on `from..to` and takes the values of `row(index, x)`. No allocation.
    pub(crate) fn refit(&mut self, from: f64, to: f64, mut row: impl FnMut(usize, f64) -> [f64; N]) {
        let last = self.nodes.len() - 1;
        self.start = from;
        self.step = (to - from) / last as f64;
        self.per_step = if self.step == 0.0 { 0.0 } else { 1.0 / self.step };
        for (i, node) in self.nodes.iter_mut().enumerate() {
            // The last node exactly at the end: round-off must not leave the domain of `row`.
            let x = if i == last { to } else { from + self.step * i as f64 };
            node.value = row(i, x);
        }
        for i in 0..=last {
            for column in 0..N {
                let nodes = &self.nodes;
                let slope = unit_slope(i, last, |j| nodes[j].value[column]);
                self.nodes[i].slope[column] = slope;
            }
        }
    }

    /// All columns at `x`, held constant outside the nodes.
    #[inline]
    pub fn at(&self, x: f64) -> [f64; N] {
        let (i, t) = place(self.nodes.len(), (x - self.start) * self.per_step);
        let (a, b) = (&self.nodes[i], &self.nodes[i + 1]);
        let [v0, s0, v1, s1] = hermite(t);
        let mut out = [0.0; N];
        for (k, out) in out.iter_mut().enumerate() {
            *out = v0 * a.value[k] + s0 * a.slope[k] + v1 * b.value[k] + s1 * b.slope[k];
        }
        out
    }

    /// All columns and their derivatives at `x`.
    #[inline]
    pub(crate) fn with_slope(&self, x: f64) -> ([f64; N], [f64; N]) {
        let (i, t) = place(self.nodes.len(), (x - self.start) * self.per_step);
        let (a, b) = (&self.nodes[i], &self.nodes[i + 1]);
        let ([v0, s0, v1, s1], [dv0, ds0, dv1, ds1]) = (hermite(t), hermite_slope(t));
        let (mut value, mut slope) = ([0.0; N], [0.0; N]);
        for k in 0..N {
            let [va, sa, vb, sb] = [a.value[k], a.slope[k], b.value[k], b.slope[k]];
            value[k] = v0 * va + s0 * sa + v1 * vb + s1 * sb;
            slope[k] = (dv0 * va + ds0 * sa + dv1 * vb + ds1 * sb) * self.per_step;
        }
        (value, slope)
    }

    /// First and last abscissa.
    pub fn span(&self) -> (f64, f64) {
        (self.start, self.start + self.step * (self.nodes.len() - 1) as f64)
    }
}

/// Values and partial derivatives of `N` columns at a point of a [`UniformGrid`].
#[derive(Clone, Copy, Debug)]
pub struct Sample<const N: usize> {
    /// The columns.
    pub value: [f64; N],
    /// Their derivatives along the slow variable.
    pub slow_slope: [f64; N],
    /// Their derivatives along the fast variable.
    pub fast_slope: [f64; N],
}

/// Value, slow slope, fast slope and cross slope (per spacings) of `N` columns at one node.
type GridNode<const N: usize> = [[f64; N]; 4];

/// `N` functions of two variables on a uniform grid, bicubic Hermite.
#[derive(Clone, Debug)]
pub struct UniformGrid<const N: usize> {
    slow: Axis,
    fast: Axis,
    nodes: Vec<GridNode<N>>,
}

/// Uniform nodes along one variable.
#[derive(Clone, Copy, Debug)]
struct Axis {
    start: f64,
    per_step: f64,
    count: usize,
}

impl Axis {
    fn spanning((from, to): (f64, f64), count: usize) -> Self {
        Self { start: from, per_step: (count - 1) as f64 / (to - from), count }
    }
}

impl<const N: usize> UniformGrid<N> {
    /// From rows in which the fast variable runs first; each variable spans its pair uniformly and has at
    /// least five nodes: programmer's duty. `rows.len()` is the product of the counts.
    pub fn new(slow: (f64, f64), fast: (f64, f64), fast_count: usize, rows: &[[f64; N]]) -> Self {
        let slow = Axis::spanning(slow, rows.len() / fast_count);
        let fast = Axis::spanning(fast, fast_count);
        let mut nodes: Vec<GridNode<N>> =
            rows.iter().map(|row| [*row, [0.0; N], [0.0; N], [0.0; N]]).collect();
        let index = |i: usize, j: usize| i * fast.count + j;
        // Slopes of the values along both axes, then the slow slope of the fast slope.
        for (from, to, along_fast) in [(0, 1, false), (0, 2, true), (2, 3, false)] {
            for i in 0..slow.count {
                for j in 0..fast.count {
                    let slopes = std::array::from_fn(|column| {
                        if along_fast {
                            unit_slope(j, fast.count - 1, |k| nodes[index(i, k)][from][column])
                        } else {
                            unit_slope(i, slow.count - 1, |k| nodes[index(k, j)][from][column])
                        }
                    });
                    nodes[index(i, j)][to] = slopes;
                }
            }
        }
        Self { slow, fast, nodes }
    }

    /// First and last node of the fast variable.
    pub(crate) fn fast_span(&self) -> (f64, f64) {
        (self.fast.start, self.fast.start + (self.fast.count - 1) as f64 / self.fast.per_step)
    }

    /// All columns and their derivatives at a point, held constant outside the grid.
    pub fn at(&self, slow: f64, fast: f64) -> Sample<N> {
        let (i, u) = place(self.slow.count, (slow - self.slow.start) * self.slow.per_step);
        let (j, v) = place(self.fast.count, (fast - self.fast.start) * self.fast.per_step);
        let (hu, du) = (hermite(u), hermite_slope(u));
        let (hv, dv) = (hermite(v), hermite_slope(v));
        let mut out = Sample { value: [0.0; N], slow_slope: [0.0; N], fast_slope: [0.0; N] };
        for a in 0..2 {
            for b in 0..2 {
                let [f, fu, fv, fuv] = &self.nodes[(i + a) * self.fast.count + j + b];
                let (u0, u1, du0, du1) = (hu[2 * a], hu[2 * a + 1], du[2 * a], du[2 * a + 1]);
                let (v0, v1, dv0, dv1) = (hv[2 * b], hv[2 * b + 1], dv[2 * b], dv[2 * b + 1]);
                for k in 0..N {
                    let (f, fu, fv, fuv) = (f[k], fu[k], fv[k], fuv[k]);
                    let (along, along_slope) = (v0 * f + v1 * fv, dv0 * f + dv1 * fv);
                    let (cross, cross_slope) = (v0 * fu + v1 * fuv, dv0 * fu + dv1 * fuv);
                    out.value[k] += u0 * along + u1 * cross;
                    out.slow_slope[k] += (du0 * along + du1 * cross) * self.slow.per_step;
                    out.fast_slope[k] += (u0 * along_slope + u1 * cross_slope) * self.fast.per_step;
                }
            }
        }
        out
    }
}

/// Cell and place in it (0..1) of a coordinate counted in node spacings.
#[inline]
fn place(count: usize, position: f64) -> (usize, f64) {
    let position = position.clamp(0.0, (count - 1) as f64);
    let cell = (position as usize).min(count - 2);
    (cell, position - cell as f64)
}

/// Weights of left value, left slope, right value, right slope.
#[inline]
fn hermite(t: f64) -> [f64; 4] {
    let (t2, r) = (t * t, 1.0 - t);
    let v1 = t2 * (3.0 - 2.0 * t);
    [1.0 - v1, t * r * r, v1, -t2 * r]
}

/// Derivatives of the weights of [`hermite`].
#[inline]
fn hermite_slope(t: f64) -> [f64; 4] {
    let bump = 6.0 * t * (1.0 - t);
    [-bump, (1.0 - t) * (1.0 - 3.0 * t), bump, t * (3.0 * t - 2.0)]
}

/// Difference of fourth order at node `i` of `0..=last`, per node spacing; one-sided near the ends.
fn unit_slope(i: usize, last: usize, f: impl Fn(usize) -> f64) -> f64 {
    let edge = |at: &dyn Fn(usize) -> f64| {
        (-25.0 * at(0) + 48.0 * at(1) - 36.0 * at(2) + 16.0 * at(3) - 3.0 * at(4)) / 12.0
    };
    let beside_edge =
        |at: &dyn Fn(usize) -> f64| (-3.0 * at(0) - 10.0 * at(1) + 18.0 * at(2) - 6.0 * at(3) + at(4)) / 12.0;
    match (i, last - i) {
        (0, _) => edge(&f),
        (1, _) => beside_edge(&f),
        (_, 0) => -edge(&|j| f(last - j)),
        (_, 1) => -beside_edge(&|j| f(last - j)),
        _ => (f(i - 2) - 8.0 * f(i - 1) + 8.0 * f(i + 1) - f(i + 2)) / 12.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_reproduced_to_round_off() {
        let f = |x: f64| 2.0 - x + 3.0 * x * x - 0.5 * x * x * x;
        let rows: Vec<[f64; 1]> = (0..9).map(|i| [f(-1.0 + 0.5 * i as f64)]).collect();
        let table = UniformCubic::new(-1.0, 0.5, &rows);
        for i in 0..=40 {
            let x = -1.0 + 0.1 * i as f64;
            assert!((table.at(x)[0] - f(x)).abs() < 1e-13, "{x}");
        }
        assert_eq!(table.at(-9.0)[0], f(-1.0));
    }

    #[test]
    fn halving_the_step_divides_the_error_by_sixteen() {
        let worst = |n: usize| {
            let mut table = UniformCubic::<1>::with_nodes(n);
            table.refit(0.0, 3.0, |_, x| [libm::exp(x)]);
            (0..1000)
                .map(|i| 0.003 * i as f64)
                .map(|x| (table.at(x)[0] - libm::exp(x)).abs())
                .fold(0.0, f64::max)
        };
        let ratio = worst(33) / worst(65);
        assert!((13.0..22.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_bicubic_and_its_slopes_are_reproduced() {
        let f = |x: f64, y: f64| (1.0 + x * x * x) * (y - 0.3 * y * y * y);
        let rows: Vec<[f64; 1]> =
            (0..42).map(|k| [f((k / 7) as f64 * 0.2, 1.0 + (k % 7) as f64 * 0.5)]).collect();
        let grid = UniformGrid::new((0.0, 1.0), (1.0, 4.0), 7, &rows);
        let (x, y) = (0.37, 2.81);
        let sample = grid.at(x, y);
        assert!((sample.value[0] - f(x, y)).abs() < 1e-12);
        assert!((sample.slow_slope[0] - 3.0 * x * x * (y - 0.3 * y * y * y)).abs() < 1e-11);
        assert!((sample.fast_slope[0] - (1.0 + x * x * x) * (1.0 - 0.9 * y * y)).abs() < 1e-11);
    }
}
