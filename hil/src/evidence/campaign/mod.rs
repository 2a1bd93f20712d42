//! A campaign: one scenario flown many times with values drawn anew, as many flights at once as there are cores.
//!
//! The autopilot is told of the scenario as it is written; the plant flies what was drawn. A flight follows from
//! campaign and seed alone, so rows are the same bits whoever flies them, in whatever order, on however many
//! machines. Rows are written as flights end, in order, so that an interrupted campaign goes on where it stopped.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

use anyhow::Result;
use hopbench::autopilot::Parameters;
use hopbench::hash::Fnv;
use hopbench::input::{Diagnostic, Document, InputError, Invalid};
use hopbench::scenario::{CampaignFile, FileKind, Scenario, ScenarioInputs};
use hopbench::simulation::{Flight, Report, data_sheet, fly_out};

use crate::load::{self, Overrides};
use table::Row;

pub mod folder;
pub mod picture;
pub mod statistics;
pub mod summary;
pub mod table;

/// A campaign, ready to fly.
pub struct Campaign {
    /// Its name: that of the file without folder and ending.
    pub name: String,
    /// The file as it was named.
    pub path: PathBuf,
    /// The file's values, runs and seed as the command line replaced them.
    pub file: CampaignFile,
    /// What flies.
    pub configurations: Vec<Configuration>,
    document: Document,
}

/// One variant of a campaign.
pub struct Configuration {
    /// Its name.
    pub name: String,
    /// The scenario before anything is drawn.
    pub nominal: Scenario,
    /// What the autopilot is told.
    told: Parameters,
    inputs: ScenarioInputs,
    values: serde_json::Value,
}

/// A run under one configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slot {
    /// Number of the run, from 0.
    pub run: u32,
    /// Index of the configuration.
    pub configuration: usize,
}

/// A flight that has been flown.
pub struct Flown {
    /// Its row of the table.
    pub row: Row,
    /// Its report, with the values that were drawn as overrides.
    pub report: Report,
}

impl Campaign {
    /// Reads a campaign with its scenario; `overrides` replace values of the scenario.
    ///
    /// # Errors
    /// When a file is wrong, or the flight before anything is drawn cannot be.
    pub fn open(path: &Path, overrides: &Overrides) -> Result<Self, InputError> {
        let document = load::document(path)?;
        if FileKind::of(&document)? != FileKind::Campaign {
            return Err(load::unusable(path, "no campaign: it names no scenario = \"FILE\""));
        }
        let file = CampaignFile::read(&document)?;
        for (index, entry) in file.dispersion.iter().enumerate() {
            if table::reserved(entry.name()) {
                let message = format!("\"{}\" is a column of {} already", entry.name(), table::FILE);
                let fault = Invalid::new(format!("dispersion.{index}.name"), message);
                return Err(document.error(vec![fault]));
            }
        }
        let scenario = path.parent().unwrap_or(Path::new(".")).join(&file.scenario);
        let mut configurations = Vec::new();
        for (index, variant) in file.variants().into_iter().enumerate() {
            // The variant's values come last: they are what is compared.
            let mut set = overrides.to_vec();
            set.extend(variant.set.iter().map(|(key, value)| format!("{key}={value}")));
            let of_variant = |mut error: InputError| {
                if let Some(fault) = error.diagnostics.first_mut()
                    && !variant.set.is_empty()
                {
                    let place = document.place_of(&["variant", &index.to_string()]);
                    fault.message += &format!(" (variant \"{}\", {place})", variant.name);
                }
                error
            };
            let inputs = load::inputs(&scenario, &set, None).map_err(of_variant)?;
            let (nominal, values) =
                (inputs.scenario().map_err(of_variant)?, inputs.values().map_err(of_variant)?);
            load::flyable(&scenario, &nominal)?;
            if nominal.schedule.is_some() {
                let message = "a campaign judges landings: its scenario has no command schedule";
                return Err(load::unusable(&scenario, message));
            }
            let told = data_sheet::nominal(&nominal)
                .map_err(|fault| of_variant(load::contradiction(&scenario, fault)))?;
            configurations.push(Configuration { name: variant.name, nominal, told, inputs, values });
        }
        let name = path.file_stem().map_or_else(|| "campaign".into(), |s| s.to_string_lossy().into_owned());
        Ok(Self { name, path: path.to_owned(), file, configurations, document })
    }

    /// Columns of what is drawn.
    pub fn columns(&self) -> Vec<String> {
        self.file.dispersion.iter().flat_map(|entry| entry.columns()).collect()
    }

    /// Every run of every configuration, in order.
    pub fn slots(&self) -> Vec<Slot> {
        let all = 0..self.configurations.len();
        (0..self.file.runs)
            .flat_map(|run| all.clone().map(move |configuration| Slot { run, configuration }))
            .collect()
    }

    /// Index of a configuration; the first without a name.
    pub fn configuration(&self, name: Option<&str>) -> Option<usize> {
        name.map_or(Some(0), |name| self.configurations.iter().position(|one| one.name == name))
    }

    /// Seed of a run.
    pub fn seed(&self, run: u32) -> u32 {
        self.file.seed.wrapping_add(run)
    }

    /// What defines the flights, beside the program: equal hashes, equal rows. How many there are, how many must
    /// succeed, and how they are described, does not count.
    pub fn hash(&self) -> String {
        let mut hash = Fnv::default();
        let mut file = CampaignFile { runs: 0, description: String::new(), ..self.file.clone() };
        (file.success.min_rate, file.success.max_failures) = (0.0, None);
        file.dispersion.iter_mut().for_each(|entry| entry.source.clear());
        hash.add(&serde_json::to_vec(&file).unwrap_or_default());
        for configuration in &self.configurations {
            hash.add(configuration.name.as_bytes());
            hash.add(configuration.values.to_string().as_bytes());
            configuration.inputs.tables().iter().for_each(|table| hash.add(table.as_bytes()));
        }
        hash.hex()
    }

    /// What flies in truth under one configuration and seed, and the values that were put in place, `KEY=VALUE`.
    ///
    /// # Errors
    /// When a drawn value is one that no such vehicle or flight can have.
    pub fn dispersed(&self, configuration: usize, seed: u32) -> Result<(Scenario, Vec<String>), InputError> {
        self.scenario(&self.configurations[configuration], seed, &self.draws(seed))
    }

    fn scenario(
        &self,
        configuration: &Configuration,
        seed: u32,
        draws: &[Vec<f64>],
    ) -> Result<(Scenario, Vec<String>), InputError> {
        let mut inputs = configuration.inputs.clone();
        let mut changed = Vec::new();
        for (index, (entry, draw)) in self.file.dispersion.iter().zip(draws).enumerate() {
            let within = format!("dispersion.{index}");
            let changes = entry
                .changes(draw, &configuration.values)
                .map_err(|fault| self.document.error(vec![fault.within(&within)]))?;
            let place = self.document.place_of(&["dispersion", &index.to_string()]);
            for (key, value) in changes {
                changed.push(format!("{key}={value}"));
                inputs.put(&place, &key, value)?;
            }
        }
        let mut scenario = inputs.scenario().map_err(|error| self.drawn(error, seed, draws))?;
        scenario.file.expect = self.file.success.expect();
        Ok((scenario, changed))
    }

    /// The error of a scenario, with what was drawn for it.
    fn drawn(&self, mut error: InputError, seed: u32, draws: &[Vec<f64>]) -> InputError {
        let drawn: Vec<String> = self
            .file
            .dispersion
            .iter()
            .zip(draws)
            .map(|(entry, draw)| {
                let numbers: Vec<String> = draw.iter().map(f64::to_string).collect();
                format!("{} = {}", entry.columns().join(", "), numbers.join(", "))
            })
            .collect();
        error.diagnostics.push(Diagnostic {
            line: None,
            key: String::new(),
            message: format!("drawn for seed {seed}: {}", drawn.join("; ")),
        });
        error
    }

    /// Draws for many, and flies none; `stop` ends it early.
    ///
    /// # Errors
    /// The first, in order, of a value that no such vehicle or flight can have.
    pub fn check_draws(&self, slots: &[Slot], jobs: usize, stop: &AtomicBool) -> Result<(), InputError> {
        let draw = |slot: Slot| self.dispersed(slot.configuration, self.seed(slot.run)).map(|_| ());
        in_order(slots, jobs, stop, draw, |()| Ok(()))
    }

    fn draws(&self, seed: u32) -> Vec<Vec<f64>> {
        self.file.dispersion.iter().map(|entry| entry.draw(seed)).collect()
    }

    /// Flies one seed under one configuration.
    ///
    /// # Errors
    /// When a drawn value is one that no such vehicle or flight can have.
    pub fn fly(&self, configuration: usize, seed: u32) -> Result<Flown, InputError> {
        let configuration = &self.configurations[configuration];
        let draws = self.draws(seed);
        let (scenario, overrides) = self.scenario(configuration, seed, &draws)?;
        let refused = |fault: Invalid| {
            self.drawn(load::contradiction(Path::new(&configuration.nominal.name), fault), seed, &draws)
        };
        let mut flight = Flight::dispersed(&scenario, seed, &configuration.told).map_err(refused)?;
        fly_out(&mut flight, |_| {});
        let mut report = flight.report();
        report.overrides = overrides;
        let run = seed.wrapping_sub(self.file.seed);
        let row = Row::new(run, &configuration.name, draws.concat(), &flight, &report);
        Ok(Flown { row, report })
    }

    /// Flies many, `jobs` at a time; `each` sees their rows in order, as they come. Once `stop` is set no flight
    /// begins, and those in the air are flown out.
    ///
    /// # Errors
    /// The first, in order, of a flight that cannot be; or what `each` says.
    pub fn fly_all(
        &self,
        slots: &[Slot],
        jobs: usize,
        stop: &AtomicBool,
        each: impl FnMut(Row) -> Result<()>,
    ) -> Result<()> {
        in_order(
            slots,
            jobs,
            stop,
            |slot| Ok(self.fly(slot.configuration, self.seed(slot.run)).map(|flown| flown.row)?),
            each,
        )
    }
}

/// Works on many, `jobs` at a time; `each` sees the results in order, as they come. The first failure, in order,
/// ends it, and so does `stop`, after what has begun.
fn in_order<T: Send, E: Send>(
    slots: &[Slot],
    jobs: usize,
    stop: &AtomicBool,
    work: impl Fn(Slot) -> Result<T, E> + Sync,
    mut each: impl FnMut(T) -> Result<(), E>,
) -> Result<(), E> {
    let next = AtomicUsize::new(0);
    let (send, receive) = mpsc::channel();
    std::thread::scope(|threads| {
        for _ in 0..jobs.clamp(1, slots.len().max(1)) {
            let (next, work, send) = (&next, &work, send.clone());
            threads.spawn(move || {
                // Asked before a slot is taken: what is taken is done, so that no gap is left.
                while !stop.load(Ordering::Relaxed)
                    && let Some(slot) = slots.get(next.fetch_add(1, Ordering::Relaxed))
                {
                    if send.send((*slot, work(*slot))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(send);
        // Done before others that come first.
        let mut early = BTreeMap::new();
        let mut take = |slot: &Slot| {
            while !early.contains_key(slot) {
                // Without a sender all have stopped, or a worker has panicked, which the scope passes on.
                let Ok((slot, result)) = receive.recv() else { return Ok(()) };
                early.insert(slot, result);
            }
            early.remove(slot).map_or(Ok(()), |result| each(result?))
        };
        let result = slots.iter().try_for_each(&mut take);
        // Whatever ended it, nobody begins another.
        next.store(slots.len(), Ordering::Relaxed);
        result
    })
}
