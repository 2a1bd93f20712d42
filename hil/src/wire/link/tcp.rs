//! TCP: connections that notice a host that vanished, and a thread that dials.

use std::io;
use std::net::{SocketAddr, TcpStream};
use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::Duration;

/// A TCP peer that acknowledges nothing for this long is gone. The kernel counts keepalive in whole seconds.
const TCP_SILENCE: Duration = Duration::from_secs(2);

/// Small frames must not wait for the acknowledgement of the one before, and a host that is gone without a
/// word (unplugged, crashed) must not hold the connection: what is sent to it is given up, and it is asked
/// when idle.
pub(super) fn prepare(stream: &TcpStream) -> io::Result<()> {
    use rustix::net::sockopt;
    stream.set_nonblocking(true)?;
    stream.set_nodelay(true)?;
    sockopt::set_tcp_user_timeout(stream, TCP_SILENCE.as_millis() as u32)?;
    sockopt::set_tcp_keepidle(stream, TCP_SILENCE / 2)?;
    sockopt::set_tcp_keepintvl(stream, TCP_SILENCE / 2)?;
    sockopt::set_tcp_keepcnt(stream, 1)?;
    Ok(sockopt::set_socket_keepalive(stream, true)?)
}

/// A thread that dials until somebody answers, then again whenever it is asked to.
pub(super) fn dial(peer: SocketAddr) -> (Receiver<TcpStream>, std::sync::mpsc::Sender<()>) {
    let (dialled_in, dialled) = std::sync::mpsc::channel();
    let (redial, asked) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        loop {
            match TcpStream::connect_timeout(&peer, Duration::from_secs(1)) {
                Ok(stream) => {
                    if dialled_in.send(stream).is_err() || asked.recv().is_err() {
                        return;
                    }
                }
                Err(_) => {
                    if asked.try_recv() == Err(TryRecvError::Disconnected) {
                        return;
                    }
                    std::thread::sleep(Duration::from_millis(100));
                }
            }
        }
    });
    (dialled, redial)
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn a_stream_notices_a_host_that_vanished() {
        use rustix::net::sockopt;
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let dialled = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (accepted, _) = listener.accept().unwrap();
        for stream in [dialled, accepted] {
            prepare(&stream).unwrap();
            assert_eq!(sockopt::tcp_user_timeout(&stream).unwrap(), 2000);
            assert!(sockopt::socket_keepalive(&stream).unwrap());
            assert_eq!(sockopt::tcp_keepidle(&stream).unwrap(), Duration::from_secs(1));
        }
    }
}
