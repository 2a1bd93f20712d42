//! A serial port on a thread of its own, seen by the stepping thread as one end of a socket pair.
//!
//! tokio-serial moves the bytes and opens for this program alone (TIOCEXCL and an exclusive lock of the
//! file). After the device was unplugged the thread reopens it until it is back; meanwhile nothing is
//! queued. A device that udev has given a lasting name is looked for under that name only: it is found when
//! it comes back with another number, and another device that took its number is left alone.
//!
//! Low latency: a USB adapter of FTDI keeps received bytes back for 16 ms unless its `latency_timer` says
//! less. It is set to 1 ms and put back at the end. Other drivers have no such file, and the flag of
//! `setserial low_latency` needs an ioctl that safe code does not reach; USB-CDC boards do not need either.

use std::io;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_serial::{SerialPort, SerialPortBuilderExt, SerialStream};

use super::failure::OpenFailure;
use crate::wire::port;

/// Bytes that may wait between the two threads: a tenth of a second at 921600 baud. What waits longer is
/// stale, and is better dropped where drops are counted.
const BUFFER_BYTES: usize = 8 * 1024;
/// Between two attempts to open a port that is gone.
const REOPEN: Duration = Duration::from_millis(200);
/// A receiver samples each byte from its own first edge, ten symbols long: beyond half a symbol in ten the
/// last one is misread, and the other end takes its share. Greatest deviation of this end (1).
const BAUD_TOLERANCE: f64 = 0.02;

/// What happened to the port.
#[derive(Debug)]
pub(super) enum Event {
    /// Open, again; under which path.
    Opened(String),
    /// Gone, and why.
    Lost(String),
}

/// An open port, as the link holds it.
#[derive(Debug)]
pub(super) struct Port {
    /// Losses and returns.
    pub(super) events: Receiver<Event>,
    /// What was found and set, for people.
    pub(super) settings: String,
    timer: SharedTimer,
}

/// The latency timer in force, put back by whoever drops it.
type SharedTimer = Arc<Mutex<Option<LatencyTimer>>>;

impl Drop for Port {
    fn drop(&mut self) {
        // The thread may live a little longer than the program's interest in it.
        if let Ok(mut timer) = self.timer.lock() {
            timer.take();
        }
    }
}

/// Opens the port; later losses and returns come as events.
pub(super) fn open(path: &str, baud: u32) -> Result<(UnixStream, Port), OpenFailure> {
    let failed = |e: io::Error| OpenFailure::of(&e);
    let (near, far) = UnixStream::pair().map_err(failed)?;
    for end in [&near, &far] {
        end.set_nonblocking(true).map_err(failed)?;
        rustix::net::sockopt::set_socket_send_buffer_size(end, BUFFER_BYTES)
            .map_err(|e| OpenFailure::of(&e.into()))?;
    }
    let (event_in, events) = std::sync::mpsc::channel();
    let (first_in, first) = std::sync::mpsc::channel();
    let place = Place::of(Path::new(path), Path::new(port::BY_ID));
    let timer = SharedTimer::default();
    let thread = {
        let (place, timer) = (place.clone(), Arc::clone(&timer));
        move || serve(&place, baud, far, &timer, &event_in, &first_in)
    };
    std::thread::Builder::new().name("serial".to_owned()).spawn(thread).map_err(failed)?;
    let ended = || OpenFailure::of(&io::Error::other("the serial thread ended"));
    let latency = first.recv().map_err(|_| ended())??;
    let settings = format!("{latency}; {}", place.hint());
    Ok((near, Port { events, settings, timer }))
}

/// Where the port is to be found, also after it was unplugged.
#[derive(Clone, Debug, PartialEq)]
struct Place {
    path: PathBuf,
    by_id: Option<PathBuf>,
}

impl Place {
    fn of(path: &Path, folder: &Path) -> Self {
        Self { path: path.to_owned(), by_id: port::by_id(path, folder) }
    }

    /// What to open.
    fn now(&self) -> &Path {
        self.by_id.as_deref().unwrap_or(&self.path)
    }

    fn hint(&self) -> String {
        match &self.by_id {
            Some(name) => format!("known as {}, under which it is found again", name.display()),
            None => format!(
                "no name under {}: unplugged, it is found again only if it comes back as {}",
                port::BY_ID,
                self.path.display()
            ),
        }
    }
}

/// The thread: opens, moves bytes until the port is lost, opens again; ends with the other end of `far`.
fn serve(
    place: &Place,
    baud: u32,
    far: UnixStream,
    timer: &SharedTimer,
    event_in: &Sender<Event>,
    first_in: &Sender<Result<String, OpenFailure>>,
) {
    let runtime = match tokio::runtime::Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(e) => return drop(first_in.send(Err(OpenFailure::of(&e)))),
    };
    let quicken = || {
        let (set, said) = LatencyTimer::set(Path::new("/sys/class/tty"), place.now());
        if let Ok(mut timer) = timer.lock() {
            *timer = set;
        }
        said
    };
    runtime.block_on(async {
        let far = tokio::net::UnixStream::from_std(far).map_err(|e| OpenFailure::of(&e));
        let (mut port, far) = match (open_port(&place.path, baud), far) {
            (Ok(port), Ok(far)) => (port, far),
            (Err(cause), _) | (_, Err(cause)) => return drop(first_in.send(Err(cause))),
        };
        let _ = first_in.send(Ok(quicken()));
        let (mut from_plant, mut to_plant) = far.into_split();
        loop {
            match copy_both(&mut port, &mut from_plant, &mut to_plant).await {
                Ended::Plant => return,
                Ended::Port(why) => {
                    if event_in.send(Event::Lost(format!("{why}; {}", place.hint()))).is_err() {
                        return;
                    }
                }
            }
            drop(port);
            port = loop {
                tokio::time::sleep(REOPEN).await;
                // What the plant wrote meanwhile is stale.
                let mut stale = [0; 4096];
                while let Ok(length) = from_plant.try_read(&mut stale) {
                    if length == 0 {
                        return;
                    }
                }
                if let Ok(port) = open_port(place.now(), baud) {
                    break port;
                }
            };
            quicken();
            let device = std::fs::canonicalize(place.now()).unwrap_or_else(|_| place.now().to_owned());
            if event_in.send(Event::Opened(device.display().to_string())).is_err() {
                return;
            }
        }
    });
}

enum Ended {
    /// The link was dropped.
    Plant,
    /// The port failed.
    Port(String),
}

async fn copy_both(
    port: &mut SerialStream,
    from_plant: &mut tokio::net::unix::OwnedReadHalf,
    to_plant: &mut tokio::net::unix::OwnedWriteHalf,
) -> Ended {
    let (mut from_port, mut to_port) = tokio::io::split(port);
    let inward = async {
        let mut buffer = [0; 1024];
        loop {
            match from_port.read(&mut buffer).await {
                Ok(0) => return Ended::Port("end of file: unplugged?".to_owned()),
                Ok(length) => {
                    if to_plant.write_all(&buffer[..length]).await.is_err() {
                        return Ended::Plant;
                    }
                }
                Err(e) => return Ended::Port(e.to_string()),
            }
        }
    };
    let outward = async {
        let mut buffer = [0; 1024];
        loop {
            match from_plant.read(&mut buffer).await {
                Ok(0) | Err(_) => return Ended::Plant,
                Ok(length) => {
                    if let Err(e) = to_port.write_all(&buffer[..length]).await {
                        return Ended::Port(e.to_string());
                    }
                }
            }
        }
    };
    tokio::select! {
        ended = inward => ended,
        ended = outward => ended,
    }
}

fn open_port(path: &Path, baud: u32) -> Result<SerialStream, OpenFailure> {
    let port = tokio_serial::new(path.to_string_lossy(), baud).open_native_async().map_err(|e| {
        let kind = match e.kind {
            tokio_serial::ErrorKind::NoDevice => match std::fs::metadata(path) {
                Err(e) => e.kind(),
                Ok(_) => io::ErrorKind::ResourceBusy,
            },
            tokio_serial::ErrorKind::Io(kind) => kind,
            _ => io::ErrorKind::Other,
        };
        OpenFailure::of_port(&io::Error::new(kind, e.to_string()), path)
    })?;
    match port.baud_rate() {
        Ok(actual) => baud_is(baud, actual).map(|()| port),
        Err(_) => Ok(port),
    }
}

/// A driver that cannot make a rate sets the nearest it can and says nothing.
fn baud_is(asked: u32, actual: u32) -> Result<(), OpenFailure> {
    if (f64::from(actual) / f64::from(asked) - 1.0).abs() <= BAUD_TOLERANCE {
        return Ok(());
    }
    let cause = format!(
        "{asked} baud refused, the driver makes {actual} of it; allowed: \
         what lies within 2 % of a rate it can make"
    );
    Err(OpenFailure { kind: io::ErrorKind::InvalidInput, cause })
}

/// The latency timer of an adapter, put back when dropped.
#[derive(Debug)]
struct LatencyTimer {
    file: PathBuf,
    before: String,
}

impl LatencyTimer {
    /// Sets 1 ms where the driver offers it, and says what it found.
    fn set(class: &Path, path: &Path) -> (Option<Self>, String) {
        let device = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let file = class.join(device.file_name().unwrap_or_default()).join("device/latency_timer");
        match port::word(&file) {
            None => (None, "low-latency mode not offered by this driver".to_owned()),
            Some(ms) if ms == "1" => (None, "latency timer 1 ms".to_owned()),
            Some(ms) => match std::fs::write(&file, "1") {
                Ok(()) => {
                    let said = format!("latency timer {ms} ms, now 1 ms");
                    (Some(Self { file, before: ms }), said)
                }
                Err(e) => {
                    (None, format!("latency timer {ms} ms stays: {e}; as root: echo 1 > {}", file.display()))
                }
            },
        }
    }
}

impl Drop for LatencyTimer {
    fn drop(&mut self) {
        // An adapter that is gone forgets the setting by itself.
        let _ = std::fs::write(&self.file, &self.before);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("hopbench-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn the_latency_timer_is_one_millisecond_for_as_long_as_the_port_is_open() {
        let class = folder("latency");
        let file = class.join("null/device/latency_timer");
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(&file, "16\n").unwrap();
        let (timer, said) = LatencyTimer::set(&class, Path::new("/dev/null"));
        assert_eq!(said, "latency timer 16 ms, now 1 ms");
        assert_eq!(port::word(&file).unwrap(), "1");
        drop(timer);
        assert_eq!(port::word(&file).unwrap(), "16");
        let (timer, said) = LatencyTimer::set(&class, Path::new("/dev/zero"));
        assert!(timer.is_none() && said.contains("not offered"), "{said}");
        std::fs::remove_dir_all(&class).unwrap();
    }

    #[test]
    fn a_rate_that_the_driver_changed_is_refused_with_both_figures() {
        assert!(baud_is(3_000_000, 3_000_000).is_ok());
        assert!(baud_is(921_600, 923_076).is_ok()); // 24 MHz / 26
        let refused = baud_is(3_000_000, 115_200).unwrap_err().cause;
        assert!(refused.contains("3000000") && refused.contains("115200"), "{refused}");
    }

    #[test]
    fn a_port_with_a_lasting_name_is_looked_for_under_that_name() {
        let by_id = folder("lasting");
        let name = by_id.join("usb-Board_1234-if00");
        std::os::unix::fs::symlink("/dev/null", &name).unwrap();
        let place = Place::of(Path::new("/dev/null"), &by_id);
        assert_eq!(place.now(), name);
        assert!(place.hint().contains("usb-Board_1234-if00"));
        let nameless = Place::of(Path::new("/dev/zero"), &by_id);
        assert_eq!(nameless.now(), Path::new("/dev/zero"));
        assert!(nameless.hint().contains("by-id"));
        std::fs::remove_dir_all(&by_id).unwrap();
    }
}
