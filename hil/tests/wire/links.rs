//! Links: what goes in comes out, on every kind; who hangs up may come back; noise harms nothing.

use std::io::Write as _;
use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

use hopbench_hil::wire::link::{Hold, Link, LinkSpec, Notice};
use hopbench_hil::wire::mavlink::{ControlsFrame, Decoder, Encoder, FromFc, actuator_controls};

/// Two ends of one kind of link; the second is what the peer holds.
fn ends(kind: &str) -> (Link, Link) {
    let open = |text: &str| Link::open(&text.parse::<LinkSpec>().unwrap()).unwrap();
    match kind {
        "memory" => Link::pair().unwrap(),
        "udp" => {
            let near = open("udp-listen:0");
            let far = open(&near.address().replace("udp-listen", "udp"));
            (near, far)
        }
        "tcp" => {
            let near = open("tcp-listen:0");
            let far = open(&near.address().replace("tcp-listen", "tcp"));
            (near, far)
        }
        _ => panic!("{kind}"),
    }
}

/// Receives until `enough` or two seconds have passed.
fn receive_until(link: &mut Link, mut enough: impl FnMut(&[u8]) -> bool) -> Vec<u8> {
    let (mut bytes, deadline) = (Vec::new(), Instant::now() + Duration::from_secs(2));
    while !enough(&bytes) && Instant::now() < deadline {
        link.wait(Instant::now() + Duration::from_millis(10));
        link.receive(&mut bytes);
    }
    bytes
}

/// The peer speaks first, until it is heard.
fn introduce(near: &mut Link, far: &mut Link) {
    let deadline = Instant::now() + Duration::from_secs(2);
    let mut bytes = Vec::new();
    while !near.has_peer() || bytes.is_empty() {
        assert!(Instant::now() < deadline, "{} never met", near.address());
        far.send(b"hello");
        near.wait(Instant::now() + Duration::from_millis(5));
        near.receive(&mut bytes);
    }
    // What of the greetings is still under way.
    let quiet = Instant::now() + Duration::from_millis(20);
    while Instant::now() < quiet {
        near.wait(quiet);
        near.receive(&mut bytes);
    }
    near.take_notices();
    far.take_notices();
}

fn controls(time_us: u64) -> ControlsFrame {
    ControlsFrame { time_us, flags: 1, controls: [0.25; 16], mode: 1 }
}

/// A pseudo-terminal: its master end, and the path that a serial link opens.
fn pty() -> (OwnedFd, String) {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    let mut raw = rustix::termios::tcgetattr(&master).unwrap();
    raw.make_raw();
    rustix::termios::tcsetattr(&master, rustix::termios::OptionalActions::Now, &raw).unwrap();
    (master, path)
}

#[test]
fn bytes_arrive_as_they_left_both_ways() {
    for kind in ["memory", "udp", "tcp"] {
        let (mut near, mut far) = ends(kind);
        introduce(&mut near, &mut far);
        for size in [1, 93, 280, 1400] {
            let sent: Vec<u8> = (0..size).map(|i| (i * 7) as u8).collect();
            near.send(&sent);
            assert_eq!(receive_until(&mut far, |b| b.len() >= size), sent, "{kind}");
            far.send(&sent);
            assert_eq!(receive_until(&mut near, |b| b.len() >= size), sent, "{kind}");
        }
        assert_eq!(near.counters().sent_bytes, 1 + 93 + 280 + 1400, "{kind}");
        assert_eq!(near.counters().dropped_queue_full, 0);
    }
}

#[test]
fn a_serial_port_carries_bytes_both_ways() {
    let (master, path) = pty();
    let mut link = Link::open(&format!("serial:{path}:921600").parse().unwrap()).unwrap();
    let mut master = std::fs::File::from(master);
    let sent: Vec<u8> = (0..=255).collect();
    link.send(&sent);
    let mut got = vec![0; 256];
    std::io::Read::read_exact(&mut master, &mut got).unwrap();
    assert_eq!(got, sent);
    master.write_all(&sent).unwrap();
    assert_eq!(receive_until(&mut link, |b| b.len() >= 256), sent);
}

#[test]
fn a_serial_port_that_is_unplugged_is_named_and_taken_up_again() {
    let (master, path) = pty();
    let folder = std::env::temp_dir().join(format!("hopbench-serial-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let port = folder.join("port");
    let _ = std::fs::remove_file(&port);
    std::os::unix::fs::symlink(&path, &port).unwrap();
    let mut link = Link::open(&format!("serial:{}:921600", port.display()).parse().unwrap()).unwrap();
    assert!(link.has_peer());
    drop(master); // the device is gone
    let (mut notices, deadline) = (Vec::new(), Instant::now() + Duration::from_secs(3));
    while !notices.iter().any(|n| matches!(n, Notice::Disconnected(_))) {
        assert!(Instant::now() < deadline, "{notices:?}");
        receive_until(&mut link, |_| true);
        link.wait(Instant::now() + Duration::from_millis(10));
        link.receive(&mut Vec::new());
        notices.extend(link.take_notices());
    }
    assert!(!link.has_peer());
    let (master, path) = pty();
    std::fs::remove_file(&port).unwrap();
    std::os::unix::fs::symlink(&path, &port).unwrap();
    while !link.has_peer() {
        assert!(Instant::now() < deadline, "never opened again");
        link.wait(Instant::now() + Duration::from_millis(10));
        link.receive(&mut Vec::new());
    }
    let mut master = std::fs::File::from(master);
    master.write_all(b"back").unwrap();
    assert_eq!(receive_until(&mut link, |b| b.len() >= 4), b"back");
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn a_second_client_is_refused_and_named() {
    let (mut near, mut far) = ends("tcp");
    introduce(&mut near, &mut far);
    let address = near.address().trim_start_matches("tcp-listen:").to_owned();
    let intruder = std::net::TcpStream::connect(&address).unwrap();
    let name = intruder.local_addr().unwrap().to_string();
    near.receive(&mut Vec::new());
    assert!(near.take_notices().contains(&Notice::Refused(name)));
    near.send(b"for the first");
    assert_eq!(receive_until(&mut far, |b| b.len() >= 13), b"for the first");

    let (mut near, mut far) = ends("udp");
    introduce(&mut near, &mut far);
    let address = near.address().trim_start_matches("udp-listen:").to_owned();
    let intruder = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    intruder.send_to(b"me too", &address).unwrap();
    assert!(receive_until(&mut near, |_| false).is_empty());
    let name = intruder.local_addr().unwrap().to_string();
    assert!(near.take_notices().contains(&Notice::Refused(name)));
    assert_eq!(near.counters().refused, 1);
}

#[test]
fn whoever_hangs_up_may_come_back() {
    let (mut near, mut far) = ends("tcp");
    introduce(&mut near, &mut far);
    let address = near.address().replace("tcp-listen", "tcp");
    drop(far);
    let deadline = Instant::now() + Duration::from_secs(2);
    while near.has_peer() {
        assert!(Instant::now() < deadline);
        near.receive(&mut Vec::new());
    }
    near.send(b"to nobody");
    assert_eq!(near.counters().dropped_no_peer, 1);
    let mut again = Link::open(&address.parse().unwrap()).unwrap();
    introduce(&mut near, &mut again);

    // A dialling link finds a listener that was not there, and again after it was gone.
    let place = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut dialling = Link::open(&format!("tcp:{place}").parse().unwrap()).unwrap();
    assert!(!dialling.has_peer());
    for _ in 0..2 {
        let mut listening = Link::open(&format!("tcp-listen:{place}").parse().unwrap()).unwrap();
        let deadline = Instant::now() + Duration::from_secs(3);
        while !(dialling.has_peer() && listening.has_peer()) {
            assert!(Instant::now() < deadline);
            dialling.receive(&mut Vec::new());
            listening.receive(&mut Vec::new());
            std::thread::sleep(Duration::from_millis(5));
        }
        drop(listening);
        while dialling.has_peer() {
            assert!(Instant::now() < deadline);
            dialling.receive(&mut Vec::new());
        }
    }
}

#[test]
fn a_peer_that_does_not_read_costs_whole_writes_and_no_time() {
    let (mut near, mut far) = ends("tcp");
    introduce(&mut near, &mut far);
    let mut encoder = Encoder::new(1, 200);
    let start = Instant::now();
    for i in 0..200_000 {
        let mut frame = Vec::new();
        encoder.encode(&actuator_controls(&controls(i)), &mut frame);
        near.send(&frame);
    }
    assert!(near.counters().dropped_queue_full > 0);
    // No limit on speed, but a write that blocked would block for ever.
    assert!(start.elapsed() < Duration::from_secs(60));
    // What does arrive is whole frames.
    let mut decoder = Decoder::default();
    decoder.push(&receive_until(&mut far, |_| false));
    let frames = std::iter::from_fn(|| decoder.next_frame()).count() as u64;
    assert!(frames > 100);
    assert_eq!(decoder.counters().crc_errors + decoder.counters().skipped_bytes, 0);
}

#[test]
fn what_cannot_be_opened_says_why() {
    let cause = |text: &str| Link::open(&text.parse().unwrap()).unwrap_err().to_string();
    let missing = cause("serial:/dev/no-such-tty:921600");
    assert!(missing.contains("/dev/no-such-tty") && missing.contains("no such port"), "{missing}");
    let near = Link::open(&"tcp-listen:0".parse().unwrap()).unwrap();
    let taken = cause(near.address());
    assert!(taken.contains("another program"), "{taken}");
    assert!(cause("udp-listen:192.0.2.1:14550").contains("no such address"));
}

/// A small generator of our own (xorshift64*, Vigna 2016): the bytes must be the same every time.
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }
}

/// Head of a long frame whose message nobody knows; repeated, each is the body of the one before.
const NESTED: [u8; 10] = [0xFD, 0xF8, 0, 0, 0, 1, 1, 0xEF, 0xCD, 0xAB];

/// One piece of about a frame: random, truncated, nested heads or mutated; never a whole good frame.
fn noise(chance: &mut Chance, encoder: &mut Encoder) -> Vec<u8> {
    let mut frame = Vec::new();
    encoder.encode(&actuator_controls(&controls(chance.next())), &mut frame);
    match chance.next() % 4 {
        0 => (0..1 + chance.next() % 200).map(|_| chance.next() as u8).collect(),
        1 => {
            frame.truncate(1 + chance.next() as usize % (frame.len() - 1));
            frame
        }
        2 => NESTED.repeat(26),
        _ => {
            let place = chance.next() as usize % frame.len();
            frame[place] ^= 1 << (chance.next() % 8);
            frame
        }
    }
}

#[test]
fn nested_heads_of_unknown_messages_cost_no_time() {
    let mut decoder = Decoder::default();
    let start = Instant::now();
    for _ in 0..100 {
        decoder.push(&NESTED.repeat(1000));
        while decoder.next_frame().is_some() {}
    }
    // A million bytes are a hundred thousand candidates of 258 bytes each: 26 million steps of the checksum,
    // a fraction of a second. One checksum for each of the 256 seeds would take ten seconds and more.
    assert!(start.elapsed() < Duration::from_secs(2), "{:?}", start.elapsed());
}

#[test]
fn a_silent_peer_gives_way_late_and_never_while_it_is_kept() {
    let (mut near, mut far) = ends("udp");
    introduce(&mut near, &mut far);
    let address = near.address().trim_start_matches("udp-listen:").to_owned();
    let stranger = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let knock = |near: &mut Link| {
        near.take_notices();
        stranger.send_to(b"me", &address).unwrap();
        near.wait(Instant::now() + Duration::from_secs(2));
        near.receive(&mut Vec::new());
        near.take_notices()
    };
    assert!(matches!(knock(&mut near)[..], [Notice::Refused(_)]));
    near.keep_peer(Hold::Keep);
    std::thread::sleep(Duration::from_millis(5_200));
    assert!(matches!(knock(&mut near)[..], [Notice::Refused(_)]));
    near.keep_peer(Hold::Release);
    assert!(matches!(knock(&mut near)[..], [Notice::Connected(_)]));
}

#[test]
fn a_flood_of_strangers_is_counted_and_named_once() {
    let (mut near, mut far) = ends("udp");
    introduce(&mut near, &mut far);
    let address = near.address().trim_start_matches("udp-listen:").to_owned();
    let intruder = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let start = Instant::now();
    let mut named = 0;
    for _ in 0..100 {
        intruder.send_to(b"me too", &address).unwrap();
        near.receive(&mut Vec::new());
        named += near.take_notices().len();
    }
    assert_eq!(near.counters().refused, 100);
    assert!(named >= 1 && named <= 1 + start.elapsed().as_secs() as usize, "{named}");
}

#[test]
fn a_million_bad_bytes_on_each_link_do_no_harm_and_are_counted() {
    for kind in ["memory", "udp", "tcp"] {
        let (mut near, mut far) = ends(kind);
        introduce(&mut near, &mut far);
        let (mut chance, mut encoder) = (Chance(0x9E37_79B9_7F4A_7C15), Encoder::new(1, 1));
        let (mut decoder, mut bytes, mut sent) = (Decoder::default(), Vec::new(), 0);
        while sent < 1_000_000 {
            let piece = noise(&mut chance, &mut encoder);
            sent += piece.len();
            far.send(&piece);
            bytes.clear();
            near.receive(&mut bytes);
            decoder.push(&bytes);
            while decoder.next_frame().is_some() {}
        }
        // The next good frames come through: at worst the first ends a damaged one that claimed its bytes.
        let mut good = Vec::new();
        for time_us in [1, 2, 3, 4] {
            encoder.encode(&actuator_controls(&controls(time_us)), &mut good);
        }
        far.send(&good);
        let mut seen = Vec::new();
        receive_until(&mut near, |all| {
            decoder.push(&all[seen.len()..]);
            seen = all.to_vec();
            let mut last = false;
            while let Some(frame) = decoder.next_frame() {
                last |= matches!(frame.from_fc(), FromFc::Controls(c) if c.time_us == 4);
            }
            last
        });
        let counters = decoder.counters();
        assert!(counters.crc_errors > 1000, "{kind}: {counters:?}");
        assert!(counters.frames >= 1, "{kind}: {counters:?}");
        assert!(near.counters().received_bytes > 900_000, "{kind}: {:?}", near.counters());
    }
}

#[test]
fn a_million_bad_bytes_on_a_serial_port_do_no_harm() {
    let (master, path) = pty();
    let mut link = Link::open(&format!("serial:{path}:921600").parse().unwrap()).unwrap();
    let writer = std::thread::spawn(move || {
        let mut master = std::fs::File::from(master);
        let (mut chance, mut encoder, mut sent) = (Chance(77), Encoder::new(1, 1), 0);
        while sent < 1_000_000 {
            let piece = noise(&mut chance, &mut encoder);
            sent += piece.len();
            master.write_all(&piece).unwrap();
        }
        (master, sent as u64)
    });
    let (mut decoder, mut bytes, deadline) =
        (Decoder::default(), Vec::new(), Instant::now() + Duration::from_secs(60));
    while link.counters().received_bytes < 1_000_000 {
        assert!(Instant::now() < deadline, "{:?}", link.counters());
        link.wait(Instant::now() + Duration::from_millis(10));
        bytes.clear();
        link.receive(&mut bytes);
        decoder.push(&bytes);
        while decoder.next_frame().is_some() {}
    }
    let (_master, sent) = writer.join().unwrap();
    assert!(sent >= 1_000_000);
    assert!(decoder.counters().crc_errors > 1000, "{:?}", decoder.counters());
}
