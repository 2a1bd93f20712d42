//! The commands of `hopbench`, one file each. A command that is not built is not here.

use std::path::PathBuf;
use std::process::ExitCode;

use hopbench::input::{Diagnostic, InputError};

mod interrupt;

pub mod autopilot;
pub mod campaign;
pub mod check;
pub mod doctor;
pub mod engine;
pub mod fly;
pub mod hil;
pub mod px4_params;

/// What every command takes.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Common {
    /// Print one JSON object on stdout; everything else goes to stderr
    #[arg(long, global = true)]
    pub json: bool,
    /// Seed of every random stream; replaces the scenario's. Of a campaign the seed of its first flight, the
    /// next one's is one more
    #[arg(long, global = true, value_name = "N")]
    pub seed: Option<u32>,
    /// Folder that receives the run
    #[arg(long, global = true, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace one value: dotted path in the scenario file, or `vehicle.` and the dotted path in the vehicle
    /// file; VALUE is TOML
    #[arg(long, global = true, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// Exit code: done and as expected.
const DONE: u8 = 0;
/// Exit code: flew, but not as expected.
const UNEXPECTED: u8 = 1;
/// Exit code: the input is wrong.
const BAD_INPUT: u8 = 2;
/// Exit code: link or device failed.
const DEVICE_FAILED: u8 = 3;
/// Exit code: ended by Ctrl-C or SIGTERM before it was done, as a shell counts it.
const INTERRUPTED: u8 = 130;

/// Exit code for an error that ends a command.
pub fn exit_code(error: &anyhow::Error) -> ExitCode {
    ExitCode::from(if error.is::<InputError>() { BAD_INPUT } else { DEVICE_FAILED })
}

/// The error of an option whose value cannot be.
fn option_error(option: &str, message: impl Into<String>) -> InputError {
    InputError {
        file: "command line".to_owned(),
        diagnostics: vec![Diagnostic { line: None, key: option.to_owned(), message: message.into() }],
    }
}

/// The value of an option, which must lie within its allowed range.
fn in_range(option: &str, value: f64, least: f64, most: f64) -> Result<f64, InputError> {
    if (least..=most).contains(&value) {
        return Ok(value);
    }
    Err(option_error(option, format!("{value} is out of range; allowed {least} to {most}")))
}

/// Refuses `--out` for a command that leaves no files; `instead` says what to do.
fn refuse_out(common: &Common, instead: &str) -> Result<(), InputError> {
    match &common.out {
        Some(_) => Err(option_error("--out", format!("this leaves no files: {instead}"))),
        None => Ok(()),
    }
}

/// A rate of HIL_SENSOR as the command line spells it: the plant steps at 1 kHz.
fn sensor_rate(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(hz) if hz > 0 && 1000 % hz == 0 => Ok(hz),
        _ => Err("allowed: the divisors of 1000".to_owned()),
    }
}

/// Cores that this program may use.
fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Writes one JSON object to stdout.
fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    print_text(&(serde_json::to_string_pretty(value)? + "\n"))
}

/// Writes to stdout, line ends included. A reader that has gone away is no reason to fail.
pub fn print_text(text: &str) -> anyhow::Result<()> {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(e.into()),
        _ => Ok(()),
    }
}
