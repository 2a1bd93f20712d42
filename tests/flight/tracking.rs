//! Predictive tracking and optimal guidance in flight: free of offset, down their ladders, and handed over
//! without a bump.

#![allow(clippy::disallowed_macros)] // figures of a run are printed for the record

use crate::fixture::autopilot_plant::{Conditions, Plant, Touchdown, parameters};
use crate::fixture::files;
use hopbench::autopilot::abort::AbortReason;
use hopbench::autopilot::planning::Answer;
use hopbench::autopilot::tracking::Rung;
use hopbench::autopilot::{Autopilot, ControlLaw, Mission, Parameters, Phase, lcvx};
use hopbench::frame::Vec3;
use hopbench::signal::{ActuatorCommand, Throttle};
use hopbench::simulation::{Flight, Source, data_sheet};
use std::collections::VecDeque;

/// How long an order takes.
#[derive(Clone, Copy)]
enum Delivery {
    AtOnce,
    After(f64),
    Never,
}

struct Flown {
    touchdown: Touchdown,
    tracked: [u64; 6],
    planned: [u64; 7],
    late: u64,
    abort: Option<AbortReason>,
    commands: Vec<[u64; 4]>,
}

impl Flown {
    fn tracked(&self, rung: Rung) -> u64 {
        self.tracked[rung as usize]
    }

    fn planned(&self, rung: lcvx::Rung) -> u64 {
        self.planned[rung as usize]
    }

    /// The limits of the landing gear.
    fn has_landed(&self) -> bool {
        let t = &self.touchdown;
        t.vertical_speed_m_s <= 1.0 && t.lateral_speed_m_s <= 0.5 && t.tilt_rad <= 5f64.to_radians()
    }
}

fn hop_5m() -> Mission {
    Mission {
        hover_height_m: 5.0,
        ascent_speed_m_s: 2.0,
        descent_speed_m_s: 1.5,
        hover_time_s: 3.0,
        ..Mission::default()
    }
}

fn fly(
    mission: Mission,
    conditions: Conditions,
    delivery: Delivery,
    change: impl FnOnce(&mut Parameters),
) -> Flown {
    let mut told = parameters(mission, conditions.rtk);
    change(&mut told);
    let mut autopilot = Autopilot::new(told);
    let mut plant = Plant::new(conditions);
    let mut command = ActuatorCommand::SAFE;
    let mut under_way: VecDeque<(f64, Answer)> = VecDeque::new();
    let mut commands = Vec::new();
    while plant.time_s() < 90.0 && autopilot.phase() != Phase::Done {
        let m = plant.advance(&command);
        while under_way.front().is_some_and(|(due_s, _)| plant.time_s() >= due_s - 1e-9) {
            let (_, answer) = under_way.pop_front().expect("just seen");
            autopilot.deliver(answer);
        }
        let phase = autopilot.phase();
        let next = autopilot.update(&m);
        let both = phase.is_flight() && autopilot.phase().is_flight();
        within_limits(&next, both.then_some(&command));
        commands.push(bits(&next));
        command = next;
        if let Some(order) = autopilot.take_order() {
            match delivery {
                Delivery::AtOnce => autopilot.deliver(order.solve()),
                Delivery::After(delay_s) => under_way.push_back((plant.time_s() + delay_s, order.solve())),
                Delivery::Never => {}
            }
        }
    }
    Flown {
        touchdown: plant.touchdown.expect("a touchdown"),
        tracked: autopilot.tracker().counts(),
        planned: autopilot.planning().counts(),
        late: autopilot.planning().late(),
        abort: autopilot.abort().map(|abort| abort.reason),
        commands,
    }
}

fn bits(c: &ActuatorCommand) -> [u64; 4] {
    let (Throttle::ThrustN(throttle) | Throttle::ValveRad(throttle)) = c.throttle;
    [throttle, c.gimbal_x_rad, c.gimbal_y_rad, c.rcs_roll].map(f64::to_bits)
}

/// Finite and inside limits; against the command before, inside the gimbal's rate.
fn within_limits(c: &ActuatorCommand, before: Option<&ActuatorCommand>) {
    let limit = 7f64.to_radians();
    assert!(c.gimbal_x_rad.abs() <= limit && c.gimbal_y_rad.abs() <= limit, "{c:?}");
    assert!(c.rcs_roll.abs() <= 1.0, "{c:?}");
    match c.throttle {
        Throttle::ThrustN(thrust_n) => {
            assert!(thrust_n == 0.0 || (300.0..=1050.0).contains(&thrust_n), "{c:?}");
        }
        Throttle::ValveRad(_) => assert!(*c == ActuatorCommand::SAFE, "{c:?}"),
    }
    if let Some(b) = before {
        let step = 90f64.to_radians() * 0.004 + 1e-12;
        assert!((c.gimbal_x_rad - b.gimbal_x_rad).abs() <= step, "{c:?} after {b:?}");
        assert!((c.gimbal_y_rad - b.gimbal_y_rad).abs() <= step, "{c:?} after {b:?}");
    }
}

/// The product's own plant, noise and all; the autopilot is told of none of it: thrust 3 % off, centre of
/// mass 10 mm off the axis (9.00 of 73.40 kg moved by 81.55 mm), wind of 5 m/s.
#[test]
fn an_unknown_thrust_bias_a_crooked_centre_of_mass_and_wind_leave_no_offset_in_the_hover() {
    let still = [
        ("wind.profile", "\"uniform\""),
        ("wind.mean_speed_m_s", "5.0"),
        ("wind.turbulence.wind_at_20_ft_m_s", "0.01"),
        ("wind.gust.0.peak_ned_m_s", "[0.0, 0.0, 0.0]"),
        ("mission.hover_height_m", "20.0"),
        ("mission.hover_time_s", "10.0"),
    ];
    let nominal = files::scenario("gusty_hop", &still);
    let told = data_sheet::nominal(&nominal).unwrap();
    for (seed, bias, place) in [
        (1, "0.03", "[0.05767, 0.05767, 0.5]"),
        (2, "-0.03", "[-0.08155, 0.0, 0.5]"),
        (3, "0.03", "[0.0, -0.08155, 0.5]"),
    ] {
        let truth = [("disturbance.0.thrust_bias", bias), ("vehicle.component.0.position_m", place)];
        let actual = files::scenario("gusty_hop", &[still.as_slice(), &truth].concat());
        let mut flight = Flight::dispersed(&actual, seed, &told).unwrap();
        flight.set_source(Source::Autopilot);
        let mut command = ActuatorCommand::SAFE;
        let (mut hovered_s, mut sum, mut samples) = (0.0, Vec3::zeros(), 0.0);
        while flight.outcome().is_none() && flight.phase() != Some(Phase::Descent) {
            flight.step(&command);
            let Some(next) = flight.autopilot_command() else { continue };
            command = next;
            flight.plan_in_place();
            if flight.phase() == Some(Phase::Hover) {
                hovered_s += 0.004;
                if hovered_s > 6.0 {
                    let reference = flight.autopilot().reference();
                    sum += flight.estimate().position_ned_m - reference.position_ned_m;
                    samples += 1.0;
                }
            }
        }
        let offset: Vec3 = sum / samples;
        eprintln!("seed {seed}: mean offset {:.1?} mm", (offset * 1e3).as_slice());
        assert!(samples > 900.0 && offset.norm() < 0.1, "seed {seed}: {offset}");
    }
}

#[test]
fn cut_short_the_solver_s_iterate_or_the_stand_in_lands_it() {
    for iterations in [1, 2, 4] {
        let flown = fly(hop_5m(), Conditions::dispersed(31), Delivery::AtOnce, |p| {
            p.tracking.solver.iterations = iterations;
        });
        eprintln!("{iterations} iterations: {:?}", flown.tracked);
        assert!(flown.tracked(Rung::Capped) + flown.tracked(Rung::Oracle) > 100, "{:?}", flown.tracked);
        assert!(flown.has_landed(), "{iterations}: {:?}", flown.touchdown);
    }
}

#[test]
fn without_its_own_solver_the_general_one_lands_it() {
    let flown =
        fly(hop_5m(), Conditions::dispersed(32), Delivery::AtOnce, |p| p.tracking.solver.iterations = 0);
    let solves: u64 = flown.tracked.iter().sum();
    assert_eq!(flown.tracked(Rung::Solved) + flown.tracked(Rung::Capped), 0);
    assert!(solves > 500 && flown.tracked(Rung::Oracle) * 100 >= solves * 99, "{:?}", flown.tracked);
    assert!(flown.has_landed() && flown.abort.is_none(), "{:?}", flown.touchdown);
}

#[test]
fn without_any_solver_the_cascade_lands_it() {
    for seed in [33, 34] {
        let flown = fly(hop_5m(), Conditions::dispersed(seed), Delivery::AtOnce, |p| {
            (p.tracking.solver.iterations, p.tracking.fallback_solver.iterations) = (0, 0);
        });
        let solves: u64 = flown.tracked.iter().sum();
        assert!(solves > 500 && flown.tracked(Rung::Cascade) == solves, "{:?}", flown.tracked);
        assert!(flown.has_landed() && flown.abort.is_none(), "seed {seed}: {:?}", flown.touchdown);
    }
}

#[test]
fn with_everything_in_order_nothing_but_the_best_rungs_is_flown() {
    let flown = fly(Mission::default(), Conditions::dispersed(35), Delivery::AtOnce, |_| {});
    let solves: u64 = flown.tracked.iter().sum();
    assert!(solves > 1500 && flown.tracked(Rung::Solved) * 100 >= solves * 99, "{:?}", flown.tracked);
    assert!(flown.planned(lcvx::Rung::Optimal) > 5, "{:?}", flown.planned);
    assert_eq!(flown.planned.iter().sum::<u64>(), flown.planned(lcvx::Rung::Optimal));
    assert!(flown.has_landed() && flown.late == 0 && flown.abort.is_none());
}

/// Closed forms of the ladder: a landing, or the abort that says that guidance is at its end, and a landing
/// all the same.
#[test]
fn without_the_cone_solver_closed_forms_land_it() {
    for (mission, seed) in [(Mission::default(), 36), (hop_5m(), 37)] {
        let flown =
            fly(mission, Conditions::dispersed(seed), Delivery::AtOnce, |p| p.planner.iterations_max = 0);
        eprintln!("no cone solver: {:?}, abort {:?}", flown.planned, flown.abort);
        assert_eq!(flown.planned(lcvx::Rung::Optimal), 0);
        assert!(
            flown.planned(lcvx::Rung::Quintic) + flown.planned(lcvx::Rung::Ramp) > 1,
            "{:?}",
            flown.planned
        );
        assert!(matches!(flown.abort, None | Some(AbortReason::Guidance)), "{:?}", flown.abort);
        assert!(flown.has_landed(), "{:?}", flown.touchdown);
    }
}

/// The deadline is 0.2 s, or lift-off. In time is in time, to the bit; too late is never, to the bit.
#[test]
fn an_answer_in_time_is_as_good_as_at_once_and_a_late_one_as_none() {
    let conditions = || Conditions::dispersed(38);
    let flown = |delivery| fly(Mission::default(), conditions(), delivery, |_| {});
    let (at_once, in_time) = (flown(Delivery::AtOnce), flown(Delivery::After(0.15)));
    assert!(at_once.commands == in_time.commands);
    assert_eq!((at_once.late, in_time.late), (0, 0));
    assert_eq!(at_once.planned, in_time.planned);

    // After the next has been ordered: neither is it taken for that one.
    let (late, never) = (flown(Delivery::After(1.1)), flown(Delivery::Never));
    assert!(late.commands == never.commands && late.commands != at_once.commands);
    assert_eq!((late.late, late.planned), (never.late, [0; 7]));
    assert!(never.late > 5, "{}", never.late);
    // After the deadline of a landing, which has no part in the climb: that one waits for lift-off.
    let climb_only = flown(Delivery::After(0.3));
    assert_eq!((climb_only.planned.iter().sum::<u64>(), climb_only.planned(lcvx::Rung::Optimal)), (1, 1));
    assert!(climb_only.late > 5, "{}", climb_only.late);
    for flown in [at_once, never, climb_only] {
        assert!(flown.has_landed() && flown.abort.is_none(), "{:?}", flown.touchdown);
    }
}

/// A shadow with predictive control takes over from either control law. Its first command is one step at the
/// gimbal's own rate from the last of the pilot; the manoeuvre that begins with it (its reference brakes, or
/// makes for the target) takes less than half of the gimbal's range in the first tenth of a second.
#[test]
fn taking_over_in_any_phase_does_not_jerk_the_gimbal() {
    let after_s = [(5.0, Phase::Ascent), (3.0, Phase::Hover), (4.0, Phase::Descent), (0.5, Phase::Terminal)];
    let (mut first_rad, mut tenth_rad) = (0.0f64, 0.0f64);
    for (control, (after_s, phase)) in [ControlLaw::Cascaded, ControlLaw::Predictive]
        .into_iter()
        .flat_map(|law| after_s.map(|case| (law, case)))
    {
        let conditions = Conditions {
            com_offset_body_m: Vec3::new(0.006, -0.004, 0.0),
            thrust_factor: 1.02,
            ..Conditions::calm(39)
        };
        let mission = Mission { control, ..Mission::default() };
        let told = parameters(Mission::default(), conditions.rtk);
        let step_rad = told.actuators.gimbal_rate_limit_rad_s * 0.004 + 1e-6;
        let half_rad = 0.5 * told.actuators.gimbal_limit_rad;
        let mut pilot = Autopilot::new(parameters(mission, conditions.rtk));
        let mut shadow = Autopilot::new(told);
        let mut plant = Plant::new(conditions);
        let mut command = ActuatorCommand::SAFE;
        let mut in_phase_s = 0.0;
        while in_phase_s < after_s {
            assert!(plant.touchdown.is_none() && plant.time_s() < 60.0, "{phase:?} was not reached");
            let m = plant.advance(&command);
            shadow.observe(&m, &command);
            command = pilot.update(&m);
            if let Some(order) = pilot.take_order() {
                pilot.deliver(order.solve());
            }
            in_phase_s += if pilot.phase() == phase { 0.004 } else { 0.0 };
        }
        let last = command;
        shadow.take_over();
        assert_eq!(shadow.phase(), phase);
        let taken_over_s = plant.time_s();
        while plant.touchdown.is_none() && plant.time_s() < taken_over_s + 60.0 {
            let m = plant.advance(&command);
            command = shadow.update(&m);
            if let Some(order) = shadow.take_order() {
                shadow.deliver(order.solve());
            }
            let since_s = plant.time_s() - taken_over_s;
            let turn = (command.gimbal_x_rad - last.gimbal_x_rad).abs();
            let turn = turn.max((command.gimbal_y_rad - last.gimbal_y_rad).abs());
            if since_s < 0.005 {
                first_rad = first_rad.max(turn);
                assert!(turn <= step_rad, "{control:?}, {phase:?}: {turn} rad at once");
            } else if since_s < 0.1 {
                tenth_rad = tenth_rad.max(turn);
                assert!(turn < half_rad, "{control:?}, {phase:?}: {turn} rad after {since_s} s");
            }
        }
        let t = plant.touchdown.expect("a touchdown");
        assert!(t.vertical_speed_m_s <= 1.0 && t.lateral_speed_m_s <= 0.5, "{control:?}, {phase:?}: {t:?}");
    }
    let (first, tenth) = (first_rad.to_degrees(), tenth_rad.to_degrees());
    eprintln!("hand-over: gimbal {first:.3} degrees at once, {tenth:.2} within a tenth of a second");
}
