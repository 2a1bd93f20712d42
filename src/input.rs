//! Input files as data: reading TOML into parameter structs with messages that name line, key and
//! allowed range.

/// A parameter that contradicts another, found by a `validate` of a parameter struct.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key}: {message}")]
pub struct Invalid {
    /// Dotted path of the key, relative to the struct that reports it.
    pub key: String,
    /// What is wrong, with the numbers.
    pub message: String,
}

impl Invalid {
    /// A contradiction at `key`.
    pub fn new(key: impl Into<String>, message: impl Into<String>) -> Self {
        Self { key: key.into(), message: message.into() }
    }

    /// The same, seen from the table `parent` that holds the struct.
    #[must_use]
    pub fn within(mut self, parent: &str) -> Self {
        self.key = format!("{parent}.{}", self.key);
        self
    }
}
