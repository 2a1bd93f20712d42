//! What the stepping thread asks of the kernel so that it wakes on time, and what it was given.
//!
//! Asked for: the real-time class SCHED_FIFO, memory that is never paged out, one CPU where there are more
//! than two, timers without slack. Each may be refused; then the run goes on without it, and its certificate
//! says so, why, and what would allow it. A thread inherits all of this from the one that starts it, so
//! whatever is started beside the loop goes through [`spawn_ordinary`]. Sources: sched(7), mlock(2),
//! cpuset(7), PR_SET_TIMERSLACK(2const).

use std::io;
use std::num::NonZeroU64;
use std::thread::JoinHandle;

use hopbench::simulation::report::Scheduler;
use rustix::io::Errno;
use rustix::mm::{MlockAllFlags, mlockall, munlockall};
use rustix::process::{Resource, getpriority_process, getrlimit, setpriority_process};
use rustix::thread::{
    CapabilitySet, CpuSet, capabilities, sched_getaffinity, sched_setaffinity, set_current_timer_slack,
};
use thread_priority::unix::{
    NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};
use thread_priority::{Error, ThreadPriority, ThreadPriorityValue};

/// Above everything but the kernel's own threads that a run depends on: interrupts stand at 50, watchdogs at
/// 99.
const PRIORITY: u8 = 80;
/// CPUs from which on one may be taken for the loop alone.
const CPUS_TO_PIN: u32 = 3;

/// What the calling thread was given; dropping it gives it back.
#[derive(Debug)]
pub(crate) struct Privileges {
    granted: Scheduler,
    /// CPUs of the thread before it was pinned.
    home: Option<CpuSet>,
}

impl Privileges {
    /// Asks for everything, for the calling thread. `cpu`: pins it there; `None`: to an isolated CPU or the
    /// last one, where there are more than two.
    pub(crate) fn acquire(cpu: Option<usize>) -> Self {
        let mut notes = Vec::new();
        let priority = take(&mut notes, raise());
        let locked = take(&mut notes, lock_memory()).is_some();
        let home = sched_getaffinity(None).ok();
        let pinned_cpu = take(&mut notes, pin(cpu, home.as_ref()));
        if let Err(refused) = set_current_timer_slack(NonZeroU64::new(1)) {
            notes.push(format!("timer slack stays: {refused}"));
        }
        let granted = Scheduler { fifo: priority.is_some(), priority, locked, pinned_cpu, notes };
        Self { granted, home }
    }

    /// What was granted, and why not what was not.
    pub(crate) fn granted(&self) -> &Scheduler {
        &self.granted
    }
}

impl Drop for Privileges {
    fn drop(&mut self) {
        step_down();
        if let Some(home) = &self.home {
            let _ = sched_setaffinity(None, home);
        }
        if self.granted.locked {
            let _ = munlockall();
        }
    }
}

/// CPUs that this process may use.
pub(crate) fn cpus() -> Vec<usize> {
    let home = sched_getaffinity(None).unwrap_or_default();
    (0..CpuSet::MAX_CPU).filter(|cpu| home.is_set(*cpu)).collect()
}

/// Starts a thread in the ordinary class on any CPU, whatever the thread that starts it has been given.
///
/// # Errors
/// When the system has no thread left.
pub(crate) fn spawn_ordinary(name: &str, run: impl FnOnce() + Send + 'static) -> io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name(name.to_owned()).spawn(move || {
        step_down();
        run();
    })
}

/// The calling thread in the ordinary class, on any CPU, with the usual slack. What may always be given up is
/// never refused.
fn step_down() {
    let nice = getpriority_process(None);
    let ordinary = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
    let _ = set_thread_priority_and_policy(thread_native_id(), level(50), ordinary);
    if let Ok(nice) = nice {
        let _ = setpriority_process(None, nice);
    }
    // The kernel keeps to those that this process may use.
    let mut all = CpuSet::new();
    (0..CpuSet::MAX_CPU).for_each(|cpu| all.set(cpu));
    let _ = sched_setaffinity(None, &all);
    let _ = set_current_timer_slack(None);
}

/// SCHED_FIFO at 80, or as high as the limit allows.
fn raise() -> Result<u8, String> {
    let try_at = |priority: u8| {
        let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        set_thread_priority_and_policy(thread_native_id(), level(priority), fifo).map(|()| priority)
    };
    let limit = getrlimit(Resource::Rtprio).current.unwrap_or(u64::from(PRIORITY));
    let lower = u8::try_from(limit).unwrap_or(PRIORITY).min(PRIORITY);
    try_at(PRIORITY).or_else(|refused| if lower > 0 { try_at(lower) } else { Err(refused) }).map_err(
        |refused| {
            let cause = match refused {
                Error::OS(code) => Errno::from_raw_os_error(code).to_string(),
                other => format!("{other:?}"),
            };
            format!(
                "no SCHED_FIFO: {cause}; `ulimit -r` is {limit}. To allow it: CAP_SYS_NICE, or the line \
             `USER - rtprio {PRIORITY}` in /etc/security/limits.d/hopbench.conf and a new login"
            )
        },
    )
}

/// Locks what there is and what will come. Under a limit a later allocation would be refused, and the program
/// with it.
fn lock_memory() -> Result<(), String> {
    let limit = getrlimit(Resource::Memlock).current;
    let capable = capabilities(None).is_ok_and(|held| held.effective.contains(CapabilitySet::IPC_LOCK));
    let allow = "To allow it: CAP_IPC_LOCK, or the line `USER - memlock unlimited` in \
                 /etc/security/limits.d/hopbench.conf and a new login";
    if let (Some(bytes), false) = (limit, capable) {
        return Err(format!("memory not locked: `ulimit -l` is {} kB. {allow}", bytes / 1024));
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)
        .map_err(|refused| format!("memory not locked: {refused}. {allow}"))
}

/// One CPU for the calling thread.
fn pin(asked: Option<usize>, home: Option<&CpuSet>) -> Result<usize, String> {
    let Some(home) = home else { return Err("not pinned: the kernel does not say where it runs".to_owned()) };
    let cpu = match asked {
        Some(cpu) => cpu,
        None if home.count() < CPUS_TO_PIN => {
            return Err(format!(
                "not pinned: {} CPUs, which the other end needs too; --cpu N pins",
                home.count()
            ));
        }
        None => isolated()
            .or_else(|| (0..CpuSet::MAX_CPU).rfind(|cpu| home.is_set(*cpu)))
            .ok_or("not pinned: no CPU to be seen")?,
    };
    let mut one = CpuSet::new();
    if cpu >= CpuSet::MAX_CPU {
        return Err(format!("not pinned: CPU {cpu} is beyond the last"));
    }
    one.set(cpu);
    sched_setaffinity(None, &one)
        .map(|()| cpu)
        .map_err(|refused| format!("not pinned to CPU {cpu}: {refused}"))
}

/// The first CPU that the kernel keeps its own scheduling away from (`isolcpus=`), a list like `2-3,6`.
fn isolated() -> Option<usize> {
    let list = std::fs::read_to_string("/sys/devices/system/cpu/isolated").ok()?;
    let first: String = list.trim().chars().take_while(char::is_ascii_digit).collect();
    first.parse().ok()
}

fn level(priority: u8) -> ThreadPriority {
    let value = ThreadPriorityValue::try_from(priority).expect("below 100");
    ThreadPriority::Crossplatform(value)
}

/// What was granted; what was not goes to the notes.
fn take<T>(notes: &mut Vec<String>, answer: Result<T, String>) -> Option<T> {
    answer.map_err(|why| notes.push(why)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use thread_priority::unix::thread_schedule_policy;

    const ORDINARY: ThreadSchedulePolicy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);

    #[test]
    fn what_is_not_granted_is_in_the_notes_and_the_rest_is_true() {
        // On a thread of its own: the class of a thread outlives a test.
        let check = || {
            let home = sched_getaffinity(None).unwrap();
            let last = (0..CpuSet::MAX_CPU).rfind(|cpu| home.is_set(*cpu)).unwrap();
            let privileges = Privileges::acquire(Some(last));
            let granted = privileges.granted().clone();
            let missing = [granted.fifo, granted.locked, granted.pinned_cpu.is_some()];
            assert_eq!(granted.notes.len(), missing.iter().filter(|given| !**given).count(), "{granted:?}");
            assert_eq!(granted.fifo, thread_schedule_policy().unwrap() != ORDINARY);
            assert_eq!(granted.pinned_cpu, Some(last));
            assert_eq!(sched_getaffinity(None).unwrap().count(), 1);
            // Whoever is started from here is nobody special.
            let child = spawn_ordinary("child", move || {
                assert_eq!(thread_schedule_policy().unwrap(), ORDINARY);
                assert_eq!(sched_getaffinity(None).unwrap().count(), home.count());
            });
            child.unwrap().join().unwrap();
            drop(privileges);
            assert_eq!(thread_schedule_policy().unwrap(), ORDINARY);
            assert_eq!(sched_getaffinity(None).unwrap().count(), home.count());
        };
        std::thread::spawn(check).join().unwrap();
    }

    #[test]
    fn a_cpu_that_is_not_there_is_named() {
        let check = || {
            let privileges = Privileges::acquire(Some(100_000));
            assert_eq!(privileges.granted().pinned_cpu, None);
            assert!(privileges.granted().notes.iter().any(|note| note.contains("CPU 100000")));
        };
        std::thread::spawn(check).join().unwrap();
    }
}
