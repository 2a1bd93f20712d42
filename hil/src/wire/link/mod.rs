//! Bytes in, bytes out: UDP, TCP, serial and an in-memory pair. A link knows no message.
//!
//! The loop that steps the plant owns its link and never blocks on it: descriptors are non-blocking,
//! [`Link::wait`] has a deadline, and what a slow peer does not take is kept in a bounded queue and then
//! dropped by whole writes, counted. Sockets are read by the stepping thread itself, because a second
//! thread in between costs two wake-ups per step; a serial port and the dialling of a TCP peer, which may
//! block, live on threads of their own.

mod failure;
mod spec;

mod serial;
mod tcp;

use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::unix::net::UnixStream;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

pub use failure::{LinkError, OpenFailure};
pub use spec::{Host, LinkSpec, LinkSpecError};

/// Bytes that wait for a slow network peer; about a second of the fullest profile.
const NETWORK_QUEUE_BYTES: usize = 64 * 1024;
/// Bytes that wait for a serial line, besides what the system holds: what waits longer is stale.
const SERIAL_QUEUE_BYTES: usize = 4 * 1024;
/// Who was turned away is not named again for this long.
const REFUSAL_SILENCE: Duration = Duration::from_secs(1);
/// Strangers that are told apart.
const STRANGERS: usize = 16;
/// A `udp-listen` peer silent for this long gives way to whoever writes next, unless it is kept.
const PEER_SILENCE: Duration = Duration::from_secs(5);

/// What happened to a link besides bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Notice {
    /// The other end is there.
    Connected(String),
    /// The other end is gone, and why.
    Disconnected(String),
    /// Somebody else knocked and was turned away.
    Refused(String),
}

/// Whether a silent `udp-listen` peer may give way to somebody else.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Hold {
    /// Never: a vehicle is in its hands, or simulated time stands.
    Keep,
    /// After a while of silence.
    #[default]
    Release,
}

/// What a link has moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Bytes received.
    pub received_bytes: u64,
    /// Bytes handed to the system.
    pub sent_bytes: u64,
    /// Writes dropped since nobody was there.
    pub dropped_no_peer: u64,
    /// Writes dropped since the queue to a slow peer was full.
    pub dropped_queue_full: u64,
    /// Bytes or connections of somebody else, turned away.
    pub refused: u64,
}

/// An open link.
#[derive(Debug)]
pub struct Link {
    transport: Transport,
    address: String,
    hold: Hold,
    /// Bytes a stream has not taken yet.
    queue: Vec<u8>,
    notices: Vec<Notice>,
    strangers: Strangers,
    counters: Counters,
}

/// Who was turned away of late, so that a flood of strangers is no flood of notices.
#[derive(Debug, Default)]
struct Strangers(Vec<(SocketAddr, Instant)>);

impl Strangers {
    /// Whether this one is worth a notice.
    fn is_news(&mut self, who: SocketAddr) -> bool {
        let now = Instant::now();
        self.0.retain(|(_, named)| now - *named < REFUSAL_SILENCE);
        let news = self.0.len() < STRANGERS && self.0.iter().all(|(known, _)| *known != who);
        if news {
            self.0.push((who, now));
        }
        news
    }
}

#[derive(Debug)]
enum Transport {
    Udp {
        socket: UdpSocket,
        peer: Option<SocketAddr>,
        listens: bool,
        heard: Instant,
    },
    TcpListen {
        listener: TcpListener,
        stream: Option<TcpStream>,
    },
    TcpDial {
        dialled: Receiver<TcpStream>,
        redial: std::sync::mpsc::Sender<()>,
        stream: Option<TcpStream>,
    },
    /// A serial port behind its thread, or the end of an in-memory pair.
    Pipe {
        stream: Option<UnixStream>,
        port: Option<serial::Port>,
        ready: bool,
    },
}

impl Link {
    /// Opens or starts to listen. Nobody needs to be at the other end yet.
    pub fn open(spec: &LinkSpec) -> Result<Self, LinkError> {
        let error = |cause: io::Error| LinkError { link: spec.to_string(), failure: OpenFailure::of(&cause) };
        let kind = spec.kind();
        let (transport, address) = match spec {
            LinkSpec::Serial { path, baud } => {
                let (stream, port) = serial::open(path, *baud)
                    .map_err(|failure| LinkError { link: spec.to_string(), failure })?;
                (Transport::Pipe { stream: Some(stream), port: Some(port), ready: true }, spec.to_string())
            }
            LinkSpec::Udp(host) => {
                let peer = host.resolve().map_err(error)?;
                let any = if peer.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
                // A loopback peer needs no socket that the network can reach.
                let local = match (peer.ip().is_loopback(), peer.is_ipv4()) {
                    (true, true) => "127.0.0.1:0",
                    (true, false) => "[::1]:0",
                    (false, _) => any,
                };
                let socket = UdpSocket::bind(local).map_err(error)?;
                socket.set_nonblocking(true).map_err(error)?;
                let transport =
                    Transport::Udp { socket, peer: Some(peer), listens: false, heard: Instant::now() };
                (transport, format!("{kind}:{peer}"))
            }
            LinkSpec::UdpListen(host) => {
                let socket = UdpSocket::bind(host.resolve().map_err(error)?).map_err(error)?;
                socket.set_nonblocking(true).map_err(error)?;
                let bound = socket.local_addr().map_err(error)?;
                let transport = Transport::Udp { socket, peer: None, listens: true, heard: Instant::now() };
                (transport, format!("{kind}:{bound}"))
            }
            LinkSpec::Tcp(host) => {
                let peer = host.resolve().map_err(error)?;
                let (dialled, redial) = tcp::dial(peer);
                (Transport::TcpDial { dialled, redial, stream: None }, format!("{kind}:{peer}"))
            }
            LinkSpec::TcpListen(host) => {
                let listener = TcpListener::bind(host.resolve().map_err(error)?).map_err(error)?;
                listener.set_nonblocking(true).map_err(error)?;
                let bound = listener.local_addr().map_err(error)?;
                (Transport::TcpListen { listener, stream: None }, format!("{kind}:{bound}"))
            }
        };
        Ok(Self::over(transport, address))
    }

    /// Two ends of a link in memory.
    pub fn pair() -> io::Result<(Self, Self)> {
        let (a, b) = UnixStream::pair()?;
        a.set_nonblocking(true)?;
        b.set_nonblocking(true)?;
        let end = |stream| Transport::Pipe { stream: Some(stream), port: None, ready: true };
        Ok((Self::over(end(a), "memory".to_owned()), Self::over(end(b), "memory".to_owned())))
    }

    fn over(transport: Transport, address: String) -> Self {
        Self {
            transport,
            address,
            hold: Hold::default(),
            queue: Vec::new(),
            notices: Vec::new(),
            strangers: Strangers::default(),
            counters: Counters::default(),
        }
    }

    /// The link with the address actually bound, `udp-listen:127.0.0.1:14555`.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// What was found out about a serial port and set when it was opened, for people.
    pub fn port_settings(&self) -> Option<&str> {
        match &self.transport {
            Transport::Pipe { port: Some(port), .. } => Some(&port.settings),
            _ => None,
        }
    }

    /// Whether somebody is there to be sent to.
    pub fn has_peer(&self) -> bool {
        match &self.transport {
            Transport::Udp { peer, .. } => peer.is_some(),
            Transport::TcpListen { stream, .. } | Transport::TcpDial { stream, .. } => stream.is_some(),
            Transport::Pipe { stream, ready, .. } => stream.is_some() && *ready,
        }
    }

    /// Whether a `udp-listen` peer is kept however silent it is. Other links know whether theirs is there.
    pub fn keep_peer(&mut self, hold: Hold) {
        self.hold = hold;
    }

    /// What has been moved so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// What has happened since the last call.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        std::mem::take(&mut self.notices)
    }

    /// Appends what has arrived to `bytes`, at most about 64 KiB a call; never blocks.
    pub fn receive(&mut self, bytes: &mut Vec<u8>) {
        self.progress();
        let mut buffer = [0; 4096];
        for _ in 0..16 {
            match self.read_once(&mut buffer) {
                Some(0) => continue,
                Some(length) => {
                    self.counters.received_bytes += length as u64;
                    bytes.extend_from_slice(&buffer[..length]);
                }
                None => return,
            }
        }
    }

    /// Sends, or queues, or drops and counts; never blocks. One call is one datagram on UDP. Whether the
    /// bytes were taken.
    pub fn send(&mut self, bytes: &[u8]) -> bool {
        if bytes.is_empty() {
            return true;
        }
        self.progress();
        if !self.has_peer() {
            self.counters.dropped_no_peer += 1;
            return false;
        }
        if let Transport::Udp { socket, peer: Some(peer), .. } = &self.transport {
            let taken = socket.send_to(bytes, *peer).is_ok();
            match taken {
                true => self.counters.sent_bytes += bytes.len() as u64,
                false => self.counters.dropped_queue_full += 1,
            }
            return taken;
        }
        let room = match self.transport {
            Transport::Pipe { .. } => SERIAL_QUEUE_BYTES,
            _ => NETWORK_QUEUE_BYTES,
        };
        if self.queue.len() + bytes.len() > room {
            self.counters.dropped_queue_full += 1;
            return false;
        }
        self.queue.extend_from_slice(bytes);
        self.flush();
        true
    }

    /// Returns when something may have arrived, at the deadline at the latest.
    pub fn wait(&mut self, deadline: Instant) {
        let mut remaining = deadline.saturating_duration_since(Instant::now());
        let mut fds = Vec::with_capacity(2);
        match &self.transport {
            Transport::Udp { socket, .. } => fds.push(PollFd::new(socket, PollFlags::IN)),
            Transport::TcpListen { listener, stream } => {
                fds.push(PollFd::new(listener, PollFlags::IN));
                if let Some(stream) = stream {
                    fds.push(PollFd::new(stream, PollFlags::IN));
                }
            }
            Transport::TcpDial { stream: Some(stream), .. } => fds.push(PollFd::new(stream, PollFlags::IN)),
            Transport::Pipe { stream: Some(stream), .. } => fds.push(PollFd::new(stream, PollFlags::IN)),
            Transport::TcpDial { .. } | Transport::Pipe { .. } => {}
        }
        if fds.is_empty() {
            // Whoever connects comes through a channel that cannot be polled.
            remaining = remaining.min(Duration::from_millis(5));
        }
        let timeout =
            Timespec { tv_sec: remaining.as_secs() as i64, tv_nsec: remaining.subsec_nanos().into() };
        // An interrupted wait is an early return, which the caller has to expect anyway.
        let _ = poll(&mut fds, Some(&timeout));
    }

    /// Accepts, notices who came and went, sends what is queued.
    fn progress(&mut self) {
        match &mut self.transport {
            Transport::Udp { .. } => return,
            Transport::TcpListen { listener, stream } => {
                while let Ok((newcomer, address)) = listener.accept() {
                    if stream.is_some() {
                        self.counters.refused += 1;
                        // Each attempt has a port of its own.
                        if self.strangers.is_news(SocketAddr::new(address.ip(), 0)) {
                            self.notices.push(Notice::Refused(address.to_string()));
                        }
                    } else if tcp::prepare(&newcomer).is_ok() {
                        *stream = Some(newcomer);
                        self.queue.clear();
                        self.notices.push(Notice::Connected(address.to_string()));
                    }
                }
            }
            Transport::TcpDial { dialled, stream, .. } => {
                if stream.is_none()
                    && let Ok(newcomer) = dialled.try_recv()
                    && tcp::prepare(&newcomer).is_ok()
                {
                    let address = newcomer.peer_addr().map_or_else(|e| e.to_string(), |a| a.to_string());
                    *stream = Some(newcomer);
                    self.queue.clear();
                    self.notices.push(Notice::Connected(address));
                }
            }
            Transport::Pipe { port, ready, .. } => {
                while let Some(Ok(event)) = port.as_ref().map(|port| port.events.try_recv()) {
                    match event {
                        serial::Event::Opened(device) => {
                            *ready = true;
                            self.notices.push(Notice::Connected(device));
                        }
                        serial::Event::Lost(why) => {
                            *ready = false;
                            self.notices.push(Notice::Disconnected(why));
                        }
                    }
                }
            }
        }
        self.flush();
    }

    /// `None`: nothing more for now. `Some(0)`: something that is no data.
    fn read_once(&mut self, buffer: &mut [u8]) -> Option<usize> {
        let read = match &mut self.transport {
            Transport::Udp { socket, peer, listens, heard } => {
                let (length, from) = match socket.recv_from(buffer) {
                    Ok(read) => read,
                    // The peer's port is closed; it may open again.
                    Err(e) if e.kind() == io::ErrorKind::ConnectionRefused => return Some(0),
                    Err(_) => return None,
                };
                let now = Instant::now();
                if *peer != Some(from) {
                    let free = *listens
                        && (peer.is_none() || (self.hold == Hold::Release && now - *heard > PEER_SILENCE));
                    if !free {
                        self.counters.refused += 1;
                        if self.strangers.is_news(from) {
                            self.notices.push(Notice::Refused(from.to_string()));
                        }
                        return Some(0);
                    }
                    *peer = Some(from);
                    self.notices.push(Notice::Connected(from.to_string()));
                }
                *heard = now;
                return Some(length);
            }
            Transport::TcpListen { stream, .. } | Transport::TcpDial { stream, .. } => {
                stream.as_mut().map(|s| s.read(buffer))
            }
            Transport::Pipe { stream, .. } => stream.as_mut().map(|s| s.read(buffer)),
        };
        match read? {
            Ok(0) => self.lose("closed by the other end".to_owned()),
            Ok(length) => return Some(length),
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => {}
            Err(e) if e.kind() == io::ErrorKind::Interrupted => return Some(0),
            Err(e) => self.lose(e.to_string()),
        }
        None
    }

    fn flush(&mut self) {
        while !self.queue.is_empty() {
            let written = match &mut self.transport {
                Transport::Udp { .. } => return,
                Transport::TcpListen { stream, .. } | Transport::TcpDial { stream, .. } => {
                    stream.as_mut().map(|s| s.write(&self.queue))
                }
                Transport::Pipe { stream, .. } => stream.as_mut().map(|s| s.write(&self.queue)),
            };
            match written {
                Some(Ok(length)) if length > 0 => {
                    self.counters.sent_bytes += length as u64;
                    self.queue.drain(..length);
                }
                Some(Err(e)) if e.kind() == io::ErrorKind::Interrupted => {}
                Some(Err(e)) if e.kind() == io::ErrorKind::WouldBlock => return,
                Some(Err(e)) => return self.lose(e.to_string()),
                Some(Ok(_)) | None => return,
            }
        }
    }

    fn lose(&mut self, why: String) {
        self.queue.clear();
        match &mut self.transport {
            Transport::Udp { .. } => return,
            Transport::TcpListen { stream, .. } => *stream = None,
            Transport::TcpDial { stream, redial, .. } => {
                *stream = None;
                // The dialling thread lives as long as this link does.
                let _ = redial.send(());
            }
            Transport::Pipe { stream, .. } => *stream = None,
        }
        self.notices.push(Notice::Disconnected(why));
    }
}
