//! The data of one planning problem: start, target, engine and limits.

use crate::frame::Vec3;

/// Motion, mass and engine at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// Position of the pivot (m).
    pub position_ned_m: Vec3,
    /// Velocity (m/s).
    pub velocity_ned_m_s: Vec3,
    /// Thrust per mass at the start of the plan (m/s²), moved inside the thrust band and the tilt limit.
    /// `None`: free.
    pub thrust_acceleration_ned_m_s2: Option<Vec3>,
    /// Mass (kg).
    pub mass_kg: f64,
}

/// End of the motion; thrust is vertical there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Position of the pivot (m).
    pub position_ned_m: Vec3,
    /// Velocity (m/s).
    pub velocity_ned_m_s: Vec3,
}

/// The engine as guidance models it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Engine {
    /// Lower end of the thrust band (N).
    pub thrust_min_n: f64,
    /// Upper end of the thrust band (N).
    pub thrust_max_n: f64,
    /// Mass flow per thrust, one over the exhaust velocity (s/m).
    pub mass_flow_per_thrust_s_m: f64,
    /// Least mass at the end of a plan (kg).
    pub dry_mass_kg: f64,
}

/// A cone open upwards that a descent stays in, its apex under the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlideSlope {
    /// Angle of the cone above the horizontal (rad).
    pub angle_rad: f64,
    /// Apex below the target (m).
    pub offset_m: f64,
}

/// Limits of the motion between its ends, which are given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest angle between thrust and the vertical (rad).
    pub tilt_rad: f64,
    /// Greatest speed (m/s).
    pub speed_m_s: f64,
    /// Greatest speed upwards (m/s).
    pub climb_m_s: f64,
    /// Greatest speed downwards (m/s).
    pub sink_m_s: f64,
    /// For descents. Without it the motion stays above the lower of its ends.
    pub glide_slope: Option<GlideSlope>,
}

/// One planning problem: point mass, thrust vector, constant exhaust velocity, uniform gravity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Problem {
    /// Motion and mass at the start.
    pub start: Start,
    /// Motion at the end.
    pub target: Target,
    /// Thrust and mass flow.
    pub engine: Engine,
    /// Limits of the motion.
    pub limits: Limits,
    /// Gravity, along +z (m/s²).
    pub gravity_m_s2: f64,
    /// Nodes of the plan: 30 in flight, 50 for proofs.
    pub nodes: usize,
}

/// Greatest least thrust as a share of the final weight. With a least thrust above the weight the relaxation
/// is not tight: the optimum burns more than its thrust needs.
pub const THRUST_FLOOR_SHARE: f64 = 0.85;

/// Why a problem is not put to the solver.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A number is not finite, or absurdly large.
    #[error("{0} is no number, or beyond a million")]
    NotFinite(&'static str),
    /// A number is out of its range.
    #[error("{what} is {value}, it must lie in {low} to {high}")]
    OutOfRange {
        /// Its name.
        what: &'static str,
        /// What was given.
        value: f64,
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
    },
    /// No propellant is left.
    #[error("mass {mass_kg} kg is not above the dry {dry_mass_kg} kg")]
    Propellant {
        /// Mass at the start (kg).
        mass_kg: f64,
        /// Dry mass (kg).
        dry_mass_kg: f64,
    },
    /// The engine cannot throttle deep enough below the weight.
    #[error(
        "least thrust {thrust_min_n} N exceeds {limit_n} N, \
         {THRUST_FLOOR_SHARE} of the weight at {mass_kg} kg"
    )]
    ThrustFloor {
        /// Lower end of the band (N).
        thrust_min_n: f64,
        /// What it may be (N).
        limit_n: f64,
        /// Lightest mass of the flight (kg).
        mass_kg: f64,
    },
}

impl Problem {
    /// The first reason not to solve it.
    pub fn refusal(&self) -> Option<Refusal> {
        self.out_of_range().or_else(|| self.out_of_propellant()).or_else(|| {
            let mass_kg = self.engine.dry_mass_kg;
            let limit_n = THRUST_FLOOR_SHARE * mass_kg * self.gravity_m_s2;
            let thrust_min_n = self.engine.thrust_min_n;
            (thrust_min_n > limit_n).then_some(Refusal::ThrustFloor { thrust_min_n, limit_n, mass_kg })
        })
    }

    fn out_of_propellant(&self) -> Option<Refusal> {
        let (mass_kg, dry_mass_kg) = (self.start.mass_kg, self.engine.dry_mass_kg);
        (mass_kg <= dry_mass_kg).then_some(Refusal::Propellant { mass_kg, dry_mass_kg })
    }

    /// Numbers with which no motion has a meaning; propellant and floor rule are not looked at.
    pub(super) fn out_of_range(&self) -> Option<Refusal> {
        let (start, target, engine, limits) = (&self.start, &self.target, &self.engine, &self.limits);
        let vectors = [
            ("start.position_ned_m", start.position_ned_m),
            ("start.velocity_ned_m_s", start.velocity_ned_m_s),
            ("start.thrust_acceleration_ned_m_s2", start.thrust_acceleration_ned_m_s2.unwrap_or_default()),
            ("target.position_ned_m", target.position_ned_m),
            ("target.velocity_ned_m_s", target.velocity_ned_m_s),
        ];
        let vector = vectors.iter().find(|(_, v)| !v.iter().all(|x| x.abs() <= 1e6));
        if let Some((what, _)) = vector {
            return Some(Refusal::NotFinite(what));
        }
        let glide = limits.glide_slope.unwrap_or(GlideSlope { angle_rad: 0.5, offset_m: 0.0 });
        let ranges = [
            ("start.mass_kg", start.mass_kg, 1e-3, 1e6),
            ("engine.dry_mass_kg", engine.dry_mass_kg, 1e-3, 1e6),
            ("engine.thrust_max_n", engine.thrust_max_n, 1e-3, 1e9),
            ("engine.thrust_min_n", engine.thrust_min_n, 1e-3, engine.thrust_max_n),
            ("engine.mass_flow_per_thrust_s_m", engine.mass_flow_per_thrust_s_m, 1e-9, 1.0),
            ("gravity_m_s2", self.gravity_m_s2, 1e-3, 1e3),
            ("limits.tilt_rad", limits.tilt_rad, 1e-3, 1.5),
            ("limits.speed_m_s", limits.speed_m_s, 1e-3, 1e5),
            ("limits.climb_m_s", limits.climb_m_s, 1e-3, 1e5),
            ("limits.sink_m_s", limits.sink_m_s, 1e-3, 1e5),
            ("limits.glide_slope.angle_rad", glide.angle_rad, 1e-3, 1.5),
            ("limits.glide_slope.offset_m", glide.offset_m, 0.0, 1e6),
            ("nodes", self.nodes as f64, 3.0, 1e4),
        ];
        // Written so that NaN is out of range.
        let wrong = ranges.iter().find(|(_, value, low, high)| !(low <= value && value <= high));
        wrong.map(|&(what, value, low, high)| Refusal::OutOfRange { what, value, low, high })
    }

    /// The target lies below the start.
    pub fn is_descent(&self) -> bool {
        self.target.position_ned_m.z > self.start.position_ned_m.z
    }

    /// Gravity as a vector (m/s²).
    pub(super) fn gravity_ned_m_s2(&self) -> Vec3 {
        Vec3::new(0.0, 0.0, self.gravity_m_s2)
    }

    /// Thrust per mass at the start, if given, moved inside the thrust band and the tilt limit (m/s²).
    pub(super) fn initial_thrust_acceleration_ned_m_s2(&self) -> Option<Vec3> {
        let wanted = self.start.thrust_acceleration_ned_m_s2?;
        let (low, high) = (self.engine.thrust_min_n, self.engine.thrust_max_n);
        let inside = INITIAL_THRUST_MARGIN * (high - low);
        let size = (wanted.norm() * self.start.mass_kg).clamp(low + inside, high - inside);
        let size_m_s2 = size / self.start.mass_kg;
        let lateral = libm::hypot(wanted.x, wanted.y);
        let tilt_rad =
            libm::atan2(lateral, -wanted.z).min((1.0 - INITIAL_THRUST_MARGIN) * self.limits.tilt_rad);
        let along = if lateral > 0.0 { size_m_s2 * libm::sin(tilt_rad) / lateral } else { 0.0 };
        Some(Vec3::new(wanted.x * along, wanted.y * along, -size_m_s2 * libm::cos(tilt_rad)))
    }
}

/// A given initial thrust lies this share inside its limits: on them the solver would have no interior.
const INITIAL_THRUST_MARGIN: f64 = 0.01;
