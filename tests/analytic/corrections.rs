//! What each correction of the seed paper is worth on the reference vehicle: its printed form beside ours.
//!
//! Every test evaluates the equation as printed, and shows the size and the sign of what was set right
//! (tests/README.md lists the corrections).

// The test prints its figures for the record.
#![allow(clippy::disallowed_macros)]

use crate::fixture::motion;
use core::f64::consts::PI;

use crate::fixture::bare_engine::{AMBIENT_PA, at_flow, condition, engine, engine_of, vehicle};
use hopbench::dynamics::mass::{BottleGeometry, Component, GrainGeometry, MassModel, TankGeometry};
use hopbench::dynamics::slosh::SloshModel;
use hopbench::fluid::Nitrous;
use hopbench::frame::{Vec3, inertia_frd_from_structural, structural_from_frd};
use hopbench::propulsion::{CombustionMap, FeedMap, PairLevels, WarmStart};

const G0: f64 = 9.80665;

fn map() -> CombustionMap {
    CombustionMap::read(include_str!("../../scenarios/vehicles/cea_reference_fit.csv"), 20e5).unwrap()
}

fn near(got: f64, expected: f64, tolerance: f64, what: &str) {
    println!("{what}: {got:.5} (expected {expected} ± {tolerance})");
    assert!((got - expected).abs() <= tolerance, "{what}: {got}, expected {expected} ± {tolerance}");
}

#[test]
fn printed_fuel_flow_lacks_a_power_of_the_number_of_ports() {
    for (ports, ratio) in [(1, 1.0), (3, 1.63), (7, 2.4)] {
        let mut grain = vehicle().engine.grain;
        grain.port_count = ports;
        let (n, r) = (grain.regression_exponent, grain.port_radius_m);
        // Eq 5 as printed.
        let printed = 2.0
            * libm::pow(PI, 1.0 - n)
            * grain.fuel_density_kg_m3
            * grain.length_m
            * grain.regression_coefficient_si
            * libm::pow(r, 1.0 - 2.0 * n);
        // Eq 5's flow under 1 kg/s of oxidiser, whose power is 1.
        let own = grain.regression_rate_m_s(1.0, r) * grain.fuel_per_regression_kg_m(r) / printed;
        assert!((own / libm::pow(f64::from(ports), 1.0 - n) - 1.0).abs() < 1e-13, "{own}");
        near(own, ratio, 0.01, "fuel flow over the printed one");
    }
}

#[test]
fn printed_fuel_left_is_the_fuel_burnt() {
    let grain = vehicle().engine.grain;
    let (start, now) = (grain.port_radius_m, 0.045);
    // Eq 6 as printed, and Eq 7, which puts Eq 4 into it.
    let printed = PI * grain.fuel_density_kg_m3 * grain.length_m * (now * now - start * start);
    assert!((grain.fuel_kg(start) - grain.fuel_kg(now) - printed).abs() < 1e-14);
    let p = 2.0 * grain.regression_exponent + 1.0;
    let flow = 0.35;
    let per_s = grain.regression_coefficient_si * p * libm::pow(flow / PI, grain.regression_exponent);
    let time_s = (libm::pow(now, p) - libm::pow(start, p)) / per_s;
    let eq_4 = libm::pow(per_s * time_s + libm::pow(start, p), 1.0 / p);
    assert!((eq_4 - now).abs() < 1e-15, "Eq 4 inverts");
    let eq_7 = PI * grain.fuel_density_kg_m3 * grain.length_m * (eq_4 * eq_4 - start * start);
    println!("Eq 7: {:.1e} kg", (eq_7 - printed).abs());
    assert!((eq_7 - printed).abs() < 1e-14);
}

/// Sea-level impulse (s) of the paper's Eq 10: a function of O/F alone, at 20 bar.
fn impulse_at_sea_level_s(map: &CombustionMap, of_ratio: f64) -> f64 {
    let mixture = map.mixture(of_ratio);
    let lost_s = AMBIENT_PA * vehicle().engine.nozzle.expansion_ratio * mixture.c_star_m_s(0.0) / (20e5 * G0);
    mixture.vacuum_isp_s(0.0) - lost_s
}

#[test]
fn an_impulse_of_the_mixture_alone_asks_for_the_wrong_flow() {
    let (engine, feed, map) = (engine(), FeedMap::new(65e5, 290.0), map());
    let condition = condition(35.0, 10.0);
    // Our nozzle's expansion of this throat, and both efficiencies, so that pressure is the only difference.
    for (thrust_n, percent) in [(250.0, -18.0), (1100.0, 2.5)] {
        let ours = engine.inverse(&feed, thrust_n, &condition, WarmStart::default()).point.oxidizer_kg_s;
        let (mut low, mut high) = (0.01, 0.7);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            let point = at_flow(&engine, &feed, middle, &condition);
            let total = point.oxidizer_kg_s + point.fuel_kg_s;
            let paper_n = 0.93 * 0.96 * G0 * impulse_at_sea_level_s(&map, point.of_ratio) * total;
            if paper_n < thrust_n { low = middle } else { high = middle }
        }
        near(100.0 * (low / ours - 1.0), percent, 1.0, &format!("flow of {thrust_n} N, per cent off"));
    }
}

#[test]
fn gravity_and_efficiency_missing_from_the_printed_thrust() {
    let (engine, feed, map) = (engine(), FeedMap::new(65e5, 290.0), map());
    let point = at_flow(&engine, &feed, 0.35, &condition(35.0, 10.0));
    let mixture = map.mixture(point.of_ratio);
    let log = map.log_pressure(point.chamber_pa);
    let total = point.oxidizer_kg_s + point.fuel_kg_s;
    let exit_m2 = PI * 0.0098 * 0.0098 * 3.0;
    let momentum = point.thrust_n + AMBIENT_PA * exit_m2;
    // Eq 10 with the impulse in seconds lacks g0; with g0 it lacks both efficiencies.
    near(momentum / (mixture.vacuum_isp_s(log) * total) / (0.93 * 0.96), G0, 1e-9, "g0");
    // The same flow through an engine without losses in the chamber gives the impulse without that factor,
    // and its pressure with it: one efficiency in both.
    let mut ideal = vehicle();
    ideal.engine.chamber.c_star_efficiency = 1.0;
    let ideal = at_flow(&engine_of(&ideal), &feed, 0.35, &condition(35.0, 10.0));
    let ideal_log = map.log_pressure(ideal.chamber_pa);
    let same_impulse = mixture.vacuum_isp_s(log) / mixture.vacuum_isp_s(ideal_log);
    let missing = 1.0 - momentum / (ideal.thrust_n + AMBIENT_PA * exit_m2) / same_impulse;
    near(100.0 * missing, 7.0, 1e-9, "efficiency of C* missing, per cent");
    let same_c_star = mixture.c_star_m_s(log) / mixture.c_star_m_s(ideal_log);
    near(
        100.0 * (1.0 - point.chamber_pa / ideal.chamber_pa / same_c_star),
        7.0,
        1e-9,
        "the same in pressure",
    );
    near(100.0 * (1.0 - momentum / (G0 * mixture.vacuum_isp_s(log) * total)), 11.0, 0.3, "both, per cent");
    // Eq 11 holds with the same efficiency.
    let throat_m2 = PI * 0.010 * 0.010;
    let eq_11 = total * mixture.c_star_m_s(log) * 0.93 / (throat_m2 * 0.98);
    assert!((point.chamber_pa / eq_11 - 1.0).abs() < 1e-12);
}

#[test]
fn a_sweep_of_flows_misses_the_thrust_by_half_its_grid() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    let condition = condition(35.0, 10.0);
    let thrust = |flow: f64| at_flow(&engine, &feed, flow, &condition).thrust_n;
    let worst = |grid: f64| {
        let nodes = ((0.560 - 0.001) / grid).round() as u32;
        let misses = (0..nodes).map(|i| {
            let from = 0.001 + grid * f64::from(i);
            0.5 * (thrust(from + grid) - thrust(from))
        });
        misses.fold(0.0, f64::max)
    };
    // The figures are an upper bound to two digits.
    near(worst(0.001), 1.3, 0.1, "1 g/s grid, N");
    near(worst(0.010), 13.0, 1.0, "10 g/s grid, N");
    for thrust_n in [310.0, 547.3, 900.0] {
        let found = engine.inverse(&feed, thrust_n, &condition, WarmStart::default()).point.thrust_n;
        assert!((found - thrust_n).abs() < 1e-6, "a bracketed root misses by {}", found - thrust_n);
    }
}

#[test]
fn along_an_isenthalp_the_equilibrium_flux_is_zero() {
    let feed = FeedMap::new(65e5, 290.0);
    let n2o = Nitrous::tables();
    for inlet_pa in [15e5, 25e5, 40e5] {
        let inlet = feed.inlet(inlet_pa);
        let line = n2o.saturation(0.5 * inlet_pa);
        // h2 = h3: nothing is left to accelerate.
        let quality = line.quality_of_enthalpy(inlet.state.enthalpy_j_kg);
        let drop = inlet.state.enthalpy_j_kg - line.enthalpy_j_kg(quality);
        assert!(drop.abs() < 1e-6, "{drop}");
        let isentropic = n2o.equilibrium_flux_kg_m2_s(&inlet.state, 0.5 * inlet_pa);
        let single = (2.0 * inlet.state.density_kg_m3 * 0.5 * inlet_pa).sqrt();
        let weighed = feed.injector_flux_kg_m2_s(&inlet, 0.5 * inlet_pa);
        // At saturation kappa is 1: the printed form would be half of the single-phase flux.
        assert!(weighed > 0.5 * single + 0.4 * isentropic, "{weighed} {single} {isentropic}");
    }
}

#[test]
fn a_back_pressure_below_the_critical_one_changes_nothing() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    let n2o = Nitrous::tables();
    let condition = condition(35.0, 10.0);
    for (thrust_n, higher_bar) in [(300.0, 1.0), (1000.0, 3.0)] {
        let point = engine.inverse(&feed, thrust_n, &condition, WarmStart::default()).point;
        let inlet = feed.inlet(point.injector_inlet_pa);
        assert!(point.chamber_pa < inlet.critical_pa, "the injector is choked");
        let unchoked = |inlet_pa: f64| {
            let inlet = feed.inlet(inlet_pa);
            let drop = inlet_pa - point.chamber_pa;
            let weight = 1.0 / (1.0 + (drop / (inlet.state.vapor_pressure_pa - point.chamber_pa)).sqrt());
            let single = (2.0 * inlet.state.density_kg_m3 * drop).sqrt();
            let equilibrium = n2o.equilibrium_flux_kg_m2_s(&inlet.state, point.chamber_pa);
            assert!(equilibrium < inlet.critical_flux_kg_m2_s, "falls again below the critical pressure");
            (1.0 - weight) * single + weight * equilibrium
        };
        let wanted = feed.injector_flux_kg_m2_s(&inlet, point.chamber_pa);
        let (mut low, mut high) = (point.injector_inlet_pa, point.injector_inlet_pa + 8e5);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if unchoked(middle) < wanted { low = middle } else { high = middle }
        }
        let difference_bar = (low - point.injector_inlet_pa) * 1e-5;
        near(
            difference_bar,
            higher_bar,
            if thrust_n < 500.0 { 0.1 } else { 1.0 },
            "P2 without choking, bar higher",
        );
    }
    // Whatever the inlet, more back pressure never gives more flow.
    for i in 1..60 {
        let inlet = feed.inlet(65e5 * f64::from(i) / 60.0);
        let mut before = f64::INFINITY;
        for j in 0..200 {
            let flux = feed.injector_flux_kg_m2_s(&inlet, inlet.state.pressure_pa * f64::from(j) / 200.0);
            assert!(flux <= before * (1.0 + 1e-9), "P2 {} Pc share {j}/200", inlet.state.pressure_pa);
            before = flux;
        }
    }
}

#[test]
fn a_valve_taken_as_incompressible_is_too_small() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    for (thrust_n, percent) in [(300.0, 13.0), (700.0, 5.0)] {
        let point = engine.inverse(&feed, thrust_n, &condition(35.0, 10.0), WarmStart::default()).point;
        let incompressible =
            (2.0 * feed.tank().density_kg_m3 * (feed.tank().pressure_pa - point.injector_inlet_pa)).sqrt();
        let own = feed.inlet(point.injector_inlet_pa).valve_flux_kg_m2_s;
        near(
            100.0 * (1.0 - own / incompressible),
            percent,
            0.6,
            &format!("area at {thrust_n} N, per cent too small"),
        );
    }
}

#[test]
fn thruster_pairs_use_twice_their_flow() {
    let rcs = vehicle().rcs;
    let loads = rcs.loads(&PairLevels { a: 1.0, b: 0.0 }, 200e5);
    // Eq 12.
    let error = (loads.nitrogen_kg_s - 2.0 * 5.0 / (65.0 * G0)).abs();
    println!("Eq 12: {error:.1e} kg/s");
    assert!(error < 1e-15, "{error:e}");
}

#[test]
fn slosh_feels_thrust_not_gravity() {
    let reference = motion::reference_vehicle();
    let mode = |g: f64| motion::full_mode(&reference, g);
    let share = |g: f64| (mode(g).stiffness_1_s2 / mode(G0).stiffness_1_s2).sqrt();
    // T/W of 1.39 at full thrust: omega 18 % higher; of 0.8: 11 % lower; none in free fall.
    near(share(1.39 * G0), libm::sqrt(1.39), 1e-14, "omega at T/W 1.39");
    near(share(0.8 * G0), libm::sqrt(0.8), 1e-14, "omega at T/W 0.8");
    assert_eq!(mode(0.0).stiffness_1_s2, 0.0);
}

#[test]
fn a_constant_share_of_the_liquid_is_not_what_sloshes() {
    let mut reference = motion::reference_vehicle();
    let tank = TankGeometry { ..*reference.model.tank() };
    let density = motion::FULL.nitrous_density_kg_m3;
    let mut slosh = |model: SloshModel, kg: f64| {
        reference.slosh.model = model;
        reference.slosh.modes(&tank, kg, density, G0)[0].unwrap()
    };
    let (two_way, paper) = (SloshModel::TwoWay, SloshModel::OneWayPaper);
    near(slosh(paper, 13.4717).mass_kg, 1.00, 0.015, "paper's mass, full, kg");
    near(slosh(two_way, 13.4717).mass_kg, 1.02, 0.005, "mode's mass, full, kg");
    near(slosh(two_way, 2.0).mass_kg / slosh(paper, 2.0).mass_kg, 6.3, 0.1, "ratio at 2 kg");
    // Eq 18 as printed: standard gravity whatever the vehicle feels.
    assert!((slosh(paper, 5.0).stiffness_1_s2 / slosh(two_way, 5.0).stiffness_1_s2 - 1.0).abs() < 1e-14);
}

#[test]
fn explicit_euler_feeds_the_oscillator() {
    let mut reference = motion::reference_vehicle();
    reference.slosh.hardening = 0.0;
    let mode = motion::full_mode(&reference, G0);
    let omega = mode.stiffness_1_s2.sqrt();
    let growth = |dt_s: f64| {
        let (mut s, mut v) = (1e-6, 0.0);
        let steps = 4000;
        for _ in 0..steps {
            let a = -mode.stiffness_1_s2 * s - mode.damping_rate_1_s * v;
            (s, v) = (s + v * dt_s, v + a * dt_s);
        }
        let amplitude = libm::sqrt(s * s + v * v / mode.stiffness_1_s2);
        libm::pow(amplitude / 1e-6, 1.0 / f64::from(steps))
    };
    near(omega, 13.8, 0.05, "omega, rad/s");
    // |1 + dt lambda|² = 1 - 2 zeta omega dt + (omega dt)².
    let expected = libm::sqrt(1.0 - mode.damping_rate_1_s * 0.02 + mode.stiffness_1_s2 * 4e-4);
    near(growth(0.02), expected, 1e-4, "growth of a step of 20 ms");
    near(100.0 * (growth(0.02) - 1.0), 2.9, 0.1, "per cent a step");
    // Stable below 2 zeta/omega, 4.4 ms, and only there.
    let limit_s = mode.damping_rate_1_s / mode.stiffness_1_s2;
    near(1e3 * limit_s, 4.4, 0.06, "limit, ms");
    assert!(growth(0.98 * limit_s) < 1.0 && growth(1.02 * limit_s) > 1.0);
}

/// Eqs 21 and 22: a bar in slices is the bar.
#[test]
fn slices_of_a_bar_have_its_mass_centre_and_inertia() {
    let (length, width, height, mass) = (0.9, 0.08, 0.05, 12.0);
    let count = 9;
    // The bar lies along a skew line, so that products of inertia occur.
    let turn = *nalgebra::Rotation3::from_euler_angles(0.3, 0.5, -0.8).matrix();
    let centre = Vec3::new(0.2, -0.1, 0.4);
    let box_of = |length: f64, mass: f64| {
        let own = Vec3::new(
            width * width + height * height,
            length * length + height * height,
            length * length + width * width,
        );
        turn * nalgebra::Matrix3::from_diagonal(&(own * (mass / 12.0))) * turn.transpose()
    };
    let part = |centre: Vec3, length: f64, mass: f64| Component {
        name: String::new(),
        mass_kg: mass,
        position_m: structural_from_frd(centre).into(),
        inertia_kg_m2: inertia_frd_from_structural(box_of(length, mass)).into(),
        swings: false,
    };
    let n = f64::from(count);
    let slices: Vec<Component> = (0..count)
        .map(|i| {
            let along = length * ((f64::from(i) + 0.5) / n - 0.5);
            part(centre + turn * Vec3::new(along, 0.0, 0.0), length / n, mass / n)
        })
        .collect();
    let model = |parts: &[Component]| {
        let tank = TankGeometry { radius_m: 0.1, length_m: 0.5, floor_z_m: 0.2 };
        let bottle = BottleGeometry { radius_m: 0.09, volume_m3: 9e-3, centre_z_m: 1.0 };
        let grain = GrainGeometry {
            port_count: 1,
            port_circle_radius_m: 0.0,
            outer_radius_m: 0.068,
            length_m: 0.25,
            top_z_m: -0.055,
            fuel_density_kg_m3: 940.0,
        };
        *MassModel::new(parts, tank, bottle, grain, 1.0).dry()
    };
    let (whole, sliced) = (model(&[part(centre, length, mass)]), model(&slices));
    assert!((sliced.mass_kg - mass).abs() < 1e-14);
    assert!((sliced.centre_of_mass_body_m() - centre).norm() < 1e-15, "Eq 21");
    assert!((sliced.inertia_kg_m2 - whole.inertia_kg_m2).abs().max() < 1e-14, "Eq 22");
    // About its own centre, what Euler's equation needs: far from the tensor about the origin.
    assert!((sliced.inertia_about_com_kg_m2() - box_of(length, mass)).abs().max() < 1e-14);
    assert!((whole.inertia_kg_m2 - box_of(length, mass)).abs().max() > 2.0);
}
