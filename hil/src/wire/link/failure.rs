//! Why a port or socket cannot be opened, and what to do about it.

use std::io;
use std::path::Path;

use crate::wire::port;

/// A link that cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("{link}: {failure}")]
pub struct LinkError {
    /// The link as it was asked for.
    pub link: String,
    /// Why.
    pub failure: OpenFailure,
}

/// Why a port or socket cannot be opened.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{cause}")]
pub struct OpenFailure {
    /// What kind of failure the system reports.
    pub kind: io::ErrorKind,
    /// What the system says, and what to do about it.
    pub cause: String,
}

impl OpenFailure {
    /// What the system says, and what usually helps.
    pub(super) fn of(cause: &io::Error) -> Self {
        let hint = match cause.kind() {
            io::ErrorKind::AddrInUse => "; another program listens there: stop it, or choose another port",
            io::ErrorKind::AddrNotAvailable => "; this machine has no such address",
            io::ErrorKind::NotFound => "; no such port or host",
            io::ErrorKind::PermissionDenied => {
                "; may this user open it? For a serial port: sudo usermod -aG dialout $USER, \
                 then log in again"
            }
            _ => "",
        };
        Self { kind: cause.kind(), cause: format!("{cause}{hint}") }
    }

    /// The same for a device file, with the name of whoever holds it.
    pub(super) fn of_port(cause: &io::Error, path: &Path) -> Self {
        if cause.kind() != io::ErrorKind::ResourceBusy {
            return Self::of(cause);
        }
        let holders: Vec<String> = port::holders(path).iter().map(ToString::to_string).collect();
        let held = if holders.is_empty() {
            "held by another program that this user may not see (a ground station, ModemManager?)".to_owned()
        } else {
            format!("held by {}", holders.join(", "))
        };
        Self { kind: cause.kind(), cause: format!("{cause}; {held}") }
    }
}
