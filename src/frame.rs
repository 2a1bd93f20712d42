//! Frames and signs, defined once.
//!
//! * **World**: local north-east-down (NED), origin on the pad surface.
//! * **Body**: forward-right-down (FRD), origin at the gimbal pivot, z down the long axis toward the
//!   nozzle. Hover is the identity attitude, leg 1 points north, thrust acts along -z.
//! * **Structural** (parameters of a vehicle): same origin, x toward leg 1, z toward the nose.
//!
//! Attitude is `q_ned_from_body`, Hamilton, scalar first where components are listed. Inertia is in
//! the tensor convention, off-diagonal `Ixy = -Σ m x y`.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// A vector of three components; the frame is in the name of what holds it.
pub type Vec3 = Vector3<f64>;
/// A 3 x 3 matrix, inertia mostly.
pub type Mat3 = Matrix3<f64>;

/// Body FRD from structural components of a vector: a half turn about x. Its own inverse.
pub fn frd_from_structural(v: impl Into<Vec3>) -> Vec3 {
    let v = v.into();
    Vec3::new(v.x, -v.y, -v.z)
}

/// Structural from body FRD components of a vector: the same half turn.
pub fn structural_from_frd(v: Vec3) -> Vec3 {
    frd_from_structural(v)
}

/// Body FRD from structural components of an inertia tensor: Ixy and Ixz change sign, Iyz does not.
pub fn inertia_frd_from_structural(i: Mat3) -> Mat3 {
    let mut out = i;
    for (row, column) in [(0, 1), (0, 2), (1, 0), (2, 0)] {
        out[(row, column)] = -i[(row, column)];
    }
    out
}

/// Cross-product matrix: `skew(a) * b == a × b`.
pub fn skew(a: Vec3) -> Mat3 {
    Mat3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Inertia of a point mass of 1 kg at `r` about the origin, tensor convention: r·r E - r rᵀ.
pub fn point_inertia(r: Vec3) -> Mat3 {
    let (xx, yy, zz) = (r.x * r.x, r.y * r.y, r.z * r.z);
    let (xy, xz, yz) = (-r.x * r.y, -r.x * r.z, -r.y * r.z);
    Mat3::new(yy + zz, xy, xz, xy, xx + zz, yz, xz, yz, xx + yy)
}

/// Time derivative of a unit quaternion: q' = 1/2 q (0, ω), ω in body axes (rad/s).
pub fn quaternion_rate(q_ned_from_body: &Quaternion<f64>, rate_body_rad_s: Vec3) -> Quaternion<f64> {
    q_ned_from_body * Quaternion::from_parts(0.0, rate_body_rad_s) * 0.5
}

/// Angle between the body's long axis and the vertical (rad).
pub fn tilt_rad(q_ned_from_body: &UnitQuaternion<f64>) -> f64 {
    let down = q_ned_from_body * Vec3::z();
    libm::atan2(libm::hypot(down.x, down.y), down.z)
}

/// Angle about the long axis, from north toward east (rad), -π..π (ZYX Euler yaw).
pub fn heading_rad(q_ned_from_body: &UnitQuaternion<f64>) -> f64 {
    let forward = q_ned_from_body * Vec3::x();
    libm::atan2(forward.y, forward.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structural_half_turn_maps_axes_as_documented() {
        assert_eq!(frd_from_structural(Vec3::new(1.0, 2.0, 3.0)), Vec3::new(1.0, -2.0, -3.0));
        let i = Mat3::new(1.0, 4.0, 5.0, 4.0, 2.0, 6.0, 5.0, 6.0, 3.0);
        let turn = Mat3::from_diagonal(&Vec3::new(1.0, -1.0, -1.0));
        assert_eq!(inertia_frd_from_structural(i), turn * i * turn.transpose());
    }

    #[test]
    fn skew_is_the_cross_product() {
        let (a, b) = (Vec3::new(1.0, -2.0, 0.5), Vec3::new(0.3, 0.7, -4.0));
        assert_eq!(skew(a) * b, a.cross(&b));
    }

    #[test]
    fn a_quarter_turn_about_z_heads_east_and_does_not_tilt() {
        let q = UnitQuaternion::from_axis_angle(&Vec3::z_axis(), core::f64::consts::FRAC_PI_2);
        assert!((heading_rad(&q) - core::f64::consts::FRAC_PI_2).abs() < 1e-15);
        assert!(tilt_rad(&q).abs() < 1e-15);
    }
}
