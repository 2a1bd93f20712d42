//! The table of flights: one row each, text that reads back to the same bits, complete lines only.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use hopbench::event::EventKind;
use hopbench::input::InputError;
use hopbench::simulation::{Flight, Report};

use crate::load::unusable;

/// Name of the table in the folder of a campaign.
pub const FILE: &str = "flights.csv";

/// One flight of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Number of the run, from 0.
    pub run: u32,
    /// Its seed.
    pub seed: u32,
    /// Name of the configuration that flew.
    pub variant: String,
    /// What was drawn, in the order of the campaign's columns.
    pub draws: Vec<f64>,
    /// How the flight ended.
    pub outcome: String,
    /// It was as the campaign expects.
    pub success: bool,
    /// The first criterion that failed, or how the flight ended and what came before; empty after a success.
    pub cause: String,
    /// What was measured; [`Row::figure`] finds one by its column.
    pub figures: Vec<Option<f64>>,
    /// Hash over the states of the flight.
    pub state_hash: String,
}

type Figure = fn(&Report, &Flight) -> Option<f64>;

/// What is measured of every flight: column and where it comes from.
const FIGURES: [(&str, Figure); 28] = [
    ("touchdown_time_s", |r, _| r.touchdown.map(|t| t.time_s)),
    ("touchdown_vertical_speed_m_s", |r, _| r.touchdown.map(|t| t.vertical_speed_m_s)),
    ("touchdown_lateral_speed_m_s", |r, _| r.touchdown.map(|t| t.lateral_speed_m_s)),
    ("touchdown_tilt_deg", |r, _| r.touchdown.map(|t| t.tilt_deg)),
    ("position_error_m", |r, _| r.touchdown.map(|t| t.position_error_m)),
    ("control_error_m", |r, _| r.touchdown?.control_error_m),
    ("navigation_error_m", |r, _| r.touchdown?.navigation_error_m),
    ("touchdown_north_m", |_, f| Some(f.touchdown_offset_m()?.true_m[0])),
    ("touchdown_east_m", |_, f| Some(f.touchdown_offset_m()?.true_m[1])),
    ("estimated_north_m", |_, f| Some(f.touchdown_offset_m()?.estimated_m?[0])),
    ("estimated_east_m", |_, f| Some(f.touchdown_offset_m()?.estimated_m?[1])),
    ("hover_s", |r, _| Some(r.hover?.duration_s)),
    ("altitude_rms_m", |r, _| Some(r.hover?.altitude_rms_m)),
    ("lateral_rms_m", |r, _| Some(r.hover?.lateral_rms_m)),
    ("altitude_control_rms_m", |r, _| r.hover?.altitude_control_rms_m),
    ("lateral_control_rms_m", |r, _| r.hover?.lateral_control_rms_m),
    ("max_altitude_m", |r, _| Some(r.max_altitude_m)),
    ("peak_tilt_deg", |_, f| f.peak_tilt_deg()),
    ("simulated_s", |r, _| Some(r.timing.simulated_s)),
    ("initial_mass_kg", |r, _| Some(r.mass.initial_kg)),
    ("closure_error_kg", |r, _| Some(r.mass.closure_error_kg)),
    ("nitrous_left_kg", |r, _| Some(r.propellant.nitrous_left_kg)),
    ("fuel_left_kg", |r, _| Some(r.propellant.fuel_left_kg)),
    ("nitrogen_rcs_kg", |r, _| Some(r.propellant.nitrogen_rcs_kg)),
    ("measurements_rejected", |_, f| Some(f.estimate().health.rejected as f64)),
    ("filter_resets", |_, f| Some(f.estimate().health.resets as f64)),
    ("saturations", |r, _| Some(count(r, |kind| *kind == EventKind::Saturated))),
    ("aborts", |r, _| Some(count(r, EventKind::is_abort))),
];

fn count(report: &Report, is: fn(&EventKind) -> bool) -> f64 {
    report.events.iter().filter(|event| is(&event.kind)).count() as f64
}

impl Row {
    /// Row of a flight that has been flown and judged.
    pub fn new(run: u32, variant: &str, draws: Vec<f64>, flight: &Flight, report: &Report) -> Self {
        Self {
            run,
            seed: report.seed,
            variant: variant.to_owned(),
            draws,
            outcome: outcome(report),
            success: report.expect.passed,
            cause: cause(report),
            figures: FIGURES.iter().map(|(_, figure)| figure(report, flight)).collect(),
            state_hash: report.state_hash.clone(),
        }
    }

    /// A figure by the name of its column.
    pub fn figure(&self, name: &str) -> Option<f64> {
        let index = FIGURES.iter().position(|(column, _)| *column == name)?;
        self.figures.get(index).copied().flatten()
    }

    fn record(&self) -> Vec<String> {
        let mut record = vec![self.run.to_string(), self.seed.to_string(), self.variant.clone()];
        record.extend(self.draws.iter().map(f64::to_string));
        record.extend([self.outcome.clone(), self.success.to_string(), self.cause.clone()]);
        record.extend(self.figures.iter().map(|figure| figure.map_or(String::new(), |x| x.to_string())));
        record.push(self.state_hash.clone());
        record
    }

    fn parse(record: &csv::StringRecord, draws: usize) -> Option<Self> {
        if record.len() != 7 + draws + FIGURES.len() {
            return None;
        }
        let figure = |text: &str| -> Option<Option<f64>> {
            if text.is_empty() { Some(None) } else { text.parse().ok().map(Some) }
        };
        let after = 3 + draws;
        Some(Self {
            run: record[0].parse().ok()?,
            seed: record[1].parse().ok()?,
            variant: record[2].to_owned(),
            draws: (3..after).map(|i| record[i].parse().ok()).collect::<Option<_>>()?,
            outcome: record[after].to_owned(),
            success: record[after + 1].parse().ok()?,
            cause: record[after + 2].to_owned(),
            figures: (0..FIGURES.len()).map(|i| figure(&record[after + 3 + i])).collect::<Option<_>>()?,
            state_hash: record[after + 3 + FIGURES.len()].to_owned(),
        })
    }
}

fn outcome(report: &Report) -> String {
    let outcome = serde_json::to_value(report.outcome).ok();
    outcome.as_ref().and_then(|o| o.as_str()).unwrap_or("?").to_owned()
}

/// Why a flight failed, in one name.
fn cause(report: &Report) -> String {
    let Some(failed) = report.expect.items.iter().find(|item| !item.passed) else { return String::new() };
    if failed.name != "outcome" {
        let ends = ["_max_m_s", "_max_deg", "_max_m", "_min_fraction"];
        let bare = ends.iter().find_map(|end| failed.name.strip_suffix(end));
        return bare.unwrap_or(&failed.name).to_owned();
    }
    // What went before a bad end, if anything did.
    let explains = |kind: &EventKind| {
        use EventKind::{BottleLow, FuelBurnThrough, NitrousDepleted};
        kind.is_abort() || matches!(kind, NitrousDepleted | FuelBurnThrough | BottleLow)
    };
    let before = report.events.iter().find(|event| explains(&event.kind));
    let outcome = outcome(report);
    before.map_or(outcome.clone(), |event| format!("{outcome} ({})", event.kind))
}

/// A table on disk that grows by whole lines.
pub struct Table {
    path: PathBuf,
    file: File,
}

impl Table {
    /// Opens the table of a folder, or starts one, and gives the rows that it has. A line that was cut short
    /// by the end of an earlier run is taken away.
    ///
    /// # Errors
    /// When the table cannot be read or written, or is not one of this campaign.
    pub fn open(folder: &Path, columns: &[String]) -> Result<(Self, Vec<Row>)> {
        let path = folder.join(FILE);
        let cannot = || format!("cannot write {}", path.display());
        let rows = if path.exists() {
            let mut text = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
            let whole = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
            if whole < text.len() {
                text.truncate(whole);
                OpenOptions::new()
                    .write(true)
                    .open(&path)
                    .and_then(|file| file.set_len(whole as u64))
                    .with_context(cannot)?;
            }
            if text.is_empty() { Vec::new() } else { parse(&path, &text, columns)? }
        } else {
            Vec::new()
        };
        let file = OpenOptions::new().create(true).append(true).open(&path).with_context(cannot)?;
        let mut table = Self { path: path.clone(), file };
        if table.file.metadata().with_context(cannot)?.len() == 0 {
            table.line(&header(columns))?;
        }
        Ok((table, rows))
    }

    /// Adds a row, at once.
    ///
    /// # Errors
    /// When the disk does not take it.
    pub fn add(&mut self, row: &Row) -> Result<()> {
        self.line(&row.record())
    }

    /// One write for the whole line: what interrupts the program leaves whole lines.
    fn line(&mut self, record: &[String]) -> Result<()> {
        let mut line = csv::Writer::from_writer(Vec::new());
        line.write_record(record)?;
        let line = line.into_inner()?;
        self.file.write_all(&line).with_context(|| format!("cannot write {}", self.path.display()))
    }
}

/// Rows of the table in a folder.
///
/// # Errors
/// When it is not there, or not one of this campaign.
pub fn read(folder: &Path, columns: &[String]) -> Result<Vec<Row>> {
    let path = folder.join(FILE);
    let text = std::fs::read(&path).map_err(|e| unusable(&path, e.to_string()))?;
    Ok(parse(&path, &text, columns)?)
}

/// Writes a whole table; the file is complete or as it was.
///
/// # Errors
/// When the disk does not take it.
pub fn write(folder: &Path, columns: &[String], rows: &[&Row]) -> Result<()> {
    let (path, half) = (folder.join(FILE), folder.join(format!("{FILE}.part")));
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(header(columns))?;
    for row in rows {
        writer.write_record(row.record())?;
    }
    std::fs::write(&half, writer.into_inner()?)
        .and_then(|()| std::fs::rename(&half, &path))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Whether a name is that of a column of every table.
pub(super) fn reserved(name: &str) -> bool {
    header(&[]).iter().any(|column| column == name)
}

fn header(columns: &[String]) -> Vec<String> {
    let mut header: Vec<String> = ["run", "seed", "variant"].map(str::to_owned).to_vec();
    header.extend(columns.iter().cloned());
    header.extend(["outcome", "success", "cause"].map(str::to_owned));
    header.extend(FIGURES.iter().map(|(name, _)| (*name).to_owned()));
    header.push("state_hash".to_owned());
    header
}

fn parse(path: &Path, text: &[u8], columns: &[String]) -> Result<Vec<Row>, InputError> {
    let mut reader = csv::ReaderBuilder::new().flexible(true).from_reader(text);
    let headed = reader.headers().is_ok_and(|found| found.iter().eq(header(columns).iter()));
    if !headed {
        return Err(unusable(path, "its columns are not those of this campaign"));
    }
    let mut rows = Vec::new();
    for (index, record) in reader.records().enumerate() {
        let row = record.ok().and_then(|record| Row::parse(&record, columns.len()));
        let row = row.ok_or_else(|| unusable(path, format!("line {} is no flight", index + 2)))?;
        rows.push(row);
    }
    Ok(rows)
}
