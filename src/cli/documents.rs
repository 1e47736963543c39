//! `meshway completions` and `meshway man`: what a shell and a reader want to know of the program.

use std::path::{Path, PathBuf};

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::files::Sink;
use super::{Cli, Failure};

/// Arguments of `meshway completions`.
#[derive(Debug, Args)]
pub(super) struct Completions {
    /// The shell.
    shell: Shell,
}

/// Arguments of `meshway man`.
#[derive(Debug, Args)]
pub(super) struct Man {
    /// Folder for the pages of all commands; without it that of the program goes to standard output.
    folder: Option<PathBuf>,
}

/// Prints the completions of a shell.
pub(super) fn completions(arguments: &Completions) -> Result<(), Failure> {
    Sink::new(Path::new("-"))?.write(|out| {
        let mut text = Vec::new();
        clap_complete::generate(arguments.shell, &mut Cli::command(), "meshway", &mut text);
        out.write_all(&text)
    })
}

/// Writes the man pages.
pub(super) fn man(arguments: &Man) -> Result<(), Failure> {
    match &arguments.folder {
        Some(folder) => clap_mangen::generate_to(Cli::command(), folder)
            .map_err(|error| Failure::output(folder, &error)),
        None => Sink::new(Path::new("-"))?
            .write(|mut out| clap_mangen::Man::new(Cli::command()).render(&mut out)),
    }
}
