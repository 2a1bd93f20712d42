//! What this machine can do at all, measured beside a run: a bare sleep and a bare echo.
//!
//! The sleep wakes at the plant's step on absolute deadlines and does nothing else; the echo sends a datagram
//! of the size of HIL_SENSOR over the loopback to a thread that sends back one of the size of
//! HIL_ACTUATOR_CONTROLS. The sleeper and the sending end have the class and the CPU of the thread that
//! starts them, the answering end is ordinary, as a flight controller on this machine would be.

use std::io;
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::bench::pace::{Distribution, now_ns, sleep_until_ns};
use crate::bench::realtime::spawn_ordinary;
use crate::wire::mavlink::frame_bytes;

const ECHO_EVERY_NS: u64 = 10_000_000;
/// An echo that takes longer is lost.
const PATIENCE: Duration = Duration::from_millis(100);

/// The two references, being measured.
#[derive(Debug)]
pub(crate) struct Baselines {
    stop: Arc<AtomicBool>,
    sleeper: JoinHandle<Distribution>,
    echo: JoinHandle<Distribution>,
}

impl Baselines {
    /// Starts both, with the privileges of the calling thread. `step_us`: how often to wake.
    ///
    /// # Errors
    /// When the system has no thread or no loopback port left.
    pub(crate) fn start(step_us: u64) -> io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        let (far, near) = (UdpSocket::bind("127.0.0.1:0")?, UdpSocket::bind("127.0.0.1:0")?);
        near.connect(far.local_addr()?)?;
        far.connect(near.local_addr()?)?;
        for socket in [&far, &near] {
            socket.set_read_timeout(Some(PATIENCE))?;
        }
        let ended = Arc::clone(&stop);
        spawn_ordinary("bare echo", move || answer(&far, &ended))?;
        let (ended, step_ns) = (Arc::clone(&stop), step_us * 1000);
        let sleeper = start("bare sleep", move || sleep(step_ns, &ended))?;
        let ended = Arc::clone(&stop);
        let echo = start("bare echo", move || ask(&near, &ended))?;
        Ok(Self { stop, sleeper, echo })
    }

    /// Ends both: how late the sleep woke, how long the echo took.
    pub(crate) fn finish(self) -> (Distribution, Distribution) {
        self.stop.store(true, Ordering::Relaxed);
        let measured =
            |thread: JoinHandle<Distribution>| thread.join().unwrap_or_else(|_| Distribution::new());
        (measured(self.sleeper), measured(self.echo))
    }
}

fn start(
    name: &str,
    run: impl FnOnce() -> Distribution + Send + 'static,
) -> io::Result<JoinHandle<Distribution>> {
    std::thread::Builder::new().name(name.to_owned()).spawn(run)
}

/// Half a step away from the run's own deadlines, more or less: it must not stand in their way.
fn sleep(step_ns: u64, stop: &AtomicBool) -> Distribution {
    let mut late = Distribution::new();
    let mut deadline_ns = now_ns() + step_ns + step_ns / 2;
    while !stop.load(Ordering::Relaxed) {
        sleep_until_ns(deadline_ns);
        let woke_ns = now_ns();
        late.record_ns(woke_ns.saturating_sub(deadline_ns));
        // What was slept through is not made up for.
        let missed = woke_ns.saturating_sub(deadline_ns) / step_ns;
        deadline_ns += step_ns * (missed + 1);
    }
    late
}

fn ask(near: &UdpSocket, stop: &AtomicBool) -> Distribution {
    let mut took = Distribution::new();
    let (mut number, mut buffer) = (0u64, [0; frame_bytes::HIL_ACTUATOR_CONTROLS]);
    let mut due_ns = now_ns();
    while !stop.load(Ordering::Relaxed) {
        due_ns = (due_ns + ECHO_EVERY_NS).max(now_ns());
        sleep_until_ns(due_ns);
        number += 1;
        let mut question = [0; frame_bytes::HIL_SENSOR];
        question[..8].copy_from_slice(&number.to_le_bytes());
        let start_ns = now_ns();
        if near.send(&question).is_err() {
            continue;
        }
        // An answer that came after its time belongs to an earlier question.
        while near.recv(&mut buffer).is_ok() {
            if buffer[..8] == number.to_le_bytes() {
                took.record_ns(now_ns() - start_ns);
                break;
            }
        }
    }
    took
}

fn answer(far: &UdpSocket, stop: &AtomicBool) {
    let mut buffer = [0; frame_bytes::HIL_ACTUATOR_CONTROLS];
    while !stop.load(Ordering::Relaxed) {
        if far.recv(&mut buffer).is_ok() {
            let _ = far.send(&buffer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_are_measured_at_their_rates() {
        let start_ns = now_ns();
        let baselines = Baselines::start(1000).unwrap();
        std::thread::sleep(Duration::from_millis(300));
        let (sleep, echo) = baselines.finish();
        let most = (now_ns() - start_ns) / 1_000_000 + 1;
        assert!((1..=most).contains(&sleep.count()), "{} of {most}", sleep.count());
        assert!((1..=most / 10 + 1).contains(&echo.count()), "{} of {}", echo.count(), most / 10);
        assert!(echo.quantile_us(0.5) > 0.0);
    }
}
