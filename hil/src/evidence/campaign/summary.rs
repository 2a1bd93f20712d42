//! What a campaign shows: rates with their bounds, failures by cause, spread of the figures, comparison of
//! variants.

use std::collections::BTreeMap;
use std::fmt::Write;

use hopbench::scenario::Success;
use serde::Serialize;

use super::definition::Campaign;
use super::slot::Shard;
use super::statistics::{Median, RateBounds, mcnemar_p, quantile};
use super::table::Row;

/// A campaign, as reported. Keys are a contract.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Name of the campaign.
    pub campaign: String,
    /// Its description.
    pub description: String,
    /// What defines its flights.
    pub campaign_hash: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Runs of each variant, of all shards.
    pub runs: u32,
    /// Seed of the first run.
    pub seed: u32,
    /// Share that this is; null: all of it.
    pub shard: Option<String>,
    /// Criteria.
    pub success: Success,
    /// Whether every variant succeeded often enough; null for a shard, which proves nothing alone.
    pub passed: Option<bool>,
    /// Whether the flights prove the rate wanted: the one-sided bound of every variant reaches it; null for a
    /// shard.
    pub proven: Option<bool>,
    /// What flew.
    pub variants: Vec<VariantSummary>,
    /// Each further variant against the first.
    pub comparisons: Vec<Comparison>,
    /// Folder of the campaign, if one was written.
    pub run: Option<String>,
    /// Values that replaced those of the files, `KEY=VALUE`; absent when there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub overrides: Vec<String>,
}

/// One configuration, as reported.
#[derive(Clone, Debug, Serialize)]
pub struct VariantSummary {
    /// Its name.
    pub name: String,
    /// Flights.
    pub flights: u32,
    /// Those that were as they should be.
    pub successes: u32,
    /// Their share; null without flights.
    pub success_rate: Option<f64>,
    /// Clopper and Pearson's bounds of it.
    pub clopper_pearson: RateBounds,
    /// What went wrong, most often first.
    pub failures: Vec<FailureGroup>,
    /// Spread of what was measured, over the flights that had it.
    pub figures: BTreeMap<&'static str, Spread>,
    /// The flights that came closest to a limit, or went over it.
    pub worst: Vec<WorstFlight>,
}

/// Failures of one cause.
#[derive(Clone, Debug, Serialize)]
pub struct FailureGroup {
    /// The first criterion that failed, or how the flight ended and what came before.
    pub cause: String,
    /// How many.
    pub count: usize,
    /// Their seeds.
    pub seeds: Vec<u32>,
    /// How to fly the first of them again, bit for bit, with a full report.
    pub replay: String,
}

/// Spread of one figure.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Spread {
    /// Flights that had it.
    pub count: usize,
    /// Least.
    pub min: f64,
    /// 1 %.
    pub p1: f64,
    /// 5 %.
    pub p5: f64,
    /// Median.
    pub p50: f64,
    /// 95 %.
    pub p95: f64,
    /// 99 %.
    pub p99: f64,
    /// Greatest.
    pub max: f64,
}

/// A flight at or over a limit.
#[derive(Clone, Debug, Serialize)]
pub struct WorstFlight {
    /// Its seed.
    pub seed: u32,
    /// How it ended.
    pub outcome: String,
    /// Why it failed, as in the table; empty after a success.
    pub cause: String,
    /// The figure closest to its limit; null for a flight that did not touch down.
    pub figure: Option<&'static str>,
    /// Its value.
    pub value: Option<f64>,
    /// Its limit.
    pub limit: Option<f64>,
}

/// Two configurations on the same seeds.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The one that is compared with.
    pub first: String,
    /// The other.
    pub second: String,
    /// Pairs in which both succeeded.
    pub both: u32,
    /// Pairs in which the first alone did.
    pub only_first: u32,
    /// Pairs in which the second alone did.
    pub only_second: u32,
    /// Pairs in which neither did.
    pub neither: u32,
    /// McNemar's exact test, two-sided: the probability of such a difference between equals.
    pub mcnemar_p: f64,
    /// Second less first, over the pairs that both have it.
    pub median_difference: BTreeMap<&'static str, Median>,
}

/// A figure that the summary shows: its column in the table, its name in words, its limit.
struct Figure {
    name: &'static str,
    words: &'static str,
    limit: fn(&Success) -> Option<f64>,
}

const NO_LIMIT: fn(&Success) -> Option<f64> = |_| None;

const FIGURES: [Figure; 13] = [
    Figure {
        name: "touchdown_vertical_speed_m_s",
        words: "vertical speed (m/s)",
        limit: |s| Some(s.touchdown_vertical_speed_max_m_s),
    },
    Figure {
        name: "touchdown_lateral_speed_m_s",
        words: "lateral speed (m/s)",
        limit: |s| Some(s.touchdown_lateral_speed_max_m_s),
    },
    Figure { name: "touchdown_tilt_deg", words: "tilt (deg)", limit: |s| Some(s.touchdown_tilt_max_deg) },
    Figure { name: "control_error_m", words: "control error (m)", limit: |s| Some(s.control_error_max_m) },
    Figure { name: "position_error_m", words: "position error (m)", limit: |s| s.position_error_max_m },
    Figure { name: "navigation_error_m", words: "navigation error (m)", limit: NO_LIMIT },
    Figure { name: "altitude_control_rms_m", words: "hover height, estimate (m RMS)", limit: NO_LIMIT },
    Figure { name: "lateral_control_rms_m", words: "hover sideways, estimate (m RMS)", limit: NO_LIMIT },
    Figure { name: "altitude_rms_m", words: "hover height, true (m RMS)", limit: NO_LIMIT },
    Figure { name: "lateral_rms_m", words: "hover sideways, true (m RMS)", limit: NO_LIMIT },
    Figure { name: "peak_tilt_deg", words: "greatest tilt in flight (deg)", limit: NO_LIMIT },
    Figure { name: "nitrous_left_kg", words: "nitrous oxide left (kg)", limit: NO_LIMIT },
    Figure { name: "fuel_left_kg", words: "fuel left (kg)", limit: NO_LIMIT },
];

/// Worst flights that are listed.
const MOST_FLIGHTS: usize = 5;
/// Seeds that the text lists of a cause.
const MOST_SEEDS: usize = 12;

impl Summary {
    /// Summary of the rows of a campaign or a shard of it, in order.
    pub fn new(campaign: &Campaign, rows: &[&Row], shard: Option<Shard>, overrides: &[String]) -> Self {
        let success = campaign.file.success;
        let variants: Vec<VariantSummary> = campaign
            .configurations
            .iter()
            .map(|configuration| {
                let own: Vec<&Row> =
                    rows.iter().copied().filter(|row| row.variant == configuration.name).collect();
                VariantSummary::new(campaign, &configuration.name, &own, overrides)
            })
            .collect();
        let comparisons = campaign.configurations[1..]
            .iter()
            .map(|second| Comparison::new(&campaign.configurations[0].name, &second.name, rows))
            .collect();
        let all_passed = variants.iter().all(|variant| success.passed(variant.successes, variant.flights));
        let proven = lowest(&variants) >= success.min_rate;
        Self {
            campaign: campaign.name.clone(),
            description: campaign.file.description.clone(),
            campaign_hash: campaign.hash(),
            scenario: campaign.configurations[0].nominal.name.clone(),
            runs: campaign.file.runs,
            seed: campaign.file.seed,
            shard: shard.map(|shard| shard.to_string()),
            success,
            passed: shard.is_none().then_some(all_passed),
            proven: shard.is_none().then_some(proven),
            variants,
            comparisons,
            run: None,
            overrides: overrides.to_vec(),
        }
    }

    /// The summary as the terminal shows it.
    pub fn text(&self) -> String {
        let mut text = String::new();
        let last = self.seed.wrapping_add(self.runs.saturating_sub(1));
        let shard = self.shard.as_ref().map_or(String::new(), |shard| format!(", shard {shard}"));
        let _ = writeln!(
            text,
            "{}: {} flown with seeds {} to {last}{shard}",
            self.campaign, self.scenario, self.seed
        );
        for variant in &self.variants {
            variant.write(&mut text, &self.success);
        }
        for comparison in &self.comparisons {
            comparison.write(&mut text);
        }
        let _ = match self.passed {
            None => writeln!(
                text,
                "\nA shard proves nothing alone: hopbench campaign FILE --runs {} --merge DIR DIR …",
                self.runs
            ),
            Some(passed) => writeln!(text, "\n{}", self.verdict(passed)),
        };
        if let Some(run) = &self.run {
            let _ = writeln!(text, "campaign       {run}");
        }
        text
    }

    /// What was wanted, and whether the flights met it by luck or prove it.
    fn verdict(&self, passed: bool) -> String {
        let word = if passed { "PASSED" } else { "FAILED" };
        let most = self.success.max_failures.map_or(String::new(), |n| format!(", at most {n} failures"));
        let wanted = trim(100.0 * self.success.min_rate);
        let shown = match (passed, self.proven) {
            (false, _) => "not met",
            (true, Some(true)) => "proven",
            (true, _) => "rate met, not proven",
        };
        let bound = at_least(lowest(&self.variants));
        format!("{word}: wanted {wanted} %{most}; {shown}: at least {bound} % at 95 % confidence")
    }
}

/// The lowest one-sided bound of any variant.
fn lowest(variants: &[VariantSummary]) -> f64 {
    variants.iter().map(|variant| variant.clopper_pearson.one_sided_95_lower).fold(1.0, f64::min)
}

impl VariantSummary {
    fn new(campaign: &Campaign, name: &str, rows: &[&Row], overrides: &[String]) -> Self {
        let flights = rows.len() as u32;
        let successes = rows.iter().filter(|row| row.success).count() as u32;
        let figures = FIGURES
            .iter()
            .filter_map(|figure| Some((figure.name, Spread::new(rows, figure.name)?)))
            .collect();
        Self {
            name: name.to_owned(),
            flights,
            successes,
            success_rate: (flights > 0).then(|| f64::from(successes) / f64::from(flights)),
            clopper_pearson: RateBounds::new(successes, flights),
            failures: FailureGroup::of(campaign, name, rows, overrides),
            figures,
            worst: WorstFlight::of(rows, &campaign.file.success),
        }
    }

    fn write(&self, text: &mut String, success: &Success) {
        let [low, high] = self.clopper_pearson.two_sided_95;
        let _ = writeln!(
            text,
            "\n{}: {} of {} flights as they should be\n\
             95 % bounds    {:.2} to {:.2} %, at least {} % (Clopper-Pearson, two-sided and one-sided)",
            self.name,
            self.successes,
            self.flights,
            100.0 * low,
            100.0 * high,
            at_least(self.clopper_pearson.one_sided_95_lower)
        );
        for failures in &self.failures {
            let mut seeds: Vec<String> = failures.seeds.iter().take(MOST_SEEDS).map(u32::to_string).collect();
            if failures.count > MOST_SEEDS {
                seeds.push("…".to_owned());
            }
            let _ = writeln!(
                text,
                "failed         {:>4} x {}: seeds {}\n               again: {}",
                failures.count,
                failures.cause,
                seeds.join(", "),
                failures.replay
            );
        }
        let _ = writeln!(
            text,
            "{:<34}{:>9}{:>9}{:>9}{:>9}{:>9}{:>9}",
            "", "least", "median", "95 %", "99 %", "greatest", "limit"
        );
        for figure in &FIGURES {
            let Some(spread) = self.figures.get(figure.name) else { continue };
            let limit = (figure.limit)(success).map_or(String::new(), trim);
            let _ = writeln!(
                text,
                "{:<34}{:>9.3}{:>9.3}{:>9.3}{:>9.3}{:>9.3}{limit:>9}",
                figure.words, spread.min, spread.p50, spread.p95, spread.p99, spread.max
            );
        }
        for worst in &self.worst {
            let at = match (worst.figure, worst.value, worst.limit) {
                (Some(figure), Some(value), Some(limit)) => {
                    format!("{figure} {value:.3} of {}", trim(limit))
                }
                _ => "no touchdown".to_owned(),
            };
            // The cause of a flight that did not land names the abort; of one that did, the figure below.
            let ended = if worst.outcome == "landed" { &worst.outcome } else { &worst.cause };
            let _ = writeln!(text, "worst          seed {}: {ended}, {at}", worst.seed);
        }
    }
}

/// A lower bound in per cent, rounded down lest it overstate; the bound itself is good to 1e-12.
fn at_least(bound: f64) -> String {
    format!("{:.2}", (1e4 * bound + 1e-6).floor() * 1e-2)
}

/// A number without trailing zeros.
fn trim(x: f64) -> String {
    let text = format!("{x:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

impl FailureGroup {
    fn of(campaign: &Campaign, variant: &str, rows: &[&Row], overrides: &[String]) -> Vec<Self> {
        let mut by_cause: BTreeMap<&str, Vec<u32>> = BTreeMap::new();
        for row in rows.iter().filter(|row| !row.success) {
            by_cause.entry(&row.cause).or_default().push(row.seed);
        }
        let mut all: Vec<Self> = by_cause
            .into_iter()
            .map(|(cause, seeds)| Self {
                cause: cause.to_owned(),
                count: seeds.len(),
                replay: replay(campaign, variant, seeds[0], overrides),
                seeds,
            })
            .collect();
        all.sort_by_key(|failures| std::cmp::Reverse(failures.count));
        all
    }
}

/// The command that flies one flight of a campaign again.
fn replay(campaign: &Campaign, variant: &str, seed: u32, overrides: &[String]) -> String {
    let mut command = format!("hopbench campaign {} --only {seed}", campaign.path.display());
    if !campaign.file.variant.is_empty() {
        command += &format!(" --variant {variant}");
    }
    for pair in overrides {
        command += &format!(" --set '{pair}'");
    }
    command
}

impl Spread {
    fn new(rows: &[&Row], figure: &str) -> Option<Self> {
        let mut values: Vec<f64> = rows.iter().filter_map(|row| row.figure(figure)).collect();
        values.sort_by(f64::total_cmp);
        let at = |share| quantile(&values, share);
        Some(Self {
            count: values.len(),
            min: at(0.0)?,
            p1: at(0.01)?,
            p5: at(0.05)?,
            p50: at(0.5)?,
            p95: at(0.95)?,
            p99: at(0.99)?,
            max: at(1.0)?,
        })
    }
}

impl WorstFlight {
    fn of(rows: &[&Row], success: &Success) -> Vec<Self> {
        let mut all: Vec<(f64, Self)> = rows.iter().map(|row| Self::of_flight(row, success)).collect();
        all.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        all.into_iter().take(MOST_FLIGHTS).map(|(_, worst)| worst).collect()
    }

    /// The figure closest to its limit, and its share of it; without touchdown there is no worse.
    fn of_flight(row: &Row, success: &Success) -> (f64, Self) {
        let of = |figure: &Figure| {
            let (value, limit) = (row.figure(figure.name)?, (figure.limit)(success)?);
            Some((value / limit, figure.name, value, limit))
        };
        let closest = FIGURES.iter().filter_map(of).max_by(|a, b| a.0.total_cmp(&b.0));
        let share = if row.outcome == "landed" { closest.map_or(0.0, |c| c.0) } else { f64::INFINITY };
        let worst = Self {
            seed: row.seed,
            outcome: row.outcome.clone(),
            cause: row.cause.clone(),
            figure: closest.map(|c| c.1),
            value: closest.map(|c| c.2),
            limit: closest.map(|c| c.3),
        };
        (share, worst)
    }
}

impl Comparison {
    fn new(first: &str, second: &str, rows: &[&Row]) -> Self {
        let of = |name: &str| -> BTreeMap<u32, &Row> {
            rows.iter().filter(|row| row.variant == name).map(|row| (row.run, *row)).collect()
        };
        let (a, b) = (of(first), of(second));
        let pairs: Vec<(&Row, &Row)> = a.iter().filter_map(|(run, a)| Some((*a, *b.get(run)?))).collect();
        let count =
            |x: bool, y: bool| pairs.iter().filter(|(a, b)| (a.success, b.success) == (x, y)).count() as u32;
        let (only_first, only_second) = (count(true, false), count(false, true));
        let median = |figure: &'static str| {
            let differences =
                pairs.iter().filter_map(|(a, b)| Some(b.figure(figure)? - a.figure(figure)?)).collect();
            Some((figure, Median::new(differences)?))
        };
        let figures = FIGURES.iter().map(|figure| figure.name);
        Self {
            first: first.to_owned(),
            second: second.to_owned(),
            both: count(true, true),
            only_first,
            only_second,
            neither: count(false, false),
            mcnemar_p: mcnemar_p(only_first, only_second),
            median_difference: figures.filter_map(median).collect(),
        }
    }

    fn write(&self, text: &mut String) {
        let _ = writeln!(
            text,
            "\n{} against {}, same seeds: both succeed {}, only {} {}, only {} {}, neither {}; \
             McNemar p = {:.4}",
            self.second,
            self.first,
            self.both,
            self.first,
            self.only_first,
            self.second,
            self.only_second,
            self.neither,
            self.mcnemar_p
        );
        for figure in &FIGURES {
            let Some(median) = self.median_difference.get(figure.name) else { continue };
            let interval = median
                .interval_95
                .map_or(String::new(), |[low, high]| format!("   95 %: {low:+.4} to {high:+.4}"));
            let _ = writeln!(
                text,
                "{:<34}{:>+10.4} median of {} pairs{interval}",
                figure.words, median.value, median.count
            );
        }
    }
}
