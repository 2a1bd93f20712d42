//! Legs on flat ground: vertical spring and damper, stick and slip, hold-down clamps.
//!
//! Each leg ends in a pad, a point fixed in the body when unloaded. Below the ground it is pushed up by `N =
//! k δ + k_b max(0, δ - stroke) + c δ'`, never pulled down, and held sideways by a spring and damper to its
//! anchor, the place where it touched down, up to the Coulomb cone `μ N`. An anchor is memory: fixed within a
//! step, so that the force is a pure function, and moved between steps ([`LandingGear::anchors_after`]): set
//! at touchdown, dragged along when the spring would leave the cone, dropped at lift-off. A pad that sticks
//! breaks away at `μ_s N`, `μ_s` being `static_friction_ratio` times μ, then slides at `μ N` for as long as
//! it moves on against its friction, and sticks again where it turns back.
//!
//! *Hold-down* grips the pads instead of adding a constraint ([`Grip::Held`]): the clamp pulls a foot down
//! exactly as hard as its leg would lift it, so leg springs work in tension too and feet do not slip. The
//! vehicle then rises by its elastic stretch alone (net lift over leg stiffness), and what the clamps
//! carry is an output. The plant passes `Grip::Held` until `[hold_down] release_time_s` after the command
//! and `Grip::Free` from the next step on. A vehicle bolted to a test stand is
//! [`super::rigid_body::clamped`].
//!
//! Source: penalty contact with anchored friction, as usual in multi-body codes (Flores and Lankarani,
//! Contact Force Models for Multibody Dynamics, 2016). Valid for flat level ground and small leg travel;
//! legs have no mass and pads no size.

use super::mass::MassProperties;
use super::{Kinematics, Load};
use crate::frame::{Vec3, skew};
use core::f64::consts::TAU;
use nalgebra::{Matrix3x6, Matrix6, Vector2};

/// Most legs a vehicle can have.
pub const MAX_LEGS: usize = 8;

/// Legs, the `[landing_gear]` table of a vehicle file.
#[derive(Clone, Debug, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LandingGear {
    /// Legs, the first on structural +x, evenly spaced.
    #[schemars(range(min = 3, max = 8))]
    pub leg_count: u32,
    /// Distance of the pads from the long axis (m).
    #[schemars(range(min = 0.05, max = 20.0))]
    pub pad_radius_m: f64,
    /// Height of the unloaded pads above the gimbal pivot (m), usually negative.
    #[schemars(range(min = -20.0, max = 20.0))]
    pub pad_z_m: f64,
    /// Vertical stiffness of a leg (N/m).
    #[schemars(range(min = 100.0, max = 1e6))]
    pub stiffness_n_m: f64,
    /// Vertical damping of a leg (N s/m).
    #[schemars(range(min = 0.0, max = 1e4))]
    pub damping_n_s_m: f64,
    /// Travel of a leg before it bottoms (m).
    #[schemars(range(min = 0.001, max = 5.0))]
    pub stroke_m: f64,
    /// Further stiffness beyond the stroke (N/m).
    #[schemars(range(min = 0.0, max = 2e6))]
    pub bottom_stiffness_n_m: f64,
    /// Coulomb friction coefficient of a pad.
    #[schemars(range(min = 0.0, max = 5.0))]
    pub friction_coefficient: f64,
    /// Friction at which a sticking pad breaks away, over that of a sliding one.
    #[serde(default = "one")]
    #[schemars(range(min = 1.0, max = 3.0))]
    pub static_friction_ratio: f64,
    /// Horizontal stiffness of a leg while its pad sticks (N/m).
    #[schemars(range(min = 100.0, max = 1e6))]
    pub stick_stiffness_n_m: f64,
    /// Horizontal damping of a leg (N s/m).
    #[schemars(range(min = 0.0, max = 1e4))]
    pub stick_damping_n_s_m: f64,
}

fn one() -> f64 {
    1.0
}

/// Hold-down, the `[hold_down]` table of a vehicle file.
#[derive(Clone, Debug, serde::Deserialize, serde::Serialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HoldDown {
    /// Time from the command until the feet are free (s).
    #[schemars(range(min = 0.0, max = 10.0))]
    pub release_time_s: f64,
}

/// Whether hold-down clamps have the feet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Grip {
    /// Clamped: a foot that is on the ground neither lifts nor slips.
    Held,
    /// Released: ground pushes and rubs.
    Free,
}

/// North and east of the place where each pad stands; `None`: in the air at the last step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Anchors {
    /// One entry per leg, in their order.
    pub pad_ned_m: [Option<Vector2<f64>>; MAX_LEGS],
    /// Whether it slides there.
    pub sliding: [bool; MAX_LEGS],
}

impl Anchors {
    /// Pads that stand.
    pub fn count(&self) -> usize {
        self.pad_ned_m.iter().flatten().count()
    }
}

/// What the ground does to the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// All legs together, about O, body FRD.
    pub load: Load,
    /// Force of the ground on each pad (N), NED: the third component is negative when it pushes up.
    pub pad_force_ned_n: [Vec3; MAX_LEGS],
    /// Pads at or below the ground.
    pub pads_down: usize,
    /// What the hold-down clamps carry, pulling down (N).
    pub hold_down_n: f64,
}

impl Contact {
    /// In the air.
    pub const NONE: Self = Self {
        load: Load::NONE,
        pad_force_ned_n: [Vec3::new(0.0, 0.0, 0.0); MAX_LEGS],
        pads_down: 0,
        hold_down_n: 0.0,
    };
}

impl LandingGear {
    /// Number of legs, not above [`MAX_LEGS`].
    pub fn legs(&self) -> usize {
        (self.leg_count as usize).min(MAX_LEGS)
    }

    /// Unloaded pad of a leg, body FRD (m).
    pub(crate) fn pad_body_m(&self, leg: usize) -> Vec3 {
        let (sine, cosine) = libm::sincos(TAU * leg as f64 / self.legs().max(1) as f64);
        // Structural (r cos, r sin, z) in FRD.
        Vec3::new(self.pad_radius_m * cosine, -self.pad_radius_m * sine, -self.pad_z_m)
    }

    /// Every unloaded pad, body FRD (m); unused entries are zero. Compute once and keep.
    pub fn pads_body_m(&self) -> [Vec3; MAX_LEGS] {
        let mut pads = [Vec3::zeros(); MAX_LEGS];
        for (leg, pad) in pads.iter_mut().enumerate().take(self.legs()) {
            *pad = self.pad_body_m(leg);
        }
        pads
    }

    /// Ground forces. `ground_down_m` is the ground's NED z, 0 at the pad surface. Pure: the anchors stay
    /// as they are during a step.
    #[inline]
    pub fn contact(
        &self,
        pads_body_m: &[Vec3; MAX_LEGS],
        motion: &Kinematics,
        ground_down_m: f64,
        anchors: &Anchors,
        grip: Grip,
    ) -> Contact {
        if self.clear_of_ground(motion, ground_down_m) && (grip == Grip::Free || anchors.count() == 0) {
            return Contact::NONE;
        }
        self.near_contact(pads_body_m, motion, ground_down_m, anchors, grip)
    }

    #[inline(never)]
    fn near_contact(
        &self,
        pads_body_m: &[Vec3; MAX_LEGS],
        motion: &Kinematics,
        ground_down_m: f64,
        anchors: &Anchors,
        grip: Grip,
    ) -> Contact {
        let mut contact = Contact::NONE;
        let body_from_ned = motion.ned_from_body.transpose();
        for (leg, &pad) in pads_body_m.iter().enumerate().take(self.legs()) {
            let place = motion.point_ned_m(pad);
            let anchor = anchors.pad_ned_m[leg];
            let depth_m = place.z - ground_down_m;
            let held = grip == Grip::Held && anchor.is_some();
            if depth_m <= 0.0 && !held {
                continue;
            }
            let velocity = motion.point_velocity_ned_m_s(pad);
            let mut up_n = self.leg_force_n(depth_m, velocity.z);
            if held {
                contact.hold_down_n += (-up_n).max(0.0);
            } else {
                up_n = up_n.max(0.0);
            }
            let mut sideways = velocity.xy() * -self.stick_damping_n_s_m;
            if let Some(anchor) = anchor {
                sideways -= (place.xy() - anchor) * self.stick_stiffness_n_m;
            }
            if !held {
                sideways = within(sideways, self.friction_limit_n(up_n, anchors.sliding[leg]));
            }
            let force_ned = Vec3::new(sideways.x, sideways.y, -up_n);
            contact.pad_force_ned_n[leg] = force_ned;
            contact.pads_down += 1;
            contact.load += Load::at(pad, body_from_ned * force_ned);
        }
        contact
    }

    /// Anchors for the next step.
    pub fn anchors_after(
        &self,
        pads_body_m: &[Vec3; MAX_LEGS],
        motion: &Kinematics,
        ground_down_m: f64,
        anchors: &Anchors,
        grip: Grip,
    ) -> Anchors {
        let mut next = Anchors::default();
        if self.clear_of_ground(motion, ground_down_m) && (grip == Grip::Free || anchors.count() == 0) {
            return next;
        }
        for (leg, &pad) in pads_body_m.iter().enumerate().take(self.legs()) {
            let place = motion.point_ned_m(pad);
            let depth_m = place.z - ground_down_m;
            let anchor = anchors.pad_ned_m[leg];
            next.pad_ned_m[leg] = match (anchor, grip) {
                (Some(anchor), Grip::Held) => Some(anchor),
                _ if depth_m <= 0.0 => None,
                (None, _) => Some(place.xy()),
                (Some(anchor), Grip::Free) => {
                    // The spring alone may reach the cone's edge, so a pad that stops slipping sticks there.
                    let velocity = motion.point_velocity_ned_m_s(pad);
                    let up_n = self.leg_force_n(depth_m, velocity.z).max(0.0);
                    let limit_m = |sliding| self.friction_limit_n(up_n, sliding) / self.stick_stiffness_n_m;
                    let stretch = place.xy() - anchor;
                    let sliding = if anchors.sliding[leg] {
                        velocity.xy().dot(&stretch) > 0.0
                    } else {
                        stretch.norm() > limit_m(false)
                    };
                    next.sliding[leg] = sliding;
                    Some(place.xy() - within(stretch, limit_m(sliding)))
                }
            };
        }
        next
    }

    /// Height of the gimbal pivot above the ground, at rest and upright under a weight (N) (m).
    pub fn rest_height_m(&self, weight_n: f64) -> f64 {
        let per_leg_n = weight_n / self.legs().max(1) as f64;
        let soft_m = per_leg_n / self.stiffness_n_m;
        let deflection_m = if soft_m <= self.stroke_m {
            soft_m
        } else {
            // k d + k_b (d - stroke) = N
            (per_leg_n + self.bottom_stiffness_n_m * self.stroke_m)
                / (self.stiffness_n_m + self.bottom_stiffness_n_m)
        };
        -self.pad_z_m - deflection_m
    }

    /// The fastest that a body on these legs can move by itself (1/s): an upper bound, at any attitude, of what a
    /// fixed step must resolve. Every pad acts with its stiffest spring and damper in every direction.
    pub(crate) fn fastest_rate_1_s(&self, pads_body_m: &[Vec3; MAX_LEGS], body: &MassProperties) -> f64 {
        let centre = body.centre_of_mass_body_m();
        // Sum of J^T J over the pads, J = (1, -r~): force of the pads per displacement of the body, and its
        // moment.
        let mut gain = Matrix6::zeros();
        for &pad in pads_body_m.iter().take(self.legs()) {
            let mut jacobian = Matrix3x6::zeros();
            jacobian.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&-skew(pad - centre));
            gain += jacobian.tr_mul(&jacobian);
        }
        let mut mass = Matrix6::zeros();
        mass.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(body.mass_kg);
        mass.fixed_view_mut::<3, 3>(3, 3).copy_from(&body.inertia_about_com_kg_m2());
        let Some(root) = mass.cholesky() else { return f64::INFINITY };
        // L^-1 G L^-T has the eigenvalues of M^-1 G and is symmetric.
        let Some(half) = root.l().solve_lower_triangular(&gain) else { return f64::INFINITY };
        let Some(whole) = root.l().solve_lower_triangular(&half.transpose()) else { return f64::INFINITY };
        let most_1_kg = whole.symmetric_eigenvalues().max();
        let stiffness_n_m = (self.stiffness_n_m + self.bottom_stiffness_n_m).max(self.stick_stiffness_n_m);
        let damping_n_s_m = self.damping_n_s_m.max(self.stick_damping_n_s_m);
        (stiffness_n_m * most_1_kg).sqrt().max(damping_n_s_m * most_1_kg)
    }

    /// Energy in the leg springs, vertical and sideways (J), for audits.
    pub fn spring_energy_j(
        &self,
        pads_body_m: &[Vec3; MAX_LEGS],
        motion: &Kinematics,
        ground_down_m: f64,
        anchors: &Anchors,
    ) -> f64 {
        let mut energy_j = 0.0;
        for (leg, &pad) in pads_body_m.iter().enumerate().take(self.legs()) {
            let place = motion.point_ned_m(pad);
            let depth_m = (place.z - ground_down_m).max(0.0);
            let beyond_m = (depth_m - self.stroke_m).max(0.0);
            energy_j += 0.5 * self.stiffness_n_m * depth_m * depth_m
                + 0.5 * self.bottom_stiffness_n_m * beyond_m * beyond_m;
            if let Some(anchor) = anchors.pad_ned_m[leg] {
                energy_j += 0.5 * self.stick_stiffness_n_m * (place.xy() - anchor).norm_squared();
            }
        }
        energy_j
    }

    /// Vertical force of a leg at a depth (m) that grows at a speed (m/s), negative in tension (N).
    fn leg_force_n(&self, depth_m: f64, down_m_s: f64) -> f64 {
        self.stiffness_n_m * depth_m
            + self.bottom_stiffness_n_m * (depth_m - self.stroke_m).max(0.0)
            + self.damping_n_s_m * down_m_s
    }

    /// Greatest friction of a pad under a load (N), at rest or sliding (N).
    fn friction_limit_n(&self, up_n: f64, sliding: bool) -> f64 {
        let ratio = if sliding { 1.0 } else { self.static_friction_ratio };
        ratio * self.friction_coefficient * up_n
    }

    /// Whether no pad can reach the ground at any attitude: the quick way out in flight.
    #[inline]
    pub(crate) fn clear_of_ground(&self, motion: &Kinematics, ground_down_m: f64) -> bool {
        let height_m = ground_down_m - motion.position_ned_m.z;
        height_m > self.pad_radius_m + self.pad_z_m.abs()
    }
}

/// The deepest of some body points that are below the ground: its index and depth (m). A nozzle exit or a
/// nose there means a crash.
pub fn deepest_below_ground(
    points_body_m: &[Vec3],
    motion: &Kinematics,
    ground_down_m: f64,
) -> Option<(usize, f64)> {
    let mut deepest = None;
    for (index, point) in points_body_m.iter().enumerate() {
        let depth_m = motion.point_ned_m(*point).z - ground_down_m;
        if depth_m > deepest.map_or(0.0, |(_, depth)| depth) {
            deepest = Some((index, depth_m));
        }
    }
    deepest
}

/// The vector, shortened to a length if it is longer.
fn within(v: Vector2<f64>, length: f64) -> Vector2<f64> {
    let norm = v.norm();
    if norm > length { v * (length / norm) } else { v }
}
