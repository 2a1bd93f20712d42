//! Planning problems of the reference vehicle, for tests and the benchmark.
#![allow(dead_code)] // each binary uses its part

use hopbench::autopilot::lcvx::{Engine, GlideSlope, Limits, Problem, Start, Target};
use hopbench::frame::Vec3;

/// Standard gravity (m/s²), and the pivot's height at rest (m).
pub const G: f64 = 9.80665;
const REST_M: f64 = 0.74;

/// From a height over the pad (m), standing still, down to 0.5 m/s on the pad.
pub fn descent(height_m: f64) -> Problem {
    Problem {
        start: Start {
            position_ned_m: Vec3::new(0.0, 0.0, -REST_M - height_m),
            velocity_ned_m_s: Vec3::zeros(),
            thrust_acceleration_ned_m_s2: None,
            mass_kg: 74.0,
        },
        target: Target {
            position_ned_m: Vec3::new(0.0, 0.0, -REST_M),
            velocity_ned_m_s: Vec3::new(0.0, 0.0, 0.5),
        },
        // Tenth of the rated band at either end is left to control; Isp 205 s.
        engine: Engine {
            thrust_min_n: 450.0,
            thrust_max_n: 945.0,
            mass_flow_per_thrust_s_m: 1.0 / (205.0 * G),
            dry_mass_kg: 60.0,
        },
        limits: Limits {
            tilt_rad: 12f64.to_radians(),
            speed_m_s: 8.0,
            climb_m_s: 6.0,
            sink_m_s: 6.0,
            glide_slope: Some(GlideSlope { angle_rad: 45f64.to_radians(), offset_m: 0.5 }),
        },
        gravity_m_s2: G,
        nodes: 30,
    }
}

/// From 50 m, 17 m beside the pad and already moving.
pub fn divert() -> Problem {
    let mut problem = descent(50.0);
    problem.start.position_ned_m += Vec3::new(15.0, 8.0, 0.0);
    problem.start.velocity_ned_m_s = Vec3::new(-2.0, 1.5, 5.0);
    problem
}

/// From the pad to a hover 50 m over it.
pub fn ascent() -> Problem {
    let mut problem = descent(0.0);
    problem.start.mass_kg = 80.0;
    problem.target =
        Target { position_ned_m: Vec3::new(0.0, 0.0, -REST_M - 50.0), velocity_ned_m_s: Vec3::zeros() };
    problem.limits.glide_slope = None;
    problem
}

/// Numbers without pattern from a seed (SplitMix64: Steele, Lea and Flood, 2014), the same everywhere.
pub struct Draw(pub u64);

impl Draw {
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        low + (high - low) * ((bits >> 11) as f64 / (1u64 << 53) as f64)
    }

    pub fn vector(&mut self, low: [f64; 3], high: [f64; 3]) -> Vec3 {
        Vec3::from_fn(|axis, _| self.between(low[axis], high[axis]))
    }
}

/// A descent, divert or ascent somewhere in the vehicle's envelope.
pub fn random(draw: &mut Draw) -> Problem {
    let is_ascent = draw.between(0.0, 1.0) < 0.25;
    let mut problem = if is_ascent { ascent() } else { descent(draw.between(10.0, 100.0)) };
    problem.engine.thrust_min_n = draw.between(300.0, 500.0);
    problem.engine.mass_flow_per_thrust_s_m = 1.0 / (draw.between(190.0, 220.0) * G);
    if is_ascent {
        problem.start.mass_kg = draw.between(74.0, 82.0);
        problem.target.position_ned_m += draw.vector([-10.0, -10.0, -30.0], [10.0, 10.0, 30.0]);
    } else {
        problem.start.mass_kg = draw.between(68.0, 80.0);
        let height_m = -problem.start.position_ned_m.z;
        let beside_m = 0.4 * height_m;
        problem.start.position_ned_m += draw.vector([-beside_m, -beside_m, 0.0], [beside_m, beside_m, 0.0]);
        problem.start.velocity_ned_m_s = draw.vector([-2.0, -2.0, -1.0], [2.0, 2.0, 4.0]);
    }
    if draw.between(0.0, 1.0) < 0.5 {
        let lean = draw.vector([-1.0, -1.0, -12.0], [1.0, 1.0, -7.0]);
        problem.start.thrust_acceleration_ned_m_s2 = Some(lean);
    }
    problem
}
