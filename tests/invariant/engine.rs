//! What must hold for the engine whatever its numbers: inverse undoes forward, more valve is more thrust,
//! nothing jumps, nothing is NaN, off is off, the filling chamber settles on the steady one.

// The tests print their figures for the record.
#![allow(clippy::disallowed_macros)]

use crate::fixture::bare_engine;
use crate::fixture::bare_engine::{
    AMBIENT_PA, at_angle, at_flow, condition, engine, filling_engine, vehicle,
};
use hopbench::propulsion::{ChamberGas, EngineCondition, FeedMap, NozzleFlow, WarmStart};
use proptest::prelude::*;

#[test]
fn forward_of_inverse_is_the_demand_over_the_envelope() {
    let engine = engine();
    let mut worst = 0.0f64;
    for tank_k in [283.0, 286.5, 290.0, 293.0, 298.0] {
        let feed = FeedMap::new(65e5, tank_k);
        for (port, throat) in [(25.0, 9.8), (35.0, 10.0), (45.0, 10.15), (60.0, 10.3)] {
            let condition = condition(port, throat);
            let mut guess = WarmStart::default();
            for i in 0..=150 {
                let thrust = 300.0 + 5.0 * f64::from(i);
                let inverse = engine.inverse(&feed, thrust, &condition, guess);
                guess = inverse.point.warm_start;
                assert!(!inverse.saturated, "{tank_k} K, {port} mm, {thrust} N: {inverse:?}");
                let area = engine.valve_area().area_m2(inverse.valve_rad);
                let cold = engine.operating_point(&feed, area, &condition, WarmStart::default());
                worst = worst.max((cold.thrust_n - thrust).abs());
                // Another guess, the same answer.
                assert!((cold.thrust_n - inverse.point.thrust_n).abs() < 1e-4);
            }
        }
    }
    println!("forward of inverse: {worst:.1e} N");
    // Flow to 1e-9 kg/s is 2.5e-6 N, P2 to 6.5 mPa less; the angle's inverse is exact.
    assert!(worst < 1e-4, "{worst} N");
}

#[test]
fn a_demand_beyond_the_limits_is_clamped_and_flagged() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    let (condition, open_rad) = (condition(25.0, 9.8), engine.valve_area().fully_open().0);
    let most = engine.inverse(&feed, 5000.0, &condition, WarmStart::default());
    assert!(most.saturated && (most.point.oxidizer_kg_s - 0.560).abs() < 1e-6, "{most:?}");
    let least = engine.inverse(&feed, 0.0, &condition, WarmStart::default());
    assert!(least.saturated && (least.point.oxidizer_kg_s - 0.001).abs() < 1e-6, "{least:?}");
    // Half the tank's pressure: the valve is the limit.
    let weak = engine.inverse(&FeedMap::new(30e5, 290.0), 1300.0, &condition, WarmStart::default());
    assert!(weak.saturated && weak.valve_rad == open_rad, "{weak:?}");
}

#[test]
fn thrust_rises_strictly_with_the_valve_and_never_jumps() {
    let engine = engine();
    for tank_k in [283.0, 290.0, 298.0] {
        let feed = FeedMap::new(65e5, tank_k);
        for (port, throat) in [(25.0, 9.8), (35.0, 10.0), (60.0, 10.3)] {
            let condition = condition(port, throat);
            let mut before = 0.0;
            let step = 0.01;
            for i in 1..=7884 {
                let degrees = step * f64::from(i);
                let point = at_angle(&engine, &feed, degrees, &condition);
                let rise = point.thrust_n - before;
                assert!(point.solved && rise > 0.0, "{tank_k} K, {port} mm, {degrees} deg: {rise}");
                // 45 N/deg at most but where the flow stops flashing (kink, not jump): 0.01 deg is under 1 N.
                assert!(rise < 1.0, "{tank_k} K, {port} mm, {degrees} deg: {rise}");
                before = point.thrust_n;
            }
        }
    }
}

#[test]
fn off_is_off() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    for burning_fraction in [0.0, 0.4, 1.0] {
        let condition = EngineCondition { burning_fraction, ..condition(35.0, 10.0) };
        let point = at_angle(&engine, &feed, 0.0, &condition);
        assert_eq!(
            (point.thrust_n, point.chamber_pa, point.injector_inlet_pa),
            (0.0, AMBIENT_PA, AMBIENT_PA)
        );
        assert_eq!((point.oxidizer_kg_s, point.fuel_kg_s, point.nozzle_kg_s), (0.0, 0.0, 0.0));
        assert_eq!(point.nozzle_flow, NozzleFlow::Off);
    }
}

#[test]
fn unlit_flow_gives_the_cold_thrust_and_burning_joins_both_ends() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    let at = |burning_fraction: f64| {
        let condition = EngineCondition { burning_fraction, ..condition(35.0, 10.0) };
        at_angle(&engine, &feed, 18.0, &condition)
    };
    let cold = at(0.0);
    assert!((cold.thrust_n - 9.80665 * 40.0 * cold.oxidizer_kg_s).abs() < 1e-12);
    let throat_m2 = core::f64::consts::PI * 1e-4;
    assert!((cold.chamber_pa - 420.0 * cold.oxidizer_kg_s / (throat_m2 * 0.98)).abs() < 1e-6);
    assert_eq!(cold.fuel_kg_s, 0.0);
    let mut before = cold;
    for i in 1..=100 {
        let now = at(0.01 * f64::from(i));
        assert!(now.thrust_n > before.thrust_n && now.fuel_kg_s > before.fuel_kg_s, "{i}");
        assert!(now.thrust_n - before.thrust_n < 6.0, "{i}");
        before = now;
    }
}

/// The table over P2 against direct evaluation, off the nodes, and across every regime of the tank.
#[test]
fn the_feed_map_interpolates_to_a_millionth() {
    let mut worst = 0.0f64;
    for (tank_pa, tank_k) in [
        (65e5, 290.0),
        (65e5, 283.0),
        (65e5, 298.0),
        (55e5, 290.0),
        (48e5, 290.0),
        (40e5, 290.0),
        (12e5, 290.0),
    ] {
        let feed = FeedMap::new(tank_pa, tank_k);
        let tank_pa = feed.tank().pressure_pa;
        for i in 1..2000 {
            let inlet_pa = 1.02e5 * libm::pow(tank_pa / 1.02e5, (f64::from(i) - 0.382) / 2000.0);
            let (table, direct) = (feed.inlet(inlet_pa), feed.inlet_directly(inlet_pa));
            let mut see = |a: f64, b: f64, what: &str| {
                let error = (a / b - 1.0).abs();
                worst = worst.max(error);
                assert!(error < 1e-6, "{tank_pa} Pa {tank_k} K, P2 {inlet_pa}: {what} {a} for {b}");
            };
            see(table.state.density_kg_m3, direct.state.density_kg_m3, "density");
            see(table.state.entropy_j_kg_k, direct.state.entropy_j_kg_k, "entropy");
            see(table.state.vapor_pressure_pa, direct.state.vapor_pressure_pa, "vapour pressure");
            see(1.0 + table.quality, 1.0 + direct.quality, "quality");
            see(table.valve_flux_kg_m2_s, direct.valve_flux_kg_m2_s, "valve flux");
            for share in [0.3, 0.6, 0.9, 0.99] {
                let chamber_pa = (share * inlet_pa).max(1.0e5);
                let (a, b) = (
                    feed.injector_flux_kg_m2_s(&table, chamber_pa),
                    feed.injector_flux_kg_m2_s(&direct, chamber_pa),
                );
                if b > 1.0 {
                    see(a, b, "injector flux");
                }
            }
        }
    }
    // Found 2.4e-7, at the low end of the flashing side.
    assert!(worst < 5e-7, "{worst}");
}

#[test]
fn a_rebuilt_map_is_a_new_one() {
    let mut feed = FeedMap::new(40e5, 300.0);
    feed.rebuild(65e5, 290.0);
    let fresh = FeedMap::new(65e5, 290.0);
    for i in 1..65 {
        let (a, b) = (feed.inlet(1e5 * f64::from(i)), fresh.inlet(1e5 * f64::from(i)));
        assert_eq!(a.valve_flux_kg_m2_s, b.valve_flux_kg_m2_s);
        assert_eq!(a.critical_flux_kg_m2_s, b.critical_flux_kg_m2_s);
    }
}

#[test]
fn the_filling_chamber_settles_on_the_steady_engine() {
    let (engine, feed) = (filling_engine(), FeedMap::new(65e5, 290.0));
    for degrees in [6.0, 15.0, 22.0, 28.0] {
        let steady_condition = condition(35.0, 10.0);
        let area_m2 = engine.valve_area().area_m2(f64::to_radians(degrees));
        let steady = engine.operating_point(&feed, area_m2, &steady_condition, WarmStart::default());
        let mut gas = engine.gas_at_rest(&steady_condition);
        let mut guess = WarmStart::default();
        let dt_s = 1e-4;
        let mut last = steady;
        for _ in 0..20_000 {
            let condition = EngineCondition { chamber_gas: Some(gas), ..steady_condition };
            last = engine.operating_point(&feed, area_m2, &condition, guess);
            guess = last.warm_start;
            gas = ChamberGas {
                oxidizer_kg: gas.oxidizer_kg + dt_s * last.chamber_gas_rate.oxidizer_kg_s,
                fuel_kg: gas.fuel_kg + dt_s * last.chamber_gas_rate.fuel_kg_s,
            };
        }
        // The filling model takes pressure from the map's T_c and molar mass, outflow from its c*; it settles
        // where inflow is outflow, so the steady law must hold exactly, whatever T_c.
        assert!((last.nozzle_kg_s / steady.nozzle_kg_s - 1.0).abs() < 1e-6, "{degrees}: {last:?}");
        assert!((last.chamber_pa / steady.chamber_pa - 1.0).abs() < 1e-6, "{degrees}: {last:?} {steady:?}");
        assert!((last.thrust_n / steady.thrust_n - 1.0).abs() < 1e-5, "{degrees}: {last:?} {steady:?}");
    }
}

#[test]
fn thrust_and_pressure_rise_strictly_with_the_flow_from_zero() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    for (port, throat) in [(25.0, 9.8), (35.0, 10.0), (60.0, 10.3)] {
        let (mut thrust, mut chamber) = (0.0, AMBIENT_PA);
        for i in 1..=2500 {
            let point = at_flow(&engine, &feed, 2e-4 * f64::from(i), &condition(port, throat));
            assert!(point.thrust_n > thrust && point.chamber_pa > chamber, "{port} mm {i}");
            // 3 N per g/s at most, so 0.6 N per 0.2 g/s: no jump where the nozzle changes its state.
            assert!(point.thrust_n - thrust < 0.65, "{port} mm {i}");
            (thrust, chamber) = (point.thrust_n, point.chamber_pa);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, failure_persistence: None, ..ProptestConfig::default() })]

    /// Random conditions and parameters inside the schema's ranges: finite numbers, no negative thrust.
    #[test]
    fn nothing_is_nan(
        (tank_pa, tank_k) in (2e5..80e5, 240.0..306.0),
        (port_share, throat_share) in (0.02..1.2, 0.5..2.5),
        degrees in -1.0..90.0,
        (burning_fraction, ambient_pa) in (0.0..1.0, 3e4..1.2e5),
        limit in prop_oneof![Just(f64::INFINITY), Just(0.0), 1e-9..0.1],
        (oxidizer_g, fuel_g) in (0.0..100.0, 0.0..50.0),
        filling in any::<bool>(),
        (exponent, log_coefficient, ports) in (0.1..0.95, -16.0..-5.0, 1u32..50),
        (throat_mm, expansion, holes, hole_mm) in (1.0..200.0, 1.05..50.0, 1u32..1000, 0.1..10.0),
        thrust_n in -100.0..20_000.0,
    ) {
        let mut vehicle = vehicle();
        vehicle.engine.grain.regression_exponent = exponent;
        vehicle.engine.grain.regression_coefficient_si = libm::exp(log_coefficient).clamp(1e-7, 1e-2);
        vehicle.engine.grain.port_count = ports;
        vehicle.engine.grain.port_radius_m = 0.001;
        vehicle.engine.nozzle.throat_diameter_m = throat_mm * 1e-3;
        vehicle.engine.nozzle.expansion_ratio = expansion;
        vehicle.feed.injector.hole_count = holes;
        vehicle.feed.injector.hole_diameter_m = hole_mm * 1e-3;
        let engine = bare_engine::engine_of(&vehicle);
        let feed = FeedMap::new(tank_pa, tank_k);
        let gas = ChamberGas { oxidizer_kg: oxidizer_g * 1e-3, fuel_kg: fuel_g * 1e-3 };
        let condition = EngineCondition {
            port_radius_m: port_share * 0.068,
            throat_radius_m: throat_share * 0.5e-3 * throat_mm,
            burning_fraction,
            ambient_pa,
            chamber_gas: filling.then_some(gas),
            fuel_flow_kg_s: None,
            oxidizer_flow_limit_kg_s: limit,
            outlet: None,
            damage: hopbench::propulsion::Damage::NONE,
        };
        let area_m2 = engine.valve_area().area_m2(f64::to_radians(degrees));
        let inverse = engine.inverse(&feed, thrust_n, &condition, WarmStart::default());
        for point in [engine.operating_point(&feed, area_m2, &condition, WarmStart::default()), inverse.point] {
            let numbers = [
                point.oxidizer_kg_s, point.fuel_kg_s, point.nozzle_kg_s, point.of_ratio, point.chamber_pa,
                point.injector_inlet_pa, point.quality, point.thrust_n, point.isp_s, point.regression_rate_m_s,
                point.throat_erosion_m_s, point.chamber_gas_rate.oxidizer_kg_s, point.chamber_gas_rate.fuel_kg_s,
            ];
            prop_assert!(numbers.iter().all(|n| n.is_finite()), "{point:?}");
            prop_assert!(point.solved && point.thrust_n >= 0.0 && point.oxidizer_kg_s >= 0.0, "{point:?}");
            prop_assert!((0.0..=1.0).contains(&point.quality), "{point:?}");
        }
        prop_assert!(inverse.valve_rad.is_finite());
    }
}
