//! Flights of a campaign: values drawn, a scenario made of them, flown and judged.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use anyhow::Result;
use hopbench::input::{Diagnostic, InputError, Invalid};
use hopbench::scenario::Scenario;
use hopbench::simulation::{Flight, Report, fly_out};

use super::definition::{Campaign, Configuration};
use super::slot::{Slot, in_order};
use super::table::Row;
use crate::load;

/// A flight as a row of the table and as a report.
pub struct FlightResult {
    /// Its row of the table.
    pub row: Row,
    /// Its report, with the values that were drawn as overrides.
    pub report: Report,
}

impl Campaign {
    /// What flies in truth under one configuration and seed, and the values that were put in place,
    /// `KEY=VALUE`.
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
                .map_err(|invalid| self.document.error(vec![invalid.within(&within)]))?;
            let place = self.document.place_of(&["dispersion", &index.to_string()]);
            for (key, value) in changes {
                changed.push(format!("{key}={value}"));
                inputs.put(&place, &key, value)?;
            }
        }
        let mut scenario = inputs.scenario().map_err(|error| self.with_draws(error, seed, draws))?;
        scenario.file.expect = self.file.success.expect();
        Ok((scenario, changed))
    }

    /// An error with what was drawn for the scenario that has it.
    fn with_draws(&self, mut error: InputError, seed: u32, draws: &[Vec<f64>]) -> InputError {
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
    pub fn fly(&self, configuration: usize, seed: u32) -> Result<FlightResult, InputError> {
        let configuration = &self.configurations[configuration];
        let draws = self.draws(seed);
        let (scenario, overrides) = self.scenario(configuration, seed, &draws)?;
        let refused = |invalid: Invalid| {
            self.with_draws(
                load::contradiction(Path::new(&configuration.nominal.name), invalid),
                seed,
                &draws,
            )
        };
        let mut flight = Flight::dispersed(&scenario, seed, &configuration.data_sheet).map_err(refused)?;
        fly_out(&mut flight, |_| {});
        let mut report = flight.report();
        report.overrides = overrides;
        let run = seed.wrapping_sub(self.file.seed);
        let row = Row::new(run, &configuration.name, draws.concat(), &flight, &report);
        Ok(FlightResult { row, report })
    }

    /// Flies many, `jobs` at a time; `each` sees their rows in order, as they come. Once `stop` is set no
    /// flight begins, and those in the air are flown out.
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
            |slot| Ok(self.fly(slot.configuration, self.seed(slot.run)).map(|result| result.row)?),
            each,
        )
    }
}
