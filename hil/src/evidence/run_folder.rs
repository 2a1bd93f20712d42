//! The folder of a run is made before it, so that a full or forbidden disk is said before the flight.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use hopbench::simulation::Report;

/// Receives what a run leaves.
pub struct RunFolder(PathBuf);

impl RunFolder {
    /// Makes the folder that was asked for.
    ///
    /// # Errors
    /// When it cannot be made or written.
    pub fn create(path: &Path) -> Result<Self> {
        std::fs::create_dir_all(path).with_context(|| format!("cannot make {}", path.display()))?;
        let probe = path.join(".writable");
        std::fs::write(&probe, "").with_context(|| format!("cannot write in {}", path.display()))?;
        let _ = std::fs::remove_file(probe);
        Ok(Self(path.to_owned()))
    }

    /// Makes a folder of its own for a run that nobody named one for, `runs/SCENARIO-SECONDS`.
    ///
    /// # Errors
    /// When it cannot be made or written.
    pub fn for_run_of(scenario: &str) -> Result<Self> {
        let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        let seconds = since.map_or(0, |since| since.as_secs());
        Self::create(&Path::new("runs").join(format!("{scenario}-{seconds}-{}", std::process::id())))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Writes a file in the folder.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_file(&self, name: &str, text: &str) -> Result<()> {
        let path = self.0.join(name);
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Writes the report in the folder and notes the folder in the report. The file is complete or not there.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write_report(&self, report: &mut Report) -> Result<()> {
        report.run = Some(self.0.display().to_string());
        let (path, half) = (self.0.join("report.json"), self.0.join("report.json.part"));
        std::fs::write(&half, serde_json::to_string_pretty(report)? + "\n")
            .and_then(|()| std::fs::rename(&half, &path))
            .with_context(|| format!("cannot write {}", path.display()))
    }
}
