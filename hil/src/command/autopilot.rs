//! `hopbench autopilot`: the built-in autopilot as a MAVLink flight controller of its own.

use std::cell::Cell;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::Result;
use hopbench::event::Phase;
use hopbench::simulation::Instrumentation;
use serde_json::json;

use super::{Common, DEVICE_FAILED, DONE, interrupt, print_json, refuse_out};
use crate::bench::pilot::Pilot;
use crate::load;
use crate::wire::link::{Link, LinkSpec};
use crate::wire::profile;

/// Fly a plant at the other end of a MAVLink link with the built-in autopilot
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Where the plant is: udp:HOST:PORT, tcp:HOST:PORT, serial:PATH:BAUD, …
    #[arg(long, value_name = "LINK")]
    pub plant: LinkSpec,
    /// Scenario whose vehicle, site and mission it is told
    #[arg(long, value_name = "FILE", default_value = "scenarios/hop_50m.toml")]
    pub scenario: PathBuf,
    /// Profile that the plant was started with: it fixes the throttle's meaning and the delay of satellite
    /// navigation
    #[arg(long, value_name = "PROFILE", default_value = "generic", value_parser = ["px4-sitl", "px4-hitl", "generic"])]
    pub profile: String,
}

/// Runs the command.
pub fn run(args: &Args, common: &Common) -> Result<ExitCode> {
    refuse_out(common, "the bench at the other end keeps the run: give it --out")?;
    let scenario = load::scenario(&args.scenario, &common.set, None)?;
    let profile = profile::named(&args.profile).unwrap_or(&profile::GENERIC);
    let instruments = Instrumentation { imu_rate_hz: None, gnss_delay_s: profile.gnss_delay_s };
    let mut pilot = Pilot::for_scenario(&scenario, &instruments, profile.throttle)?;
    let mut link = Link::open(&args.plant)?;
    let stop = interrupt::stop_on_signal()?;
    eprintln!("flying {} for the plant on {}", scenario.name, link.address());
    let (mut phase, mut abort) = (None, None);
    let heard = Cell::new(false);
    let due = Cell::new(Instant::now() + Duration::from_secs(1));
    let address = link.address().to_owned();
    pilot.serve(
        &mut link,
        || {
            let now = Instant::now();
            if !heard.get() && now >= due.get() {
                due.set(now + Duration::from_secs(1));
                eprintln!("waiting for plant on {address}");
            }
            stop.load(Ordering::Relaxed)
        },
        |belief| {
            heard.set(true);
            if belief.abort != abort {
                abort = belief.abort;
                if let Some(abort) = abort {
                    eprintln!("abort: {} at {:.3} s", abort.reason.name(), abort.time.s());
                }
            }
            if phase != Some(belief.phase) {
                phase = Some(belief.phase);
                eprintln!("{}", belief.phase.name());
            }
        },
    );
    if common.json {
        let (received, sent) = pilot.frames();
        print_json(&json!({
            "plant": link.address(),
            "scenario": scenario.name,
            "heard": pilot.has_flown(),
            "phase": phase.map(Phase::name),
            "received": received,
            "sent": sent,
        }))?;
    }
    if !pilot.has_flown() {
        eprintln!("no HIL_SENSOR came from {}", link.address());
        return Ok(ExitCode::from(DEVICE_FAILED));
    }
    Ok(ExitCode::from(DONE))
}
