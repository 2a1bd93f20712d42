//! A vehicle from its files: the vehicle file, the tables it names, and the mass reports of a CAD program.
//!
//! Nothing is read here: whoever loads a vehicle hands over a function that gives the text of a file.

use std::fmt::Display;
use std::path::Path;

use super::{Table, Vehicle, VehicleError, VehicleFile};
use crate::input::{Document, InputError, InputText};

/// A vehicle file and the text of every file it names. Vehicles that differ in single values are made of it
/// without another look at the disk.
#[derive(Clone)]
pub struct VehicleInputs {
    /// The vehicle file, with the values that replace its own.
    pub document: Document,
    /// By index of the component.
    mass_reports: Vec<(usize, InputText)>,
    combustion_map: InputText,
    valve_area: InputText,
}

impl Vehicle {
    /// The vehicle of the file at `path`; `read` gives the text of a file: `|file|
    /// std::fs::read_to_string(file)`. Relative paths in the vehicle file start at its own folder.
    ///
    /// # Errors
    /// When a file cannot be read, or is wrong: with file, line, key and allowed range.
    pub fn load<E: Display>(
        path: impl AsRef<Path>,
        mut read: impl FnMut(&Path) -> Result<String, E>,
    ) -> Result<Self, InputError> {
        let path = path.as_ref();
        let document = InputText::read(path, &mut read)?.document()?;
        VehicleInputs::read(document, path, read)?.vehicle()
    }
}

impl VehicleInputs {
    /// Reads the files that a vehicle file names: `document`, which stands at `path`.
    ///
    /// # Errors
    /// When a file cannot be read, or a value of the document is wrong.
    pub fn read<E: Display>(
        document: Document,
        path: &Path,
        mut read: impl FnMut(&Path) -> Result<String, E>,
    ) -> Result<Self, InputError> {
        let file = VehicleFile::read(&document)?;
        let folder = folder_of(path);
        let mut beside = |name: &str| InputText::read(&folder.join(name), &mut read);
        let mass_reports = file
            .mass_reports()
            .into_iter()
            .map(|(index, name)| Ok((index, beside(&name)?)))
            .collect::<Result<_, InputError>>()?;
        let (combustion_map, valve_area) =
            (beside(&file.engine.map.file)?, beside(&file.feed.valve.area_file)?);
        Ok(Self { document, mass_reports, combustion_map, valve_area })
    }

    /// The vehicle file's values, its mass reports taken in.
    pub(crate) fn file(&self) -> Result<VehicleFile, InputError> {
        let mut file = VehicleFile::read(&self.document)?;
        for (index, report) in &self.mass_reports {
            file.import_mass(*index, &report.text).map_err(|e| report.error_at(e.line, e.message))?;
        }
        Ok(file)
    }

    /// The vehicle.
    ///
    /// # Errors
    /// When a value of a file is wrong.
    pub fn vehicle(&self) -> Result<Vehicle, InputError> {
        let (map, area) = (&self.combustion_map, &self.valve_area);
        Vehicle::new(self.file()?, &map.text, &area.text).map_err(|e| match e {
            VehicleError::Table { table: Table::Map, message } => InputError::of_file(&map.file, message),
            VehicleError::Table { table: Table::ValveArea, message } => {
                InputError::of_file(&area.file, message)
            }
            VehicleError::Invalid(invalid) => self.document.error(vec![invalid]),
        })
    }

    /// Text of the tables that the vehicle file names.
    pub(crate) fn tables(&self) -> [&str; 2] {
        [&self.combustion_map.text, &self.valve_area.text]
    }

    /// Every file, exactly as read: its name and its text.
    pub(crate) fn files(&self) -> impl Iterator<Item = (&str, &str)> {
        let reports = self.mass_reports.iter().map(|(_, report)| report);
        let named = reports.chain([&self.combustion_map, &self.valve_area]);
        std::iter::once((self.document.file(), self.document.text()))
            .chain(named.map(|one| (one.file.as_str(), one.text.as_str())))
    }
}

/// Where relative paths in a file start.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new("."))
}
