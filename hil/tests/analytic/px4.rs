//! The PX4 airframe against closed forms, against the tuning that flew on PX4, and against PX4's own rules
//! for parameters.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use hopbench::vehicle::Vehicle;
use hopbench_hil::load;
use hopbench_hil::px4::budget::{self, Hop};
use hopbench_hil::px4::files;
use hopbench_hil::px4::parameters::{Parameter, Value};
use hopbench_hil::px4::tuning::{DIFFERENTIAL_CUTOFF_HZ, RATE_BANDWIDTH_RAD_S, Tuning};
use hopbench_hil::px4::{Airframe, Lander, SwingingEngine, airframe};

const HOP: Hop = Hop { height_m: 10.0, hold_s: 8.0 };
const VEHICLES: [&str; 2] = ["reference", "gt_lander"];

fn vehicle(name: &str, set: &[&str]) -> Vehicle {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../scenarios/vehicles/{name}.toml"));
    let set: Vec<String> = set.iter().map(|&s| s.to_owned()).collect();
    load::vehicle(&path, &set).unwrap()
}

fn made(name: &str, set: &[&str]) -> Airframe {
    airframe(&vehicle(name, set), &HOP).unwrap()
}

fn real(list: &[Parameter], name: &str) -> f64 {
    match list.iter().find(|p| p.name == name).unwrap_or_else(|| panic!("no {name}")).value {
        Value::Real(value) => value,
        Value::Integer(value) => f64::from(value),
    }
}

fn close(value: f64, expected: f64, tolerance: f64) {
    assert!((value - expected).abs() <= tolerance, "{value} against {expected}, tolerance {tolerance}");
}

/// The 70 kg plant with which a stock PX4 flew; its gimbal moved no mass.
fn flown() -> Lander {
    Lander {
        mass_kg: 70.0,
        gravity_m_s2: 9.80665,
        thrust_rated_n: 1000.0,
        thrust_min_n: 300.0,
        thrust_max_n: 1000.0,
        lever_m: 0.9,
        offset_m: [0.0, 0.0],
        inertia_kg_m2: [25.0, 25.0, 2.5],
        gimbal_limit_rad: 8.0_f64.to_radians(),
        gimbal_dead_time_s: 0.005,
        gimbal_servo_rad_s: 50.3,
        gimbal_servo_damping: 0.7,
        swinging: SwingingEngine::default(),
        roll_moment_n_m: 6.0,
    }
}

#[test]
fn the_tuning_that_flew_on_px4_is_given_back() {
    let tuning = Tuning::of(&flown());
    // Its effect was printed as 3.4, two digits, and the gains with one or two: 4 % is half a digit of each.
    close(tuning.unit_effect_rad_s2[0], 3.4, 0.05);
    for axis in [0, 1] {
        close(tuning.rate[axis].p, 2.0, 0.08);
        close(tuning.rate[axis].i, 0.4, 0.02);
        close(tuning.rate[axis].d, 0.06, 0.003);
        close(tuning.rate[axis].integral_limit, 0.15, 1e-12);
    }
    close(tuning.rate[2].p, 1.5, 0.01);
    close(tuning.rate[2].i, 0.1, 0.005);
    assert_eq!(tuning.attitude_p_1_s, [2.4, 2.4, 1.0]);
    assert_eq!(tuning.rate_max_deg_s, [60.0, 60.0, 45.0]);
    assert_eq!(tuning.velocity_xy, [1.0, 0.1, 0.1]);
    assert_eq!(tuning.velocity_z, [2.5, 0.8, 0.0]);
    close(tuning.throttle_hover_min_max[0], 0.687, 0.001);
    close(tuning.throttle_hover_min_max[1], 0.3, 1e-12);
    assert_eq!(tuning.acceleration_up_down_m_s2, [2.0, 1.5]);
    assert_eq!(tuning.gyro_cutoff_hz, 40.0);
    assert_eq!(tuning.swing_zero_rad_s, None);
}

#[test]
fn gains_are_a_bandwidth_over_thrust_times_lever_over_inertia() {
    for name in VEHICLES {
        let made = made(name, &[]);
        let lander = &made.lander;
        let weight_n = lander.mass_kg * 9.80665;
        for axis in [0, 1] {
            let effect =
                weight_n * lander.lever_m * libm::sin(lander.gimbal_limit_rad) / lander.inertia_kg_m2[axis];
            close(made.tuning.rate[axis].p, made.tuning.rate_bandwidth_rad_s / effect, 1e-12);
        }
        close(made.tuning.rate[2].p, 3.6 * lander.inertia_kg_m2[2] / lander.roll_moment_n_m, 1e-12);
        // Parameters are written with four decimals.
        close(real(&made.sitl, "MPC_THR_HOVER"), weight_n / 1000.0, 5.1e-5);
        close(real(&made.sitl, "MC_PITCHRATE_P"), made.tuning.rate[1].p, 5.1e-5);
    }
    // The reference vehicle's page: lift-off, digits as printed there.
    let reference = vehicle("reference", &[]);
    let full = Lander::of(&reference, &budget::full_contents(&reference));
    close(full.mass_kg, 73.40, 0.005);
    close(full.lever_m, 0.4015, 5e-5);
    close(full.inertia_kg_m2[0], 22.294, 1e-3);
    close(full.roll_moment_n_m, 2.0, 1e-9);
}

#[test]
fn an_engine_that_swings_costs_the_differential_part_and_bandwidth() {
    let mut lander = flown();
    let still = Tuning::of(&lander);
    assert_eq!(still.rate_bandwidth_rad_s, RATE_BANDWIDTH_RAD_S);
    assert!(still.gain_margin > 4.0 && still.rate[0].d > 0.0);
    lander.swinging = SwingingEngine { moment_kg_m: 2.8, inertia_kg_m2: 0.76 };
    let swinging = Tuning::of(&lander);
    // T l δ + (J + S l) δ'' is nothing at this frequency.
    let zero = (lander.weight_n() * 0.9 / (0.76 + 2.8 * 0.9)).sqrt();
    close(swinging.swing_zero_rad_s.unwrap(), zero, 1e-9);
    assert!(swinging.gain_margin >= 2.0 && swinging.gyro_cutoff_hz < 40.0);
    // An engine without mass is none.
    lander.swinging = SwingingEngine { moment_kg_m: 1e-9, inertia_kg_m2: 1e-9 };
    assert_eq!(Tuning::of(&lander).rate, still.rate);
    for name in VEHICLES {
        let tuning = made(name, &[]).tuning;
        assert!(tuning.gain_margin >= 2.0, "{name}: {}", tuning.gain_margin);
        assert_eq!(tuning.rate[0].d, 0.0, "{name}");
    }
}

#[test]
fn parameters_are_such_as_px4_takes() {
    for name in VEHICLES {
        let made = made(name, &[]);
        for list in [&made.sitl, &made.hitl] {
            let names: BTreeSet<&str> = list.iter().map(|p| p.name.as_str()).collect();
            assert_eq!(names.len(), list.len(), "a name stands twice");
            for parameter in list {
                assert!(parameter.name.len() <= 16, "{}", parameter.name);
                assert!(
                    parameter.name.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit() || b == b'_')
                );
                assert!(!parameter.why.is_empty() && !parameter.why.contains('\n'));
                if let Value::Real(value) = parameter.value {
                    assert!(value.is_finite(), "{}", parameter.name);
                }
            }
            // The traps: exactly no offset, no row under 0.05, slower by hand than the limit, slowing above
            // landing.
            for axis in ["PX", "PY", "PZ"] {
                assert_eq!(real(list, &format!("CA_ROTOR0_{axis}")).to_bits(), 0);
            }
            for parameter in list.iter().filter(|p| p.name.contains("_TRQ_")) {
                let value = real(list, &parameter.name);
                assert!(value == 0.0 || value.abs() >= 0.1);
            }
            assert!(real(list, "MPC_VEL_MANUAL") <= real(list, "MPC_XY_VEL_MAX"));
            assert!(real(list, "MPC_LAND_ALT1") > real(list, "MPC_LAND_ALT2"));
            assert!(real(list, "MPC_XY_ERR_MAX") > 2.0);
            assert_eq!(real(list, "MPC_YAW_MODE"), 5.0);
        }
        let functions = |list: &[Parameter], prefix: &str| -> Vec<f64> {
            list.iter().filter(|p| p.name.starts_with(prefix)).map(|p| real(list, &p.name)).collect()
        };
        assert_eq!(functions(&made.sitl, "PWM_MAIN_FUNC"), [101.0, 201.0, 202.0, 203.0]);
        assert_eq!(functions(&made.hitl, "HIL_ACT_FUNC"), [101.0, 201.0, 202.0, 203.0]);
        assert!(functions(&made.hitl, "PWM_MAIN_FUNC").is_empty());
        assert_eq!((real(&made.sitl, "EKF2_GPS_DELAY"), real(&made.hitl, "EKF2_GPS_DELAY")), (10.0, 110.0));
        assert_eq!(real(&made.hitl, "SYS_HITL"), 1.0);
        assert!(made.sitl.iter().all(|p| p.name != "SYS_HITL"));
    }
}

#[test]
fn both_kinds_of_file_say_the_same() {
    let made = made("reference", &[]);
    let files = files::files(&made);
    let parsed: Vec<BTreeMap<String, String>> = files
        .iter()
        .map(|file| {
            let lines = file.text.lines().filter(|line| !line.starts_with('#') && !line.is_empty());
            lines
                .filter_map(|line| {
                    if let Some(rest) = line.strip_prefix("param ") {
                        let words: Vec<&str> = rest.split(' ').collect();
                        assert!(words.len() == 3 && words[0].starts_with("set"), "{line}");
                        return Some((words[1].to_owned(), words[2].to_owned()));
                    }
                    if line.starts_with(". ") {
                        return None;
                    }
                    let words: Vec<&str> = line.split('\t').collect();
                    assert!(words.len() == 5 && words[..2] == ["1", "1"], "{line}");
                    // 6 is INT32 and 9 is FLOAT, which is written with its point.
                    assert_eq!(words[4], if words[3].contains('.') { "9" } else { "6" }, "{line}");
                    Some((words[2].to_owned(), words[3].to_owned()))
                })
                .collect()
        })
        .collect();
    assert_eq!(parsed[0], parsed[2]);
    assert_eq!(parsed[1], parsed[3]);
    assert_eq!((parsed[0].len(), parsed[1].len()), (made.sitl.len(), made.hitl.len()));
    assert!(files[1].text.contains("param set SYS_HITL 1"));
}

#[test]
fn outputs_follow_the_vehicles_own_map() {
    let moved = made(
        "reference",
        &[
            "controls.channels.throttle.index=9",
            "controls.channels.gimbal_x.index=2",
            "controls.channels.gimbal_y.index=1",
            "controls.channels.gimbal_y.polarity=-1",
        ],
    );
    for (name, value) in [("PWM_MAIN_FUNC10", 101.0), ("PWM_MAIN_FUNC3", 201.0), ("PWM_MAIN_FUNC2", 202.0)] {
        assert_eq!(real(&moved.sitl, name), value);
    }
    assert_eq!(real(&moved.sitl, "CA_SV_CS1_TRQ_P"), -1.0);

    let two = made(
        "reference",
        &[
            "controls.channels.rcs_roll={ index = 3, range = [0.0, 1.0] }",
            "controls.channels.rcs_roll_negative={ index = 8, range = [0.0, 1.0] }",
        ],
    );
    assert_eq!((real(&two.sitl, "CA_ROTOR_COUNT"), real(&two.sitl, "CA_SV_CS_COUNT")), (3.0, 2.0));
    assert_eq!((real(&two.sitl, "PWM_MAIN_FUNC4"), real(&two.sitl, "PWM_MAIN_FUNC9")), (102.0, 103.0));
    // Moment about z of a rotor at PX that pushes along AY: PX AY CT. A pair of 0.5 takes the whole setpoint.
    for (rotor, moment) in [(1, 0.5), (2, -0.5)] {
        let of = |part: &str| real(&two.sitl, &format!("CA_ROTOR{rotor}_{part}"));
        close(of("PX") * of("AY") * of("CT"), moment, 1e-5);
        assert_eq!(of("AZ"), 0.0);
    }
}

#[test]
fn what_px4_cannot_serve_is_refused_by_name() {
    for (set, key, word) in [
        ("controls.throttle=\"valve\"", "controls.throttle", "thrust"),
        ("controls.channels.gimbal_x.range=[-0.12, 0.12]", "controls.channels.gimbal_x.range", "-1"),
        ("controls.channels.throttle.range=[0.0, 1000.0]", "controls.channels.throttle.range", "1000"),
        ("vehicle.vehicle.thrust_command_max_n=780.0", "vehicle.thrust_command_max_n", "weight"),
        ("vehicle.vehicle.thrust_command_min_n=650.0", "vehicle.thrust_command_min_n", "descend"),
        ("gimbal.limit_rad=0.01", "gimbal.limit_rad", "rad/s²"),
    ] {
        let fault = airframe(&vehicle("reference", &[set]), &HOP).unwrap_err();
        assert_eq!(fault.key, key, "{set}");
        assert!(fault.message.contains(word), "{set}: {}", fault.message);
    }
    let fault = airframe(&vehicle("reference", &[]), &Hop { hold_s: 120.0, ..HOP }).unwrap_err();
    assert!(fault.key == "--hold-s" && fault.message.contains("allowed a hover up to"), "{}", fault.message);
}

/// What PX4 v1.16 documents for the values that are chosen: 3 is land for lost radio control, 4 for lost
/// offboard.
#[test]
fn failsafes_do_what_their_reasons_say() {
    let made = made("reference", &[]);
    for (name, meanings) in [
        ("COM_OBL_RC_ACT", "position altitude stabilized return land hold terminate disarm"),
        ("NAV_RCL_ACT", "- hold return land - terminate disarm"),
        ("NAV_DLL_ACT", "on hold return land - terminate disarm"),
        ("COM_LOW_BAT_ACT", "warn - land return"),
        ("MPC_YAW_MODE", "waypoint home away trajectory first fixed"),
        ("COM_RC_IN_MODE", "radio MAVLink either first off"),
    ] {
        for list in [&made.sitl, &made.hitl] {
            let parameter = list.iter().find(|p| p.name == name).unwrap();
            let Value::Integer(value) = parameter.value else { panic!("{name} is an integer") };
            let meaning = meanings.split(' ').nth(usize::try_from(value).unwrap()).unwrap();
            let mut words = parameter.why.split(|c: char| !c.is_alphabetic());
            assert!(words.any(|word| word == meaning), "{name} {value} is {meaning}, not {}", parameter.why);
        }
    }
    // Bits for mission, hold, offboard, in this order.
    assert_eq!(real(&made.sitl, "COM_RCL_EXCEPT"), 7.0);
    // The filter with which the gain margin is computed.
    assert_eq!(real(&made.sitl, "IMU_DGYRO_CUTOFF"), DIFFERENTIAL_CUTOFF_HZ);
}

#[test]
fn slivers_between_ports_are_no_fuel() {
    let set = ["vehicle.engine.grain.port_count=3", "vehicle.engine.grain.port_radius_m=0.012"];
    let three = vehicle("reference", &set);
    let fault = airframe(&three, &HOP).unwrap_err();
    assert_eq!(fault.key, "--hold-s");
    assert!(
        fault.message.contains("burnt through at a port radius of 0.0294 m in the leg"),
        "{}",
        fault.message
    );

    // A wider grain flies: what burns is the difference of the ports' areas at the start and as they meet.
    let three = vehicle("reference", &[set[0], set[1], "vehicle.engine.grain.outer_radius_m=0.09"]);
    let low = budget::hop_budget(&three, &Hop { height_m: 2.0, hold_s: 0.0 }).unwrap();
    let grain = three.engine.grain();
    let meet_m = 0.5 * grain.outer_radius_m * libm::sin(std::f64::consts::FRAC_PI_3);
    let area_m2 = 3.0 * std::f64::consts::PI * (meet_m * meet_m - 0.012 * 0.012);
    close(low.fuel_kg, grain.fuel_density_kg_m3 * grain.length_m * area_m2, 1e-9);
    assert_eq!(low.burnt_through_in(), None);
    // One port leaves no slivers.
    let one = vehicle("reference", &[]);
    let fresh_kg = one.engine.grain().fuel_kg(one.engine.grain().port_radius_m);
    close(made("reference", &[]).budget.fuel_kg, fresh_kg, 1e-12);
}

#[test]
fn the_pace_is_the_slowest_that_the_propellant_allows() {
    for name in VEHICLES {
        let budget = made(name, &[]).budget;
        assert_eq!([budget.pace.climb_m_s, budget.pace.sink_m_s], [2.0, 1.5], "{name}: as it flew");
        assert!(budget.nitrous_left_fraction > 0.12 && budget.fuel_left_fraction > 0.12);
        let sum = |of: fn(&budget::Leg) -> f64| budget.legs.iter().map(of).sum::<f64>();
        close(
            budget.nitrous_left_fraction,
            1.0 - sum(|leg| leg.nitrous_kg) / budget.nitrous_usable_kg,
            1e-12,
        );
        close(budget.burn_s, sum(|leg| leg.duration_s), 1e-12);
        // Descent: ramps of v/a + a/j; landing: ∫dh/v with v linear in height, then 2 m at 0.6 m/s.
        let of = |name: &str| budget.legs.iter().find(|leg| leg.name == name).unwrap().duration_s;
        close(of("descent"), 6.0 / 1.5 + 1.5 / 1.5 + 1.5 / 1.5, 1e-9);
        close(of("landing"), 2.0 * libm::log(1.5 / 0.6) / 0.9 + 2.0 / 0.6, 1e-9);
    }
    let longest_s = made("reference", &[]).budget.longest_hold_s;
    let long = Hop { hold_s: longest_s + 1.0, ..HOP };
    let faster = airframe(&vehicle("reference", &[]), &long).unwrap().budget;
    assert!(faster.pace.climb_m_s > 2.0);
    assert!(faster.nitrous_left_fraction >= 0.12 && faster.fuel_left_fraction >= 0.12);
}
