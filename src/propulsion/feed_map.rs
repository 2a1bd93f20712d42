//! [`FeedMap`]: everything of the feed system that depends on the pressure between valve and injector alone.
//!
//! State 1 is the liquid in the tank, state 2 the oxidiser between valve and injector (the valve throttles:
//! h₂ = h₁), state 3 the chamber (the injector expands: s₃ = s₂). At fixed h₁, s₁ every property of state 2,
//! the choked flux of the injector and the flux of the valve are functions of P₂ alone. They are tabulated
//! once for a state of the tank, piecewise between the pressures at which they have kinks, and cost a look-up
//! each afterwards.

use super::injector::{OrificePressures, SinglePhase, flashing_flux_kg_m2_s};
use crate::fluid::{CriticalFlow, Nitrous, Stagnation};
use crate::interpolate::{Bracket, UniformCubic, bracketed_root};

/// Oxidiser between valve and injector at one P2, and the fluxes that depend on P2 alone.
#[derive(Clone, Copy, Debug)]
pub struct Inlet {
    /// State 2 as the start of the injector's isentrope.
    pub state: Stagnation,
    /// Vapour mass fraction.
    pub quality: f64,
    /// Pressure below which the injector's equilibrium flux is choked (Pa).
    pub critical_pa: f64,
    /// The injector's choked flux (kg/(m² s)).
    pub critical_flux_kg_m2_s: f64,
    /// Flux through the valve into this pressure (kg/(m² s)).
    pub valve_flux_kg_m2_s: f64,
}

/// Columns of the table over sqrt(P2).
#[derive(Clone, Copy, Debug)]
enum Column {
    Density,
    Entropy,
    Quality,
    VaporPressure,
    CriticalPressure,
    CriticalFlux,
    ValveDensity,
    /// Enthalpy drop of the valve's isentrope over its pressure drop: smooth, unlike the drop's root.
    ValveDropPerPa,
}
const COLUMNS: usize = 8;
/// Smooth pieces on either side of the flash pressure, at most.
const PIECES: usize = 6;
/// Nodes of a piece: the flashing side spans two decades of pressure, the liquid side is nearly straight.
const FLASHING_NODES: usize = 97;
const LIQUID_NODES: usize = 25;
/// Not a kink: below it the properties bend faster, so the table is finer there (Pa).
const FINER_BELOW_PA: f64 = 6e5;
/// Kinks closer than this are one (Pa).
const SAME_PA: f64 = 2.0;

/// One smooth piece of the table.
#[derive(Clone, Debug)]
struct Piece {
    top_pa: f64,
    table: UniformCubic<COLUMNS>,
}

/// Everything of the feed system that depends on P2 alone, for one state of the tank.
#[derive(Clone, Debug)]
pub struct FeedMap {
    tank: Stagnation,
    tank_temperature_k: f64,
    built_for: (f64, f64),
    flash_pa: f64,
    valve_critical_pa: f64,
    valve_critical_flux: f64,
    valve_single_phase: SinglePhase,
    injector_single_phase: SinglePhase,
    flashing: [Piece; PIECES],
    flashing_count: usize,
    liquid: [Piece; PIECES],
    liquid_count: usize,
}

impl FeedMap {
    /// For a tank pressure and temperature of the liquid.
    pub fn new(tank_pa: f64, tank_k: f64) -> Self {
        let piece = |nodes: usize| Piece { top_pa: 0.0, table: UniformCubic::with_nodes(nodes) };
        let at_rest = Stagnation {
            pressure_pa: 0.0,
            vapor_pressure_pa: 0.0,
            density_kg_m3: 0.0,
            enthalpy_j_kg: 0.0,
            entropy_j_kg_k: 0.0,
        };
        let mut map = Self {
            tank: at_rest,
            tank_temperature_k: tank_k,
            built_for: (f64::NAN, f64::NAN),
            flash_pa: 0.0,
            valve_critical_pa: 0.0,
            valve_critical_flux: 0.0,
            valve_single_phase: SinglePhase::Incompressible,
            injector_single_phase: SinglePhase::Incompressible,
            flashing: std::array::from_fn(|_| piece(FLASHING_NODES)),
            flashing_count: 0,
            liquid: std::array::from_fn(|_| piece(LIQUID_NODES)),
            liquid_count: 0,
        };
        map.rebuild(tank_pa, tank_k);
        map
    }

    /// The same with another form of the flux of valve and injector below their critical pressures.
    pub(super) fn with_single_phase(self, valve: SinglePhase, injector: SinglePhase) -> Self {
        Self { valve_single_phase: valve, injector_single_phase: injector, ..self }
    }

    /// Tabulates anew for another state of the tank; does nothing when it is the same. No allocation.
    ///
    /// A tank pressure below the vapour pressure leaves the liquid saturated at that pressure: it is taken
    /// to have cooled by boiling.
    pub fn rebuild(&mut self, tank_pa: f64, tank_k: f64) {
        if self.built_for == (tank_pa, tank_k) {
            return;
        }
        self.built_for = (tank_pa, tank_k);
        let n2o = Nitrous::tables();
        let tank_pa = tank_pa.clamp(1.05 * Nitrous::LEAST_PA, 80e5);
        let tank_k = tank_k.clamp(200.0, 307.0).min(n2o.saturation(tank_pa).temperature_k);
        let liquid = n2o.liquid(tank_pa, tank_k);
        // Boiling within rounding of the tables counts as boiling.
        let vapor_pa = n2o.vapor_pressure_pa(tank_k);
        let boils = vapor_pa > tank_pa * (1.0 - 1e-7);
        self.tank_temperature_k = tank_k;
        self.tank = Stagnation {
            pressure_pa: tank_pa,
            vapor_pressure_pa: if boils { tank_pa } else { vapor_pa },
            density_kg_m3: liquid.density_kg_m3,
            enthalpy_j_kg: liquid.enthalpy_j_kg,
            entropy_j_kg_k: liquid.entropy_j_kg_k,
        };
        if boils {
            // The saturation line itself, so that both sides of it are one.
            let line = n2o.saturation(tank_pa);
            self.tank.density_kg_m3 = line.liquid_density_kg_m3;
            self.tank.enthalpy_j_kg = line.liquid_enthalpy_j_kg;
            self.tank.entropy_j_kg_k = line.liquid_entropy_j_kg_k;
        }
        self.flash_pa =
            if boils { tank_pa } else { n2o.flash_pressure_pa(self.tank.enthalpy_j_kg).min(tank_pa) };
        let valve = n2o.critical(&self.tank, 0.9 * self.flash_pa);
        self.valve_critical_pa = valve.pressure_pa;
        self.valve_critical_flux = valve.flux_kg_m2_s;

        // Where the injector's choking pressure enters the table's range, and where its peak moves to the
        // kink.
        let (floor_pa, tank) = (Nitrous::LEAST_PA, self.tank);
        let choking_enters_pa = self.zero_of(floor_pa, self.flash_pa, |map, pa| {
            let critical = map.injector_critical(n2o, pa, true);
            if critical.pressure_pa > floor_pa * (1.0 + 1e-9) { 1.0 } else { -1.0 }
        });
        let peak_moves_pa = self.zero_of(self.flash_pa, tank.pressure_pa, |map, pa| {
            map.injector_critical(n2o, pa, false).onset_mach2 - 1.0
        });
        let kinks = [
            valve.pressure_pa,
            valve.saturation_pa,
            choking_enters_pa,
            peak_moves_pa,
            tank.vapor_pressure_pa,
            FINER_BELOW_PA,
        ];
        self.flashing_count = self.tabulate(n2o, (floor_pa, self.flash_pa), kinks, true);
        self.liquid_count = self.tabulate(n2o, (self.flash_pa, tank.pressure_pa), kinks, false);
    }

    /// Tank pressure and temperature that this map was asked to be for.
    pub(super) fn built_for(&self) -> (f64, f64) {
        self.built_for
    }

    /// The liquid in the tank.
    pub fn tank(&self) -> &Stagnation {
        &self.tank
    }

    /// Temperature of the liquid in the tank (K).
    pub fn tank_temperature_k(&self) -> f64 {
        self.tank_temperature_k
    }

    /// Pressure at which the isenthalp from the tank begins to boil (Pa).
    pub fn flash_pa(&self) -> f64 {
        self.flash_pa
    }

    /// Pressure below which the valve's equilibrium flux is choked (Pa).
    pub fn valve_critical_pa(&self) -> f64 {
        self.valve_critical_pa
    }

    /// State 2 and the flux of the valve at an inlet pressure P2.
    #[inline(always)]
    pub fn inlet(&self, inlet_pa: f64) -> Inlet {
        let flashing = inlet_pa < self.flash_pa || self.liquid_count == 0;
        let (pieces, count) =
            if flashing { (&self.flashing, self.flashing_count) } else { (&self.liquid, self.liquid_count) };
        let mut piece = 0;
        while piece + 1 < count && inlet_pa > pieces[piece].top_pa {
            piece += 1;
        }
        let row = pieces[piece].table.at(inlet_pa.max(0.0).sqrt());
        let vapor_pressure_pa =
            if flashing { inlet_pa } else { row[Column::VaporPressure as usize].min(inlet_pa) };
        let tank = &self.tank;
        let pressures = OrificePressures {
            upstream_pa: tank.pressure_pa,
            downstream_pa: self
                .valve_single_phase
                .effective_back_pressure_pa(inlet_pa, self.valve_critical_pa),
            vapor_pa: tank.vapor_pressure_pa,
        };
        let valve_flux = flashing_flux_kg_m2_s(pressures, tank.density_kg_m3, || {
            if inlet_pa <= self.valve_critical_pa {
                return self.valve_critical_flux;
            }
            let drop_j_kg = row[Column::ValveDropPerPa as usize] * (tank.pressure_pa - inlet_pa);
            row[Column::ValveDensity as usize] * (2.0 * drop_j_kg).max(0.0).sqrt()
        });
        Inlet {
            state: Stagnation {
                pressure_pa: inlet_pa,
                vapor_pressure_pa,
                density_kg_m3: row[Column::Density as usize],
                enthalpy_j_kg: tank.enthalpy_j_kg,
                entropy_j_kg_k: row[Column::Entropy as usize],
            },
            quality: if flashing { row[Column::Quality as usize] } else { 0.0 },
            critical_pa: row[Column::CriticalPressure as usize],
            critical_flux_kg_m2_s: row[Column::CriticalFlux as usize],
            valve_flux_kg_m2_s: valve_flux,
        }
    }

    /// Flux of the injector (kg/(m² s)) from an inlet state into the chamber.
    #[inline]
    pub fn injector_flux_kg_m2_s(&self, inlet: &Inlet, chamber_pa: f64) -> f64 {
        let pressures = OrificePressures {
            upstream_pa: inlet.state.pressure_pa,
            downstream_pa: self
                .injector_single_phase
                .effective_back_pressure_pa(chamber_pa, inlet.critical_pa),
            vapor_pa: inlet.state.vapor_pressure_pa,
        };
        flashing_flux_kg_m2_s(pressures, inlet.state.density_kg_m3, || {
            // At the table's floor the choking pressure is not known: the chamber is above it.
            if chamber_pa <= inlet.critical_pa && inlet.critical_pa > Nitrous::LEAST_PA * (1.0 + 1e-6) {
                inlet.critical_flux_kg_m2_s
            } else {
                // A small drop of enthalpy is a difference of large numbers: the entropy must be exact.
                let n2o = Nitrous::tables();
                let flashing = inlet.state.vapor_pressure_pa >= inlet.state.pressure_pa;
                let state = if flashing {
                    boiling_state(n2o, inlet.state.pressure_pa, inlet.state.enthalpy_j_kg).0
                } else {
                    inlet.state
                };
                n2o.equilibrium_flux_kg_m2_s(&state, chamber_pa)
            }
        })
    }

    /// State 2 evaluated directly, without the table; the reference that the table is tested against.
    pub fn inlet_directly(&self, inlet_pa: f64) -> Inlet {
        let n2o = Nitrous::tables();
        let row = self.row(n2o, inlet_pa, inlet_pa < self.flash_pa, &mut f64::NAN.clone());
        let tank = &self.tank;
        let flashing = inlet_pa < self.flash_pa;
        let pressures = OrificePressures {
            upstream_pa: tank.pressure_pa,
            downstream_pa: self
                .valve_single_phase
                .effective_back_pressure_pa(inlet_pa, self.valve_critical_pa),
            vapor_pa: tank.vapor_pressure_pa,
        };
        let choked_pa = inlet_pa.max(self.valve_critical_pa);
        let valve_flux = flashing_flux_kg_m2_s(pressures, tank.density_kg_m3, || {
            n2o.equilibrium_flux_kg_m2_s(tank, choked_pa)
        });
        Inlet {
            state: throttled_state(n2o, inlet_pa, self.tank.enthalpy_j_kg, flashing).0,
            quality: row[Column::Quality as usize],
            critical_pa: row[Column::CriticalPressure as usize],
            critical_flux_kg_m2_s: row[Column::CriticalFlux as usize],
            valve_flux_kg_m2_s: valve_flux,
        }
    }

    /// Tabulates one side of the flash pressure between the kinks that fall into it.
    fn tabulate(&mut self, n2o: &Nitrous, (from, to): (f64, f64), kinks: [f64; 6], flashing: bool) -> usize {
        if to - from <= SAME_PA {
            return 0;
        }
        let mut ends = kinks;
        ends.sort_by(f64::total_cmp);
        let (mut count, mut start) = (0, from);
        for end in ends.into_iter().chain([to]) {
            let inside = end - start > SAME_PA && to - end > SAME_PA && count + 1 < PIECES;
            if inside || end == to {
                // Take the piece out while its table asks the map for rows.
                let side = if flashing { &mut self.flashing } else { &mut self.liquid };
                let empty = Piece { top_pa: 0.0, table: UniformCubic::placeholder() };
                let mut piece = std::mem::replace(&mut side[count], empty);
                piece.top_pa = end;
                let mut guess_pa = f64::NAN;
                piece.table.refit(start.sqrt(), end.sqrt(), |_, root_pa| {
                    self.row(n2o, (root_pa * root_pa).clamp(start, end), flashing, &mut guess_pa)
                });
                let side = if flashing { &mut self.flashing } else { &mut self.liquid };
                side[count] = piece;
                count += 1;
                start = end;
                if end == to {
                    break;
                }
            }
        }
        count
    }

    /// One row of the table. `guess_pa` carries the choking pressure from row to row.
    fn row(&self, n2o: &Nitrous, inlet_pa: f64, flashing: bool, guess_pa: &mut f64) -> [f64; COLUMNS] {
        let (state, quality) = throttled_state(n2o, inlet_pa, self.tank.enthalpy_j_kg, flashing);
        let critical = n2o.critical(&state, if guess_pa.is_nan() { 0.8 * inlet_pa } else { *guess_pa });
        *guess_pa = critical.pressure_pa;
        let tank = &self.tank;
        let drop_pa = tank.pressure_pa - inlet_pa;
        // At the tank's own pressure the mean specific volume is the tank's.
        let (valve_density, valve_drop_per_pa) = if drop_pa > 1.0 {
            let (density, drop_j_kg) = n2o.expanded(tank, inlet_pa);
            (density, drop_j_kg / drop_pa)
        } else {
            (tank.density_kg_m3, 1.0 / tank.density_kg_m3)
        };
        let mut row = [0.0; COLUMNS];
        row[Column::Density as usize] = state.density_kg_m3;
        row[Column::Entropy as usize] = state.entropy_j_kg_k;
        row[Column::Quality as usize] = quality;
        row[Column::VaporPressure as usize] = state.vapor_pressure_pa;
        row[Column::CriticalPressure as usize] = critical.pressure_pa;
        row[Column::CriticalFlux as usize] = critical.flux_kg_m2_s;
        row[Column::ValveDensity as usize] = valve_density;
        row[Column::ValveDropPerPa as usize] = valve_drop_per_pa;
        row
    }

    fn injector_critical(&self, n2o: &Nitrous, inlet_pa: f64, flashing: bool) -> CriticalFlow {
        n2o.critical(&throttled_state(n2o, inlet_pa, self.tank.enthalpy_j_kg, flashing).0, 0.8 * inlet_pa)
    }

    /// Pressure in a range at which a rising function passes zero, or the end nearest to that.
    fn zero_of(&self, from: f64, to: f64, f: impl Fn(&Self, f64) -> f64) -> f64 {
        let bracket = Bracket { low: from, high: to, guess: f64::NAN, slope: None, tolerance: 0.01 };
        bracketed_root(bracket, |pa| f(self, pa)).x
    }
}

/// State 2 and its quality behind the valve, which throttles: h₂ = h₁, boiling or liquid.
pub(super) fn throttled_state(
    n2o: &Nitrous,
    inlet_pa: f64,
    enthalpy_j_kg: f64,
    flashing: bool,
) -> (Stagnation, f64) {
    if flashing {
        return boiling_state(n2o, inlet_pa, enthalpy_j_kg);
    }
    let liquid = n2o.liquid_of_enthalpy(inlet_pa, enthalpy_j_kg);
    let state = Stagnation {
        pressure_pa: inlet_pa,
        vapor_pressure_pa: n2o.vapor_pressure_pa(liquid.temperature_k).min(inlet_pa),
        density_kg_m3: liquid.density_kg_m3,
        enthalpy_j_kg,
        entropy_j_kg_k: liquid.entropy_j_kg_k,
    };
    (state, 0.0)
}

/// Boiling state and its quality at a pressure and an enthalpy.
fn boiling_state(n2o: &Nitrous, pressure_pa: f64, enthalpy_j_kg: f64) -> (Stagnation, f64) {
    let line = n2o.saturation(pressure_pa);
    let quality = line.quality_of_enthalpy(enthalpy_j_kg);
    let state = Stagnation {
        pressure_pa,
        vapor_pressure_pa: pressure_pa,
        density_kg_m3: line.density_kg_m3(quality),
        enthalpy_j_kg,
        entropy_j_kg_k: line.entropy_j_kg_k(quality),
    };
    (state, quality)
}
