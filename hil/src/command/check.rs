//! `hopbench check`: is this file right, what does a key mean, which way does what turn.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

use anyhow::Result;
use hopbench::input::{Diagnostic, InputError};
use hopbench::plant::signs;
use hopbench::propulsion::ValveMapCheck;
use hopbench::scenario::{CampaignFile, FileKind, ScenarioFile};
use hopbench::simulation::Flight;
use hopbench::vehicle::VehicleFile;
use serde_json::json;

use super::{Common, DONE, UNEXPECTED, leaves_nothing, print_json, print_text};
use crate::evidence::campaign::Campaign;
use crate::load;

/// Validate any scenario, vehicle or campaign file
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scenario, vehicle or campaign file
    pub file: PathBuf,
    /// Print and compute the table of signs from the plant itself
    #[arg(long, conflicts_with_all = ["explain", "schema"])]
    pub signs: bool,
    /// Say what a key means and what it may be
    #[arg(long, value_name = "KEY", conflicts_with = "schema")]
    pub explain: Option<String>,
    /// Print the JSON schema of this kind of file, for editors
    #[arg(long)]
    pub schema: bool,
}

/// Runs the command.
pub fn run(args: &Args, common: &Common) -> Result<ExitCode> {
    leaves_nothing(common, "redirect what it prints")?;
    let document = load::document(&args.file)?;
    let kind = FileKind::of(&document)?;
    let schema = match kind {
        FileKind::Vehicle => schemars::schema_for!(VehicleFile),
        FileKind::Scenario => schemars::schema_for!(ScenarioFile),
        FileKind::Campaign => schemars::schema_for!(CampaignFile),
    };
    if args.schema {
        print_json(&schema)?;
        return Ok(ExitCode::from(DONE));
    }
    if let Some(key) = &args.explain {
        // A scenario's key may also lie in its vehicle file.
        let vehicle_schema = schemars::schema_for!(VehicleFile);
        let text = hopbench::input::explain(&schema, key).or_else(|| {
            let key = key.strip_prefix("vehicle.")?;
            hopbench::input::explain(&vehicle_schema, key)
        });
        let Some(text) = text else {
            return Err(InputError {
                file: args.file.display().to_string(),
                diagnostics: vec![Diagnostic {
                    line: None,
                    key: key.clone(),
                    message: "unknown key".to_owned(),
                }],
            }
            .into());
        };
        let text = if matches!(key.as_str(), "fault.component" | "fault.mode" | "fault.value") {
            format!("{text}\n{}", hopbench::fault::explain().trim_end())
        } else {
            text
        };
        if common.json {
            print_json(&json!({ "key": key, "text": text }))?;
        } else {
            print_text(&(text + "\n"))?;
        }
        return Ok(ExitCode::from(DONE));
    }
    let vehicle = match kind {
        FileKind::Vehicle => load::vehicle(&args.file, &common.set)?,
        FileKind::Scenario => {
            let scenario = load::scenario(&args.file, &common.set, None)?;
            // All that a flight is refused for before its first step.
            let seed = common.seed.unwrap_or(scenario.file.seed);
            load::flyable(&args.file, &scenario)?;
            Flight::new(&scenario, seed).map_err(|fault| load::contradiction(&args.file, fault))?;
            scenario.vehicle
        }
        FileKind::Campaign => {
            let mut campaign = Campaign::open(&args.file, &common.set)?;
            campaign.file.seed = common.seed.unwrap_or(campaign.file.seed);
            // Every draw of every flight, so that none is refused later.
            campaign.check_draws(&campaign.slots(), super::campaign::cores(), &AtomicBool::new(false))?;
            campaign.configurations.remove(0).nominal.vehicle
        }
    };
    if args.signs {
        let table = signs::table(&vehicle).map_err(|fault| load::contradiction(&args.file, fault))?;
        let agrees = table.iter().all(|row| row.agrees);
        if common.json {
            print_json(&json!({ "vehicle": vehicle.name, "agrees": agrees, "signs": table }))?;
        } else {
            let mut text = format!(
                "Signs of {}, computed by deflecting one command at a time in hover:\n\n",
                vehicle.name
            );
            text += &format!(
                "{:<14} {:<36} {:>12} {:>12} {:>12}   agrees\n",
                "command", "convention", "about x", "about y", "about z"
            );
            for row in &table {
                text += &format!(
                    "{:<14} {:<36} {:>12.4} {:>12.4} {:>12.4}   {}\n",
                    row.command,
                    row.convention,
                    row.angular_acceleration_rad_s2[0],
                    row.angular_acceleration_rad_s2[1],
                    row.angular_acceleration_rad_s2[2],
                    if row.agrees { "yes" } else { "NO" }
                );
            }
            text += "\nAngular acceleration in rad/s², body FRD: x leg 1, z down toward the nozzle.\n";
            print_text(&text)?;
        }
        return Ok(ExitCode::from(if agrees { DONE } else { UNEXPECTED }));
    }
    let what = match kind {
        FileKind::Vehicle => "vehicle",
        FileKind::Scenario => "scenario",
        FileKind::Campaign => "campaign",
    };
    let map = (kind == FileKind::Vehicle).then(|| vehicle.engine.valve_area().check());
    if common.json {
        print_json(&json!({ "file": args.file, "kind": what, "valid": true, "valve_map": map }))?;
    } else {
        let map = map.map_or(String::new(), |map| valve_map(&map) + "\n");
        print_text(&format!("{}: a good {what} file\n{map}", args.file.display()))?;
    }
    Ok(ExitCode::from(DONE))
}

/// How good the valve's table is, in words.
pub(super) fn valve_map(map: &ValveMapCheck) -> String {
    let mut text = format!(
        "Valve map: {} rows of {}, shut to {:.3} deg, open at {:.3} deg with {:.3} mm2; angle to area to angle within {:.1e} deg",
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
