//! [`FeedGrid`]: the feed system of a tank whose pressure and temperature move.
//!
//! A [`FeedMap`] holds for one state of the tank and costs the time of some steps. So maps are made at the
//! nodes of a grid over tank pressure and temperature, and between nodes the feed system is interpolated
//! linearly over the triangle of three nodes that contains the tank's state. Neighbouring triangles agree
//! along their common side, so a flight converges as its step shrinks. [`Feed`] is the feed system at one
//! state of the tank; every stage of the integrator takes its own. At a node it is that node's map alone: a
//! tank that keeps its first state costs nothing.
//!
//! Each map has a kink at its own flash pressure. Interpolated at equal P2, the three would give three kinks.
//! So each map is read at the same relative position, either between the lowest pressure and its flash
//! pressure or between its flash pressure and its tank pressure: the kinks coincide, and one remains.
//!
//! Linear interpolation over 0.5 bar and 0.25 K errs by an eighth of the second difference. Near the vapour
//! pressure, where the slope of the valve's flux is that of a square root, this is up to 8e-4 of the flow;
//! for the injector it is 2e-5.

use super::feed_map::{FeedMap, Inlet};
use crate::fluid::{Nitrous, Stagnation};

/// Spacing of the grid: Pa and K.
const SPACING: [f64; 2] = [5e4, 0.25];
/// A state nearer to a node than this share of the spacing counts as the node: 5 mPa, less than the accuracy
/// of P2.
const ON_NODE: f64 = 1e-7;
/// Maps that are kept: those of a triangle, and one more for a state that moves to and fro across a side.
const MAPS: usize = 4;

/// Feed maps at grid nodes around the state of a tank.
#[derive(Clone, Debug)]
pub struct FeedGrid {
    origin: [f64; 2],
    maps: [FeedMap; MAPS],
    nodes: [Option<[i32; 2]>; MAPS],
    /// When each map was last used, counted in changes of the triangle.
    last_used: [u64; MAPS],
    change_count: u64,
    triangle: GridTriangle,
}

/// Half a cell of the grid, with the maps at its corners: constant inside a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct GridTriangle {
    cell: [i32; 2],
    /// The half in which temperature is farther from the cell's first corner than pressure, in units of the
    /// spacing.
    warm: bool,
    /// Index of the map at each corner; one without weight need not exist.
    corners: [Option<usize>; 3],
}

/// The feed system at one state of the tank.
#[derive(Clone, Copy, Debug)]
pub struct Feed<'a> {
    first: &'a FeedMap,
    blend: Option<Blend<'a>>,
}

/// Interpolation between maps.
#[derive(Clone, Copy, Debug)]
struct Blend<'a> {
    parts: [(f64, &'a FeedMap); 3],
    tank: Stagnation,
    flash_pa: f64,
}

impl<'a> From<&'a FeedMap> for Feed<'a> {
    fn from(map: &'a FeedMap) -> Self {
        Self { first: map, blend: None }
    }
}

impl<'a> From<&Feed<'a>> for Feed<'a> {
    fn from(feed: &Feed<'a>) -> Self {
        *feed
    }
}

impl FeedGrid {
    /// Around the state of the tank that a map is for.
    pub fn new(map: FeedMap) -> Self {
        let (tank_pa, tank_k) = map.built_for();
        let mut nodes = [None; MAPS];
        nodes[0] = Some([0, 0]);
        Self {
            origin: [tank_pa, tank_k],
            maps: std::array::from_fn(|_| map.clone()),
            nodes,
            last_used: [0; MAPS],
            change_count: 0,
            triangle: GridTriangle { cell: [0, 0], warm: false, corners: [Some(0), None, None] },
        }
    }

    /// The feed system at a state of the tank; extrapolated where that lies somewhat outside the triangle.
    #[inline]
    pub fn at(&self, tank_pa: f64, tank_k: f64) -> Feed<'_> {
        let GridTriangle { cell, warm, corners } = self.triangle;
        if [tank_pa, tank_k] == self.origin && cell == [0, 0] {
            return Feed { first: &self.maps[corners[0].unwrap_or(0)], blend: None };
        }
        let position = self.position(tank_pa, tank_k);
        let from = |axis: usize| (position[axis] - f64::from(cell[axis])).clamp(-1.0, 2.0);
        let (long, short) = if warm { (from(1), from(0)) } else { (from(0), from(1)) };
        let map = |corner: usize| corners[corner].map(|at| &self.maps[at]);
        let first = map(0).unwrap_or(&self.maps[0]);
        // A map that is not made yet will be from the next step on.
        let third = map(2).map_or(0.0, |_| short);
        let second = map(1).map_or(0.0, |_| long - third);
        if second == 0.0 && third == 0.0 {
            return Feed { first, blend: None };
        }
        let (b, c) = (map(1).unwrap_or(first), map(2).unwrap_or(first));
        let parts = [(1.0 - second - third, first), (second, b), (third, c)];
        Feed { first, blend: Some(Blend::of(parts)) }
    }

    /// Moves to another state of the tank, between steps: makes the maps that its triangle lacks, and says
    /// whether the triangle is another. No allocation.
    pub fn follow(&mut self, tank_pa: f64, tank_k: f64) -> bool {
        let [u, v] = self.position(tank_pa, tank_k);
        let cell = [u.floor(), v.floor()].map(|x| x as i32);
        let (fu, fv) = (u - u.floor(), v - v.floor());
        let warm = fv > fu;
        let (long, short) = if warm { (fv, fu) } else { (fu, fv) };
        let [i, j] = cell;
        let nodes = [[i, j], if warm { [i, j + 1] } else { [i + 1, j] }, [i + 1, j + 1]];
        let weights = [1.0 - long, long - short, short];
        let now = &self.triangle;
        let complete = (0..3).all(|k| weights[k] <= 0.0 || now.corners[k].is_some());
        if now.cell == cell && now.warm == warm && complete {
            return false;
        }
        self.change_count += 1;
        let mut corners = nodes.map(|node| self.nodes.iter().position(|at| *at == Some(node)));
        for at in corners.into_iter().flatten() {
            self.last_used[at] = self.change_count;
        }
        for corner in 0..3 {
            if corners[corner].is_none() && weights[corner] > 0.0 {
                corners[corner] = Some(self.make_map(nodes[corner]));
            }
        }
        self.triangle = GridTriangle { cell, warm, corners };
        true
    }

    /// Makes the map of a node, in place of the least recently used one.
    fn make_map(&mut self, node: [i32; 2]) -> usize {
        let mut oldest = 0;
        for at in 1..MAPS {
            if self.last_used[at] < self.last_used[oldest] {
                oldest = at;
            }
        }
        let state: [f64; 2] =
            std::array::from_fn(|axis| self.origin[axis] + f64::from(node[axis]) * SPACING[axis]);
        self.maps[oldest].rebuild(state[0], state[1]);
        self.nodes[oldest] = Some(node);
        self.last_used[oldest] = self.change_count;
        oldest
    }

    /// Position of a state on the grid, in units of its spacing.
    #[inline]
    fn position(&self, tank_pa: f64, tank_k: f64) -> [f64; 2] {
        let state = [tank_pa, tank_k];
        std::array::from_fn(|axis| {
            let position = (state[axis] - self.origin[axis]) / SPACING[axis];
            let node = position.round();
            if (position - node).abs() < ON_NODE { node } else { position }
        })
    }
}

impl<'a> Feed<'a> {
    /// The liquid in the tank.
    #[inline]
    pub fn tank(&self) -> &Stagnation {
        match &self.blend {
            None => self.first.tank(),
            Some(blend) => &blend.tank,
        }
    }

    /// Pressure at which the isenthalp from the tank begins to boil (Pa).
    pub fn flash_pa(&self) -> f64 {
        self.blend.as_ref().map_or(self.first.flash_pa(), |blend| blend.flash_pa)
    }

    /// State 2 and the flux of the valve at an inlet pressure P2.
    #[inline]
    pub fn inlet(&self, inlet_pa: f64) -> Inlet {
        match &self.blend {
            None => self.first.inlet(inlet_pa),
            Some(blend) => blend.inlet(inlet_pa),
        }
    }

    /// Flux of the injector (kg/(m² s)) from an inlet state into the chamber.
    #[inline]
    pub fn injector_flux_kg_m2_s(&self, inlet: &Inlet, chamber_pa: f64) -> f64 {
        self.first.injector_flux_kg_m2_s(inlet, chamber_pa)
    }
}

impl<'a> Blend<'a> {
    fn of(parts: [(f64, &'a FeedMap); 3]) -> Self {
        let mean = |of: fn(&FeedMap) -> f64| parts.iter().map(|(weight, map)| weight * of(map)).sum();
        Self {
            tank: Stagnation {
                pressure_pa: mean(|map| map.tank().pressure_pa),
                vapor_pressure_pa: mean(|map| map.tank().vapor_pressure_pa),
                density_kg_m3: mean(|map| map.tank().density_kg_m3),
                enthalpy_j_kg: mean(|map| map.tank().enthalpy_j_kg),
                entropy_j_kg_k: mean(|map| map.tank().entropy_j_kg_k),
            },
            flash_pa: mean(FeedMap::flash_pa),
            parts,
        }
    }

    #[inline(never)]
    fn inlet(&self, inlet_pa: f64) -> Inlet {
        let (floor_pa, flash_pa, tank) = (Nitrous::LEAST_PA, self.flash_pa, &self.tank);
        let flashing = inlet_pa < flash_pa;
        let (from_pa, to_pa) = if flashing { (floor_pa, flash_pa) } else { (flash_pa, tank.pressure_pa) };
        let share = if to_pa > from_pa { (inlet_pa - from_pa) / (to_pa - from_pa) } else { 1.0 };
        let mut blended = Inlet {
            state: Stagnation {
                pressure_pa: inlet_pa,
                vapor_pressure_pa: 0.0,
                density_kg_m3: 0.0,
                enthalpy_j_kg: tank.enthalpy_j_kg,
                entropy_j_kg_k: 0.0,
            },
            quality: 0.0,
            critical_pa: 0.0,
            critical_flux_kg_m2_s: 0.0,
            valve_flux_kg_m2_s: 0.0,
        };
        for (weight, map) in self.parts.iter().filter(|(weight, _)| *weight != 0.0) {
            let (from_pa, to_pa) =
                if flashing { (floor_pa, map.flash_pa()) } else { (map.flash_pa(), map.tank().pressure_pa) };
            let inlet = map.inlet(from_pa + share * (to_pa - from_pa));
            blended.state.vapor_pressure_pa += weight * inlet.state.vapor_pressure_pa;
            blended.state.density_kg_m3 += weight * inlet.state.density_kg_m3;
            blended.state.entropy_j_kg_k += weight * inlet.state.entropy_j_kg_k;
            blended.quality += weight * inlet.quality;
            blended.critical_pa += weight * inlet.critical_pa;
            blended.critical_flux_kg_m2_s += weight * inlet.critical_flux_kg_m2_s;
            blended.valve_flux_kg_m2_s += weight * inlet.valve_flux_kg_m2_s;
        }
        let vapor_pa = blended.state.vapor_pressure_pa;
        blended.state.vapor_pressure_pa = if flashing { inlet_pa } else { vapor_pa.min(inlet_pa) };
        blended.quality = blended.quality.max(0.0);
        blended.valve_flux_kg_m2_s = blended.valve_flux_kg_m2_s.max(0.0);
        blended
    }
}
