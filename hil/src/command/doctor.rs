//! `hopbench doctor`: what is wrong with this bench.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Result;
use serde_json::json;

use super::{Common, DEVICE_FAILED, DONE, interrupt, print_json, print_text, refuse_out, sensor_rate};
use crate::doctor::{Finding, Observation, Severity};
use crate::doctor::{diagnose, diagnose_machine, listen, machine, mapped_channels};
use crate::load;
use crate::wire::link::{Link, LinkSpec};
use crate::wire::port;
use crate::wire::profile::{self, SensorRates};

/// Say what is wrong with this machine and this link, and what to do. Never arms anything. Exit 0: nothing
/// worse than a warning; 3: an error was found; 2: wrong arguments
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Listen on this link: serial:PATH:BAUD, udp:HOST:PORT, udp-listen:HOST:PORT, tcp:HOST:PORT or
    /// tcp-listen:HOST:PORT; absent: look at the machine alone
    #[arg(long, value_name = "LINK")]
    pub fc: Option<LinkSpec>,
    /// What the flight controller expects; by default what fits the link
    #[arg(long, value_name = "PROFILE", value_parser = ["px4-sitl", "px4-hitl", "generic"], requires = "fc")]
    pub profile: Option<String>,
    /// Judge the flight controller's channels by the vehicle of this scenario
    #[arg(long, value_name = "FILE", requires = "fc")]
    pub scenario: Option<PathBuf>,
    /// Rate of HIL_SENSOR; a divisor of 1000. By default the scenario's vehicle's, else 250
    #[arg(long, value_name = "HZ", value_parser = sensor_rate, requires = "fc")]
    pub sensor_hz: Option<u32>,
    /// How long to listen
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = seconds)]
    pub listen_s: f64,
}

/// Runs the command.
pub fn run(args: &Args, common: &Common) -> Result<ExitCode> {
    refuse_out(common, "redirect what it prints")?;
    let (heading, findings) = match &args.fc {
        None => ("this machine".to_owned(), diagnose_machine(&machine::inspect())),
        Some(spec) => {
            let observation = observe(args, common, spec)?;
            (format!("{spec}, profile {}", observation.profile.name), diagnose(&observation))
        }
    };
    let count = |severity| findings.iter().filter(|finding| finding.severity == severity).count();
    let (errors, warnings) = (count(Severity::Error), count(Severity::Warning));
    if common.json {
        print_json(&json!({
            "looked_at": heading, "errors": errors, "warnings": warnings, "findings": findings,
        }))?;
    } else {
        let paragraphs: String = findings.iter().map(paragraph).collect();
        print_text(&format!("{heading}\n\n{paragraphs}errors {errors}, warnings {warnings}\n"))?;
    }
    Ok(ExitCode::from(if errors > 0 { DEVICE_FAILED } else { DONE }))
}

/// Opens the link, listens, and puts together what was observed.
fn observe(args: &Args, common: &Common, spec: &LinkSpec) -> Result<Observation> {
    let profile = args.profile.as_deref().and_then(profile::named);
    let profile = profile.unwrap_or_else(|| profile::default_for(spec));
    let scenario =
        args.scenario.as_deref().map(|file| load::scenario(file, &common.set, None)).transpose()?;
    let asked_hz = args.sensor_hz.map(f64::from);
    let rates = match &scenario {
        Some(scenario) => SensorRates::of(&scenario.vehicle.sensors, asked_hz),
        None => SensorRates { imu_hz: asked_hz.unwrap_or(250.0), gnss_hz: 10.0, altimeter_hz: 50.0 },
    };
    let mut observed = Observation {
        link: spec.clone(),
        profile,
        rates,
        map: scenario.as_ref().map(|s| mapped_channels(&s.vehicle.controls, s.file.sequence.source)),
        failure: None,
        holders: Vec::new(),
        ports: port::present(),
        traffic: Default::default(),
    };
    let mut link = match Link::open(spec) {
        Ok(link) => link,
        Err(error) => {
            observed.failure = Some(error.failure);
            return Ok(observed);
        }
    };
    if let LinkSpec::Serial { path, .. } = spec {
        observed.holders = port::other_holders(path.as_ref());
    }
    let stop = interrupt::stop_on_signal()?;
    eprintln!("listening on {} for {} s", link.address(), args.listen_s);
    link.port_settings().into_iter().for_each(|settings| eprintln!("{settings}"));
    let time = Duration::from_secs_f64(args.listen_s);
    observed.traffic = listen::listen(&mut link, profile, &rates, time, &stop);
    Ok(observed)
}

fn paragraph(finding: &Finding) -> String {
    let severity = match finding.severity {
        Severity::Ok => "ok",
        Severity::Warning => "warning",
        Severity::Error => "error",
    };
    let mut text = format!("{severity:<8} {}: {}\n", finding.name, finding.seen);
    if finding.severity != Severity::Ok {
        text += &format!("         why: {}\n         do:  {}\n", finding.why, finding.fix);
    }
    text
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.1..=3600.0).contains(&seconds) => Ok(seconds),
        _ => Err("allowed: 0.1 to 3600".to_owned()),
    }
}
