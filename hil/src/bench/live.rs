//! Prints notices and one live line, which the next overwrites, on stderr.
//!
//! A thread of its own prints, since a terminal may block; what it cannot take in time is dropped.

use std::io::{IsTerminal, Write};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

enum Line {
    /// Stays.
    Notice(String),
    /// Is overwritten by the next on a terminal.
    Live(String),
}

/// Where a run says what happens.
#[derive(Debug)]
pub struct Live {
    lines: Option<SyncSender<Line>>,
    thread: Option<JoinHandle<()>>,
    interval_ns: u64,
    due_ns: u64,
}

impl Live {
    /// To stderr: five lines a second on a terminal, where each overwrites the last, else one.
    pub fn stderr() -> Self {
        Self::to(std::io::stderr(), std::io::stderr().is_terminal())
    }

    /// The same to anything that can be written to.
    pub fn to(out: impl Write + Send + 'static, terminal: bool) -> Self {
        let (lines, received) = sync_channel(64);
        let thread = std::thread::spawn(move || print(&received, out, terminal));
        let interval_ns = if terminal { 200_000_000 } else { 1_000_000_000 };
        Self { lines: Some(lines), thread: Some(thread), interval_ns, due_ns: 0 }
    }

    /// To nowhere, for tests.
    pub fn silent() -> Self {
        Self { lines: None, thread: None, interval_ns: u64::MAX, due_ns: u64::MAX }
    }

    /// Says something once.
    pub fn notice(&self, text: String) {
        if let Some(lines) = &self.lines {
            let _ = lines.try_send(Line::Notice(text));
        }
    }

    /// Shows where the run is, if it is time for that.
    pub fn show(&mut self, now_ns: u64, text: impl FnOnce() -> String) {
        if let Some(lines) = &self.lines
            && now_ns >= self.due_ns
        {
            self.due_ns = now_ns.saturating_add(self.interval_ns);
            let _ = lines.try_send(Line::Live(text()));
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        /// A stderr that nobody reads must not hold up the verdict: then the thread is left to itself.
        const PATIENCE: Duration = Duration::from_millis(200);
        self.lines = None;
        let Some(thread) = self.thread.take() else { return };
        let deadline = Instant::now() + PATIENCE;
        while !thread.is_finished() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

fn print(lines: &Receiver<Line>, mut out: impl Write, terminal: bool) {
    const OVERWRITE: &str = "\r\x1b[K";
    // A live line stands on the terminal without its end.
    let mut open = false;
    for line in lines {
        let start = if open { OVERWRITE } else { "" };
        let stays = !terminal || matches!(line, Line::Notice(_));
        let (Line::Notice(text) | Line::Live(text)) = line;
        // A stderr that has gone away is no reason to stop a run.
        let _ = write!(out, "{start}{text}{}", if stays { "\n" } else { "" });
        let _ = out.flush();
        open = !stays;
    }
    if open {
        let _ = writeln!(out);
    }
}
