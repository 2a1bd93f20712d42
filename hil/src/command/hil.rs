//! `hopbench hil`: the bench.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use anyhow::{Context, Result};
use hopbench::input::InputError;
use hopbench::scenario::Scenario;
use hopbench::simulation::report::Timing;
use hopbench::simulation::{Flight, Instrumentation, Report, Source};

use super::{Common, DONE, UNEXPECTED, interrupt, option_error, print_json, print_text, sensor_rate};
use crate::bench::baseline::Baselines;
use crate::bench::ground::Ground;
use crate::bench::live::Live;
use crate::bench::pilot::Pilot;
use crate::bench::realtime::{self, Privileges};
use crate::bench::{Belief, Bench, Options};
use crate::evidence::certificate::{self, BenchSetup, Host};
use crate::evidence::run_folder::RunFolder;
use crate::evidence::summary;
use crate::load;
use crate::wire::link::{Link, LinkSpec};
use crate::wire::profile::{self, Budget, Pacing, Profile, SensorRates};

/// Put a flight controller on the bench: the plant in real time or in lockstep, MAVLink on the wire
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scenario file
    pub scenario: PathBuf,
    /// Flight controller: serial:PATH:BAUD, udp:HOST:PORT, udp-listen:HOST:PORT, tcp:HOST:PORT or
    /// tcp-listen:HOST:PORT; absent: the built-in autopilot, over a loopback UDP link
    #[arg(long, value_name = "LINK")]
    pub fc: Option<LinkSpec>,
    /// What the flight controller expects; by default what fits the link
    #[arg(long, value_name = "PROFILE", value_parser = ["px4-sitl", "px4-hitl", "generic"])]
    pub profile: Option<String>,
    /// Ground station: telemetry of the true vehicle, requests, and the flight controller's traffic both
    /// ways; a link as for --fc
    #[arg(long, value_name = "LINK")]
    pub gcs: Option<LinkSpec>,
    /// After a flight wait for a reset and fly again, until Ctrl-C
    #[arg(long)]
    pub stay: bool,
    /// Steps follow the wall clock
    #[arg(long, conflicts_with = "lockstep")]
    pub realtime: bool,
    /// Each step waits for the answer to the last, and never runs ahead of real time
    #[arg(long)]
    pub lockstep: bool,
    /// Lockstep may run ahead of real time
    #[arg(long)]
    pub fast: bool,
    /// Longest wait for one answer in lockstep
    #[arg(long, value_name = "MS", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=60_000))]
    pub lockstep_timeout_ms: u64,
    /// Rate of HIL_SENSOR; a divisor of 1000. By default the vehicle file's
    #[arg(long, value_name = "HZ", value_parser = sensor_rate)]
    pub sensor_hz: Option<u32>,
    /// Do not ask the kernel for SCHED_FIFO, locked memory and a CPU
    #[arg(long, conflicts_with = "cpu")]
    pub no_realtime_priority: bool,
    /// CPU for the thread that steps the plant; by default an isolated one or the last, where there are more
    /// than two
    #[arg(long, value_name = "N")]
    pub cpu: Option<usize>,
    /// Measure a bare sleep and a bare echo beside the run
    #[arg(long)]
    pub references: bool,
    /// I have disconnected the igniter and the oxidiser; a serial link and px4-hitl ask for it, since a real
    /// board may fire real outputs
    #[arg(long)]
    pub igniter_disconnected: bool,
    /// Write the addresses in use to this file, as JSON, once the bench listens
    #[arg(long, value_name = "PATH")]
    pub ready_file: Option<PathBuf>,
}

/// Runs the command.
pub fn run(args: &Args, common: &Common) -> Result<ExitCode> {
    if let Some(path) = &args.ready_file {
        // The file of an earlier run would name a port where nobody listens.
        remove_ready_file(path)?;
    }
    let mut scenario = scenario_for_bench(args, common)?;
    let live = Live::stderr();
    let options = options(args, &scenario, &live)?;
    let profile = options.profile;
    let instruments =
        Instrumentation { imu_rate_hz: args.sensor_hz.map(f64::from), gnss_delay_s: profile.gnss_delay_s };
    raise_noise(profile, &mut scenario, &instruments, &live);
    let seed = common.seed.unwrap_or(scenario.file.seed);
    let mut flight = Flight::with(&scenario, seed, &instruments)
        .map_err(|invalid| load::contradiction(&args.scenario, invalid))?;

    let mut link = open_link(args)?;
    let mut ground = open_ground(args)?;
    let folder = match &common.out {
        Some(path) => RunFolder::create(path)?,
        None => RunFolder::for_run_of(&scenario.name)?,
    };
    let stop = interrupt::stop_on_signal()?;
    let built_in = match &args.fc {
        Some(_) => None,
        None => Some(BuiltIn::start(&scenario, &instruments, profile, link.address())?),
    };
    announce(args, &scenario, profile, &link, ground.as_ref(), &live)?;

    let belief = || built_in.as_ref().and_then(BuiltIn::belief);
    let scheduling = Scheduling::begin(args, flight.step_s())?;
    let mut bench = Bench::new(&mut flight, &mut link, options, live).with_belief(&belief);
    if let Some(ground) = &mut ground {
        bench = bench.with_ground(ground);
    }
    if args.stay {
        bench = bench.until_stopped();
    }
    let (mut timing, link_report) = bench.run(&stop);
    scheduling.end(&mut timing);
    timing.sensor_hz = instruments.imu_rate_hz.or(Some(scenario.vehicle.sensors.imu.rate_hz));
    if let Some(built_in) = built_in {
        built_in.join();
    }

    let mut report = flight.report();
    if args.fc.is_some() && !scenario.file.fallback_expected {
        report.require_fc();
    }
    report.timing = timing;
    report.link = Some(link_report);
    report.overrides = common.set.clone();
    report.ground = ground.as_ref().map(Ground::figures);
    let setup = BenchSetup { profile: profile.name, link: link.address(), step_s: flight.step_s() };
    present(&mut report, &folder, &setup, common)
}

/// The scenario, which must leave something to send to a flight controller.
fn scenario_for_bench(args: &Args, common: &Common) -> Result<Scenario, InputError> {
    let scenario = load::scenario(&args.scenario, &common.set, None)?;
    if scenario.schedule.is_some() {
        let message = "a command schedule flies by itself: use `hopbench fly`";
        return Err(load::unusable(&args.scenario, message));
    }
    if !scenario.file.sensors.enabled {
        return Err(load::unusable(&args.scenario, "sensors.enabled = false leaves nothing to send"));
    }
    Ok(scenario)
}

/// How the run is to be made; what cannot be, or may not be, is refused before anything is opened.
fn options(args: &Args, scenario: &Scenario, live: &Live) -> Result<Options, InputError> {
    let profile = chosen_profile(args);
    check_interlock(args, profile)?;
    let pacing = chosen_pacing(args, profile)?;
    check_cpu(args)?;
    Ok(Options {
        profile,
        pacing,
        fast: args.fast,
        lockstep_timeout: Duration::from_millis(args.lockstep_timeout_ms),
        source: if args.fc.is_some() { Source::Fc } else { Source::Autopilot },
        baud: check_budget(args, profile, scenario, live)?,
    })
}

/// Raises noise that the flight controller's checks would take for a dead sensor, and says so.
fn raise_noise(profile: &Profile, scenario: &mut Scenario, instruments: &Instrumentation, live: &Live) {
    let raised = profile.raise_noise(&mut scenario.vehicle.sensors, instruments.imu_rate_hz);
    if !raised.is_empty() {
        live.notice(format!(
            "noise raised to one step of what {} stores, lest its checks take samples for stuck: {}",
            profile.name,
            raised.join(", ")
        ));
    }
}

/// The flight controller's link, or a loopback for the built-in autopilot.
fn open_link(args: &Args) -> Result<Link> {
    let spec = match &args.fc {
        Some(spec) => spec.clone(),
        None => "udp-listen:127.0.0.1:0".parse()?,
    };
    Ok(Link::open(&spec)?)
}

fn open_ground(args: &Args) -> Result<Option<Ground>> {
    let Some(spec) = &args.gcs else { return Ok(None) };
    Ok(Some(Ground::new(Link::open(spec)?, baud_of(spec))))
}

/// Says where the bench listens, to programs in the ready file and to people.
fn announce(
    args: &Args,
    scenario: &Scenario,
    profile: &Profile,
    link: &Link,
    ground: Option<&Ground>,
    live: &Live,
) -> Result<()> {
    if let Some(path) = &args.ready_file {
        write_ready_file(path, link, ground)?;
    }
    live.notice(format!("{} on {}, profile {}", scenario.name, link.address(), profile.name));
    if let Some(ground) = ground {
        live.notice(format!("ground station on {}", ground.address()));
    }
    link.port_settings().into_iter().for_each(|settings| live.notice(settings.to_owned()));
    Ok(())
}

/// What the stepping thread, this one, has of the kernel, and what is measured beside the run to compare it
/// with.
struct Scheduling {
    /// Nothing is asked for where no clock is followed.
    privileges: Option<Privileges>,
    baselines: Option<Baselines>,
}

impl Scheduling {
    fn begin(args: &Args, step_s: f64) -> Result<Self> {
        let privileges = (!args.no_realtime_priority && !args.fast).then(|| Privileges::acquire(args.cpu));
        let baselines = args.references.then(|| Baselines::start((step_s * 1e6).round() as u64));
        let baselines = baselines.transpose().context("no bare sleep and echo beside the run")?;
        Ok(Self { privileges, baselines })
    }

    /// Gives the privileges back: what follows the run is in no hurry.
    fn end(self, timing: &mut Timing) {
        if let Some((sleep, echo)) = self.baselines.map(Baselines::finish) {
            (timing.reference_sleep_us, timing.reference_echo_us) = (sleep.percentiles(), echo.percentiles());
        }
        timing.scheduler = self.privileges.as_ref().map(|privileges| privileges.granted().clone());
    }
}

/// Leaves report and certificate in the folder, prints the report, and judges the run.
fn present(
    report: &mut Report,
    folder: &RunFolder,
    setup: &BenchSetup<'_>,
    common: &Common,
) -> Result<ExitCode> {
    // A flight that somebody cut short is judged too, but its verdict is not the run's.
    let others_passed = report.flights.iter().all(|flight| flight.expect.passed || flight.is_excused());
    // The verdict is printed whatever becomes of the disk.
    let written = folder.write_report(report).and_then(|()| {
        folder.write_file(certificate::FILE, &certificate::page(report, setup, &Host::here()))
    });
    if common.json {
        print_json(&report)?;
    } else {
        print_text(&summary::text(report))?;
    }
    written?;
    Ok(ExitCode::from(if report.expect.passed && others_passed { DONE } else { UNEXPECTED }))
}

fn check_cpu(args: &Args) -> Result<(), InputError> {
    let allowed = realtime::cpus();
    match args.cpu {
        Some(cpu) if !allowed.contains(&cpu) => Err(option_error(
            "--cpu",
            format!("{cpu} is not one that this process may use; allowed: {allowed:?}"),
        )),
        _ => Ok(()),
    }
}

fn chosen_profile(args: &Args) -> &'static Profile {
    let named = args.profile.as_deref().and_then(profile::named);
    named.unwrap_or_else(|| args.fc.as_ref().map_or(&profile::GENERIC, profile::default_for))
}

fn chosen_pacing(args: &Args, profile: &Profile) -> Result<Pacing, InputError> {
    let pacing = match (args.realtime, args.lockstep) {
        (true, _) => Pacing::RealTime,
        (_, true) => Pacing::Lockstep,
        _ => profile.pacing,
    };
    if pacing == Pacing::Lockstep && !profile.lockstep_possible {
        return Err(option_error(
            "--lockstep",
            format!("profile {} answers on a clock of its own", profile.name),
        ));
    }
    if args.fast && pacing != Pacing::Lockstep {
        return Err(option_error("--fast", "only in lockstep: add --lockstep".to_owned()));
    }
    Ok(pacing)
}

/// Nobody but the person at the bench knows what hangs on a board's outputs.
fn check_interlock(args: &Args, profile: &Profile) -> Result<(), InputError> {
    let Some(link) = &args.fc else { return Ok(()) };
    // Every kind of link is named: whether a new one leads to a board is decided here.
    let leads_to_board = match link {
        LinkSpec::Serial { .. } => true,
        LinkSpec::Udp(_) | LinkSpec::UdpListen(_) | LinkSpec::Tcp(_) | LinkSpec::TcpListen(_) => false,
    };
    let is_board = profile.needs_hil_flag || leads_to_board;
    if !is_board || args.igniter_disconnected {
        return Ok(());
    }
    let reason = format!(
        "{link}, profile {}: a real board is armed, and its outputs may be live: disconnect the igniter and \
         the oxidiser, then say so with --igniter-disconnected",
        profile.name
    );
    Err(option_error("--igniter-disconnected", reason))
}

/// Whether the profile fits the line; its baud rate, where there is one.
fn check_budget(
    args: &Args,
    profile: &Profile,
    scenario: &Scenario,
    live: &Live,
) -> Result<Option<u32>, InputError> {
    let Some(baud) = args.fc.as_ref().and_then(baud_of) else { return Ok(None) };
    let rates = SensorRates::of(&scenario.vehicle.sensors, args.sensor_hz.map(f64::from));
    match profile.budget(&rates, baud) {
        Budget::Fits { .. } => {}
        Budget::Tight { load_percent } => live.notice(format!(
            "{load_percent:.0} % of {baud} baud are taken at {:.0} Hz: expect jitter, or lower --sensor-hz",
            rates.imu_hz
        )),
        Budget::Refused { load_percent, fitting_hz } => {
            let advice = match fitting_hz {
                Some(hz) => format!("--sensor-hz {hz:.0} fits, or a faster line"),
                None => "no --sensor-hz fits: use a faster line".to_owned(),
            };
            let taken = format!(
                "{load_percent:.0} % of {baud} baud would be taken by HIL_SENSOR at {:.0} Hz \
                 and what goes with it; {advice}",
                rates.imu_hz
            );
            return Err(option_error("--fc", taken));
        }
    }
    Ok(Some(baud))
}

/// Symbols a second, where a link has such a rate.
fn baud_of(spec: &LinkSpec) -> Option<u32> {
    match spec {
        LinkSpec::Serial { baud, .. } => Some(*baud),
        _ => None,
    }
}

/// The built-in autopilot on a thread, at the other end of the bench's own link.
struct BuiltIn {
    thread: std::thread::JoinHandle<()>,
    done: Arc<AtomicBool>,
    belief: Arc<Mutex<Option<Belief>>>,
}

impl BuiltIn {
    fn start(
        scenario: &Scenario,
        instruments: &Instrumentation,
        profile: &Profile,
        address: &str,
    ) -> Result<Self> {
        let plant: LinkSpec = address.replace("udp-listen:", "udp:").parse()?;
        let mut pilot = Pilot::for_scenario(scenario, instruments, profile.throttle)?.until_stopped();
        let mut link = Link::open(&plant)?;
        let (done, belief) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(None)));
        let (stop, told) = (Arc::clone(&done), Arc::clone(&belief));
        let fly = move || {
            let tell = |now| {
                if let Ok(mut told) = told.lock() {
                    *told = Some(now);
                }
            };
            pilot.serve(&mut link, || stop.load(Ordering::Relaxed), tell);
        };
        let thread = std::thread::Builder::new().name("autopilot".to_owned()).spawn(fly)?;
        Ok(Self { thread, done, belief })
    }

    fn belief(&self) -> Option<Belief> {
        self.belief.lock().ok().and_then(|belief| *belief)
    }

    fn join(self) {
        self.done.store(true, Ordering::Relaxed);
        let _ = self.thread.join();
    }
}

fn remove_ready_file(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(e).with_context(|| format!("cannot replace {}", path.display()))
        }
        _ => Ok(()),
    }
}

/// Whoever waits for the file never sees half of it.
fn write_ready_file(path: &Path, link: &Link, ground: Option<&Ground>) -> Result<()> {
    let mut addresses = serde_json::json!({ "fc": link.address() });
    if let Some(ground) = ground {
        addresses["gcs"] = ground.address().into();
    }
    let text = addresses.to_string() + "\n";
    let mut half = path.as_os_str().to_owned();
    half.push(".part");
    std::fs::write(&half, text)
        .and_then(|()| std::fs::rename(&half, path))
        .with_context(|| format!("cannot write {}", path.display()))
}
