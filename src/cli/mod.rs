//! The command line: one module a subcommand, exit codes, and nothing that computes.

mod audit;
mod check;
mod data_folder;
mod documents;
mod encoding;
mod error;
mod evaluate;
mod files;
mod health;
mod inspect;
mod key;
mod logging;
mod migrate;
mod parts;
mod presets;
mod progress;
mod reconstruct;
mod relocate;
mod rows;
mod sample;
mod serve;
mod slot;
mod station;
mod upkeep;
mod user;
mod verify;
mod worker;

use std::ffi::OsString;
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Parser, Subcommand};
use tokio::runtime::Runtime;

use crate::jobs::worker::Work;

pub use error::Failure;

/// Point clouds in, watertight meshes out.
#[derive(Debug, Parser)]
#[command(name = "meshway", version, about, max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Reconstruct a closed mesh from a point cloud.
    Reconstruct(Box<reconstruct::Arguments>),
    /// Draw a labelled cloud from an analytic shape.
    Sample(sample::Arguments),
    /// Measure a mesh: topology, and distances to a mesh, a cloud or a shape.
    Evaluate(evaluate::Arguments),
    /// Replay golden training traces; exit code 1 when one differs.
    Verify(verify::Arguments),
    /// Print the presets with all their settings.
    Presets(presets::Arguments),
    /// Serve the HTTP API, with worker processes that reconstruct.
    Serve(Box<serve::Arguments>),
    /// Make keys for a service.
    Key(key::Arguments),
    /// Make passwords of people for a service.
    User(user::Arguments),
    /// Check or export the audit trail of a service.
    Audit(audit::Arguments),
    /// Bring the tables of a service up to date, or tell whether they are.
    Migrate(migrate::Arguments),
    /// Find that all bytes are there that the rows of a service name; exit code 1 when some are not.
    Check(check::Arguments),
    /// Move a service from a folder with `SQLite` to Postgres, and perhaps to an object store.
    Move(relocate::Arguments),
    /// Print what completes the command line in a shell.
    Completions(documents::Completions),
    /// Print the man page, or write those of all commands into a folder.
    Man(documents::Man),
    /// Work on jobs of services on other machines.
    Worker(Box<worker::Arguments>),
    /// Work for `serve` or `worker`.
    #[command(hide = true)]
    Slot(slot::Arguments),
    /// Read one file for the service.
    #[command(hide = true)]
    Inspect(inspect::Arguments),
    /// Ask the service on this machine whether it lives.
    #[command(hide = true)]
    Health(health::Arguments),
}

/// What the workers of a service do in place of reconstructing.
#[derive(Clone)]
pub struct Substitute {
    /// Their work.
    pub work: Arc<Work>,
    /// The flag that says so to this program when it is started as a worker.
    pub flag: OsString,
}

/// The program: reads the command line and does what it says.
pub fn main() -> ExitCode {
    let line: Vec<OsString> = std::env::args_os().collect();
    main_with(&line, None)
}

/// The program with another command line than that of the process, and perhaps with other work.
pub fn main_with(line: &[OsString], substitute: Option<&Substitute>) -> ExitCode {
    let cli = Cli::parse_from(line);
    let cli = match &cli.command {
        Command::Serve(arguments) => arguments.with_file(line),
        _ => Ok(cli),
    };
    match cli {
        Ok(cli) => run(cli, substitute),
        Err(failure) => {
            failure.print();
            failure.exit_code()
        }
    }
}

/// What tasks run in.
///
/// # Errors
/// `Output` when the system has no threads for it.
fn runtime() -> Result<Runtime, Failure> {
    Runtime::new().map_err(|error| Failure::Output(format!("no runtime: {error}")))
}

/// Runs the program: what it returns is the exit code.
///
/// 0 done, 1 a check or an output failed, 2 usage or settings, 3 input, 4 reconstruction failed,
/// 5 the mesh is likely wrong and `--strict` asks for it.
fn run(cli: Cli, substitute: Option<&Substitute>) -> ExitCode {
    let result = match cli.command {
        Command::Reconstruct(arguments) => reconstruct::run(&arguments),
        Command::Sample(arguments) => sample::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Presets(arguments) => presets::run(&arguments),
        Command::Key(arguments) => key::run(&arguments),
        Command::User(arguments) => user::run(&arguments),
        Command::Audit(arguments) => audit::run(&arguments),
        Command::Migrate(arguments) => migrate::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Move(arguments) => relocate::run(&arguments),
        Command::Completions(arguments) => documents::completions(&arguments),
        Command::Man(arguments) => documents::man(&arguments),
        Command::Health(arguments) => health::run(&arguments),
        Command::Serve(arguments) => serve::run(&arguments, substitute),
        Command::Worker(arguments) => worker::run(&arguments, substitute),
        Command::Slot(arguments) => slot::run(&arguments, substitute),
        Command::Inspect(arguments) => inspect::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.print();
            failure.exit_code()
        }
    }
}
