//! Plans without a solver: a polynomial of fifth order, and ramps straight down or up.

use super::problem::Problem;
use crate::autopilot::trajectory::Node;
use crate::frame::Vec3;

/// Time between nodes (s).
const STEP_S: f64 = 0.1;
/// Flight times tried for the polynomial: each longer than the last by this factor, up to the longest (s).
const QUINTIC_FACTOR: f64 = 1.25;
const QUINTIC_LONGEST_S: f64 = 120.0;
/// Distance that its nodes may lie below the lower end (m).
const QUINTIC_SAG_M: f64 = 0.1;
/// Longest ramp (s).
const RAMP_LONGEST_S: f64 = 300.0;
/// Greatest acceleration of ramps (m/s²), vertical and lateral.
const RAMP_VERTICAL_M_S2: f64 = 1.5;
const RAMP_LATERAL_M_S2: f64 = 1.0;
/// Share of the acceleration available from engine and tilt that ramps use, and the least they assume (m/s²).
const RAMP_SHARE: f64 = 0.7;
const RAMP_LEAST_M_S2: f64 = 0.3;
/// Time constant with which ramps follow their speeds (s).
const RAMP_FOLLOW_S: f64 = 0.4;
/// Greatest speed of ramps (m/s).
const FAST_M_S: f64 = 5.0;
/// Speeds downwards (m/s), and the heights (m) below which they apply.
const SLOW_M_S: f64 = 1.5;
const SLOW_BELOW_M: f64 = 10.0;
const TERMINAL_M_S: f64 = 0.8;
const TERMINAL_BELOW_M: f64 = 1.5;

/// A position to hold when numbers are missing: the start, or the target, or the origin.
pub(super) fn known_position(problem: &Problem) -> Vec3 {
    let known = |v: &Vec3| v.iter().all(|x| x.is_finite());
    let points = [problem.start.position_ned_m, problem.target.position_ned_m];
    points.into_iter().find(known).unwrap_or_default()
}

/// The shortest polynomial of fifth order from start to target that keeps thrust band, tilt limit, speed
/// limits and ground; at the end only the weight is carried.
pub(super) fn quintic(problem: &Problem) -> Option<Vec<Node>> {
    let distance_m = (problem.target.position_ned_m - problem.start.position_ned_m).norm();
    let mut time_s = (distance_m / problem.limits.speed_m_s).max(1.0);
    while time_s < QUINTIC_LONGEST_S {
        let nodes = quintic_nodes(problem, time_s);
        if keeps_limits(problem, &nodes) {
            return Some(nodes);
        }
        time_s *= QUINTIC_FACTOR;
    }
    None
}

fn quintic_nodes(problem: &Problem, time_s: f64) -> Vec<Node> {
    let (start, target) = (&problem.start, &problem.target);
    let (p0, v0) = (start.position_ned_m, start.velocity_ned_m_s * time_s);
    let a0 = start_acceleration(problem) * (time_s * time_s);
    // Differences to the parabola of the start, with the flight time as unit; the end's acceleration is zero.
    let dp = target.position_ned_m - (p0 + v0 + a0 * 0.5);
    let dv = target.velocity_ned_m_s * time_s - (v0 + a0);
    let da = -a0;
    let c3 = dp * 10.0 - dv * 4.0 + da * 0.5;
    let c4 = dp * -15.0 + dv * 7.0 - da;
    let c5 = dp * 6.0 - dv * 3.0 + da * 0.5;
    let count = (time_s / STEP_S).ceil().max(1.0) as usize;
    let node = |k: usize| {
        let s = k as f64 / count as f64;
        Node {
            time_s: s * time_s,
            position_ned_m: p0 + (v0 + (a0 * 0.5 + (c3 + (c4 + c5 * s) * s) * s) * s) * s,
            velocity_ned_m_s: (v0 + (a0 + (c3 * 3.0 + (c4 * 4.0 + c5 * (5.0 * s)) * s) * s) * s) / time_s,
            acceleration_ned_m_s2: (a0 + (c3 * 6.0 + (c4 * 12.0 + c5 * (20.0 * s)) * s) * s)
                / (time_s * time_s),
        }
    };
    (0..=count).map(node).collect()
}

/// Acceleration at the start (m/s²).
fn start_acceleration(problem: &Problem) -> Vec3 {
    problem.initial_thrust_acceleration_ned_m_s2().map_or(Vec3::zeros(), |u| u + problem.gravity_ned_m_s2())
}

fn keeps_limits(problem: &Problem, nodes: &[Node]) -> bool {
    let (engine, limits, start) = (&problem.engine, &problem.limits, &problem.start);
    let speed_m_s = limits.speed_m_s.max(start.velocity_ned_m_s.norm());
    let sink_m_s = limits.sink_m_s.max(start.velocity_ned_m_s.z);
    let climb_m_s = limits.climb_m_s.max(-start.velocity_ned_m_s.z);
    let lowest_m = start.position_ned_m.z.max(problem.target.position_ned_m.z) + QUINTIC_SAG_M;
    let mut mass_kg = start.mass_kg;
    let mut last_s = 0.0;
    nodes.iter().all(|node| {
        let u = node.acceleration_ned_m_s2 - problem.gravity_ned_m_s2();
        let thrust_n = mass_kg * u.norm();
        mass_kg -= engine.mass_flow_per_thrust_s_m * thrust_n * (node.time_s - last_s);
        last_s = node.time_s;
        let v = node.velocity_ned_m_s;
        engine.thrust_min_n <= thrust_n
            && thrust_n <= engine.thrust_max_n
            && -u.z >= u.norm() * libm::cos(limits.tilt_rad)
            && mass_kg >= engine.dry_mass_kg
            && node.position_ned_m.z <= lowest_m
            && v.norm() <= speed_m_s
            && -climb_m_s <= v.z
            && v.z <= sink_m_s
    })
}

/// Brakes horizontal motion, and descends to the target's height at 5, 1.5 and at last 0.8 m/s, or climbs to
/// it.
///
/// Acceleration follows the wanted speed with a time constant, is bounded, and is integrated as trajectories
/// are: linear between nodes.
pub(super) fn ramps(problem: &Problem) -> Vec<Node> {
    let (start, engine) = (&problem.start, &problem.engine);
    let g = problem.gravity_m_s2;
    let within =
        |spare_m_s2: f64, most_m_s2: f64| (RAMP_SHARE * spare_m_s2).clamp(RAMP_LEAST_M_S2, most_m_s2);
    let bounds = Bounds {
        up_m_s2: within(engine.thrust_max_n / start.mass_kg - g, RAMP_VERTICAL_M_S2),
        down_m_s2: within(g - engine.thrust_min_n / start.mass_kg, RAMP_VERTICAL_M_S2),
        lateral_m_s2: within(g * libm::tan(problem.limits.tilt_rad), RAMP_LATERAL_M_S2),
    };
    let mut node = Node {
        time_s: 0.0,
        position_ned_m: start.position_ned_m,
        velocity_ned_m_s: start.velocity_ned_m_s,
        acceleration_ned_m_s2: start_acceleration(problem),
    };
    let mut nodes = vec![node];
    while node.time_s < RAMP_LONGEST_S && !has_arrived(problem, &node) {
        let next = wanted_acceleration(problem, &bounds, &node);
        let (p, v, a) = (node.position_ned_m, node.velocity_ned_m_s, node.acceleration_ned_m_s2);
        node = Node {
            time_s: STEP_S * nodes.len() as f64,
            position_ned_m: p + v * STEP_S + (a / 3.0 + next / 6.0) * (STEP_S * STEP_S),
            velocity_ned_m_s: v + (a + next) * (0.5 * STEP_S),
            acceleration_ned_m_s2: next,
        };
        nodes.push(node);
    }
    nodes
}

/// Greatest accelerations of ramps.
struct Bounds {
    up_m_s2: f64,
    down_m_s2: f64,
    lateral_m_s2: f64,
}

fn height_m(problem: &Problem, node: &Node) -> f64 {
    problem.target.position_ned_m.z - node.position_ned_m.z
}

fn has_arrived(problem: &Problem, node: &Node) -> bool {
    let height_m = height_m(problem, node);
    if problem.is_descent() {
        height_m <= 0.0
    } else {
        height_m.abs() < 0.02
            && node.velocity_ned_m_s.norm() < 0.05
            && node.acceleration_ned_m_s2.norm() < 0.1
    }
}

fn wanted_acceleration(problem: &Problem, bounds: &Bounds, node: &Node) -> Vec3 {
    let velocity = node.velocity_ned_m_s;
    // The speed wanted at the height one time constant ahead: the ramp is followed without lag.
    let height_m = height_m(problem, node) - velocity.z * RAMP_FOLLOW_S;
    let sink_m_s = if problem.is_descent() {
        sink_m_s(height_m, bounds.up_m_s2).min(problem.limits.sink_m_s)
    } else {
        -climb_m_s(-height_m, bounds.down_m_s2).min(problem.limits.climb_m_s)
    };
    let mut wanted = (Vec3::new(0.0, 0.0, sink_m_s) - velocity) / RAMP_FOLLOW_S;
    wanted.z = wanted.z.clamp(-bounds.up_m_s2, bounds.down_m_s2);
    let lateral = libm::hypot(wanted.x, wanted.y);
    if lateral > bounds.lateral_m_s2 {
        wanted.x *= bounds.lateral_m_s2 / lateral;
        wanted.y *= bounds.lateral_m_s2 / lateral;
    }
    wanted
}

/// Speed downwards at a height (m/s): braked early enough to be slow where it has to be.
fn sink_m_s(height_m: f64, braking_m_s2: f64) -> f64 {
    let ramp = |end_m_s: f64, above_m: f64, most_m_s: f64| {
        (end_m_s * end_m_s + 2.0 * RAMP_SHARE * braking_m_s2 * above_m.max(0.0)).sqrt().min(most_m_s)
    };
    if height_m > SLOW_BELOW_M {
        ramp(SLOW_M_S, height_m - SLOW_BELOW_M, FAST_M_S)
    } else {
        ramp(TERMINAL_M_S, height_m - TERMINAL_BELOW_M, SLOW_M_S)
    }
}

/// Speed upwards that stops at the target (m/s), linear near it with a time constant of 1 s.
fn climb_m_s(below_m: f64, braking_m_s2: f64) -> f64 {
    let braking = RAMP_SHARE * braking_m_s2;
    let distance_m = below_m.abs();
    let speed =
        if distance_m < braking { distance_m } else { (2.0 * braking * (distance_m - 0.5 * braking)).sqrt() };
    speed.min(FAST_M_S).copysign(below_m)
}
