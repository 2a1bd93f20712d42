//! The timing certificate: one page that a person can sign, made from a run's report.
//!
//! Each line has its figure, its budget and whether it is within. Budgets: a step of the plant for what has
//! to happen in one; 100 us of lateness at 99 % (a tenth of the step at 1 kHz); 2 ms for a round trip at 99
//! %, a tenth of the period of a 50 Hz predictive controller; 70 % of a serial line, above which queues build
//! up.

use std::fmt::Write;

use hopbench::event::EventKind;
use hopbench::simulation::Report;
use hopbench::simulation::report::{LinkReport, Percentiles, Scheduler, Timing};

/// Name of the certificate in the folder of a run.
pub const FILE: &str = "certificate.txt";

const LATENESS_BUDGET_US: f64 = 100.0;
const ROUND_TRIP_BUDGET_US: f64 = 2000.0;
const WIRE_BUDGET_PERCENT: f64 = 70.0;
/// Changes in flight that are named; the report names more.
const NAMED_CHANGES: usize = 10;

/// How the run was set up, as far as the report does not say.
#[derive(Clone, Copy, Debug)]
pub struct BenchSetup<'a> {
    /// Name of the profile.
    pub profile: &'a str,
    /// The link as it was bound.
    pub link: &'a str,
    /// Step of the plant (s).
    pub step_s: f64,
}

/// The computer on which a run was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Host {
    /// Its name.
    pub name: String,
    /// Kernel's release and build.
    pub kernel: String,
    /// Model and number of its processors.
    pub cpu: String,
    /// What the clock reads.
    pub clock: String,
}

impl Host {
    /// This computer.
    pub fn here() -> Self {
        let system = rustix::system::uname();
        let text = |name: &std::ffi::CStr| name.to_string_lossy().into_owned();
        let file = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
        let cpus = file("/proc/cpuinfo");
        let model = cpus.lines().find(|line| line.starts_with("model name") || line.starts_with("Model"));
        let model = model.and_then(|line| line.split(':').nth(1)).unwrap_or("unknown processor").trim();
        let count = std::thread::available_parallelism().map_or(0, usize::from);
        let clock = file("/sys/devices/system/clocksource/clocksource0/current_clocksource");
        Self {
            name: text(system.nodename()),
            kernel: format!(
                "{} {} {}",
                text(system.sysname()),
                text(system.release()),
                text(system.version())
            ),
            cpu: format!("{count} x {model}"),
            clock: if clock.trim().is_empty() { "unknown".to_owned() } else { clock.trim().to_owned() },
        }
    }
}

/// The certificate as text.
pub fn page(report: &Report, setup: &BenchSetup<'_>, host: &Host) -> String {
    let mut page = Page::default();
    let t = &report.timing;
    page.line("HOPBENCH TIMING CERTIFICATE");
    page.line("");
    page.entry("run", report.run.as_deref().unwrap_or("not kept"));
    page.entry("scenario", &format!("{}, seed {}", report.scenario, report.seed));
    page.entry("version", concat!("hopbench ", env!("CARGO_PKG_VERSION")));
    page.entry("state hash", &report.state_hash);
    page.entry("host", &host.name);
    page.entry("kernel", &host.kernel);
    page.entry("processor", &format!("{}, clock {}", host.cpu, host.clock));
    page.entry("link", &format!("{}, profile {}", setup.link, setup.profile));
    page.entry("pacing", t.pacing.as_deref().unwrap_or("none"));
    let sensor = t.sensor_hz.map_or(String::new(), |hz| format!(", sensors {hz:.0} Hz"));
    page.entry("plant", &format!("{}, {:.0} Hz{sensor}", name(&t.plant_mode), t.plant_hz));
    let named = report.modified.iter().take(NAMED_CHANGES);
    for (i, change) in report.overrides.iter().chain(named).enumerate() {
        page.entry(if i == 0 { "modified" } else { "" }, change);
    }
    if report.modified_count > NAMED_CHANGES {
        page.entry("", &format!("{} changes in flight altogether", report.modified_count));
    }
    scheduler(&mut page, t.scheduler.as_ref());
    times(&mut page, t);
    overruns(&mut page, t, setup);
    if let Some(link) = &report.link {
        wire(&mut page, link, report);
    }
    page.line("");
    page.line(match page.over_budget {
        0 => "Every line that has a budget is within it.",
        _ => "NOT every line is within its budget.",
    });
    page.line("");
    page.line("name  ______________________   date  ______________   signature  ______________________");
    page.text
}

#[derive(Default)]
struct Page {
    text: String,
    /// Lines that are not within their budget.
    over_budget: u32,
}

impl Page {
    fn line(&mut self, text: &str) {
        let _ = writeln!(self.text, "{}", text.trim_end());
    }

    fn entry(&mut self, name: &str, value: &str) {
        self.line(&format!("{name:<22}{value}"));
    }

    fn head(&mut self, text: &str) {
        self.line("");
        self.line(text);
    }

    /// A figure with the most that it may be.
    fn judged(&mut self, name: &str, value: &str, limit: &str, within: bool) {
        self.over_budget += u32::from(!within);
        let verdict = if within { "yes" } else { "NO" };
        self.line(&format!("{name:<22}{value:<44}{limit:<20}{verdict}"));
    }
}

fn name(value: &impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|value| Some(value.as_str()?.to_owned())).unwrap_or_default()
}

fn scheduler(page: &mut Page, granted: Option<&Scheduler>) {
    let Some(granted) = granted else {
        page.entry("scheduling", "ordinary; nothing was asked of the kernel");
        return;
    };
    let class = granted.priority.map_or("ordinary".to_owned(), |priority| format!("SCHED_FIFO {priority}"));
    let memory = if granted.locked { "memory locked" } else { "memory not locked" };
    let cpu = granted.pinned_cpu.map_or(String::new(), |cpu| format!(", pinned to CPU {cpu}"));
    page.entry("scheduling", &format!("{class}, {memory}{cpu}"));
    granted.notes.iter().for_each(|note| page.entry("", note));
}

fn times(page: &mut Page, t: &Timing) {
    /// What of a distribution is held against its budget.
    type Statistic = fn(&Percentiles) -> f64;
    /// What is measured, and its budget: as words, what of it counts, and the most that it may be.
    type Row<'a> = (&'a str, &'a Option<Percentiles>, Option<(&'a str, Statistic, f64)>);
    let p99: Statistic = |p| p.p99;
    let p999: Statistic = |p| p.p999;
    page.head("us                         p50       p99     p99.9       max      budget            within");
    let step = format!("p99.9 {:.0}", t.step_budget_us);
    let late = format!("p99 {LATENESS_BUDGET_US:.0}");
    let trip = format!("p99 {ROUND_TRIP_BUDGET_US:.0}");
    let rows: [Row<'_>; 7] = [
        ("step of the plant", &t.step_us, Some((step.as_str(), p999, t.step_budget_us))),
        ("whole cycle", &t.cycle_us, Some((step.as_str(), p999, t.step_budget_us))),
        ("lateness", &t.lateness_us, Some((late.as_str(), p99, LATENESS_BUDGET_US))),
        ("  beside a bare sleep", &t.reference_sleep_us, None),
        ("round trip, time stamp", &t.round_trip_us, Some((trip.as_str(), p99, ROUND_TRIP_BUDGET_US))),
        ("round trip, echo", &t.echo_us, Some((trip.as_str(), p99, ROUND_TRIP_BUDGET_US))),
        ("  beside a bare echo", &t.reference_echo_us, None),
    ];
    for (name, measured, budget) in rows {
        let Some(p) = measured else {
            page.entry(name, "not measured");
            continue;
        };
        let figures = format!("{:>8.1}{:>10.1}{:>10.1}{:>10.1}", p.p50, p.p99, p.p999, p.max);
        match budget {
            Some((limit, of, most)) => page.judged(name, &figures, limit, of(p) <= most),
            None => page.entry(name, &figures),
        }
    }
}

fn overruns(page: &mut Page, t: &Timing, setup: &BenchSetup<'_>) {
    page.head(&format!(
        "Steps: {} in {:.3} s, {:.3} s simulated. Overruns, steps begun more than a step late: {}",
        t.steps, t.wall_s, t.simulated_s, t.overruns
    ));
    page.entry("caught up", &format!("{} steps, no sample left out, they left late", t.overruns_caught_up));
    page.entry("ended by a slip", &format!("{} steps", t.overruns_slipped));
    page.entry("late at the end", &format!("{} steps", t.overruns_open));
    page.judged("slips", &format!("{}, {:.6} s altogether", t.slips, t.slipped_s), "0", t.slips == 0);
    if let Some(unaccounted_us) = t.unaccounted_us {
        let limit_us = setup.step_s * 1e6;
        let value = format!("{unaccounted_us:.1} us of wall time");
        page.judged(
            "unaccounted for",
            &value,
            &format!("{limit_us:.0} us"),
            unaccounted_us.abs() <= limit_us,
        );
    }
    for worst in &t.worst_overruns {
        let end = match worst.slipped_ms {
            Some(ms) => format!("time slipped by {ms:.3} ms"),
            None => format!("caught up, steps begun late: {}", worst.steps),
        };
        page.entry(&format!("  at {:.3} s", worst.time_s), &format!("{:.3} ms late, {end}", worst.late_ms));
    }
}

fn wire(page: &mut Page, link: &LinkReport, report: &Report) {
    page.head(&format!(
        "Wire: {} frames out ({:.1} Hz, {} bytes), {} in ({:.1} Hz, {} bytes)",
        link.sent, link.rate_out_hz, link.sent_bytes, link.received, link.rate_in_hz, link.received_bytes
    ));
    let loads = [("load outward", link.wire_load_percent), ("load inward", link.wire_load_in_percent)];
    for (name, load) in loads {
        match load {
            Some(load) => {
                let limit = format!("{WIRE_BUDGET_PERCENT:.0} %");
                page.judged(name, &format!("{load:.1} %"), &limit, load <= WIRE_BUDGET_PERCENT);
            }
            None => page.entry(name, "the link has no rate of its own"),
        }
    }
    let counts = [
        ("dropped", link.dropped),
        ("lost", link.lost),
        ("controls refused", link.controls_refused),
        ("controls old or repeated", link.controls_old),
        ("duplicates", link.duplicates),
        ("out of order", link.out_of_order),
        ("CRC errors", link.crc_errors),
        ("bytes in no frame", link.skipped_bytes),
        ("stalls of lockstep", link.stalls),
        ("gaps in controls", link.gaps),
    ];
    for (name, count) in counts {
        page.judged(name, &count.to_string(), "0", count == 0);
    }
    let longest = link.longest_gap_ms.map_or("none".to_owned(), |ms| format!("{ms:.3} ms"));
    page.entry("longest gap", &longest);
    let losses = report.events.iter().filter(|event| event.kind == EventKind::FcLost).count();
    page.judged("controller lost", &losses.to_string(), "0", losses == 0);
}
