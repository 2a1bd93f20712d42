//! The hash of a flight's states: equal bits, equal hash.

use crate::hash::Fnv;
use crate::plant::State;

/// Hash of the bits of every number of the states that were taken in.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct StateHash(Fnv);

impl StateHash {
    /// Takes in a state.
    pub(super) fn add(&mut self, state: &State) {
        for number in state.numbers() {
            self.0.add(&number.to_bits().to_le_bytes());
        }
    }

    /// As text.
    pub(super) fn hex(self) -> String {
        self.0.hex()
    }
}
