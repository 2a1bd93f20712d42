//! Who speaks and who is spoken to.

use std::fmt;

/// System and component; in a target, 0 is any.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Address {
    /// System.
    pub system: u8,
    /// Component.
    pub component: u8,
}

impl Address {
    /// Whether a message to this address is for `own` too.
    pub fn reaches(self, own: Self) -> bool {
        (self.system == 0 || self.system == own.system)
            && (self.component == 0 || self.component == own.component)
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.system, self.component)
    }
}
