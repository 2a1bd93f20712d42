//! The project's test command: `cargo xtask test` is what a person and CI run, `cargo xtask long` the
//! evidence that takes longer.
//!
//! A stage prints its header and its duration, leaves the runner's own output as it is, and ends the command
//! with the runner's exit code when it fails. Nothing is skipped: without Python the command fails.

mod python;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

use clap::Parser;

#[derive(Parser)]
#[command(name = "cargo xtask", about = "The project's test command.")]
enum Task {
    /// Every Rust test, then every Python test against the release binary. What CI calls.
    Test {
        /// Arguments for pytest, after `--`: `cargo xtask test -- -k lockstep`.
        #[arg(last = true)]
        pytest: Vec<String>,
    },
    /// The Python tests against the release binary, without the Rust tests.
    Python {
        /// Arguments for pytest, after `--`.
        #[arg(last = true)]
        pytest: Vec<String>,
    },
    /// The evidence that takes longer than CI has.
    Long,
}

fn main() -> ExitCode {
    let started = Instant::now();
    let outcome = match Task::parse() {
        Task::Test { pytest } => rust_tests().and_then(|()| python_tests(&pytest)),
        Task::Python { pytest } => python_tests(&pytest),
        Task::Long => long_evidence(),
    };
    let seconds = started.elapsed().as_secs_f64();
    match outcome {
        Ok(()) => {
            eprintln!("xtask: all stages passed in {seconds:.1} s");
            ExitCode::SUCCESS
        }
        Err(failure) => {
            eprintln!("xtask: {} after {seconds:.1} s", failure.message);
            ExitCode::from(failure.code)
        }
    }
}

/// Why a stage ended the command.
struct Failure {
    message: String,
    code: u8,
}

impl Failure {
    fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), code: 1 }
    }
}

type Outcome = Result<(), Failure>;

/// Python tests that run at a time: they mostly wait.
const PYTHON_PROCESSES: &str = "3";

/// Assertions and overflow checks of the library and its tests, on top of the release profile: the
/// dependencies stay those of the release build.
const ASSERTIONS: [&str; 6] = [
    "--config",
    "profile.release.package.hopbench.debug-assertions=true",
    "--config",
    "profile.release.package.hopbench.overflow-checks=true",
    // Compiled on every core: these tests do not ask for speed.
    "--config",
    "profile.release.package.hopbench.codegen-units=16",
];

/// Tests of the autopilot, all but one of them on a plant of the tests' own.
const WITHOUT_THE_PLANT: [&str; 5] = ["autopilot::", "lcvx::", "mpc::", "navigation::", "tracking::"];

/// In release: what is tested is what flies, and dependencies are built once for tests and program. Then what
/// steps the plant once more, with its assertions on.
fn rust_tests() -> Outcome {
    // Documentation tests are part of `cargo test` as long as no target is selected.
    stage("Rust tests", &mut workspace_test())?;
    let mut with_assertions = workspace_test();
    with_assertions.args(["--test", "flight", "--test", "invariant", "--test", "reference"]).args(ASSERTIONS);
    with_assertions.arg("--").args(WITHOUT_THE_PLANT.into_iter().flat_map(|tests| ["--skip", tests]));
    stage("Rust tests, assertions on", &mut with_assertions)
}

/// Of the workspace even where one package is meant: the features of shared dependencies, and with them what
/// is compiled, are then the same in every stage.
fn workspace_test() -> Command {
    let mut command = cargo();
    command.args(["test", "--workspace", "--release", "--locked"]);
    command
}

/// Without arguments two runs: what waits for messages side by side, then what asks for the machine to
/// itself.
fn python_tests(pytest: &[String]) -> Outcome {
    let hopbench = release_binary()?;
    let python = python::environment(&root())?;
    if !pytest.is_empty() {
        return stage(
            "Python tests",
            pytest_command(&python, &hopbench).args(["-m", "not long"]).args(pytest),
        );
    }
    stage(
        "Python tests, side by side",
        pytest_command(&python, &hopbench).args([
            "-m",
            "not long and not alone",
            "--numprocesses",
            PYTHON_PROCESSES,
        ]),
    )?;
    stage(
        "Python tests, one at a time",
        pytest_command(&python, &hopbench).args(["-m", "alone and not long"]),
    )
}

fn long_evidence() -> Outcome {
    println!(
        "long evidence: 10 000 random vehicle files, a million lockstep steps on a bad wire, then the Python tests \
         marked `long` (tests/python)"
    );
    stage(
        "10 000 random vehicles",
        workspace_test()
            .args(["--test", "invariant", "random_vehicles::", "--", "--nocapture"])
            .env("HOPBENCH_RANDOM_FILES", "10000"),
    )?;
    stage(
        "a million lockstep steps",
        workspace_test()
            .args(["--test", "wire", "endurance::", "--", "--nocapture"])
            .env("HOPBENCH_LOCKSTEP_STEPS", "1000000"),
    )?;
    let hopbench = release_binary()?;
    let python = python::environment(&root())?;
    stage("long Python tests", pytest_command(&python, &hopbench).args(["-m", "long"]))
}

fn pytest_command(python: &Path, hopbench: &Path) -> Command {
    let mut command = Command::new(python);
    command.args(["-m", "pytest", "tests/python", "-ra", "--durations=10"]).env("HOPBENCH", hopbench);
    command
}

/// Builds the program as a user gets it; the path of the binary.
fn release_binary() -> Result<PathBuf, Failure> {
    // Of the workspace, as the tests are: what they have compiled is not compiled again.
    let build = ["build", "--workspace", "--release", "--locked", "--bin", "hopbench"];
    stage("release build", cargo().args(build))?;
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), PathBuf::from);
    let binary =
        root().join(target).join("release").join(format!("hopbench{}", std::env::consts::EXE_SUFFIX));
    if binary.is_file() {
        Ok(binary)
    } else {
        Err(Failure::new(format!("the release build left no {}", binary.display())))
    }
}

/// Runs one command at the root of the repository, between a header and its duration.
fn stage(name: &str, command: &mut Command) -> Outcome {
    eprintln!("\n=== {name}: {}", shown(command));
    let started = Instant::now();
    let status = command
        .current_dir(root())
        .status()
        .map_err(|error| Failure::new(format!("{name}: {}: {error}", command.get_program().display())))?;
    eprintln!("=== {name}: {status} in {:.1} s", started.elapsed().as_secs_f64());
    if status.success() {
        return Ok(());
    }
    // A runner ended by a signal has no code of its own.
    let code = status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1);
    Err(Failure { message: format!("{name} failed ({status})"), code })
}

fn shown(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

/// The cargo that runs this program, so that both use one toolchain.
fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// The root of the repository.
fn root() -> PathBuf {
    let xtask = Path::new(env!("CARGO_MANIFEST_DIR"));
    xtask.ancestors().nth(2).expect("xtask lies two folders below the root").to_path_buf()
}
