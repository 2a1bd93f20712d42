//! The folder of a campaign: its table of flights, and what the table belongs to.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use hopbench::hash::Fnv;
use serde::{Deserialize, Serialize};

use super::definition::Campaign;
use super::slot::Slot;
use super::table::{self, Row, Table};
use crate::load::unusable;

const MANIFEST: &str = "campaign.json";

/// What the table of a folder belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Manifest {
    /// Name of the campaign.
    campaign: String,
    /// What defines its flights.
    campaign_hash: String,
    /// The program that flew them.
    build_hash: String,
    /// Its version.
    version: String,
}

impl Manifest {
    fn new(campaign: &Campaign) -> Self {
        let mut build = Fnv::default();
        // Without its own file a program is known by its version alone.
        let program = std::env::current_exe().and_then(std::fs::read).unwrap_or_default();
        build.add(&program);
        Self {
            campaign: campaign.name.clone(),
            campaign_hash: campaign.hash(),
            build_hash: build.hex(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        }
    }

    fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(MANIFEST);
        match std::fs::read_to_string(&path) {
            Ok(text) => Ok(Some(serde_json::from_str(&text).map_err(|e| unusable(&path, e.to_string()))?)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(unusable(&path, e.to_string()).into()),
        }
    }
}

/// A folder that receives flights.
pub struct CampaignFolder {
    path: PathBuf,
    table: Table,
    columns: Vec<String>,
    rows: BTreeMap<Slot, Row>,
    sorted: bool,
}

impl CampaignFolder {
    /// Opens a folder for a campaign, and takes over the flights that it already holds.
    ///
    /// # Errors
    /// When it cannot be written, or holds flights of another campaign or program: they are not touched.
    pub fn open(path: &Path, campaign: &Campaign) -> Result<Self> {
        std::fs::create_dir_all(path).with_context(|| format!("cannot make {}", path.display()))?;
        let manifest = Manifest::new(campaign);
        match Manifest::read(path)? {
            Some(old) if old.campaign_hash != manifest.campaign_hash => {
                let message = format!(
                    "holds flights of another campaign ({} {}; this is {} {}): give another --out",
                    old.campaign, old.campaign_hash, manifest.campaign, manifest.campaign_hash
                );
                return Err(unusable(path, message).into());
            }
            Some(old) if old.build_hash != manifest.build_hash => {
                let message = "holds flights of another build of this program: give another --out";
                return Err(unusable(path, message).into());
            }
            Some(_) => {}
            None if path.join(table::FILE).exists() => {
                let message = format!("{} without {MANIFEST}: of which campaign is it?", table::FILE);
                return Err(unusable(path, message).into());
            }
            None => {
                let text = serde_json::to_string_pretty(&manifest)? + "\n";
                write_file(path, MANIFEST, &text)?;
            }
        }
        let columns = campaign.columns();
        let (table, found) = Table::open(path, &columns)?;
        let (rows, sorted) = by_slot(campaign, found);
        Ok(Self { path: path.to_owned(), table, columns, rows, sorted })
    }

    /// Whether a flight is there already.
    pub fn has(&self, slot: Slot) -> bool {
        self.rows.contains_key(&slot)
    }

    /// Adds a flight, at once.
    ///
    /// # Errors
    /// When the disk does not take it.
    pub fn add(&mut self, slot: Slot, row: Row) -> Result<()> {
        self.table.add(&row)?;
        self.sorted &= self.rows.last_key_value().is_none_or(|(last, _)| *last < slot);
        self.rows.insert(slot, row);
        Ok(())
    }

    /// Puts the table in order, where flights came in another.
    ///
    /// # Errors
    /// When the disk does not take it.
    pub fn sort(&mut self) -> Result<()> {
        if !self.sorted {
            table::write(&self.path, &self.columns, &self.rows.values().collect::<Vec<_>>())?;
            self.sorted = true;
        }
        Ok(())
    }

    /// Rows of these slots, as far as they have flown.
    pub fn rows(&self, slots: &[Slot]) -> Vec<&Row> {
        slots.iter().filter_map(|slot| self.rows.get(slot)).collect()
    }

    /// Writes a file; it is complete or as it was.
    ///
    /// # Errors
    /// When the disk does not take it.
    pub fn write_file(&self, name: &str, text: &str) -> Result<()> {
        write_file(&self.path, name, text)
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The flights of several folders, which must be of this campaign and lack none of it.
///
/// # Errors
/// When a folder is of another campaign, two disagree, or flights are missing.
pub fn merge(campaign: &Campaign, folders: &[PathBuf]) -> Result<Vec<(Slot, Row)>> {
    let hash = campaign.hash();
    let mut rows: BTreeMap<Slot, Row> = BTreeMap::new();
    for folder in folders {
        match Manifest::read(folder)? {
            Some(manifest) if manifest.campaign_hash == hash => {}
            Some(manifest) => {
                let message = format!(
                    "holds flights of another campaign ({} {}; this is {hash})",
                    manifest.campaign, manifest.campaign_hash
                );
                return Err(unusable(folder, message).into());
            }
            None => return Err(unusable(folder, format!("no {MANIFEST}: not a campaign's folder")).into()),
        }
        let (found, _) = by_slot(campaign, table::read(folder, &campaign.columns())?);
        for (slot, row) in found {
            if rows.get(&slot).is_some_and(|other| *other != row) {
                let message = format!("seed {} differs from another folder's", row.seed);
                return Err(unusable(folder, message).into());
            }
            rows.insert(slot, row);
        }
    }
    let slots = campaign.slots();
    let missing: Vec<&Slot> = slots.iter().filter(|slot| !rows.contains_key(slot)).collect();
    if let Some(first) = missing.first() {
        let message = format!(
            "these folders lack {} of {} flights, the first of seed {}; \
             flown with --runs N they merge with --runs N",
            missing.len(),
            slots.len(),
            campaign.seed(first.run)
        );
        return Err(unusable(&campaign.path, message).into());
    }
    rows.retain(|slot, _| slot.run < campaign.file.runs);
    Ok(rows.into_iter().collect())
}

/// Rows by what they are of, and whether they came in order, each once.
fn by_slot(campaign: &Campaign, found: Vec<Row>) -> (BTreeMap<Slot, Row>, bool) {
    let mut rows = BTreeMap::new();
    let mut sorted = true;
    for row in found {
        if let Some(configuration) = campaign.configuration(Some(&row.variant)) {
            let slot = Slot { run: row.run, configuration };
            sorted &= rows.last_key_value().is_none_or(|(last, _)| *last < slot);
            rows.insert(slot, row);
        }
    }
    (rows, sorted)
}

fn write_file(folder: &Path, name: &str, text: &str) -> Result<()> {
    let (path, half) = (folder.join(name), folder.join(format!("{name}.part")));
    std::fs::write(&half, text)
        .and_then(|()| std::fs::rename(&half, &path))
        .with_context(|| format!("cannot write {}", path.display()))
}
