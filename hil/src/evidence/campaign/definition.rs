//! A campaign as its file defines it: scenario, variants, what is drawn, runs and seeds.

use std::path::{Path, PathBuf};

use hopbench::autopilot::Parameters;
use hopbench::hash::Fnv;
use hopbench::input::{Document, InputError, Invalid};
use hopbench::scenario::{CampaignFile, FileKind, Scenario, ScenarioInputs};
use hopbench::simulation::data_sheet;

use super::slot::Slot;
use super::table;
use crate::load::{self, Overrides};

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
    pub(super) document: Document,
}

/// One variant of a campaign.
pub struct Configuration {
    /// Its name.
    pub name: String,
    /// The scenario before anything is drawn.
    pub nominal: Scenario,
    /// What the autopilot knows of vehicle and mission.
    pub(super) data_sheet: Parameters,
    pub(super) inputs: ScenarioInputs,
    /// Every value of the scenario in force, before anything is drawn.
    pub(super) values: serde_json::Value,
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
                let invalid = Invalid::new(format!("dispersion.{index}.name"), message);
                return Err(document.error(vec![invalid]));
            }
        }
        let scenario = path.parent().unwrap_or(Path::new(".")).join(&file.scenario);
        let mut configurations = Vec::new();
        for (index, variant) in file.variants().into_iter().enumerate() {
            // The variant's values come last: they are what is compared.
            let mut set = overrides.to_vec();
            set.extend(variant.set.iter().map(|(key, value)| format!("{key}={value}")));
            let of_variant = |mut error: InputError| {
                if let Some(diagnostic) = error.diagnostics.first_mut()
                    && !variant.set.is_empty()
                {
                    let place = document.place_of(&["variant", &index.to_string()]);
                    diagnostic.message += &format!(" (variant \"{}\", {place})", variant.name);
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
            let data_sheet = data_sheet::nominal(&nominal)
                .map_err(|invalid| of_variant(load::contradiction(&scenario, invalid)))?;
            configurations.push(Configuration { name: variant.name, nominal, data_sheet, inputs, values });
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

    /// What defines the flights, beside the program: equal hashes, equal rows. How many there are, how many
    /// must succeed, and how they are described, does not count.
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
}
