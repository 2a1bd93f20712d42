//! One bench cycle beside a bare UDP echo, in the same run: actuator bytes out -> sensor bytes in, as the
//! flight controller sees it, in lockstep without holding to real time (four plant steps a cycle).
//!
//!     cargo bench -p hopbench-hil

use std::net::UdpSocket;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use hopbench::simulation::{Flight, Source};
use hopbench_hil::bench::live::Live;
use hopbench_hil::bench::pace::{Distribution, now_ns};
use hopbench_hil::bench::{Bench, Options};
use hopbench_hil::load;
use hopbench_hil::wire::link::Link;
use hopbench_hil::wire::mavlink::{
    ControlsFrame, Decoder, Encoder, MavMessage, actuator_controls, frame_bytes,
};
use hopbench_hil::wire::profile::{PX4_SITL, Pacing};

const ROUNDS: usize = 3;
const CYCLES: usize = 20_000;

fn main() {
    for round in 1..=ROUNDS {
        let (echo, cycle) = (echo(), cycle());
        println!(
            "round {round}: bare echo p50 {:.1} us, p99 {:.1} us; bench cycle p50 {:.1} us, p99 {:.1} us; \
             ratio {:.2}",
            echo.quantile_us(0.5),
            echo.quantile_us(0.99),
            cycle.quantile_us(0.5),
            cycle.quantile_us(0.99),
            cycle.quantile_us(0.5) / echo.quantile_us(0.5),
        );
    }
}

/// A thread that sends back what it gets: the frames' sizes, and nothing else.
fn echo() -> Distribution {
    let far = UdpSocket::bind("127.0.0.1:0").expect("loopback has ports");
    let near = UdpSocket::bind("127.0.0.1:0").expect("loopback has ports");
    near.connect(far.local_addr().expect("bound")).expect("loopback");
    let mut times = Distribution::new();
    std::thread::scope(|threads| {
        threads.spawn(|| {
            let mut buffer = [0; 512];
            while let Ok((length, from)) = far.recv_from(&mut buffer) {
                if length == 1 || far.send_to(&buffer[..frame_bytes::HIL_SENSOR], from).is_err() {
                    return;
                }
            }
        });
        let mut buffer = [0; 512];
        for _ in 0..CYCLES {
            let start_ns = now_ns();
            near.send(&[0; frame_bytes::HIL_ACTUATOR_CONTROLS]).expect("loopback");
            near.recv(&mut buffer).expect("the echo lives");
            times.record_ns(now_ns() - start_ns);
        }
        near.send(&[0]).expect("loopback");
    });
    times
}

fn cycle() -> Distribution {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/hover_5m.toml");
    let scenario = load::scenario(&path, &[], None).expect("the scenario is part of this repository");
    let mut flight = Flight::new(&scenario, 1).expect("the scenario is sound");
    let mut link = Link::open(&"udp-listen:0".parse().expect("a link")).expect("loopback has ports");
    let address = link.address().trim_start_matches("udp-listen:").to_owned();
    let stop = AtomicBool::new(false);
    let options = Options {
        profile: &PX4_SITL,
        pacing: Pacing::Lockstep,
        fast: true,
        lockstep_timeout: Duration::from_millis(100),
        source: Source::Fc,
        baud: None,
    };
    let mut times = Distribution::new();
    std::thread::scope(|threads| {
        threads.spawn(|| Bench::new(&mut flight, &mut link, options, Live::silent()).run(&stop));
        let socket = UdpSocket::bind("127.0.0.1:0").expect("loopback has ports");
        socket.connect(&address).expect("loopback");
        let (mut encoder, mut decoder) = (Encoder::new(1, 1), Decoder::default());
        let (mut frame, mut buffer, mut cycles) = (Vec::new(), [0; 2048], 0);
        let mut answer = |time_us: u64| {
            frame.clear();
            let idle = ControlsFrame { time_us, flags: 1, controls: [0.0; 16], mode: 1 };
            encoder.encode(&actuator_controls(&idle), &mut frame);
            let start_ns = now_ns();
            socket.send(&frame).expect("loopback");
            start_ns
        };
        let mut start_ns = answer(0);
        while cycles < CYCLES {
            let length = socket.recv(&mut buffer).expect("the bench lives");
            let arrived_ns = now_ns();
            decoder.push(&buffer[..length]);
            while let Some(frame) = decoder.next_frame() {
                if let Some(MavMessage::HIL_SENSOR(data)) = frame.message() {
                    times.record_ns(arrived_ns - start_ns);
                    cycles += 1;
                    start_ns = answer(data.time_usec);
                }
            }
        }
        stop.store(true, Ordering::Relaxed);
    });
    times
}
