//! The engine against the figures published with the reference vehicle, computed by another implementation
//! of the same equations (the vehicle's page and its notes on the seed paper).

use crate::fixture::bare_engine::{at_angle, at_flow, condition, engine};
use hopbench::propulsion::{FeedMap, NozzleFlow, WarmStart};

fn near(got: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((got - expected).abs() <= tolerance, "{what}: {got}, expected {expected} ± {tolerance}");
}

/// T, ṁ_o, ṁ_f, O/F, Pc bar, P2 bar, x2, A mm², θ deg, Isp at R 35 mm, throat 10.0 mm, 290 K, 65 bar.
const WORKING_POINTS: [[f64; 10]; 5] = [
    [300.0, 0.15488, 0.04141, 3.740, 8.628, 22.278, 0.2412, 2.6503, 15.022, 155.85],
    [450.0, 0.21224, 0.04924, 4.310, 11.913, 28.868, 0.1792, 3.8152, 17.878, 175.49],
    [650.0, 0.28963, 0.05843, 4.957, 16.284, 36.667, 0.1017, 5.5923, 21.451, 190.43],
    [850.0, 0.36791, 0.06664, 5.521, 20.642, 43.463, 0.0249, 7.7408, 25.040, 199.46],
    [1000.0, 0.42718, 0.07235, 5.904, 23.899, 49.356, 0.0000, 10.4512, 28.888, 204.14],
];

#[test]
fn steady_working_points() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    for row in WORKING_POINTS {
        let inverse = engine.inverse(&feed, row[0], &condition(35.0, 10.0), WarmStart::default());
        let point = inverse.point;
        assert!(!inverse.saturated && point.solved);
        // Half a unit of the last printed digit, and as much again for the other side's tables.
        near(point.thrust_n, row[0], 1e-4, "thrust");
        near(point.oxidizer_kg_s, row[1], 1e-5, "oxidiser");
        near(point.fuel_kg_s, row[2], 1e-5, "fuel");
        near(point.of_ratio, row[3], 1e-3, "O/F");
        near(point.chamber_pa * 1e-5, row[4], 1e-3, "Pc");
        near(point.injector_inlet_pa * 1e-5, row[5], 2e-3, "P2");
        near(point.quality, row[6], 1e-4, "quality");
        near(inverse.valve_area_m2 * 1e6, row[7], 1e-3, "area");
        near(inverse.valve_rad.to_degrees(), row[8], 2e-3, "angle");
        near(point.isp_s, row[9], 1e-2, "Isp");
    }
}

#[test]
fn fully_open_valve_of_the_fresh_engine() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    let point = at_angle(&engine, &feed, 78.84, &condition(25.0, 9.8));
    near(point.oxidizer_kg_s, 0.581, 5e-4, "oxidiser");
    near(point.thrust_n, 1386.0, 0.6, "thrust");
}

#[test]
fn thrust_near_zero_against_flow() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    for (flow, thrust) in [(0.010, 4.68), (0.030, 32.2), (0.060, 88.9), (0.100, 166.9)] {
        let point = at_flow(&engine, &feed, flow, &condition(35.0, 10.0));
        near(point.oxidizer_kg_s, flow, 1e-12, "flow");
        near(point.thrust_n, thrust, if thrust < 10.0 { 0.006 } else { 0.06 }, "thrust");
    }
}

#[test]
fn thrust_near_zero_against_valve_angle() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    let rows =
        [(12.0, 169.8, 5.53), (10.0, 110.3, 3.91), (8.0, 62.2, 2.55), (6.0, 24.7, 1.51), (4.0, 5.87, 1.12)];
    for (degrees, thrust, chamber_bar) in rows {
        let point = at_angle(&engine, &feed, degrees, &condition(35.0, 10.0));
        near(point.thrust_n, thrust, if thrust < 10.0 { 0.02 } else { 0.1 }, "thrust");
        near(point.chamber_pa * 1e-5, chamber_bar, 0.006, "Pc");
    }
    near(at_angle(&engine, &feed, 2.0, &condition(35.0, 10.0)).thrust_n, 0.58, 0.006, "thrust");
}

#[test]
fn onset_of_separation_and_of_unchoked_flow() {
    let (engine, feed) = (engine(), FeedMap::new(65e5, 290.0));
    for (port, throat, thrust, chamber_bar) in
        [(25.0, 9.8, 225.3, 7.28), (35.0, 10.0, 221.5, 6.91), (55.0, 10.3, 216.1, 6.40)]
    {
        let condition = condition(port, throat);
        let boundary = |state: NozzleFlow| {
            let (mut low, mut high) = (0.001, 0.3);
            for _ in 0..50 {
                let middle = 0.5 * (low + high);
                let flow = at_flow(&engine, &feed, middle, &condition).nozzle_flow;
                let above = flow == NozzleFlow::Full || flow == state;
                if above { high = middle } else { low = middle }
            }
            at_flow(&engine, &feed, high, &condition)
        };
        let full = boundary(NozzleFlow::Full);
        near(full.thrust_n, thrust, 0.06, "onset of separation");
        near(full.chamber_pa * 1e-5, chamber_bar, 0.006, "Pc at onset");
        let choked = boundary(NozzleFlow::Separated);
        assert!((34.5..40.5).contains(&choked.thrust_n), "{}", choked.thrust_n);
        assert!((1.805e5..1.835e5).contains(&choked.chamber_pa), "{}", choked.chamber_pa);
        assert!((0.0305..0.0355).contains(&choked.oxidizer_kg_s), "{}", choked.oxidizer_kg_s);
    }
}

#[test]
fn choking_and_flashing_pressures_of_the_feed_system() {
    let feed = FeedMap::new(65e5, 290.0);
    near(feed.flash_pa() * 1e-5, 45.43, 0.006, "P_flash");
    near(feed.valve_critical_pa() * 1e-5, 44.4, 0.06, "valve's critical pressure");
    near(feed.tank().vapor_pressure_pa * 1e-5, 47.01, 0.006, "Psat");
    near(FeedMap::new(65e5, 288.0).flash_pa() * 1e-5, 43.39, 0.006, "P_flash at 288 K");
    near(FeedMap::new(65e5, 293.0).flash_pa() * 1e-5, 48.68, 0.006, "P_flash at 293 K");
    // Critical pressure of the injector over the throttle range, 14 to 37 bar.
    near(feed.inlet(22.278e5).critical_pa * 1e-5, 14.0, 1.0, "injector's critical pressure at 300 N");
}
