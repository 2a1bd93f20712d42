//! The hash of a flight's states: equal bits, equal hash.

use crate::plant::State;

/// 64-bit FNV-1a over the bits of every number of a state.
#[derive(Clone, Copy, Debug)]
pub(super) struct StateHash(u64);

impl Default for StateHash {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl StateHash {
    /// Takes in a state.
    pub(super) fn add(&mut self, state: &State) {
        for number in state.numbers() {
            for byte in number.to_bits().to_le_bytes() {
                self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
            }
        }
    }

    /// As text.
    pub(super) fn hex(self) -> String {
        format!("{:016x}", self.0)
    }
}
