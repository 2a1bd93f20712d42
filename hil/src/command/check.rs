//! `hopbench check`: is this file right, what does a key mean, which way does what turn.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

use anyhow::Result;
use hopbench::input::{self, Diagnostic, InputError};
use hopbench::plant::signs;
use hopbench::scenario::{CampaignFile, FileKind, ScenarioFile};
use hopbench::simulation::Flight;
use hopbench::vehicle::{Vehicle, VehicleFile};
use schemars::Schema;
use serde_json::json;

use super::{Common, DONE, UNEXPECTED, cores, print_json, print_text, refuse_out};
use crate::evidence::campaign::Campaign;
use crate::evidence::valve_map;
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
    refuse_out(common, "redirect what it prints")?;
    let document = load::document(&args.file)?;
    let kind = FileKind::of(&document)?;
    if args.schema {
        print_json(&schema(kind))?;
        return Ok(ExitCode::from(DONE));
    }
    if let Some(key) = &args.explain {
        explain(&args.file, kind, key, common)?;
        return Ok(ExitCode::from(DONE));
    }
    let vehicle = checked(&args.file, kind, common)?;
    if args.signs {
        let agrees = signs(&args.file, &vehicle, common)?;
        return Ok(ExitCode::from(if agrees { DONE } else { UNEXPECTED }));
    }
    let name = match kind {
        FileKind::Vehicle => "vehicle",
        FileKind::Scenario => "scenario",
        FileKind::Campaign => "campaign",
    };
    let map = (kind == FileKind::Vehicle).then(|| vehicle.engine.valve_area().check());
    if common.json {
        print_json(&json!({ "file": args.file, "kind": name, "valid": true, "valve_map": map }))?;
    } else {
        let map = map.map_or(String::new(), |map| valve_map::text(&map) + "\n");
        print_text(&format!("{}: a good {name} file\n{map}", args.file.display()))?;
    }
    Ok(ExitCode::from(DONE))
}

/// JSON schema of a kind of file.
fn schema(kind: FileKind) -> Schema {
    match kind {
        FileKind::Vehicle => schemars::schema_for!(VehicleFile),
        FileKind::Scenario => schemars::schema_for!(ScenarioFile),
        FileKind::Campaign => schemars::schema_for!(CampaignFile),
    }
}

/// Prints what a key means and what it may be.
fn explain(file: &Path, kind: FileKind, key: &str, common: &Common) -> Result<()> {
    // A scenario's key may also lie in its vehicle file.
    let explanation = input::explain(&schema(kind), key)
        .or_else(|| input::explain(&schema(FileKind::Vehicle), key.strip_prefix("vehicle.")?));
    let Some(mut text) = explanation else {
        let diagnostic = Diagnostic { line: None, key: key.to_owned(), message: "unknown key".to_owned() };
        return Err(InputError { file: file.display().to_string(), diagnostics: vec![diagnostic] }.into());
    };
    if matches!(key, "fault.component" | "fault.mode" | "fault.value") {
        text = format!("{text}\n{}", hopbench::fault::explain().trim_end());
    }
    if common.json { print_json(&json!({ "key": key, "text": text })) } else { print_text(&(text + "\n")) }
}

/// Checks all that a file would be refused for before its first step; the vehicle that it is, or that it
/// flies.
fn checked(file: &Path, kind: FileKind, common: &Common) -> Result<Vehicle> {
    match kind {
        FileKind::Vehicle => Ok(load::vehicle(file, &common.set)?),
        FileKind::Scenario => {
            let scenario = load::scenario(file, &common.set, None)?;
            let seed = common.seed.unwrap_or(scenario.file.seed);
            load::flyable(file, &scenario)?;
            Flight::new(&scenario, seed).map_err(|invalid| load::contradiction(file, invalid))?;
            Ok(scenario.vehicle)
        }
        FileKind::Campaign => {
            let mut campaign = Campaign::open(file, &common.set)?;
            campaign.file.seed = common.seed.unwrap_or(campaign.file.seed);
            // Every draw of every flight.
            campaign.check_draws(&campaign.slots(), cores(), &AtomicBool::new(false))?;
            Ok(campaign.configurations.remove(0).nominal.vehicle)
        }
    }
}

/// Prints the table of signs, computed by the plant; whether all of them agree with the convention.
fn signs(file: &Path, vehicle: &Vehicle, common: &Common) -> Result<bool> {
    let table = signs::table(vehicle).map_err(|invalid| load::contradiction(file, invalid))?;
    let agrees = table.iter().all(|row| row.agrees);
    if common.json {
        print_json(&json!({ "vehicle": vehicle.name, "agrees": agrees, "signs": table }))?;
        return Ok(agrees);
    }
    let mut text =
        format!("Signs of {}, computed by deflecting one command at a time in hover:\n\n", vehicle.name);
    text += &format!(
        "{:<14} {:<36} {:>12} {:>12} {:>12}   agrees\n",
        "command", "convention", "about x", "about y", "about z"
    );
    for row in &table {
        let [x, y, z] = row.angular_acceleration_rad_s2;
        let agrees = if row.agrees { "yes" } else { "NO" };
        text +=
            &format!("{:<14} {:<36} {x:>12.4} {y:>12.4} {z:>12.4}   {agrees}\n", row.command, row.convention);
    }
    text += "\nAngular acceleration in rad/s², body FRD: x leg 1, z down toward the nozzle.\n";
    print_text(&text)?;
    Ok(agrees)
}
