//! Environment against other people's code: magnetic field and geodetic coordinates.

use hopbench::environment::Site;
use hopbench::environment::geodesy::{Datum, Geodetic};
use hopbench::environment::magnetic_field::{MagneticModel, field_ned_t};
use hopbench::frame::Vec3;

/// Rows of a reference file: lines that start with a number.
fn rows<const N: usize>(text: &str) -> Vec<[f64; N]> {
    let rows: Vec<[f64; N]> = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .skip(1)
        .map(|line| {
            let values: Vec<f64> = line.split(',').map(|v| v.parse().expect("a number")).collect();
            values.try_into().expect("the columns of the header")
        })
        .collect();
    assert!(!rows.is_empty());
    rows
}

/// pygeomag, double precision, NOAA's coefficients. Ours is single precision: a field of 6e4 nT is a sum of
/// some 200 terms rounded to 6e-8 of partial sums up to as large, so up to 6e4 x 6e-8 x sqrt(200) = 0.05 nT
/// typically, and the date is rounded to a day, at most 120 nT a year over 365, 0.33 nT. Bound: 0.5 nT.
#[test]
fn magnetic_field_agrees_with_a_double_precision_implementation() {
    for [latitude_deg, longitude_deg, altitude_m, year, north_nt, east_nt, down_nt] in
        rows(include_str!("magnetic_field_points.csv"))
    {
        let site = Site {
            latitude_deg,
            longitude_deg,
            altitude_m,
            gravity_m_s2: 9.80665,
            pressure_pa: 101_325.0,
            temperature_k: 288.15,
            air_density_kg_m3: 1.225,
            magnetic_model: MagneticModel::Wmm2025,
            magnetic_epoch_year: year,
        };
        let field_nt = field_ned_t(&site).unwrap() * 1e9;
        let error_nt = (field_nt - Vec3::new(north_nt, east_nt, down_nt)).amax();
        assert!(error_nt < 0.5, "{latitude_deg} {longitude_deg} {year}: {error_nt} nT");
    }
}

/// PROJ. It converts from Earth-centred coordinates by one pass of Bowring's formula, whose error grows with
/// height to 1 um at 9 km; ours repeats it, and its own round trip is exact to nanometres (unit test). The
/// file reaches 5 km far and 2.4 km up. Bound 0.3 um, far below the millimetre that a hop needs.
#[test]
fn geodetic_coordinates_agree_with_proj() {
    for [pad_latitude, pad_longitude, pad_altitude_m, north, east, down, latitude, longitude, altitude_m] in
        rows(include_str!("geodesy_points.csv"))
    {
        let datum = Datum::new(pad_latitude.to_radians(), pad_longitude.to_radians(), pad_altitude_m);
        let ours = datum.geodetic(&Vec3::new(north, east, down));
        let north_error_m = (ours.latitude_rad - latitude.to_radians()) * 6.4e6;
        let east_error_m =
            (ours.longitude_rad - longitude.to_radians()) * 6.4e6 * libm::cos(latitude.to_radians());
        let error_m = Vec3::new(north_error_m, east_error_m, ours.altitude_m - altitude_m).amax();
        assert!(error_m < 3e-7, "{pad_latitude} {north} {east} {down}: {error_m} m");

        let theirs = Geodetic {
            latitude_rad: latitude.to_radians(),
            longitude_rad: longitude.to_radians(),
            altitude_m,
        };
        let back_error_m = (datum.position_ned_m(&theirs) - Vec3::new(north, east, down)).amax();
        assert!(back_error_m < 3e-7, "{pad_latitude} {north} {east} {down}: back {back_error_m} m");
    }
}
