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
    /// Seed of every random stream; replaces the scenario's. Of a campaign the seed of its first flight, the next one's is one more
    #[arg(long, global = true, value_name = "N")]
    pub seed: Option<u32>,
    /// Folder that receives the run
    #[arg(long, global = true, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace one value: dotted path in the scenario file, or `vehicle.` and the dotted path in the vehicle file; VALUE is TOML
    #[arg(long, global = true, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// Exit codes: done and as expected.
pub const DONE: u8 = 0;
/// Flew, but not as expected.
pub const UNEXPECTED: u8 = 1;
/// The input is wrong.
pub const BAD_INPUT: u8 = 2;
/// Link or device failed.
pub const DEVICE_FAILED: u8 = 3;

/// Ended by Ctrl-C or SIGTERM before it was done, as a shell counts it.
pub const INTERRUPTED: u8 = 130;

/// Exit code for an error that ends a command.
pub fn exit_code(error: &anyhow::Error) -> ExitCode {
    ExitCode::from(if error.is::<InputError>() { BAD_INPUT } else { DEVICE_FAILED })
}

/// What is wrong with an option.
fn wrong(key: &str, message: String) -> InputError {
    InputError {
        file: "command line".to_owned(),
        diagnostics: vec![Diagnostic { line: None, key: key.to_owned(), message }],
    }
}

/// `--out` for a command that leaves nothing is a mistake, and not passed over.
fn leaves_nothing(common: &Common, instead: &str) -> Result<(), InputError> {
    match &common.out {
        Some(_) => Err(wrong("--out", format!("this leaves no files: {instead}"))),
        None => Ok(()),
    }
}

/// Writes one JSON object to stdout.
pub fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
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
