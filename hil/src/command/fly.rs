//! `hopbench fly`: a flight in memory, as fast as possible.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use hopbench::input::{Fault, InputError};
use hopbench::plant::Snapshot;
use hopbench::simulation::{self, Report};

use super::{Common, DONE, UNEXPECTED, print_json};
use crate::load;

/// Fly a scenario in memory: built-in autopilot, or an open-loop schedule
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scenario file
    pub scenario: PathBuf,
    /// Open-loop command schedule; replaces the scenario's
    #[arg(long, value_name = "FILE.csv")]
    pub commands: Option<PathBuf>,
    /// Write the state to this table
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Rows a second in the table; a divisor of 1000
    #[arg(long, value_name = "HZ", default_value_t = 100)]
    pub csv_rate: u32,
}

/// Runs the command.
pub fn run(args: &Args, common: &Common) -> Result<ExitCode> {
    if args.csv_rate == 0 || 1000 % args.csv_rate != 0 {
        return Err(InputError {
            file: "command line".to_owned(),
            faults: vec![Fault {
                line: None,
                key: "--csv-rate".to_owned(),
                message: format!("{} is out of range; allowed: the divisors of 1000", args.csv_rate),
            }],
        }
        .into());
    }
    let scenario = load::scenario(&args.scenario, &common.set, args.commands.as_deref())?;
    if scenario.schedule.is_none() && !scenario.file.sensors.enabled {
        return Err(load::unusable(&args.scenario, "sensors.enabled = false needs a command schedule").into());
    }
    let seed = common.seed.unwrap_or(scenario.file.seed);
    let mut table = args.csv.as_deref().map(|path| Table::create(path, args.csv_rate)).transpose()?;

    let start = Instant::now();
    let mut written = Ok(());
    let flight = simulation::fly(&scenario, seed, |now| {
        if let (Some(table), Ok(())) = (&mut table, &written) {
            written = table.row(now);
        }
    })
    .map_err(|fault| load::contradiction(&args.scenario, fault))?;
    written?;
    if let Some(table) = table {
        table.finish()?;
    }
    let wall_s = start.elapsed().as_secs_f64();

    let mut report = flight.report(false);
    report.timing.wall_s = wall_s;
    report.timing.realtime_factor = report.timing.simulated_s / wall_s;
    report.overrides = common.set.clone();
    if let Some(folder) = &common.out {
        write_run(folder, &mut report)?;
    }
    if common.json {
        print_json(&report)?;
    } else {
        print!("{}", summary(&report));
    }
    Ok(ExitCode::from(if report.expect.passed { DONE } else { UNEXPECTED }))
}

/// The state of a flight as a CSV table.
struct Table {
    path: PathBuf,
    writer: csv::Writer<BufWriter<File>>,
    every_us: u64,
}

impl Table {
    fn create(path: &Path, rate_hz: u32) -> Result<Self> {
        let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
        let mut writer = csv::Writer::from_writer(BufWriter::new(file));
        writer.write_record(Snapshot::CSV_HEADER.split(','))?;
        Ok(Self { path: path.to_owned(), writer, every_us: 1_000_000 / u64::from(rate_hz) })
    }

    fn row(&mut self, now: &Snapshot) -> Result<()> {
        if now.time.us().is_multiple_of(self.every_us) {
            // Shortest text that reads back to the same bits.
            self.writer
                .write_record(now.csv_row().map(|x| x.to_string()))
                .with_context(|| format!("cannot write {}", self.path.display()))?;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<()> {
        self.writer.flush().with_context(|| format!("cannot write {}", self.path.display()))
    }
}

/// Leaves the report in the run's folder and notes the folder in it.
pub fn write_run(folder: &Path, report: &mut Report) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    report.run = Some(folder.display().to_string());
    let path = folder.join("report.json");
    std::fs::write(&path, serde_json::to_string_pretty(report)? + "\n")
        .with_context(|| format!("cannot write {}", path.display()))
}

/// The report for people.
pub fn summary(report: &Report) -> String {
    use std::fmt::Write;
    let mut text = String::new();
    let mut line = |l: String| {
        let _ = writeln!(text, "{l}");
    };
    let outcome = serde_json::to_value(report.outcome).ok();
    let outcome = outcome.as_ref().and_then(|o| o.as_str()).unwrap_or("?");
    line(format!("{} (seed {}): {outcome}", report.scenario, report.seed));
    for event in &report.events {
        line(format!("  {:>8.3} s  {:<18} {}", event.time_s, event.name, event.detail));
    }
    if let Some(t) = &report.touchdown {
        line(format!(
            "touchdown      {:.2} m/s down, {:.2} m/s across, tilt {:.2} deg, {:.2} m from the target",
            t.vertical_speed_m_s, t.lateral_speed_m_s, t.tilt_deg, t.position_error_m
        ));
        if let (Some(control), Some(navigation)) = (t.control_error_m, t.navigation_error_m) {
            line(format!("               control error {control:.2} m, navigation error {navigation:.2} m"));
        }
    }
    line(format!("highest        {:.2} m", report.max_altitude_m));
    if let Some(h) = &report.hover {
        line(format!(
            "hover          {:.1} s, height {:.3} m RMS, sideways {:.3} m RMS",
            h.duration_s, h.altitude_rms_m, h.lateral_rms_m
        ));
    }
    let p = &report.propellant;
    line(format!(
        "used           N2O {:.3} kg ({:.3} left), fuel {:.3} kg ({:.3} left), nitrogen {:.3} kg by thrusters, {:.3} vented",
        p.nitrous_used_kg,
        p.nitrous_left_kg,
        p.fuel_used_kg,
        p.fuel_left_kg,
        p.nitrogen_rcs_kg,
        p.nitrogen_vented_kg
    ));
    let m = &report.mass;
    line(format!(
        "mass           {:.3} kg to {:.3} kg, closure error {:.1e} kg",
        m.initial_kg, m.final_kg, m.closure_error_kg
    ));
    let t = &report.timing;
    line(format!(
        "time           {:.3} s in {:.3} s, {:.0} x real time, {} steps, {} overruns",
        t.simulated_s, t.wall_s, t.realtime_factor, t.steps, t.overruns
    ));
    for item in &report.expect.items {
        let mark = if item.passed { "ok    " } else { "FAILED" };
        line(format!("expect {mark}  {:<36} {} (limit {})", item.name, item.value, item.limit));
    }
    line(format!("state hash     {}", report.state_hash));
    text
}
