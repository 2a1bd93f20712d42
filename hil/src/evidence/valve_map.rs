//! The check of a valve's table of areas, in words.

use hopbench::propulsion::ValveMapCheck;

/// The check in words: rows, ends, and how closely angles come back from their areas.
pub fn text(map: &ValveMapCheck) -> String {
    let mut text = format!(
        "Valve map: {} rows of {}, shut to {:.3} deg, open at {:.3} deg with {:.3} mm2; \
         angle to area to angle within {:.1e} deg",
        map.rows,
        map.measure,
        map.shut_deg,
        map.open_deg,
        map.open_area_m2 * 1e6,
        map.round_trip_deg
    );
    if let Some(worst) = map.worst_row {
        text += &format!(
            "; worst row {:.3} deg: the others put its {:.4} mm2 at {:+.3} deg from there",
            worst.angle_deg,
            worst.area_m2 * 1e6,
            // No minus before what rounds to nothing.
            if worst.error_deg.abs() < 5e-4 { 0.0 } else { worst.error_deg }
        );
    }
    text + "."
}
