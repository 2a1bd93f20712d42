//! What must hold for a feed system that stores: it tends to the steady engine as volume, length and lag
//! vanish, it converges with the step as its method says, it keeps mass, it empties to nothing, it never
//! gives a number that is not finite.

// The whole flights read the files that `hopbench fly` reads; figures are printed for the record.
#![allow(clippy::disallowed_macros, clippy::disallowed_methods)]

use crate::fixture::bare_engine;
use crate::fixture::bare_engine::{AMBIENT_PA, condition, engine_of, vehicle};
use crate::fixture::feed_line::{Fed, with_line, with_manifold};
use crate::fixture::files;
use hopbench::plant::Snapshot;
use hopbench::propulsion::{EngineCondition, Feed, FeedGrid, FeedMap, ImplicitMethod, ManifoldModel};
use hopbench::simulation::fly;
use proptest::prelude::*;

/// Steady flow and P2 of an angle.
fn steady(engine: &hopbench::propulsion::Engine, degrees: f64) -> hopbench::propulsion::OperatingPoint {
    bare_engine::at_angle(engine, &FeedMap::new(65e5, 290.0), degrees, &condition(35.0, 10.0))
}

#[test]
fn a_manifold_of_no_volume_and_a_line_of_no_length_are_the_steady_engine() {
    for (volume_m3, length_m) in [(1e-7, None), (1e-7, Some(1e-6)), (0.0, Some(1e-6))] {
        let mut vehicle = vehicle();
        if volume_m3 > 0.0 {
            with_manifold(&mut vehicle, volume_m3);
        }
        if let Some(length_m) = length_m {
            with_line(&mut vehicle, length_m);
        }
        let engine = engine_of(&vehicle);
        let mut fed = Fed::steady(&engine, 15.0);
        let mut worst = 0.0f64;
        let angle = |t: f64| 15.0 + 6.0 * t;
        for i in 0..2000 {
            let (t, dt) = (1e-3 * f64::from(i), 1e-3);
            fed.step(angle(t), angle(t + dt), dt, ImplicitMethod::Sdirk2);
            worst = worst.max((fed.point.thrust_n / steady(&engine, angle(t + dt)).thrust_n - 1.0).abs());
        }
        println!("{volume_m3:e} m3, {length_m:?} m: {worst:.1e}");
        // What a volume stores lags by its lag: 1e-7 m3 has a 250th of 47 ms, 0.19 ms; the thrust moves by
        // 1.3 of itself per s at most. The line has 1e-6 m/1.3e-4 m2/(2 ΔP/ṁ = 3e7) = 0.3 ns.
        let lag_s = if volume_m3 > 0.0 { 0.19e-3 } else { 1e-8 };
        assert!(worst < 1.3 * 1.5 * lag_s + 1e-7, "{worst:e}");
    }
}

/// Two stages are of second order, one is of first, and 1 ms is as good as the method's error constant says.
#[test]
fn halving_the_step_shows_the_order() {
    for (name, method, line, order) in [
        ("SDIRK2", ImplicitMethod::Sdirk2, false, 2.0),
        ("backward Euler", ImplicitMethod::BackwardEuler, false, 1.0),
        ("SDIRK2 with a line", ImplicitMethod::Sdirk2, true, 2.0),
    ] {
        let mut vehicle = vehicle();
        with_manifold(&mut vehicle, 2.5e-5);
        if line {
            // A line a hundred times too long: its own lag, 20 ms, must be resolved to show an order.
            with_line(&mut vehicle, 50.0);
        }
        let engine = engine_of(&vehicle);
        // Inside the boiling range: at its end the order is lost for a step.
        let angle = |t: f64| 18.0 + 3.0 * libm::sin(20.0 * t);
        let end = |steps: u32| {
            let mut fed = Fed::steady(&engine, 18.0);
            let dt = 0.32 / f64::from(steps);
            for i in 0..steps {
                let t = dt * f64::from(i);
                fed.step(angle(t), angle(t + dt), dt, method);
            }
            fed.point.injector_inlet_pa
        };
        let p2: Vec<f64> = [20, 40, 80, 160, 320, 640, 5120].into_iter().map(end).collect();
        let exact = p2[p2.len() - 1];
        let errors: Vec<f64> = p2[..6].iter().map(|x| (x - exact).abs()).collect();
        println!("{name}: {errors:.2?} Pa of {exact:.0}");
        for pair in errors.windows(2).skip(2).take(2) {
            let found = libm::log2(pair[0] / pair[1]);
            assert!((found - order).abs() < 0.35, "{name}: order {found}, {errors:?}");
        }
        // Sixteenth column is 1 ms, the step of the plant. Amplitude of P2 9 bar, ωτ = 0.8; z = 1/40:
        // second order 0.04 z² of 9e5 is 23 Pa, first order z/2 of it 11 kPa.
        let allowed_pa = if order == 2.0 { 60.0 } else { 15_000.0 };
        assert!(errors[4] < allowed_pa, "{name}: {} Pa", errors[4]);
    }
}

#[test]
fn what_leaves_the_tank_is_what_is_injected_and_what_is_stored() {
    let mut vehicle = vehicle();
    with_manifold(&mut vehicle, 2.5e-5);
    with_line(&mut vehicle, 0.5);
    let engine = engine_of(&vehicle);
    let mut fed = Fed::steady(&engine, 20.0);
    fed.settle(20.0, 1e-3, 400);
    // Steady again: nothing is taken up, the line brings what the injector passes.
    let point = fed.point;
    assert!((point.tank_kg_s / point.oxidizer_kg_s - 1.0).abs() < 1e-9, "{point:?}");
    assert!((point.thrust_n / steady(&engine, 20.0).thrust_n - 1.0).abs() < 1e-8, "{point:?}");
}

/// A jump of the valve, into and out of the range where the lag is thirty times shorter than the step.
#[test]
fn steps_across_the_flash_point_settle_on_the_steady_engine() {
    for method in [ImplicitMethod::Sdirk2, ImplicitMethod::BackwardEuler] {
        for length_m in [None, Some(0.5)] {
            let mut vehicle = vehicle();
            with_manifold(&mut vehicle, 2.5e-5);
            if let Some(length_m) = length_m {
                with_line(&mut vehicle, length_m);
            }
            let engine = engine_of(&vehicle);
            for (from, to) in [(20.0, 30.0), (20.0, 78.8), (78.8, 20.0), (30.0, 24.0), (28.0, 40.0)] {
                let mut fed = Fed::steady(&engine, from);
                let (start, end) = (steady(&engine, from).thrust_n, steady(&engine, to).thrust_n);
                let mut beyond = 0.0f64;
                for _ in 0..1000 {
                    fed.step(to, to, 1e-3, method);
                    let thrust_n = fed.point.thrust_n;
                    assert!(thrust_n.is_finite() && fed.point.solved);
                    let share = (thrust_n - start) / (end - start);
                    beyond = beyond.max(share - 1.0);
                }
                let left = (fed.point.thrust_n / end - 1.0).abs();
                println!("{method:?} {length_m:?} {from} -> {to}: beyond {beyond:.1e}, left {left:.1e}");
                // Backward Euler does not overshoot. Two stages: (1 - (1 - 2γ) z)/(1 + γ z)² is at least
                // -0.207. A column that is braked by liquid rings.
                let allowed = match (method, length_m) {
                    (_, Some(_)) => 0.35,
                    (ImplicitMethod::BackwardEuler, None) => 1e-6,
                    (ImplicitMethod::Sdirk2, None) => 0.207,
                };
                assert!(left < 1e-6 && beyond < allowed, "{beyond:e} {left:e}");
            }
        }
    }
}

#[test]
fn a_shut_valve_empties_the_manifold_and_then_nothing_flows() {
    let mut vehicle = vehicle();
    with_manifold(&mut vehicle, 2.5e-5);
    let engine = engine_of(&vehicle);
    let mut fed = Fed::steady(&engine, 22.0);
    let full_kg = fed.state.manifold_kg;
    let mut spent_kg = 0.0;
    let mut before = (f64::INFINITY, f64::INFINITY);
    let mut ended_ms = None;
    for ms in 0..2000 {
        fed.step(0.0, 0.0, 1e-3, ImplicitMethod::Sdirk2);
        let now = (fed.point.injector_inlet_pa, fed.point.thrust_n);
        spent_kg += 1e-3 * fed.point.oxidizer_kg_s;
        // The root in P2 is good to 65 µPa, rest begins at 0.1 Pa.
        assert!(
            now.0 <= before.0 + 0.1 && now.1 <= before.1 && fed.point.oxidizer_kg_s >= 0.0,
            "{ms}: {now:?}"
        );
        before = now;
        if now.1 == 0.0 {
            ended_ms.get_or_insert(ms);
        }
    }
    println!("{full_kg:.5} kg emptied by {ended_ms:?} ms; {:.5} kg stays", fed.state.manifold_kg);
    assert_eq!((fed.point.thrust_n, fed.point.oxidizer_kg_s, fed.point.nozzle_kg_s), (0.0, 0.0, 0.0));
    assert_eq!((fed.point.chamber_pa, fed.point.tank_kg_s), (AMBIENT_PA, 0.0));
    // What stays is gas at ambient pressure.
    let rest = engine.feed_at_rest(&FeedMap::new(65e5, 290.0), AMBIENT_PA).manifold_kg;
    assert!((fed.state.manifold_kg / rest - 1.0).abs() < 2e-6);
    // Flow at the step's end, summed: first order, so a hundredth.
    assert!((spent_kg / (full_kg - rest) - 1.0).abs() < 0.03, "{spent_kg} {full_kg}");
}

/// The flux choked in both parts: constant below the critical pressure, the same above it, and never more.
#[test]
fn choked_flux_does_not_know_the_back_pressure() {
    let mut vehicle = vehicle();
    vehicle.feed.valve.single_phase = hopbench::propulsion::SinglePhase::Choked;
    vehicle.feed.injector.single_phase = hopbench::propulsion::SinglePhase::Choked;
    let engine = engine_of(&vehicle);
    let (open, choked) = (FeedMap::new(65e5, 290.0), engine.feed_map(65e5, 290.0));
    for i in 1..640 {
        let p2 = 1e5 * (0.9 + 0.1 * f64::from(i));
        let (a, b) = (open.inlet(p2), choked.inlet(p2));
        assert!(b.valve_flux_kg_m2_s <= a.valve_flux_kg_m2_s);
        if p2 >= open.valve_critical_pa() {
            assert_eq!(a.valve_flux_kg_m2_s, b.valve_flux_kg_m2_s);
        } else {
            assert_eq!(b.valve_flux_kg_m2_s, choked.inlet(1.1e5).valve_flux_kg_m2_s);
        }
        let mut before = f64::INFINITY;
        for share in 1..40 {
            let pc = p2 * f64::from(share) / 40.0;
            let (f, g) = (open.injector_flux_kg_m2_s(&a, pc), choked.injector_flux_kg_m2_s(&b, pc));
            assert!(g <= f && g <= before, "{p2} {pc}");
            if pc >= b.critical_pa {
                assert_eq!(f, g);
            }
            before = g;
        }
    }
}

/// Snapshots of the first open-loop reference run, every 10 ms.
fn flown(overrides: &[(&str, &str)], step_us: u64) -> Vec<Snapshot> {
    let step_s = format!("{}", 1e-6 * step_us as f64);
    let mut overrides = overrides.to_vec();
    overrides.push(("physics.step_s", &step_s));
    let (mut rows, mut steps) = (Vec::new(), 0);
    fly(&files::scenario("open_loop_a", &overrides), 1, |snapshot| {
        if (steps * step_us).is_multiple_of(10_000) {
            rows.push(*snapshot);
        }
        steps += 1;
    })
    .unwrap();
    rows
}

/// Greatest difference in height (m).
fn apart(a: &[Snapshot], b: &[Snapshot]) -> f64 {
    assert_eq!(a.len(), b.len());
    let differences = a.iter().zip(b).map(|(a, b)| (a.position_ned_m.z - b.position_ned_m.z).abs());
    differences.fold(0.0, f64::max)
}

const DROOP: (&str, &str) = ("vehicle.pressurant.regulator.droop_pa_s_kg", "3.3e6");
const LITTLE_NITROGEN: (&str, &str) = ("initial.nitrogen_kg", "1.2");
const ENERGY: (&str, &str) = (
    "vehicle.feed.tank.ullage",
    "{ model = \"energy_balance\", heat_conductance_w_k = 5.0, vapor_conductance_kg_s_pa = 1e-8, vapor_saturation = 1.0 }",
);
const IMPLICIT: (&str, &str) = ("vehicle.feed.manifold.model", "\"implicit\"");
const HEAD: (&str, &str) =
    ("vehicle.feed.line", "{ length_m = 0.5, area_m2 = 1.267e-4, static_head = true, drop_m = 0.5 }");

/// 1 ms against 0.25 ms over 8 s. Maps rebuilt at 0.1 bar, which this replaced, were 22 mm apart under droop
/// and 0.37 mm in blow-down. Now 7.0e-6 m and 2.7e-7 m; 1.1e-4 m with vapour off a liquid that cools by 0.5
/// K. What is left under droop falls with the square of the step (1.8e-4 m at 5 ms): the regulator's response
/// to the throttle steps. The implicit manifold has 2.4e-4 m with the tank at rest, its own second order
/// after a throttle step (1.1e-2 m at 5 ms), and 1.2e-3 m under droop, where both of its stages see the tank
/// of the later one. A line has 7.8e-4 m (4.7e-3 m at 5 ms): first order, with its head followed within the
/// step as without; its column lags by less than a step. All together 2.1e-3 m. Allowed: about twice what
/// each was found to be.
#[test]
fn whole_flights_converge_while_the_tank_moves() {
    let mut missed = Vec::new();
    for (name, overrides, allowed_m) in [
        ("reference", vec![], 1e-8),
        ("droop", vec![DROOP], 1.5e-5),
        ("blow-down", vec![LITTLE_NITROGEN], 1e-6),
        ("energy balance", vec![ENERGY, DROOP], 2.2e-4),
        ("implicit manifold", vec![IMPLICIT], 4e-4),
        ("implicit manifold, droop", vec![IMPLICIT, DROOP], 2.5e-3),
        ("line with head", vec![HEAD], 1.6e-3),
        ("all", vec![IMPLICIT, HEAD, ENERGY, DROOP, LITTLE_NITROGEN], 4e-3),
    ] {
        let fine = flown(&overrides, 250);
        let [one, five] = [1_000, 5_000].map(|step_us| apart(&flown(&overrides, step_us), &fine));
        let pressures = fine.iter().map(|row| row.tank_pa);
        let (low, high) = pressures.fold((f64::MAX, 0.0f64), |(l, h), pa| (l.min(pa), h.max(pa)));
        let cooled_k = fine[0].liquid_k - fine[fine.len() - 1].liquid_k;
        println!(
            "{name}: {one:.1e} m at 1 ms, {five:.1e} m at 5 ms; tank {:.2}..{:.2} bar, cooled {cooled_k:.2} K",
            1e-5 * low,
            1e-5 * high
        );
        if one > allowed_m || one.is_nan() {
            missed.push(name);
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
}

#[test]
fn maps_between_the_nodes_of_the_grid_are_those_of_the_state_itself() {
    let mut grid = FeedGrid::new(FeedMap::new(65e5, 290.0));
    // A path through pressures and temperatures, up and down, in steps that no node meets.
    let mut worst = [0.0f64; 3];
    for i in 0..240 {
        let t = f64::from(i);
        let (tank_pa, tank_k) = (65e5 - 8.3e3 * t, 290.0 - 0.9 * libm::sin(0.02 * t));
        grid.follow(tank_pa, tank_k);
        if i % 6 != 0 {
            continue;
        }
        let (feed, direct): (Feed<'_>, _) = (grid.at(tank_pa, tank_k), FeedMap::new(tank_pa, tank_k));
        assert!((feed.tank().pressure_pa / tank_pa - 1.0).abs() < 1e-12);
        for share in [0.2, 0.4, 0.6, 0.7, 0.8, 0.95] {
            let p2 = share * tank_pa;
            let (ours, exact) = (feed.inlet(p2), direct.inlet(p2));
            let valve = (ours.valve_flux_kg_m2_s / exact.valve_flux_kg_m2_s - 1.0).abs();
            let kind = usize::from(share > 0.65);
            worst[kind] = worst[kind].max(valve);
            let flux = |feed: Feed<'_>, inlet| feed.injector_flux_kg_m2_s(inlet, 0.4 * p2);
            let injected = flux(feed, &ours) / flux(Feed::from(&direct), &exact);
            worst[2] = worst[2].max((injected - 1.0).abs());
        }
    }
    println!("valve {:.1e}, near boiling and above {:.1e}; injector {:.1e}", worst[0], worst[1], worst[2]);
    // An eighth of the second difference over 0.5 bar and 0.25 K; near the vapour pressure the valve's flux
    // has a root's slope, and that pressure is not where the maps are aligned.
    assert!(worst[0] < 3e-4 && worst[1] < 2e-3 && worst[2] < 1e-4, "{worst:?}");
}

/// The weight of the liquid at the valve drives it as much as pressure in the tank would.
#[test]
fn the_static_head_is_pressure_before_the_valve() {
    let mut vehicle = vehicle();
    with_line(&mut vehicle, 0.0);
    vehicle.feed.line.as_mut().unwrap().static_head = true;
    vehicle.feed.line.as_mut().unwrap().drop_m = 0.3;
    let engine = engine_of(&vehicle);
    let map = FeedMap::new(65e5, 290.0);
    let head_pa = engine.static_head_pa(&map, 0.57, 11.0);
    assert!((head_pa / (map.tank().density_kg_m3 * 11.0 * 0.87) - 1.0).abs() < 1e-12);
    assert_eq!(engine.static_head_pa(&map, 0.57, -11.0), 0.0);
    // Where P2 settles, the flow is the valve's own times the root of (drop + head)/drop, and the injector
    // passes it.
    for degrees in [15.0, 20.0, 26.0] {
        let mut fed = Fed::steady(&engine, degrees);
        fed.head_pa = head_pa;
        fed.settle(degrees, 1e-3, 3);
        let (point, inlet) = (fed.point, map.inlet(fed.point.injector_inlet_pa));
        let gain = 1.0 + head_pa / (65e5 - point.injector_inlet_pa);
        let area_m2 = engine.valve_area().area_m2(degrees.to_radians());
        let flow =
            vehicle.feed.valve.discharge_coefficient * area_m2 * inlet.valve_flux_kg_m2_s * gain.sqrt();
        let more_n = point.thrust_n - steady(&engine, degrees).thrust_n;
        println!("{degrees}: {head_pa:.0} Pa, {more_n:+.4} N; flow {:.1e}", point.oxidizer_kg_s / flow - 1.0);
        assert!((point.oxidizer_kg_s / flow - 1.0).abs() < 1e-8 && more_n > 0.0);
    }
}

/// In flight the head is what the vehicle's liquid weighs: density, axial specific force, level and drop.
#[test]
fn in_flight_the_head_is_the_weight_of_the_column() {
    let file = vehicle();
    let map = FeedMap::new(65e5, 290.0);
    let tank = files::reference().tank;
    let floor_m2 = core::f64::consts::PI * tank.radius_m * tank.radius_m;
    let mut worst = 0.0f64;
    for row in flown(&[HEAD], 1_000).iter().skip(20).step_by(7) {
        let flux = map.inlet(row.injector_inlet_pa).valve_flux_kg_m2_s;
        let ratio = row.oxidizer_kg_s / (file.feed.valve.discharge_coefficient * row.valve_area_m2 * flux);
        let found_pa = (ratio * ratio - 1.0) * (65e5 - row.injector_inlet_pa);
        let axial_m_s2 = -row.specific_force_body_m_s2.z;
        let expected_pa = axial_m_s2 * (row.nitrous_kg / floor_m2 + map.tank().density_kg_m3 * 0.5);
        worst = worst.max((found_pa / expected_pa - 1.0).abs());
    }
    println!("head in flight: {worst:.1e} of it");
    // A step of the plant behind, and a flow that the column follows 0.2 ms late.
    assert!(worst < 1e-2, "{worst}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Random throttles, volumes, lines, chambers and tanks: finite numbers, nothing negative, content in
    /// range.
    #[test]
    fn nothing_is_nan_over_random_throttles(
        angles in prop::collection::vec(prop_oneof![Just(0.0), 0.0..80.0], 12),
        log_volume in -16.1..-2.4,
        line in prop_oneof![Just(None), (0.0..20.0, -13.8..-4.6).prop_map(Some)],
        manifold in any::<bool>(),
        (tank_pa, tank_k) in (2e5..80e5, 240.0..306.0),
        (burning_fraction, ambient_pa) in (0.0..1.0, 3e4..1.2e5),
        (limit, head_pa) in (prop_oneof![Just(f64::INFINITY), 1e-9..0.1], 0.0..2e4),
        fuel in prop_oneof![Just(None), (0.0..0.2).prop_map(Some)],
        (limit_s, choked) in (0.0..1.0, any::<bool>()),
        step_s in prop_oneof![Just(1e-3), 1e-5..0.05],
    ) {
        let mut vehicle = vehicle();
        if manifold {
            with_manifold(&mut vehicle, libm::exp(log_volume));
        } else {
            vehicle.feed.manifold.model = ManifoldModel::QuasiSteady;
        }
        vehicle.feed.manifold.quasi_steady_below_s = limit_s;
        if let Some((length_m, log_area)) = line {
            with_line(&mut vehicle, length_m);
            vehicle.feed.line.as_mut().unwrap().area_m2 = libm::exp(log_area);
        }
        if choked {
            vehicle.feed.injector.single_phase = hopbench::propulsion::SinglePhase::Choked;
        }
        let engine = engine_of(&vehicle);
        if !engine.feed_has_state() {
            return Ok(());
        }
        let mut fed = Fed::at_rest(&engine, engine.feed_map(tank_pa, tank_k));
        fed.head_pa = head_pa;
        fed.condition = EngineCondition {
            burning_fraction,
            ambient_pa,
            oxidizer_flow_limit_kg_s: limit,
            fuel_flow_kg_s: fuel,
            ..condition(35.0, 10.0)
        };
        let mut before = 0.0;
        for angle in angles {
            for _ in 0..20 {
                let area = engine.valve_area().area_m2(f64::to_radians(angle));
                let method = engine.implicit_method(&fed.feed, area, fed.point.injector_inlet_pa, fed.point.chamber_pa);
                fed.step(before, angle, step_s, method);
                before = angle;
                let point = fed.point;
                let numbers = [
                    point.oxidizer_kg_s, point.tank_kg_s, point.fuel_kg_s, point.nozzle_kg_s, point.chamber_pa,
                    point.injector_inlet_pa, point.quality, point.thrust_n, point.steady_fuel_kg_s,
                    fed.state.manifold_kg, fed.state.line_kg_s,
                ];
                prop_assert!(numbers.iter().all(|n| n.is_finite() && *n >= 0.0), "{point:?} {:?}", fed.state);
                prop_assert!(point.solved);
                let most = vehicle.feed.manifold.volume_m3 * fed.feed.tank().density_kg_m3;
                prop_assert!(fed.state.manifold_kg <= most * (1.0 + 1e-6), "{:?} {most}", fed.state);
            }
        }
    }
}
