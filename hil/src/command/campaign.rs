//! `hopbench campaign`: dispersed flights, and what their number proves.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use anyhow::Result;
use hopbench::input::InputError;

use super::{Common, DONE, INTERRUPTED, UNEXPECTED, cores, interrupt, option_error, print_json, print_text};
use crate::bench::live::Live;
use crate::evidence::campaign::folder::{CampaignFolder, merge};
use crate::evidence::campaign::slot::{Shard, Slot, slots_of};
use crate::evidence::campaign::summary::Summary;
use crate::evidence::campaign::table::Row;
use crate::evidence::campaign::{Campaign, picture};
use crate::evidence::run_folder::RunFolder;
use crate::evidence::summary;

/// Fly a scenario many times with values drawn anew; statistics with confidence bounds
#[derive(Debug, clap::Args)]
#[command(override_usage = "hopbench campaign <CAMPAIGN> [OPTIONS]")]
pub struct Args {
    /// Campaign file; before --merge, which takes all that follows it for folders
    #[arg(required_unless_present = "merge")]
    pub campaign: Option<PathBuf>,
    /// Flights of each variant; replaces the file's
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub runs: Option<u32>,
    /// Flights at once; as many as there are cores if absent. The result does not depend on it
    #[arg(long, value_name = "J", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Fly share I of N, counted from 1, to be merged later
    #[arg(long, value_name = "I/N")]
    pub shard: Option<Shard>,
    /// Fly nothing: put the flights of these folders together in --out, and judge them:
    /// `campaign FILE --merge DIR DIR`, with --runs and --seed as they were flown
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with = "shard")]
    pub merge: Vec<PathBuf>,
    /// Fly the flight of this seed alone, the same bits as in the campaign, and print its full report
    #[arg(long, value_name = "SEED", conflicts_with_all = ["runs", "jobs", "shard", "merge"])]
    pub only: Option<u32>,
    /// With --only: the variant that flies; the first if absent
    #[arg(long, value_name = "NAME", requires = "only")]
    pub variant: Option<String>,
}

/// Runs the command. A campaign that was interrupted goes on where it stopped when it gets the same --out.
/// Whether it passed, and with it the exit code, follows from the rate met; whether that proves anything is
/// said beside it.
pub fn run(args: &Args, common: &Common) -> Result<ExitCode> {
    let campaign = open(args, common)?;
    if let Some(seed) = args.only {
        return fly_one(&campaign, seed, args, common);
    }
    let slots = slots_of(campaign.slots(), args.shard);
    let stop = interrupt::stop_on_signal()?;
    let folder = collect(&campaign, &slots, args, common, &stop)?;
    let rows = folder.rows(&slots);
    if rows.len() < slots.len() {
        // Only a signal ends it early.
        eprintln!(
            "interrupted: {} of {} flights kept in {}; the same --out goes on",
            rows.len(),
            slots.len(),
            folder.path().display()
        );
        return Ok(ExitCode::from(INTERRUPTED));
    }
    let mut result = Summary::new(&campaign, &rows, args.shard, &common.set);
    folder.write_file("summary.json", &(serde_json::to_string_pretty(&result)? + "\n"))?;
    write_pictures(&campaign, &rows, &folder)?;
    result.run = Some(folder.path().display().to_string());
    if common.json {
        print_json(&result)?;
    } else {
        print_text(&result.text())?;
    }
    Ok(ExitCode::from(if result.passed == Some(false) { UNEXPECTED } else { DONE }))
}

/// The campaign, with the runs and the seed of the command line.
fn open(args: &Args, common: &Common) -> Result<Campaign, InputError> {
    let Some(file) = &args.campaign else {
        let message = "took FILE for a folder: hopbench campaign FILE --merge DIR DIR, \
                       with --runs and --seed as they were flown";
        return Err(option_error("--merge", message));
    };
    let mut campaign = Campaign::open(file, &common.set)?;
    campaign.file.runs = args.runs.unwrap_or(campaign.file.runs);
    campaign.file.seed = common.seed.unwrap_or(campaign.file.seed);
    if campaign.file.seed.checked_add(campaign.file.runs).is_none() {
        let message = format!("{} leaves no seeds for {} runs", campaign.file.seed, campaign.file.runs);
        return Err(option_error("--seed", message));
    }
    Ok(campaign)
}

/// The folder of the campaign with all its flights: those it had, and those flown now, or merged from other
/// folders.
fn collect(
    campaign: &Campaign,
    slots: &[Slot],
    args: &Args,
    common: &Common,
    stop: &AtomicBool,
) -> Result<CampaignFolder> {
    let jobs = args.jobs.map_or_else(cores, usize::from);
    if args.merge.is_empty() {
        // A value that cannot be is said now, not after hours.
        campaign.check_draws(slots, jobs, stop)?;
    }
    let mut folder = match &common.out {
        Some(path) => CampaignFolder::open(path, campaign)?,
        None => CampaignFolder::open(RunFolder::for_run_of(&campaign.name)?.path(), campaign)?,
    };
    if args.merge.is_empty() {
        fly(campaign, slots, jobs, stop, &mut folder)?;
    } else {
        for (slot, row) in merge(campaign, &args.merge)? {
            if !folder.has(slot) {
                folder.add(slot, row)?;
            }
        }
    }
    folder.sort()?;
    Ok(folder)
}

/// Two pictures of each variant.
fn write_pictures(campaign: &Campaign, rows: &[&Row], folder: &CampaignFolder) -> Result<()> {
    for configuration in &campaign.configurations {
        let name = &configuration.name;
        let own: Vec<_> = rows.iter().copied().filter(|row| row.variant == *name).collect();
        let title = if campaign.file.variant.is_empty() {
            campaign.name.clone()
        } else {
            format!("{}, {name}", campaign.name)
        };
        let touchdown = picture::touchdown(&title, &own, &campaign.file.success)?;
        folder.write_file(&format!("touchdown_{name}.svg"), &touchdown)?;
        folder.write_file(&format!("position_{name}.svg"), &picture::position(&title, &own)?)?;
    }
    Ok(())
}

/// Flies what the folder lacks, until `stop` is set.
fn fly(
    campaign: &Campaign,
    slots: &[Slot],
    jobs: usize,
    stop: &AtomicBool,
    folder: &mut CampaignFolder,
) -> Result<()> {
    let missing: Vec<Slot> = slots.iter().copied().filter(|slot| !folder.has(*slot)).collect();
    let mut live = Live::stderr();
    if missing.len() < slots.len() {
        live.notice(format!("{} of {} flights are there already", slots.len() - missing.len(), slots.len()));
    }
    let start = Instant::now();
    let (mut flown, mut failed) = (0, 0);
    let mut slot = missing.iter();
    campaign.fly_all(&missing, jobs, stop, |row| {
        flown += 1;
        failed += usize::from(!row.success);
        if let Some(slot) = slot.next() {
            folder.add(*slot, row)?;
        }
        let elapsed_s = start.elapsed().as_secs_f64();
        live.show(start.elapsed().as_nanos() as u64, || {
            let rate_hz = flown as f64 / elapsed_s;
            let to_go_s = (missing.len() - flown) as f64 / rate_hz;
            format!(
                "{}: {flown} of {} flights, {failed} failed, {rate_hz:.1} flights/s, \
                 {:.0} min {:02.0} s to go",
                campaign.name,
                missing.len(),
                (to_go_s / 60.0).floor(),
                (to_go_s % 60.0).floor()
            )
        });
        Ok(())
    })?;
    let elapsed_s = start.elapsed().as_secs_f64();
    if flown > 0 {
        let rate_hz = flown as f64 / elapsed_s;
        live.notice(format!("{flown} flights in {elapsed_s:.1} s, {rate_hz:.1} flights/s, {jobs} at once"));
    }
    Ok(())
}

/// Flies one flight of a campaign and prints its report.
fn fly_one(campaign: &Campaign, seed: u32, args: &Args, common: &Common) -> Result<ExitCode> {
    let Some(configuration) = campaign.configuration(args.variant.as_deref()) else {
        let names: Vec<&str> = campaign.configurations.iter().map(|c| c.name.as_str()).collect();
        let name = args.variant.as_deref().unwrap_or_default();
        return Err(option_error(
            "--variant",
            format!("\"{name}\" is not allowed; one of {}", names.join(", ")),
        )
        .into());
    };
    let folder = common.out.as_deref().map(RunFolder::create).transpose()?;
    let start = Instant::now();
    let mut report = campaign.fly(configuration, seed)?.report;
    report.timing.wall_s = start.elapsed().as_secs_f64();
    report.timing.realtime_factor = report.timing.simulated_s / report.timing.wall_s;
    let drawn = report.overrides.clone();
    report.overrides = common.set.iter().cloned().chain(drawn).collect();
    if let Some(folder) = &folder {
        folder.write_report(&mut report)?;
    }
    if common.json {
        print_json(&report)?;
    } else {
        let values: String = report.overrides.iter().map(|pair| format!("set            {pair}\n")).collect();
        print_text(&(values + &summary::text(&report)))?;
    }
    Ok(ExitCode::from(if report.expect.passed { DONE } else { UNEXPECTED }))
}
