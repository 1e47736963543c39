//! How a command fails: one clear sentence, and an exit code that scripts can rely on.

use std::fmt;
use std::io;
use std::path::Path;
use std::process::ExitCode;

use thiserror::Error;

use crate::jobs;
use crate::reconstruction::{self, cloud, settings};

/// Why a command did not do what it was asked.
#[derive(Debug, Error)]
pub enum Failure {
    /// The command line cannot be followed.
    #[error("{0}")]
    Usage(String),
    /// The settings are refused.
    #[error(transparent)]
    Settings(#[from] settings::Error),
    /// An input file cannot be read or used.
    #[error("{place}: {detail}")]
    Input {
        /// The file, or what stands for it.
        place: String,
        /// What is wrong with it.
        detail: String,
    },
    /// The reconstruction gave no mesh.
    #[error("reconstruction failed: {0}")]
    Reconstruction(String),
    /// The mesh is there and likely wrong.
    #[error("the mesh is likely wrong: {0}")]
    Poor(String),
    /// A result cannot be written, or a check did not pass.
    #[error("{0}")]
    Output(String),
}

impl From<jobs::Error> for Failure {
    fn from(error: jobs::Error) -> Self {
        Self::Output(error.to_string())
    }
}

impl Failure {
    /// An input file that cannot be used.
    pub fn input(path: &Path, detail: impl fmt::Display) -> Self {
        Self::Input {
            place: path.display().to_string(),
            detail: detail.to_string(),
        }
    }

    /// An output that cannot be written.
    pub fn output(path: &Path, error: &io::Error) -> Self {
        Self::Output(format!("{}: cannot be written: {error}", path.display()))
    }

    /// Sorts an error of the library by who can mend it.
    pub fn of(error: reconstruction::Error, input: &Path) -> Self {
        match error {
            reconstruction::Error::Cloud(error) => Self::cloud(input, &error),
            reconstruction::Error::Settings(error) => Self::Settings(error),
            error => Self::Reconstruction(error.to_string()),
        }
    }

    /// A cloud that cannot be read or used.
    pub fn cloud(input: &Path, error: &cloud::Error) -> Self {
        Self::input(input, error)
    }

    /// The exit code of its kind.
    pub fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Output(_) => 1,
            Self::Usage(_) | Self::Settings(_) => 2,
            Self::Input { .. } => 3,
            Self::Reconstruction(_) => 4,
            Self::Poor(_) => 5,
        })
    }

    /// Writes the sentence to standard error; settings get one line a violation.
    #[expect(
        clippy::print_stderr,
        reason = "the command line speaks to its user here"
    )]
    pub fn print(&self) {
        match self {
            Self::Settings(error) if error.violations().len() > 1 => {
                eprintln!("error: {} settings are refused", error.violations().len());
                for violation in error.violations() {
                    eprintln!("  {violation}");
                }
            }
            // Results are there: it ends a command that did what it was asked.
            Self::Poor(_) => eprintln!("warning: {self}"),
            failure => eprintln!("error: {failure}"),
        }
    }
}
