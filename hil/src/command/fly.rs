//! `hopbench fly`: a flight in memory, as fast as possible.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result};
use hopbench::plant::{Snapshot, column};
use hopbench::simulation;

use super::{Common, DONE, UNEXPECTED, option_error, print_json, print_text};
use crate::bench::pace::{Distribution, now_ns};
use crate::evidence::run_folder::RunFolder;
use crate::evidence::summary;
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
        let message = format!("{} is out of range; allowed: the divisors of 1000", args.csv_rate);
        return Err(option_error("--csv-rate", message).into());
    }
    let scenario = load::scenario(&args.scenario, &common.set, args.commands.as_deref())?;
    load::flyable(&args.scenario, &scenario)?;
    let seed = common.seed.unwrap_or(scenario.file.seed);
    let folder = common.out.as_deref().map(RunFolder::create).transpose()?;
    let mut table = args.csv.as_deref().map(|path| Table::create(path, args.csv_rate)).transpose()?;

    let start = Instant::now();
    let mut cost = StepCost { last_ns: None, durations: Distribution::new() };
    let mut written = Ok(());
    let flight = simulation::fly(&scenario, seed, |now| {
        cost.step();
        if let (Some(table), Ok(())) = (&mut table, &written) {
            written = table.row(now);
        }
    })
    .map_err(|invalid| load::contradiction(&args.scenario, invalid))?;
    written?;
    if let Some(table) = table {
        table.finish()?;
    }
    let wall_s = start.elapsed().as_secs_f64();

    let mut report = flight.report();
    report.timing.wall_s = wall_s;
    report.timing.realtime_factor = report.timing.simulated_s / wall_s;
    report.timing.step_us = cost.durations.percentiles();
    report.overrides = common.set.clone();
    if let Some(folder) = &folder {
        folder.write_report(&mut report)?;
    }
    if common.json {
        print_json(&report)?;
    } else {
        print_text(&summary::text(&report))?;
    }
    Ok(ExitCode::from(if report.expect.passed { DONE } else { UNEXPECTED }))
}

/// Wall time from one step to the next: plant, sensors and controller.
struct StepCost {
    last_ns: Option<u64>,
    durations: Distribution,
}

impl StepCost {
    fn step(&mut self) {
        let now = now_ns();
        if let Some(last_ns) = self.last_ns.replace(now) {
            self.durations.record_ns(now - last_ns);
        }
    }
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
        writer.write_record(column::csv().map(|column| column.name))?;
        Ok(Self { path: path.to_owned(), writer, every_us: 1_000_000 / u64::from(rate_hz) })
    }

    fn row(&mut self, now: &Snapshot) -> Result<()> {
        if now.time.us().is_multiple_of(self.every_us) {
            // Shortest text that reads back to the same bits.
            self.writer
                .write_record(column::csv().map(|column| column.of(now).to_string()))
                .with_context(|| format!("cannot write {}", self.path.display()))?;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<()> {
        self.writer.flush().with_context(|| format!("cannot write {}", self.path.display()))
    }
}
