//! Where the other end is: the `LINK` of the command line.

use std::io;
use std::net::{SocketAddr, ToSocketAddrs};

/// Rates that serial hardware is made for: 12 Mbaud is the greatest of USB adapters. What a driver makes of
/// a rate is asked when the port is open.
const BAUD_RANGE: std::ops::RangeInclusive<u32> = 50..=12_000_000;

/// Where the other end is: the `LINK` of the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkSpec {
    /// `serial:PATH:BAUD`
    Serial {
        /// Device file.
        path: String,
        /// Symbols per second.
        baud: u32,
    },
    /// `udp:HOST:PORT`, speaks first.
    Udp(Host),
    /// `udp-listen:HOST:PORT`, answers whoever writes.
    UdpListen(Host),
    /// `tcp:HOST:PORT`, dials and redials.
    Tcp(Host),
    /// `tcp-listen:HOST:PORT`, one client at a time.
    TcpListen(Host),
}

/// Host and port; the host is the loopback unless given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Host {
    /// Name or address.
    pub name: String,
    /// Port; 0 lets the system choose one to listen on.
    pub port: u16,
}

/// A `LINK` that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "\"{text}\" is no link: {reason}; expected serial:PATH:BAUD, udp:HOST:PORT, udp-listen:HOST:PORT, \
     tcp:HOST:PORT or tcp-listen:HOST:PORT"
)]
pub struct LinkSpecError {
    text: String,
    reason: String,
}

impl LinkSpec {
    /// The kind of link, as the command line spells it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Serial { .. } => "serial",
            Self::Udp(_) => "udp",
            Self::UdpListen(_) => "udp-listen",
            Self::Tcp(_) => "tcp",
            Self::TcpListen(_) => "tcp-listen",
        }
    }
}

impl std::str::FromStr for LinkSpec {
    type Err = LinkSpecError;

    fn from_str(text: &str) -> Result<Self, LinkSpecError> {
        let error = |reason: String| LinkSpecError { text: text.to_owned(), reason };
        let Some((kind, rest)) = text.split_once(':') else {
            return Err(error("no kind before a colon".to_owned()));
        };
        let host = || -> Result<Host, LinkSpecError> {
            let (name, port) = rest.rsplit_once(':').unwrap_or(("", rest));
            let port = port.parse().map_err(|_| error(format!("\"{port}\" is no port, 0 to 65535")))?;
            let name = name.trim_start_matches('[').trim_end_matches(']');
            Ok(Host { name: if name.is_empty() { "127.0.0.1" } else { name }.to_owned(), port })
        };
        let dialled = |host: Host| -> Result<Host, LinkSpecError> {
            if host.port == 0 { Err(error("port 0 is only for listening".to_owned())) } else { Ok(host) }
        };
        match kind {
            "serial" => {
                let Some((path, baud)) = rest.rsplit_once(':') else {
                    return Err(error("no baud rate after the path".to_owned()));
                };
                let baud = baud.parse().ok().filter(|baud| BAUD_RANGE.contains(baud));
                let baud = baud.ok_or_else(|| {
                    error(format!(
                        "the baud rate is no number from {} to {}",
                        BAUD_RANGE.start(),
                        BAUD_RANGE.end()
                    ))
                })?;
                if path.is_empty() {
                    return Err(error("the path is empty".to_owned()));
                }
                Ok(Self::Serial { path: path.to_owned(), baud })
            }
            "udp" => Ok(Self::Udp(dialled(host()?)?)),
            "udp-listen" => Ok(Self::UdpListen(host()?)),
            "tcp" => Ok(Self::Tcp(dialled(host()?)?)),
            "tcp-listen" => Ok(Self::TcpListen(host()?)),
            _ => Err(error(format!("unknown kind \"{kind}\""))),
        }
    }
}

impl std::fmt::Display for LinkSpec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Serial { path, baud } => write!(f, "serial:{path}:{baud}"),
            Self::Udp(h) | Self::UdpListen(h) | Self::Tcp(h) | Self::TcpListen(h) => {
                let bracket = h.name.contains(':');
                let (open, close) = if bracket { ("[", "]") } else { ("", "") };
                write!(f, "{}:{open}{}{close}:{}", self.kind(), h.name, h.port)
            }
        }
    }
}

impl Host {
    pub(super) fn resolve(&self) -> io::Result<SocketAddr> {
        let mut addresses = (self.name.as_str(), self.port).to_socket_addrs()?;
        addresses.next().ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "the host has no address"))
    }
}
