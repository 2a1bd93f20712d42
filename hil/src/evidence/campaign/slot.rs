//! What a campaign flies: a slot for each run under each configuration, shared among machines and cores.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

/// A run under one configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Slot {
    /// Number of the run, from 0.
    pub run: u32,
    /// Index of the configuration.
    pub configuration: usize,
}

/// Share `index` of `count`, counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which, from 1.
    pub index: u32,
    /// Of how many.
    pub count: u32,
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((index, count)) if (1..=count).contains(&index) => Ok(Self { index, count }),
            _ => Err("expected I/N with I from 1 to N, as in 2/4".to_owned()),
        }
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

impl Shard {
    /// Whether it has a run; runs go round, so that all shards take as long.
    pub fn has(self, run: u32) -> bool {
        run % self.count == self.index - 1
    }
}

/// Slots of a shard, or all.
pub fn slots_of(slots: Vec<Slot>, shard: Option<Shard>) -> Vec<Slot> {
    slots.into_iter().filter(|slot| shard.is_none_or(|shard| shard.has(slot.run))).collect()
}

/// Works on many, `jobs` at a time; `each` sees the results in order, as they come. The first failure, in
/// order, ends it, and so does `stop`, after what has begun.
pub(super) fn in_order<T: Send, E: Send>(
    slots: &[Slot],
    jobs: usize,
    stop: &AtomicBool,
    work: impl Fn(Slot) -> Result<T, E> + Sync,
    mut each: impl FnMut(T) -> Result<(), E>,
) -> Result<(), E> {
    let next = AtomicUsize::new(0);
    let (send, receive) = mpsc::channel();
    std::thread::scope(|threads| {
        for _ in 0..jobs.clamp(1, slots.len().max(1)) {
            let (next, work, send) = (&next, &work, send.clone());
            threads.spawn(move || {
                // Asked before a slot is taken: what is taken is done, so that no gap is left.
                while !stop.load(Ordering::Relaxed)
                    && let Some(slot) = slots.get(next.fetch_add(1, Ordering::Relaxed))
                {
                    if send.send((*slot, work(*slot))).is_err() {
                        return;
                    }
                }
            });
        }
        drop(send);
        // Done before others that come first.
        let mut early = BTreeMap::new();
        let mut take = |slot: &Slot| {
            while !early.contains_key(slot) {
                // Without a sender all have stopped, or a worker has panicked, which the scope passes on.
                let Ok((slot, result)) = receive.recv() else { return Ok(()) };
                early.insert(slot, result);
            }
            early.remove(slot).map_or(Ok(()), |result| each(result?))
        };
        let result = slots.iter().try_for_each(&mut take);
        // Whatever ended it, nobody begins another.
        next.store(slots.len(), Ordering::Relaxed);
        result
    })
}
