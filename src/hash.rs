//! Hash of bytes: the same text or the same states give the same word, on every machine.
//!
//! Source: Fowler, Noll and Vo's FNV-1a, 64 bit. It tells flights and files apart; it keeps no secret.

/// FNV-1a, byte by byte.
#[derive(Clone, Copy, Debug)]
pub struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325) // offset basis
    }
}

impl Fnv {
    /// Takes in bytes.
    #[inline]
    pub fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3); // prime
        }
    }

    /// The hash of what was taken in so far.
    pub const fn word(self) -> u64 {
        self.0
    }

    /// As text.
    pub fn hex(self) -> String {
        format!("{:016x}", self.0)
    }
}
