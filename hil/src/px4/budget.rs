//! Propellant of a hop flown by PX4, and the speeds that it allows.
//!
//! The hop is a list of legs whose durations follow from the limits that PX4 is given; over each the thrust
//! is the weight, which is exact at constant speed and on average for speeds that rise and fall. The engine's
//! own inverse gives the flows; port and mass are carried on. From lift-off to disarming nothing is left out,
//! the rise of the flame and the decay of the throttle after contact included, so the budget errs toward
//! more.

use hopbench::dynamics::mass::Contents;
use hopbench::input::Invalid;
use hopbench::propulsion::{EngineCondition, WarmStart};
use hopbench::vehicle::Vehicle;
use serde::{Serialize, Serializer};

use super::lander::Lander;
use super::tuning::Tuning;

/// A hop to be flown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hop {
    /// Height above the pad (m).
    pub height_m: f64,
    /// Hover at the top (s).
    pub hold_s: f64,
}

/// Speeds of a hop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Pace {
    /// Upward, at most (m/s).
    pub climb_m_s: f64,
    /// Downward, at most, above `slow_from_m` (m/s).
    pub sink_m_s: f64,
    /// Downward below `land_from_m` (m/s).
    pub land_m_s: f64,
    /// Height from which PX4 slows down, linearly with height (m).
    pub slow_from_m: f64,
    /// Height from which it sinks at `land_m_s` (m).
    pub land_from_m: f64,
}

/// One part of the hop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Leg {
    /// What happens.
    pub name: &'static str,
    /// For how long (s).
    pub duration_s: f64,
    /// Nitrous oxide that it takes (kg).
    pub nitrous_kg: f64,
    /// Fuel that it takes (kg).
    pub fuel_kg: f64,
}

/// What a hop takes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Budget {
    /// Height above the pad (m).
    pub height_m: f64,
    /// Hover at the top (s).
    pub hold_s: f64,
    /// The slowest pace, as it flew, unless the propellant needs a faster one.
    pub pace: Pace,
    /// Parts of the hop, in order.
    pub legs: Vec<Leg>,
    /// Burn from the flame to shutdown (s).
    pub burn_s: f64,
    /// Usable nitrous oxide at the start (kg).
    pub nitrous_usable_kg: f64,
    /// Share of it that is left.
    pub nitrous_left_fraction: f64,
    /// Fuel at the start that can burn, without the slivers between several ports (kg).
    pub fuel_kg: f64,
    /// Share of it that is left.
    pub fuel_left_fraction: f64,
    /// Longest hover that leaves [`RESERVE_FRACTION`] of both (s).
    pub longest_hold_s: f64,
    /// Contents as the hover begins, for the gains; its nitrous oxide in a report (kg).
    #[serde(serialize_with = "nitrous")]
    pub at_hover: Contents,
}

fn nitrous<S: Serializer>(contents: &Contents, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_f64(contents.nitrous_kg)
}

/// Share of either propellant that a hop must leave by this budget; scenarios ask for 0.08.
pub const RESERVE_FRACTION: f64 = 0.12;
/// Speeds up and down, slowest first: the slowest flew on PX4.
const SPEEDS_M_S: [[f64; 2]; 4] = [[2.0, 1.5], [2.5, 2.0], [3.0, 2.5], [4.0, 3.0]];
/// Landing speed that flew (m/s): 0.6 of contact speed.
const LAND_M_S: f64 = 0.6;
/// PX4's own heights, 10 and 5 m, would sink the last 5 m at landing speed: 8 s of hover. The height is known
/// to a metre or so: twice that remains slow.
const SLOW_FROM_M: f64 = 4.0;
const LAND_FROM_M: f64 = 2.0;
/// Limit of jerk that flew (m/s³).
pub(super) const JERK_M_S3: f64 = 1.5;
/// Ramp of the throttle from 0 to hover (s), as flown.
pub(super) const TAKEOFF_RAMP_S: f64 = 1.0;
/// Speed upward near the ground, as flown (m/s).
pub(super) const TAKEOFF_SPEED_M_S: f64 = 1.0;
/// From the end of the ramp to lift-off, as flown (s).
const LIFT_OFF_S: f64 = 0.3;
/// From contact to "Landing detected", as flown (s), charged at full weight though the throttle decays.
const TOUCHDOWN_S: f64 = 3.2;
/// Longest step of the integration (s).
const STEP_S: f64 = 0.25;

/// Contents with full tanks and a fresh port.
pub fn full_contents(vehicle: &Vehicle) -> Contents {
    contents(vehicle, vehicle.initial_nitrous_kg(), vehicle.engine.grain().port_radius_m)
}

fn contents(vehicle: &Vehicle, nitrous_kg: f64, port_radius_m: f64) -> Contents {
    let nitrogen_kg = vehicle.initial_nitrogen_kg(vehicle.initial_nitrous_kg());
    let pressurant = vehicle.nitrogen(nitrogen_kg, nitrous_kg, vehicle.site.pressure_pa);
    Contents {
        nitrous_kg,
        nitrous_density_kg_m3: vehicle.nitrous_density_kg_m3,
        port_radius_m,
        nitrogen_run_tank_kg: pressurant.tank_kg,
        nitrogen_bottle_kg: pressurant.bottle_kg,
    }
}

/// The hop at the slowest pace that the propellant allows.
///
/// # Errors
/// When even the fastest pace leaves too little.
pub fn hop_budget(vehicle: &Vehicle, hop: &Hop) -> Result<Budget, Invalid> {
    let mut last = None;
    for [climb_m_s, sink_m_s] in SPEEDS_M_S {
        let pace = Pace {
            climb_m_s,
            sink_m_s,
            land_m_s: LAND_M_S,
            slow_from_m: SLOW_FROM_M,
            land_from_m: LAND_FROM_M,
        };
        let budget = budget_at_pace(vehicle, hop, pace);
        if budget.longest_hold_s >= hop.hold_s {
            return Ok(budget);
        }
        last = Some(budget);
    }
    let longest_s = last.as_ref().map_or(0.0, |budget| budget.longest_hold_s);
    let burnt_through = last.and_then(|budget| budget.burnt_through_in()).map_or_else(String::new, |leg| {
        let radius_m = vehicle.engine.grain().burn_through_radius_m();
        format!("; the grain is burnt through at a port radius of {radius_m:.4} m in the leg \"{leg}\"")
    });
    let allowed = if longest_s > 0.0 {
        format!("allowed a hover up to {longest_s:.1} s, or a lower hop")
    } else {
        "allowed a lower hop".to_owned()
    };
    let message = format!(
        "a hop to {} m with {} s of hover leaves less than {RESERVE_FRACTION} of nitrous oxide or fuel at \
         any pace{burnt_through}; {allowed}",
        hop.height_m, hop.hold_s
    );
    Err(Invalid::new("--hold-s", message))
}

impl Budget {
    /// The leg in which the last fuel that can burn is gone, if one does that.
    pub fn burnt_through_in(&self) -> Option<&'static str> {
        let mut left_kg = self.fuel_kg;
        self.legs.iter().find_map(|leg| {
            left_kg -= leg.fuel_kg;
            (left_kg <= 0.0).then_some(leg.name)
        })
    }
}

/// Durations of the parts, by PX4's limits.
fn durations(hop: &Hop, pace: &Pace, tuning: &Tuning, ignition_s: f64) -> [(&'static str, f64); 6] {
    let [up, down] = tuning.acceleration_up_down_m_s2;
    // A speed is reached and left along ramps limited in acceleration and jerk.
    let travel_s = |distance_m: f64, speed_m_s: f64, acceleration_m_s2: f64| {
        distance_m / speed_m_s + speed_m_s / acceleration_m_s2 + acceleration_m_s2 / JERK_M_S3
    };
    // PX4 climbs at its take-off speed up to `land_from_m` and gets faster from there to `slow_from_m`.
    let slow_climb_m = hop.height_m.min(pace.land_from_m);
    let speeding_up_m = (hop.height_m.min(pace.slow_from_m) - slow_climb_m).max(0.0);
    let speeding_up_s = speeding_up_m * logarithmic_mean(1.0 / TAKEOFF_SPEED_M_S, 1.0 / pace.climb_m_s);
    let climb_s = slow_climb_m / TAKEOFF_SPEED_M_S
        + speeding_up_s
        + travel_s((hop.height_m - pace.slow_from_m).max(0.0), pace.climb_m_s, up);
    let fast_m = (hop.height_m - pace.slow_from_m).max(0.0);
    let slowing_from = hop.height_m.min(pace.slow_from_m);
    let slowing_m = (slowing_from - pace.land_from_m).max(0.0);
    let slowing_s = slowing_m * logarithmic_mean(1.0 / pace.sink_m_s, 1.0 / pace.land_m_s);
    [
        // The lit engine burns at its least thrust from 2 % of throttle on.
        ("ignition and ramp", TAKEOFF_RAMP_S + LIFT_OFF_S + ignition_s),
        ("climb", climb_s),
        ("hover", hop.hold_s),
        ("descent", travel_s(fast_m, pace.sink_m_s, down)),
        ("landing", slowing_s + hop.height_m.min(pace.land_from_m) / pace.land_m_s),
        ("touchdown", TOUCHDOWN_S),
    ]
}

/// Mean of the time a metre takes where the speed changes linearly with height, from one to the other (s/m):
/// ∫dh/v over a height h with speeds u and v is h ln(v/u)/(v - u).
fn logarithmic_mean(a_s_m: f64, b_s_m: f64) -> f64 {
    let (u, v) = (1.0 / a_s_m, 1.0 / b_s_m);
    if (u - v).abs() < 1e-9 { a_s_m } else { libm::log(v / u) / (v - u) }
}

fn budget_at_pace(vehicle: &Vehicle, hop: &Hop, pace: Pace) -> Budget {
    let (engine, grain) = (&vehicle.engine, vehicle.engine.grain());
    let feed = engine.feed_map(vehicle.tank.pressure_pa, vehicle.tank.temperature_k);
    let throat_m = engine.nozzle().throat_radius_m();
    let tuning = Tuning::of(&Lander::of(vehicle, &full_contents(vehicle)));
    let ignition_s = vehicle.engine_parameters.ignition.rise_time_constant_s;
    let nitrous_usable_kg = (vehicle.initial_nitrous_kg() - vehicle.tank.unusable_nitrous_kg).max(0.0);
    let burn_through_m = grain.burn_through_radius_m();
    let fuel_kg = grain.fuel_kg(grain.port_radius_m) - grain.fuel_kg(burn_through_m);
    // A hair of web: without any the engine would count as cold.
    let last_web_m = burn_through_m * (1.0 - 1e-9);

    let mut now = full_contents(vehicle);
    let mut at_hover = now;
    let mut legs = Vec::new();
    for (name, duration_s) in durations(hop, &pace, &tuning, ignition_s) {
        if name == "hover" {
            at_hover = now;
        }
        let (mut nitrous_used_kg, mut fuel_used_kg) = (0.0, 0.0);
        let steps = (duration_s / STEP_S).ceil();
        let step_s = if steps > 0.0 { duration_s / steps } else { 0.0 };
        for _ in 0..steps as usize {
            let condition = EngineCondition::burning(now.port_radius_m, throat_m, vehicle.site.pressure_pa);
            let weight_n = Lander::of(vehicle, &now).weight_n();
            let point = engine.inverse(&feed, weight_n, &condition, WarmStart::default()).point;
            // What is asked for counts, there or not, past burn-through at the last radius: the shortage is
            // then a number.
            nitrous_used_kg += point.oxidizer_kg_s * step_s;
            fuel_used_kg += point.fuel_kg_s * step_s;
            let fuel_left_kg = (grain.fuel_kg(now.port_radius_m) - point.fuel_kg_s * step_s).max(0.0);
            let nitrous_kg = (now.nitrous_kg - point.oxidizer_kg_s * step_s).max(0.0);
            now = contents(vehicle, nitrous_kg, grain.port_radius_of_fuel_m(fuel_left_kg).min(last_web_m));
        }
        legs.push(Leg { name, duration_s, nitrous_kg: nitrous_used_kg, fuel_kg: fuel_used_kg });
    }
    let burn_s: f64 = legs.iter().map(|leg| leg.duration_s).sum();
    let nitrous_kg: f64 = legs.iter().map(|leg| leg.nitrous_kg).sum();
    let burnt_kg: f64 = legs.iter().map(|leg| leg.fuel_kg).sum();
    let left = |used: f64, had: f64| if had > 0.0 { 1.0 - used / had } else { 0.0 };
    let (nitrous_left, fuel_left) = (left(nitrous_kg, nitrous_usable_kg), left(burnt_kg, fuel_kg));
    // More hover costs what the whole burn costs a second, on average.
    let spare_s = |left: f64| burn_s * (left - RESERVE_FRACTION) / (1.0 - left).max(1e-9);
    Budget {
        height_m: hop.height_m,
        hold_s: hop.hold_s,
        pace,
        burn_s,
        nitrous_usable_kg,
        nitrous_left_fraction: nitrous_left,
        fuel_kg,
        fuel_left_fraction: fuel_left,
        longest_hold_s: hop.hold_s + spare_s(nitrous_left).min(spare_s(fuel_left)),
        legs,
        at_hover,
    }
}
