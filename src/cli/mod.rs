//! The command line: one module a subcommand, exit codes, and nothing that computes.

mod error;
mod evaluate;
mod files;
mod inspect;
mod presets;
mod progress;
mod reconstruct;
mod sample;
mod verify;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

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
    Reconstruct(reconstruct::Arguments),
    /// Draw a labelled cloud from an analytic shape.
    Sample(sample::Arguments),
    /// Measure a mesh: topology, and distances to a mesh, a cloud or a shape.
    Evaluate(evaluate::Arguments),
    /// Replay golden training traces; exit code 1 when one differs.
    Verify(verify::Arguments),
    /// Print the presets with all their settings.
    Presets(presets::Arguments),
    /// Read one file for the service.
    #[command(hide = true)]
    Inspect(inspect::Arguments),
}

/// Runs the program: what it returns is the exit code.
///
/// 0 done, 1 a check or an output failed, 2 usage or settings, 3 input, 4 reconstruction failed.
pub fn run(cli: Cli) -> ExitCode {
    let result = match cli.command {
        Command::Reconstruct(arguments) => reconstruct::run(&arguments),
        Command::Sample(arguments) => sample::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Presets(arguments) => presets::run(&arguments),
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
