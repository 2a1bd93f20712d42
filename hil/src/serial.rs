//! A serial port on a thread of its own, seen by the stepping thread as one end of a socket pair.
//!
//! tokio-serial moves the bytes. After the device was unplugged the thread reopens it until it is back;
//! meanwhile nothing is queued.

use std::io;
use std::os::unix::net::UnixStream;
use std::sync::mpsc::{Receiver, Sender};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_serial::{SerialPortBuilderExt, SerialStream};

/// Bytes that may wait between the two threads: a tenth of a second at 921600 baud. What waits longer is
/// stale, and is better dropped where drops are counted.
const BUFFER_BYTES: usize = 8 * 1024;

/// What happened to the port.
#[derive(Debug)]
pub enum Event {
    /// Open, again.
    Opened,
    /// Gone, and why.
    Lost(String),
}

/// Opens the port; later losses and returns come as events.
pub fn open(path: &str, baud: u32) -> Result<(UnixStream, Receiver<Event>), String> {
    let (near, far) = UnixStream::pair().map_err(|e| e.to_string())?;
    for end in [&near, &far] {
        end.set_nonblocking(true).map_err(|e| e.to_string())?;
        rustix::net::sockopt::set_socket_send_buffer_size(end, BUFFER_BYTES).map_err(|e| e.to_string())?;
    }
    let (event_in, events) = std::sync::mpsc::channel();
    let (first_in, first) = std::sync::mpsc::channel();
    let path = path.to_owned();
    let thread = move || serve(&path, baud, far, &event_in, &first_in);
    std::thread::Builder::new().name("serial".to_owned()).spawn(thread).map_err(|e| e.to_string())?;
    match first.recv() {
        Ok(Ok(())) => Ok((near, events)),
        Ok(Err(cause)) => Err(cause),
        Err(_) => Err("the serial thread ended".to_owned()),
    }
}

/// The thread: opens, moves bytes until the port is lost, opens again; ends with the other end of `far`.
fn serve(
    path: &str,
    baud: u32,
    far: UnixStream,
    event_in: &Sender<Event>,
    first_in: &Sender<Result<(), String>>,
) {
    let runtime = match tokio::runtime::Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(e) => return drop(first_in.send(Err(e.to_string()))),
    };
    runtime.block_on(async {
        let (mut port, far) = match (open_port(path, baud), tokio::net::UnixStream::from_std(far)) {
            (Ok(port), Ok(far)) => (port, far),
            (Err(cause), _) => return drop(first_in.send(Err(cause))),
            (_, Err(e)) => return drop(first_in.send(Err(e.to_string()))),
        };
        let _ = first_in.send(Ok(()));
        let (mut from_plant, mut to_plant) = far.into_split();
        loop {
            match copy_both(&mut port, &mut from_plant, &mut to_plant).await {
                Ended::Plant => return,
                Ended::Port(why) => {
                    if event_in.send(Event::Lost(why)).is_err() {
                        return;
                    }
                }
            }
            drop(port);
            port = loop {
                tokio::time::sleep(Duration::from_millis(200)).await;
                // What the plant wrote meanwhile is stale.
                let mut stale = [0; 4096];
                while let Ok(length) = from_plant.try_read(&mut stale) {
                    if length == 0 {
                        return;
                    }
                }
                if let Ok(port) = open_port(path, baud) {
                    break port;
                }
            };
            if event_in.send(Event::Opened).is_err() {
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

fn open_port(path: &str, baud: u32) -> Result<SerialStream, String> {
    tokio_serial::new(path, baud).open_native_async().map_err(|e| {
        let kind = match e.kind {
            tokio_serial::ErrorKind::NoDevice => match std::fs::metadata(path) {
                Err(e) => e.kind(),
                Ok(_) => io::ErrorKind::ResourceBusy,
            },
            tokio_serial::ErrorKind::Io(kind) => kind,
            _ => io::ErrorKind::Other,
        };
        crate::link::explain(&io::Error::new(kind, e.to_string()))
    })
}
