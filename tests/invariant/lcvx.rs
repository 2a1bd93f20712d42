//! What must hold of any optimal plan: tight, certified, least, the same at any number of nodes, and flown to
//! where it says; and of the ladder below it: there is always something to fly.

// The tests print their figures for the record.
#![allow(clippy::disallowed_macros)]

use crate::fixture::lcvx::{Draw, G, ascent, descent, divert, random};
use hopbench::autopilot::lcvx::conic::{self, Program, Status};
use hopbench::autopilot::lcvx::flight_time::{Search, least_s};
use hopbench::autopilot::lcvx::verification::Rejection;
use hopbench::autopilot::lcvx::{
    Effort, FixedTimeSolution, Motion, Objective, Plan, PlanRequest, Problem, Refusal, Rung, Settings, plan,
    program, solve,
};
use hopbench::autopilot::trajectory::Trajectory;
use hopbench::frame::Vec3;
use hopbench::time::SimTime;

const SEARCH: Search = Search { nodes: 20, tolerance_s: 0.1, iterations_max: 40 };

fn proof(problem: &Problem, flight_time_s: f64) -> FixedTimeSolution {
    solve(problem, Objective::Fuel, flight_time_s, Settings::PROOF.accuracy())
}

fn motion(problem: &Problem, flight_time_s: f64) -> Motion {
    proof(problem, flight_time_s).motion.expect("the problem has a solution")
}

fn least(problem: &Problem) -> f64 {
    least_s(problem, Objective::Fuel, &SEARCH, &mut Effort::default()).expect("the problem has a solution")
}

fn request(problem: Problem) -> PlanRequest {
    PlanRequest { problem, start: SimTime::from_s(3.0), heading_rad: 0.1, previous: None }
}

#[test]
fn five_hundred_random_problems_are_tight_and_flown_where_they_say() {
    let mut draw = Draw(1);
    let (mut solved, mut infeasible, mut uncertain, mut iterations_max) = (0, 0, 0, 0);
    let (mut gap, mut miss_m, mut miss_m_s) = (0f64, 0f64, 0f64);
    while solved < 500 {
        let problem = random(&mut draw);
        let way = problem.target.position_ned_m - problem.start.position_ned_m;
        let answer = proof(&problem, way.norm() / draw.between(2.5, 5.0) + 2.0);
        iterations_max = iterations_max.max(answer.solution.iterations);
        match answer.solution.status {
            Status::Infeasible => infeasible += 1,
            Status::Solved => {
                let quality = answer.verdict.unwrap_or_else(|why| panic!("{problem:?}: {why}"));
                (gap, miss_m) = (gap.max(quality.gap), miss_m.max(quality.miss_m));
                miss_m_s = miss_m_s.max(quality.miss_m_s);
                solved += 1;
            }
            // Rounding stopped it short of its accuracy: the ladder treats that as no answer.
            _ => uncertain += 1,
        }
    }
    println!(
        "500 solved, {infeasible} infeasible, {uncertain} uncertain, iterations up to {iterations_max}: gap {gap:.1e}, \
         flown with exact mass {miss_m:.1e} m, {miss_m_s:.1e} m/s off"
    );
    // Solver accuracy 1e-8 of numbers around one; the ends are the limits of the verification.
    assert!(uncertain <= 2, "{uncertain}");
    assert!(gap < 1e-5 && miss_m < 0.2 && miss_m_s < 0.1);
}

/// The negative control: a floor above the weight makes the relaxation loose, and "solved" means nothing.
#[test]
fn a_floor_above_the_weight_is_refused_and_its_optimum_rejected() {
    let mut problem = descent(30.0);
    problem.start.position_ned_m.x = 8.0;
    problem.start.velocity_ned_m_s = Vec3::new(-1.0, 0.0, 5.0);
    problem.limits.tilt_rad = 15f64.to_radians();
    problem.start.mass_kg = 66.0;
    problem.engine.thrust_min_n = 660.0;
    let floor = problem.refusal();
    assert!(matches!(floor, Some(Refusal::ThrustFloor { thrust_min_n: 660.0, .. })), "{floor:?}");

    let mut found = 0;
    for flight_time_s in [6.5, 6.75, 7.0, 7.25, 8.0] {
        let answer = proof(&problem, flight_time_s);
        match answer.verdict {
            Err(Rejection::NotTight { gap }) => {
                println!("{flight_time_s} s: {:?} with gap {gap:.2e}", answer.solution.status);
                assert!(answer.solution.status == Status::Solved && gap > 1e-3);
                found += 1;
            }
            Err(Rejection::NotSolved(_)) => {}
            // Late enough, the floor is not in the way.
            verdict => assert!(verdict.is_ok_and(|quality| quality.gap < 1e-5)),
        }
    }
    assert!(found > 0, "no flight time has a solution");
    let plan = plan(&request(problem), &Settings::FLIGHT);
    assert!(plan.rung > Rung::LandingError && plan.effort.solves == 0, "{:?}", plan.rung);
}

#[test]
fn a_hundred_constructed_infeasible_problems_are_certified() {
    let mut draw = Draw(2);
    let mut iterations_max = 0;
    for case in 0..100 {
        let mut problem = random(&mut draw);
        let way = problem.target.position_ned_m - problem.start.position_ned_m;
        let mut flight_time_s = way.norm() / 4.0 + 3.0;
        match case % 5 {
            // Faster than the vertical speed limit allows.
            0 => flight_time_s = 0.8 * way.z.abs() / 6.0,
            // Less propellant than carrying the weight takes: m g t / c, two thirds of it there.
            1 => {
                let weight_kg = problem.start.mass_kg * G * flight_time_s;
                let burnt_kg = weight_kg * problem.engine.mass_flow_per_thrust_s_m;
                problem.engine.dry_mass_kg = problem.start.mass_kg - 0.66 * burnt_kg;
            }
            // Engine weaker than the weight, at a standstill at both ends.
            2 => {
                problem.engine.thrust_max_n = 0.9 * problem.start.mass_kg * G;
                problem.engine.dry_mass_kg = 0.95 * problem.start.mass_kg;
                problem.start.velocity_ned_m_s = Vec3::zeros();
                problem.target.velocity_ned_m_s = Vec3::zeros();
                problem.start.thrust_acceleration_ned_m_s2 = None;
            }
            // The start lies outside the limits of place, by more than they forgive.
            3 if problem.limits.glide_slope.is_some() => {
                problem.start.position_ned_m.x = 1.5 - problem.start.position_ned_m.z;
            }
            3 => problem.start.velocity_ned_m_s.z = 20.0,
            // Too fast to be caught by the next node.
            _ => problem.start.velocity_ned_m_s.z = if problem.is_descent() { 30.0 } else { -30.0 },
        }
        let solution = proof(&problem, flight_time_s).solution;
        assert_eq!(solution.status, Status::Infeasible, "case {case}: {problem:?}, {flight_time_s} s");
        iterations_max = iterations_max.max(solution.iterations);
    }
    println!("100 certified in up to {iterations_max} iterations");
}

#[test]
fn least_flight_time_lies_within_a_tenth_of_a_second_of_a_fine_grid() {
    let mut low = divert();
    low.start.position_ned_m = Vec3::new(6.0, -3.0, -15.0);
    for (name, problem) in
        [("descent", descent(50.0)), ("divert", divert()), ("low", low), ("ascent", ascent())]
    {
        let found_s = least(&problem);
        let problem = Problem { nodes: SEARCH.nodes, ..problem };
        let is_feasible = |time_s: f64| proof(&problem, time_s).solution.status == Status::Solved;
        // Infeasible, then feasible, and never back.
        let grid: Vec<f64> = (-20..=10).map(|k| found_s + 0.02 * f64::from(k)).collect();
        let first = grid.iter().position(|&t| is_feasible(t)).expect("the answer is feasible");
        assert!(first > 0, "{name}: {} s is feasible", grid[0]);
        assert!(grid[first..].iter().all(|&t| is_feasible(t)), "{name}: feasible times have a gap");
        assert!([0.5, 0.7, 0.9].iter().all(|&share| !is_feasible(share * found_s)));
        assert!([1.2, 1.5, 2.0].iter().all(|&share| is_feasible(share * found_s)));
        println!("{name}: {found_s:.3} s, on the grid {:.3} s", grid[first]);
        assert!((found_s - grid[first]).abs() < 0.1, "{name}: {found_s} s, grid {} s", grid[first]);
    }
}

#[test]
fn cost_does_not_fall_with_flight_time() {
    for problem in [descent(50.0), divert(), ascent()] {
        let least_s = least(&problem) + 0.1;
        let costs: Vec<f64> =
            (0..12).map(|k| motion(&problem, least_s + 0.4 * f64::from(k)).cost_m_s()).collect();
        // Solver accuracy 1e-8 in costs around 100 m/s.
        assert!(costs.windows(2).all(|pair| pair[1] > pair[0] - 1e-5), "{costs:?}");
        // Each second costs about one second of weight.
        let slope = (costs[11] - costs[0]) / 4.4;
        assert!((slope / G - 1.0).abs() < 0.1, "{slope} m/s²");
    }
}

/// Between its ends thrust lies on a limit: the switching function is zero at isolated times only, as long as
/// no limit of speed or place holds the motion (Pontryagin's principle; Açıkmeşe and Ploen 2007, Lemma 2).
#[test]
fn thrust_is_at_a_limit_almost_everywhere() {
    let mut problem = divert();
    problem.nodes = 100;
    (problem.limits.speed_m_s, problem.limits.sink_m_s, problem.limits.climb_m_s) = (50.0, 50.0, 50.0);
    problem.limits.glide_slope = None;
    problem.limits.tilt_rad = 0.5;
    let motion = motion(&problem, 1.15 * least(&problem));
    let thrust_n = |k: usize| motion.thrust_acceleration_ned_m_s2[k].norm() * motion.mass_kg[k];
    let (low_n, high_n) = (problem.engine.thrust_min_n, problem.engine.thrust_max_n);
    let side = |k: usize| {
        let share = (thrust_n(k) - low_n) / (high_n - low_n);
        if share < 0.01 {
            -1
        } else if share > 0.99 {
            1
        } else {
            0
        }
    };
    let sides: Vec<i32> = (0..problem.nodes).map(side).collect();
    let between = sides.iter().filter(|&&s| s == 0).count();
    let limits: Vec<i32> = sides.into_iter().filter(|&s| s != 0).collect();
    let switches = limits.windows(2).filter(|pair| pair[0] != pair[1]).count();
    println!("{between} of {} nodes between the limits, {switches} switches", problem.nodes);
    // Each switch has a node or two on its way; the theory allows two switches.
    assert!(switches <= 2 && between <= 6, "{limits:?}");
}

/// The program with one variable held at a value.
fn held(program: &Program, columns: &[usize], values: &[f64]) -> Program {
    let mut held = program.clone();
    let count = columns.len();
    held.column_starts = vec![0];
    (held.rows, held.values) = (Vec::new(), Vec::new());
    for column in 0..program.cost.len() {
        if let Some(row) = columns.iter().position(|&c| c == column) {
            held.rows.push(row);
            held.values.push(1.0);
        }
        for k in program.column_starts[column]..program.column_starts[column + 1] {
            held.rows.push(program.rows[k] + count);
            held.values.push(program.values[k]);
        }
        held.column_starts.push(held.rows.len());
    }
    held.right.splice(0..0, values.iter().copied());
    held.equalities += count;
    held
}

#[test]
fn no_motion_beside_the_optimum_costs_less() {
    for problem in [divert(), ascent()] {
        let flight_time_s = 1.2 * least(&problem);
        let best = program(&problem, Objective::Fuel, flight_time_s);
        let optimum = conic::solve(&best, Settings::PROOF.accuracy());
        let (mut dearer, mut infeasible) = (0, 0);
        for node in 0..problem.nodes {
            for share in [0.99, 1.01] {
                // Thrust per mass of one node by a hundredth off, everything else as good as it gets.
                let columns = [11 * node + 7, 11 * node + 8, 11 * node + 9];
                let values = columns.map(|c| share * optimum.x[c]);
                let other = conic::solve(&held(&best, &columns, &values), Settings::PROOF.accuracy());
                match other.status {
                    Status::Solved => {
                        dearer += 1;
                        assert!(other.cost > optimum.cost - 1e-6, "node {node}: {}", other.cost);
                    }
                    // Beyond a limit of thrust.
                    _ => infeasible += 1,
                }
            }
        }
        println!("{dearer} neighbours are not cheaper, {infeasible} are no solutions");
        assert!(dearer >= problem.nodes / 2);
    }
}

/// The double integrator is discretised without error: nodes only decide when thrust may turn.
#[test]
fn fuel_does_not_depend_on_the_number_of_nodes() {
    for problem in [descent(50.0), divert(), ascent()] {
        let flight_time_s = 1.2 * least(&problem);
        let fuel_kg =
            [20, 50, 100].map(|nodes| motion(&Problem { nodes, ..problem }, flight_time_s).fuel_kg());
        println!("fuel at 20, 50, 100 nodes: {fuel_kg:?} kg");
        assert!(fuel_kg.iter().all(|fuel| (fuel / fuel_kg[2] - 1.0).abs() < 1e-4), "{fuel_kg:?}");
        // More nodes are more freedom.
        assert!(fuel_kg[2] < fuel_kg[0] + 1e-6);
    }
}

/// Every node finite, rising in time, and joined to the next by what stands between them.
fn assert_sound(plan: &Plan) {
    let finite = |v: Vec3| v.iter().all(|x| x.is_finite());
    for node in plan.trajectory.nodes() {
        let (r, v, a) = (node.position_ned_m, node.velocity_ned_m_s, node.acceleration_ned_m_s2);
        assert!(finite(r) && finite(v) && finite(a) && node.time_s.is_finite(), "{node:?}");
    }
    assert!(plan.trajectory.nodes().windows(2).all(|pair| pair[0].time_s < pair[1].time_s));
    assert!(plan.flight_time_s.is_finite());
}

/// Largest jump of position (m) and velocity (m/s) where the motion after one node meets the next.
fn jumps(trajectory: &Trajectory) -> (f64, f64) {
    trajectory.nodes().windows(2).fold((0.0, 0.0), |(r, v): (f64, f64), pair| {
        let end = trajectory.after(pair[1].time_s - 1e-9);
        let jump = |a: Vec3, b: Vec3| (a - b).norm();
        (
            r.max(jump(end.position_ned_m, pair[1].position_ned_m)),
            v.max(jump(end.velocity_ned_m_s, pair[1].velocity_ned_m_s)),
        )
    })
}

#[test]
fn each_rung_of_the_ladder_can_be_reached() {
    let flight = Settings::FLIGHT;
    let capped = Settings { iterations_max: 2, ..flight };

    let optimal = plan(&request(divert()), &flight);
    assert_eq!(optimal.rung, Rung::Optimal);
    assert!((optimal.flight_time_s - 1.2 * optimal.least_time_s.unwrap()).abs() < 1e-9);

    // A second later, on the plan, and the solver gives up: the plan is kept, until it is old, left or moot.
    let mut later = request(divert());
    later.start = SimTime::from_s(4.0);
    let there = optimal.trajectory.after(1.0);
    later.problem.start.position_ned_m = there.position_ned_m;
    later.problem.start.velocity_ned_m_s = there.velocity_ned_m_s;
    later.previous = Some(optimal.trajectory.clone());
    let kept = plan(&later, &capped);
    assert_eq!((kept.rung, &kept.trajectory), (Rung::Previous, &optimal.trajectory));
    assert!((kept.flight_time_s - (optimal.flight_time_s - 1.0)).abs() < 1e-6);
    assert!(kept.effort.solves > 0);
    let mut old = later.clone();
    old.start = SimTime::from_s(6.5);
    assert!(plan(&old, &capped).rung > Rung::Previous);
    let mut left = later.clone();
    left.problem.start.position_ned_m.x += 1.5;
    assert!(plan(&left, &capped).rung > Rung::Previous);
    let mut moot = later.clone();
    moot.problem.target.position_ned_m.x += 1.5;
    assert!(plan(&moot, &capped).rung > Rung::Previous);

    // Low beside the pad: outside the glide slope.
    let mut low = descent(8.0);
    low.start.position_ned_m.x = 20.0;
    let wide = plan(&request(low), &flight);
    assert_eq!(wide.rung, Rung::WideGlideSlope);

    // Propellant for 8 s, too far away for them.
    let mut far = descent(20.0);
    far.start.position_ned_m.x = 60.0;
    far.engine.dry_mass_kg = 71.0;
    far.engine.thrust_min_n = 400.0;
    let beside = plan(&request(far), &flight);
    assert_eq!(beside.rung, Rung::LandingError, "{:?} {:?}", beside.effort, beside.rejection);
    let landing = beside.trajectory.last().position_ned_m;
    assert!((landing.z - far.target.position_ned_m.z).abs() < 1e-3 && landing.x > 10.0, "{landing}");

    // The solver gives up and nothing is being flown: closed forms.
    let quintic = plan(&request(divert()), &capped);
    assert_eq!(quintic.rung, Rung::Quintic);
    let end = quintic.trajectory.last();
    assert!((end.position_ned_m - divert().target.position_ned_m).norm() < 1e-9);
    assert!((end.velocity_ned_m_s - divert().target.velocity_ned_m_s).norm() < 1e-9);

    // Falling too fast for any polynomial within the limits.
    let mut falling = divert();
    falling.start.velocity_ned_m_s = Vec3::new(6.0, 0.0, 15.0);
    let ramp = plan(&request(falling), &capped);
    assert_eq!(ramp.rung, Rung::Ramp);

    // By its own estimate out of propellant, it still comes down.
    let mut empty = divert();
    empty.start.mass_kg = 59.9;
    let last = plan(&request(empty), &flight);
    assert_eq!(last.rung, Rung::Ramp);
    assert!(matches!(last.refusal, Some(Refusal::Propellant { .. })));

    let mut unknown = divert();
    unknown.start.position_ned_m.y = f64::NAN;
    let hold = plan(&request(unknown), &flight);
    assert_eq!((hold.rung, hold.trajectory.nodes().len()), (Rung::Hold, 1));
    assert!(matches!(hold.refusal, Some(Refusal::NotFinite("start.position_ned_m"))));

    for plan in [&optimal, &kept, &wide, &beside, &quintic, &ramp, &last, &hold] {
        assert_sound(plan);
        let (r, v) = jumps(&plan.trajectory);
        println!(
            "{}: {:.2} s, {:?}, jumps {r:.1e} m, {v:.1e} m/s",
            plan.rung.name(),
            plan.flight_time_s,
            plan.effort
        );
        // Round-off; the polynomial's acceleration bends between its nodes.
        let (most_m, most_m_s) = if plan.rung == Rung::Quintic { (1e-3, 2e-3) } else { (1e-7, 1e-7) };
        assert!(r < most_m && v < most_m_s);
    }
}

/// The last rung's own law: 5 m/s above 10 m, 1.5 below, 0.8 at the end; sideways motion is gone.
#[test]
fn ramps_come_down_at_their_speeds() {
    let none = Settings { iterations_max: 0, ..Settings::FLIGHT };
    for (height_m, sideways_m_s, sink_m_s) in [(60.0, 3.0, 9.0), (30.0, -2.0, -7.0), (4.0, 1.0, 7.0)] {
        let mut problem = descent(height_m);
        problem.start.velocity_ned_m_s = Vec3::new(sideways_m_s, 4.0, sink_m_s);
        problem.target.position_ned_m.x = 1000.0; // out of reach of any polynomial
        let plan = plan(&request(problem), &none);
        assert_eq!((plan.rung, plan.effort.solves), (Rung::Ramp, 0));
        let height = |r: Vec3| problem.target.position_ned_m.z - r.z;
        for node in &plan.trajectory.nodes()[1..] {
            let (h, v, a) = (height(node.position_ned_m), node.velocity_ned_m_s, node.acceleration_ned_m_s2);
            assert!(a.z.abs() <= 1.5 + 1e-12 && libm::hypot(a.x, a.y) <= 1.0 + 1e-12, "{a}");
            // Once it has had the time to brake; a twentieth of the change is still under way at its height.
            if height_m > 20.0 && node.time_s > 8.0 {
                assert!(v.z < 5.05 && (h > 10.0 || v.z < 1.6) && (h > 1.5 || v.z < 0.9), "{h} m: {v}");
            }
        }
        let end = plan.trajectory.last();
        // The last node is the first under the ground, a step of 0.1 s at most.
        let below_m = -height(end.position_ned_m);
        assert!(below_m >= 0.0 && below_m <= 0.1 * end.velocity_ned_m_s.z + 0.01);
        if height_m > 20.0 {
            assert!(
                (end.velocity_ned_m_s - Vec3::new(0.0, 0.0, 0.8)).norm() < 0.02,
                "{}",
                end.velocity_ned_m_s
            );
        }
    }
    // Up, and to rest at the height asked for.
    let mut problem = ascent();
    problem.start.velocity_ned_m_s = Vec3::new(3.0, 0.0, 9.0);
    problem.start.position_ned_m.z = -40.0;
    problem.target.position_ned_m.x = 1000.0;
    let end = *plan(&request(problem), &none).trajectory.last();
    assert!((end.position_ned_m.z - problem.target.position_ned_m.z).abs() < 0.02, "{end:?}");
    assert!(end.velocity_ned_m_s.norm() < 0.05 && end.time_s < 40.0);
}

#[test]
fn whatever_the_numbers_a_plan_is_sound_and_repeats_bit_for_bit() {
    fn is_sent<T: Clone + Send + 'static>() {}
    is_sent::<PlanRequest>();
    is_sent::<Plan>();

    let mut draw = Draw(3);
    let strange = [f64::NAN, f64::INFINITY, -f64::INFINITY, 0.0, -1.0, 1e300, -1e300, 1e-300, 1e6, -1e5];
    let mut rungs = [0; Rung::ALL.len()];
    for _ in 0..150 {
        let mut request = request(random(&mut draw));
        let problem = &mut request.problem;
        let value = strange[draw.between(0.0, strange.len() as f64) as usize];
        let lean = problem.start.thrust_acceleration_ned_m_s2.get_or_insert_with(Vec3::zeros);
        match draw.between(0.0, 17.0) as usize {
            axis @ 0..3 => problem.start.position_ned_m[axis] = value,
            axis @ 3..6 => problem.start.velocity_ned_m_s[axis - 3] = value,
            axis @ 6..9 => lean[axis - 6] = value,
            9 => problem.target.position_ned_m.z = value,
            10 => problem.start.mass_kg = value,
            11 => problem.engine.dry_mass_kg = value,
            12 => problem.engine.thrust_max_n = value,
            13 => problem.limits.tilt_rad = value,
            14 => problem.limits.sink_m_s = value,
            15 => problem.gravity_m_s2 = value,
            _ => request.heading_rad = value,
        }
        let first = plan(&request, &Settings::FLIGHT);
        assert_sound(&first);
        assert!(first.trajectory.after(1.0).heading_rad.is_finite());
        let second = plan(&request, &Settings::FLIGHT);
        assert!(first.trajectory == second.trajectory && first.effort == second.effort);
        rungs[first.rung as usize] += 1;
    }
    println!("{rungs:?}");
    assert!(rungs[Rung::Hold as usize] > 0 && rungs[Rung::Optimal as usize] > 0);
}
