//! The machine under the bench: clock, priorities, processors, serial ports.

use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::{Resource, Rlimit, getrlimit};

use super::catalog;
use super::finding::{Finding, worst_first};
use crate::wire::port::{self, Port, word};

/// What a bench needs of its machine. `None`: this machine does not say.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// Processors for this program.
    pub cpus: usize,
    /// What the kernel reads its clock from.
    pub clock_source: Option<String>,
    /// How long the kernel may put a wake-up off, to share it with another (ns).
    pub timer_slack_ns: Option<u64>,
    /// How late 100 sleeps of a millisecond ended: median and worst (us).
    pub sleep_late_us: (f64, f64),
    /// Greatest real-time priority; `None`: any.
    pub priority_limit: Option<u64>,
    /// Limits do not bind root.
    pub root: bool,
    /// Memory that may be locked (byte); `None`: any.
    pub memory_lock_bytes: Option<u64>,
    /// How processors choose their frequency.
    pub governor: Option<String>,
    /// Serial ports.
    pub ports: Vec<Port>,
    /// Whether this user is in the group `dialout`; `None`: there is none.
    pub in_dialout: Option<bool>,
    /// Process of a running ModemManager.
    pub modem_manager: Option<u32>,
}

/// Inspects this machine; takes about 0.1 s, for the sleeps.
pub fn inspect() -> Machine {
    let limit = |resource| {
        let Rlimit { current, .. } = getrlimit(resource);
        current
    };
    Machine {
        cpus: std::thread::available_parallelism().map_or(1, usize::from),
        clock_source: word(Path::new("/sys/devices/system/clocksource/clocksource0/current_clocksource")),
        timer_slack_ns: word(Path::new("/proc/self/timerslack_ns")).and_then(|ns| ns.parse().ok()),
        sleep_late_us: sleep_late_us(),
        priority_limit: limit(Resource::Rtprio),
        root: rustix::process::geteuid().is_root(),
        memory_lock_bytes: limit(Resource::Memlock),
        governor: word(Path::new("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")),
        ports: port::present(),
        in_dialout: port::belongs_to("dialout"),
        modem_manager: port::process_named("ModemManager").map(|process| process.pid),
    }
}

fn sleep_late_us() -> (f64, f64) {
    const SLEEP: Duration = Duration::from_millis(1);
    let sleep = |_| {
        let start = Instant::now();
        std::thread::sleep(SLEEP);
        start.elapsed().saturating_sub(SLEEP).as_secs_f64() * 1e6
    };
    let mut late_us: Vec<f64> = (0..100).map(sleep).collect();
    late_us.sort_by(f64::total_cmp);
    (late_us[50], late_us[99])
}

/// What is wrong with a machine, worst first.
pub fn diagnose_machine(machine: &Machine) -> Vec<Finding> {
    let (median_us, worst_us) = machine.sleep_late_us;
    let mut findings = vec![
        catalog::cpus(machine.cpus),
        catalog::sleep(median_us, worst_us, machine.timer_slack_ns),
        catalog::priority(machine.priority_limit, machine.root),
        catalog::memory_lock(machine.memory_lock_bytes.filter(|_| !machine.root)),
        catalog::ports(&machine.ports),
    ];
    findings.extend(machine.clock_source.as_deref().map(catalog::clock_source));
    findings.extend(machine.governor.as_deref().map(catalog::governor));
    findings.extend(machine.modem_manager.map(catalog::modem_manager));
    if machine.in_dialout == Some(false) && !machine.root {
        findings.push(catalog::not_in_group("dialout"));
    }
    worst_first(findings)
}
