//! `hopbench`: the bench on which a hybrid-rocket lander hops before it hops.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use hopbench_hil::command::{self, Common};

/// The bench on which a hybrid-rocket lander hops before it hops
#[derive(Debug, Parser)]
#[command(name = "hopbench", version)]
struct Cli {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    Hil(command::hil::Args),
    Fly(command::fly::Args),
    Autopilot(command::autopilot::Args),
    Campaign(command::campaign::Args),
    Engine(command::engine::Args),
    Check(command::check::Args),
    Doctor(command::doctor::Args),
    Px4Params(command::px4_params::Args),
}

const TO_TRY: &str = "Three commands to try:

  hopbench hil scenarios/hop_50m.toml                 hop in real time, the autopilot at the other end of a MAVLink link
  hopbench fly scenarios/hop_50m.toml                 the same hop in memory, as fast as possible
  hopbench engine scenarios/vehicles/reference.toml --thrust-n 650   one steady point of the engine

No `hopbench` on the PATH? `cargo install --path hil --locked`, or `cargo run --release --` in its place.
`hopbench --help` lists everything.
";

fn main() -> ExitCode {
    let cli = Cli::parse();
    let common = &cli.common;
    let result = match &cli.command {
        None => command::print_text(TO_TRY).map(|()| ExitCode::SUCCESS),
        Some(Command::Hil(args)) => command::hil::run(args, common),
        Some(Command::Fly(args)) => command::fly::run(args, common),
        Some(Command::Autopilot(args)) => command::autopilot::run(args, common),
        Some(Command::Campaign(args)) => command::campaign::run(args, common),
        Some(Command::Engine(args)) => command::engine::run(args, common),
        Some(Command::Check(args)) => command::check::run(args, common),
        Some(Command::Doctor(args)) => command::doctor::run(args, common),
        Some(Command::Px4Params(args)) => command::px4_params::run(args, common),
    };
    result.unwrap_or_else(|error| {
        eprintln!("{error:#}");
        command::exit_code(&error)
    })
}
