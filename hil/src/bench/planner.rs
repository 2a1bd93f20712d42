//! Plans are solved here, beside the loop that flies: some milliseconds each, on a thread of their own.

use std::io;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use hopbench::autopilot::Autopilot;
use hopbench::autopilot::planning::{Answer, LATENCY_S, Order};
use hopbench::time::SimTime;

use crate::bench::realtime::spawn_ordinary;

/// Solves what an autopilot orders.
#[derive(Debug)]
pub struct Planner {
    orders: SyncSender<Order>,
    answers: Receiver<Answer>,
    /// When the order that is out was taken.
    ordered: Option<Instant>,
    /// What is being solved belongs to a flight that is over.
    stale: bool,
}

impl Planner {
    /// Starts the thread; it ends with the planner.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub fn start() -> io::Result<Self> {
        let (orders, inbox) = sync_channel::<Order>(1);
        let (outbox, answers) = sync_channel(2);
        spawn_ordinary("planner", move || {
            while let Ok(order) = inbox.recv() {
                if outbox.send(order.solve()).is_err() {
                    return;
                }
            }
        })?;
        Ok(Self { orders, answers, ordered: None, stale: false })
    }

    /// Before an update at `now`: hands over what is ready. A plan that is due is waited for until the wall
    /// clock has gone through its time too: not at all in real time, up to that when simulated time runs
    /// ahead.
    pub fn deliver(&mut self, autopilot: &mut Autopilot, now: SimTime) {
        if let Some(ordered) = self.ordered {
            let patience = Duration::from_secs_f64(LATENCY_S).saturating_sub(ordered.elapsed());
            self.deliver_within(autopilot, now, patience);
        }
    }

    /// The same with a wait of its own for a plan that is due.
    pub fn deliver_within(&mut self, autopilot: &mut Autopilot, now: SimTime, patience: Duration) {
        if self.ordered.is_none() {
            return;
        }
        let due = autopilot.planning().begins().is_some_and(|begins| now >= begins);
        let answer =
            if due { self.answers.recv_timeout(patience).ok() } else { self.answers.try_recv().ok() };
        if let Some(answer) = answer {
            self.ordered = None;
            if !core::mem::take(&mut self.stale) {
                autopilot.deliver(answer);
            }
        }
    }

    /// Another flight begins: what is being solved is for nobody.
    pub fn forget(&mut self) {
        self.stale = self.ordered.is_some();
    }

    /// After an update: takes what was ordered. While one is being solved the next waits; it would be late
    /// anyway.
    pub fn take(&mut self, autopilot: &mut Autopilot) {
        if self.ordered.is_none()
            && let Some(order) = autopilot.take_order()
            && self.orders.try_send(order).is_ok()
        {
            self.ordered = Some(Instant::now());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_thread_ends_with_its_planner() {
        let planner = Planner::start().expect("a thread");
        let Planner { orders, answers, .. } = planner;
        drop(orders);
        // The thread drops its end when its inbox closes.
        assert!(answers.recv_timeout(Duration::from_secs(10)).is_err());
    }
}
