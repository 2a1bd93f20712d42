//! `hopbench px4-params`: a PX4 airframe and its parameters from the vehicle file.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use hopbench::scenario::FileKind;
use serde_json::json;

use super::{Common, DONE, in_range, option_error, print_json, print_text};
use crate::evidence::run_folder::RunFolder;
use crate::load;
use crate::px4::budget::Hop;
use crate::px4::{airframe, files};

/// Write a PX4 airframe and its parameters for this vehicle, SITL and HITL
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Vehicle file
    pub vehicle: PathBuf,
    /// Height of the hop that the propellant must suffice for (m)
    #[arg(long, value_name = "H", default_value_t = 10.0, allow_negative_numbers = true)]
    pub height_m: f64,
    /// Hover at its top (s)
    #[arg(long, value_name = "T", default_value_t = 8.0, allow_negative_numbers = true)]
    pub hold_s: f64,
}

/// The folder of a vehicle that nobody named one for: letters, digits and the like of its name.
fn folder_of(vehicle: &str) -> PathBuf {
    let plain = |c: char| if c.is_alphanumeric() || c == '-' || c == '_' { c } else { '_' };
    PathBuf::from(format!("px4-{}", vehicle.chars().map(plain).collect::<String>()))
}

/// Runs the command.
pub fn run(args: &Args, common: &Common) -> Result<ExitCode> {
    let hop = Hop {
        height_m: in_range("--height-m", args.height_m, 2.0, 200.0)?,
        hold_s: in_range("--hold-s", args.hold_s, 0.0, 300.0)?,
    };
    let document = load::document(&args.vehicle)?;
    if FileKind::of(&document)? != FileKind::Vehicle {
        return Err(load::unusable(&args.vehicle, "not a vehicle file: it has no [vehicle] table").into());
    }
    let vehicle = load::vehicle(&args.vehicle, &common.set)?;
    let airframe = airframe(&vehicle, &hop).map_err(|invalid| {
        if invalid.key.starts_with("--") {
            option_error(&invalid.key, invalid.message)
        } else {
            document.error(vec![invalid])
        }
    })?;
    let out = common.out.clone().unwrap_or_else(|| folder_of(&vehicle.name));
    let folder = RunFolder::create(&out)?;
    let files = files::files(&airframe);
    for file in &files {
        folder.write_file(file.name, &file.text)?;
    }
    if common.json {
        let names: Vec<_> = files.iter().map(|file| folder.path().join(file.name)).collect();
        print_json(&json!({ "out": folder.path(), "files": names, "airframe": airframe }))?;
        return Ok(ExitCode::from(DONE));
    }
    let mut text =
        format!("PX4 airframe of {}\n\n{}\n", airframe.vehicle, files::budget_table(&airframe.budget));
    let [x, y, z] = airframe.tuning.unit_effect_rad_s2;
    text += &format!(
        "At hover, {:.1} kg, full command turns the vehicle at {x:.2}, {y:.2} and {z:.2} rad/s² \
         about FRD x, y, z.\n\n",
        airframe.lander.mass_kg
    );
    for file in &files {
        text += &format!("{:<40} {}\n", folder.path().join(file.name).display().to_string(), file.purpose);
    }
    text += "\nWhat to do with them: docs/px4.md\n";
    print_text(&text)?;
    Ok(ExitCode::from(DONE))
}
