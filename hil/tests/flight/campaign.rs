//! Whole flights drawn as the project's campaigns draw them: every one lands, and predictive control lands no
//! worse than the cascade.
//!
//! A gate of few seeds: it shows that nothing is broken, not how often a flight fails. A thousand flights and
//! their confidence are what `hopbench campaign` is for.

#![allow(clippy::disallowed_methods, clippy::disallowed_macros)] // reads and writes files, prints figures

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use hopbench_hil::evidence::campaign::Campaign;
use hopbench_hil::evidence::campaign::table::Row;

/// Control error of the hover (m), rms: the estimate against the reference.
const HOVER_ALTITUDE_RMS_M: f64 = 0.3;
const HOVER_LATERAL_RMS_M: f64 = 0.5;

fn scenarios() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios")
}

/// The first runs of a campaign, all its variants.
fn flown(path: &Path, runs: u32) -> Vec<Row> {
    let mut campaign = Campaign::open(path, &[]).unwrap();
    campaign.file.runs = runs;
    let mut rows = Vec::new();
    let keep = |row| {
        rows.push(row);
        Ok(())
    };
    campaign.fly_all(&campaign.slots(), 2, &AtomicBool::new(false), keep).unwrap();
    rows
}

fn figure(row: &Row, name: &str) -> f64 {
    row.figure(name)
        .unwrap_or_else(|| panic!("seed {} {}: no {name}, {}", row.seed, row.variant, row.outcome))
}

fn greatest(rows: &[Row], name: &str) -> f64 {
    rows.iter().map(|row| figure(row, name)).fold(0.0, f64::max)
}

fn median(rows: &[&Row], name: &str) -> f64 {
    let mut values: Vec<f64> = rows.iter().map(|row| figure(row, name)).collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    0.5 * (values[(values.len() - 1) / 2] + values[middle])
}

#[test]
fn every_hop_of_both_vehicles_lands_within_limits_and_hovers_on_its_reference() {
    for name in ["hop_50m", "hop_50m_gt"] {
        let rows = flown(&scenarios().join(format!("campaigns/{name}.toml")), 20);
        assert_eq!(rows.len(), 20);
        for row in &rows {
            assert!(row.success, "{name}, seed {}: {} {}", row.seed, row.outcome, row.cause);
            let altitude_m = figure(row, "altitude_control_rms_m");
            let lateral_m = figure(row, "lateral_control_rms_m");
            assert!(altitude_m <= HOVER_ALTITUDE_RMS_M, "{name}, seed {}: {altitude_m} m", row.seed);
            assert!(lateral_m <= HOVER_LATERAL_RMS_M, "{name}, seed {}: {lateral_m} m", row.seed);
            assert_eq!(figure(row, "aborts"), 0.0, "{name}, seed {}", row.seed);
        }
        eprintln!(
            "{name}: worst hover rms altitude {:.3} lateral {:.3} m, touchdown {:.3} down {:.3} m/s across, \
             {:.2} deg, {:.3} m",
            greatest(&rows, "altitude_control_rms_m"),
            greatest(&rows, "lateral_control_rms_m"),
            greatest(&rows, "touchdown_vertical_speed_m_s"),
            greatest(&rows, "touchdown_lateral_speed_m_s"),
            greatest(&rows, "touchdown_tilt_deg"),
            greatest(&rows, "control_error_m"),
        );
    }
}

/// The campaign's own dispersions, both control laws on each seed.
#[test]
fn predictive_control_lands_no_worse_than_the_cascade_on_the_same_seeds() {
    let written = std::fs::read_to_string(scenarios().join("campaigns/hop_50m.toml")).unwrap();
    let scenario = scenarios().join("gusty_hop.toml");
    let placed = written.replace("\"../gusty_hop.toml\"", &format!("'{}'", scenario.display()));
    assert_ne!(placed, written);
    let variants = ["predictive", "cascaded"]
        .map(|law| format!("\n[[variant]]\nname = \"{law}\"\nset = {{ \"mission.control\" = \"{law}\" }}\n"));
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("flight-campaign");
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("paired.toml");
    std::fs::write(&path, placed + &variants.concat()).unwrap();

    let rows = flown(&path, 10);
    let of = |law: &str| rows.iter().filter(|row| row.variant == law).collect::<Vec<_>>();
    let (predictive, cascaded) = (of("predictive"), of("cascaded"));
    assert_eq!((predictive.len(), cascaded.len()), (10, 10));
    for (one, other) in predictive.iter().zip(&cascaded) {
        assert_eq!((one.seed, &one.draws), (other.seed, &other.draws));
        assert_ne!(one.state_hash, other.state_hash, "the variants fly alike");
    }
    let names = ["lateral_control_rms_m", "altitude_control_rms_m", "touchdown_lateral_speed_m_s"];
    for name in names {
        eprintln!("{name}: median {:.4} against {:.4}", median(&predictive, name), median(&cascaded, name));
    }
    for name in names {
        assert!(median(&predictive, name) <= median(&cascaded, name), "{name}");
    }
    for row in &rows {
        assert!(row.success, "{}, seed {}: {} {}", row.variant, row.seed, row.outcome, row.cause);
    }
}
