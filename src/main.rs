//! The `meshway` program.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    meshway::cli::run(meshway::cli::Cli::parse())
}
