//! Geodetic coordinates of points near the pad.
//!
//! The local tangent plane of WGS 84 through the pad, by way of Earth-centred coordinates, so nothing
//! is linearised: what is left is rounding, some nanometres. Latitude from Earth-centred coordinates by
//! Bowring, "Transformation from spatial to geographical coordinates", Survey Review 181 (1976) 323,
//! repeated once. Valid within some hundred kilometres of Earth's surface, off the poles.

use crate::frame::{Mat3, Vec3};

/// Semi-major axis of WGS 84 (m).
const A_M: f64 = 6_378_137.0;
/// Flattening of WGS 84.
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// First eccentricity squared.
const E2: f64 = FLATTENING * (2.0 - FLATTENING);

/// A point on or above the ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geodetic {
    /// Geodetic latitude (rad).
    pub latitude_rad: f64,
    /// Longitude (rad).
    pub longitude_rad: f64,
    /// Height (m), the ellipsoid taken as mean sea level.
    pub altitude_m: f64,
}

/// Origin and orientation of a local NED frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Datum {
    /// The origin.
    pub origin: Geodetic,
    origin_ecef_m: Vec3,
    ecef_from_ned: Mat3,
}

impl Datum {
    /// The frame whose origin has these coordinates.
    pub fn new(latitude_rad: f64, longitude_rad: f64, altitude_m: f64) -> Self {
        let origin = Geodetic { latitude_rad, longitude_rad, altitude_m };
        let (sin_lat, cos_lat) = libm::sincos(latitude_rad);
        let (sin_lon, cos_lon) = libm::sincos(longitude_rad);
        #[rustfmt::skip]
        let ecef_from_ned = Mat3::new(
            -sin_lat * cos_lon, -sin_lon, -cos_lat * cos_lon,
            -sin_lat * sin_lon,  cos_lon, -cos_lat * sin_lon,
             cos_lat,            0.0,     -sin_lat,
        );
        Self { origin, origin_ecef_m: ecef_m(&origin), ecef_from_ned }
    }

    /// Coordinates of a point given in this NED frame (m).
    pub fn geodetic(&self, position_ned_m: &Vec3) -> Geodetic {
        geodetic(&(self.origin_ecef_m + self.ecef_from_ned * position_ned_m))
    }

    /// Position in this NED frame of a point given by its coordinates (m).
    pub fn position_ned_m(&self, point: &Geodetic) -> Vec3 {
        self.ecef_from_ned.tr_mul(&(ecef_m(point) - self.origin_ecef_m))
    }
}

/// Earth-centred, Earth-fixed coordinates (m).
fn ecef_m(point: &Geodetic) -> Vec3 {
    let (sin_lat, cos_lat) = libm::sincos(point.latitude_rad);
    let (sin_lon, cos_lon) = libm::sincos(point.longitude_rad);
    let normal_m = A_M / (1.0 - E2 * sin_lat * sin_lat).sqrt();
    let equatorial_m = (normal_m + point.altitude_m) * cos_lat;
    Vec3::new(
        equatorial_m * cos_lon,
        equatorial_m * sin_lon,
        (normal_m * (1.0 - E2) + point.altitude_m) * sin_lat,
    )
}

/// Inverse of [`ecef_m`].
fn geodetic(ecef_m: &Vec3) -> Geodetic {
    let b_m = A_M * (1.0 - FLATTENING);
    let ep2 = E2 / (1.0 - E2); // second eccentricity squared
    let equatorial_m = (ecef_m.x * ecef_m.x + ecef_m.y * ecef_m.y).sqrt();
    // Reduced latitude of the point, then the geodetic latitude, then both again: Bowring's formula is
    // already good to 1e-9 rad near the surface, the second pass is below rounding.
    let mut reduced_rad = libm::atan2(A_M * ecef_m.z, b_m * equatorial_m);
    let mut latitude_rad = 0.0;
    for _ in 0..2 {
        let (s, c) = libm::sincos(reduced_rad);
        latitude_rad = libm::atan2(ecef_m.z + ep2 * b_m * s * s * s, equatorial_m - E2 * A_M * c * c * c);
        let (s, c) = libm::sincos(latitude_rad);
        reduced_rad = libm::atan2((1.0 - FLATTENING) * s, c);
    }
    let (s, c) = libm::sincos(latitude_rad);
    Geodetic {
        latitude_rad,
        longitude_rad: libm::atan2(ecef_m.y, ecef_m.x),
        altitude_m: equatorial_m * c + ecef_m.z * s - A_M * (1.0 - E2 * s * s).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise;

    /// Rounding: Earth-centred coordinates of 6.4e6 m carry 1e-9 m, some ten operations deep.
    #[test]
    fn there_and_back_is_exact_to_ten_nanometres() {
        let mut stream = noise::stream(1, "geodesy");
        for _ in 0..1000 {
            let latitude_rad = 1.5 * (2.0 * stream.uniform() - 1.0);
            let datum =
                Datum::new(latitude_rad, 3.1 * (2.0 * stream.uniform() - 1.0), 500.0 * stream.normal());
            for reach_m in [1.0, 1e3, 5e4] {
                let ned = stream.normal3() * reach_m;
                let back = datum.position_ned_m(&datum.geodetic(&ned));
                assert!((back - ned).amax() < 1e-8, "{latitude_rad} {ned}: {}", back - ned);
            }
        }
    }

    /// Straight up is altitude alone, and the radius of curvature gives the first-order shifts: the
    /// meridian's M = a(1-e2)/(1-e2 sin2)^1.5 and the prime vertical's N; the second order is d²/2R.
    #[test]
    fn small_steps_follow_the_radii_of_curvature() {
        let (latitude_rad, longitude_rad) = (0.5_f64, -1.4_f64);
        let datum = Datum::new(latitude_rad, longitude_rad, 0.0);
        let s2 = libm::sin(latitude_rad) * libm::sin(latitude_rad);
        let meridian_m = A_M * (1.0 - E2) / libm::pow(1.0 - E2 * s2, 1.5);
        let vertical_m = A_M / (1.0 - E2 * s2).sqrt();

        let up = datum.geodetic(&Vec3::new(0.0, 0.0, -100.0));
        assert!((up.altitude_m - 100.0).abs() < 1e-8);
        let north = datum.geodetic(&Vec3::new(100.0, 0.0, 0.0));
        assert!(((north.latitude_rad - latitude_rad) * meridian_m - 100.0).abs() < 1e-5);
        assert!((north.altitude_m - 100.0 * 100.0 / (2.0 * meridian_m)).abs() < 1e-7);
        let east = datum.geodetic(&Vec3::new(0.0, 100.0, 0.0));
        let parallel_m = vertical_m * libm::cos(latitude_rad);
        assert!(((east.longitude_rad - longitude_rad) * parallel_m - 100.0).abs() < 1e-5);
    }
}
