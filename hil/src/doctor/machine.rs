//! The machine under the bench: clock, priorities, processors, serial ports.

use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::{Resource, Rlimit, getrlimit};

use super::Finding;
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

/// Looks; takes about 0.1 s for the sleeps.
pub fn look() -> Machine {
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
    const NAP: Duration = Duration::from_millis(1);
    let nap = |_| {
        let start = Instant::now();
        std::thread::sleep(NAP);
        start.elapsed().saturating_sub(NAP).as_secs_f64() * 1e6
    };
    let mut late_us: Vec<f64> = (0..100).map(nap).collect();
    late_us.sort_by(f64::total_cmp);
    (late_us[50], late_us[99])
}

impl Machine {
    pub(super) fn findings(&self) -> Vec<Finding> {
        let (median_us, worst_us) = self.sleep_late_us;
        let mut findings = vec![
            Finding::Cpus { count: self.cpus },
            Finding::Sleep { median_us, worst_us, slack_ns: self.timer_slack_ns },
            Finding::Priority { limit: self.priority_limit, root: self.root },
            Finding::MemoryLock { limit_bytes: self.memory_lock_bytes.filter(|_| !self.root) },
            Finding::Ports { ports: self.ports.clone() },
        ];
        findings.extend(self.clock_source.clone().map(|name| Finding::ClockSource { name }));
        findings.extend(self.governor.clone().map(|name| Finding::Governor { name }));
        findings.extend(self.modem_manager.map(|pid| Finding::ModemManager { pid }));
        if self.in_dialout == Some(false) && !self.root {
            findings.push(Finding::NotInGroup { group: "dialout".to_owned() });
        }
        findings
    }
}
