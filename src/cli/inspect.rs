//! `meshway inspect`: reads one uploaded file for the service, in a process of its own.

use std::io;
use std::path::{Path, PathBuf};

use clap::Args;
use rustix::process::{Resource, Rlimit, nice, setrlimit};

use super::Failure;
use super::files::{Sink, read};
use super::slot::NICENESS;
use crate::intake::{Error, Verdict, limits, parse, rows, sum_up};
use crate::reconstruction::cloud::Format;

/// Arguments of `meshway inspect`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The file.
    file: PathBuf,
    /// Ending of a file name, for contents that do not show their format.
    #[arg(long)]
    hint: Option<String>,
    /// Takes a label map that does not say how it lies in the patient as it lies in its own axes.
    #[arg(long)]
    assume_orientation: bool,
    /// Most points.
    #[arg(long, default_value_t = 5_000_000)]
    max_points: u64,
    /// Most bytes after unpacking.
    #[arg(long, default_value_t = 512 << 20)]
    max_bytes: u64,
    /// Most memory to take in bytes; the process ends where more is needed.
    #[arg(long)]
    memory_bytes: Option<u64>,
    /// After the line, so many of its points as binary numbers, to look at.
    #[arg(long, default_value_t = 0)]
    points: usize,
    /// Where the file is written without the texts that may name somebody, if it has any.
    #[arg(long, hide = true)]
    clean_to: Option<PathBuf>,
    /// End when standard input does: whoever started this is gone then.
    #[arg(long, hide = true)]
    until_input_ends: bool,
}

/// Prints a [`Verdict`]; a refused file is no failure of the command.
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(bytes) = arguments.memory_bytes {
        // What is written to, not what is mapped: the libraries alone map half a gigabyte.
        let limit = Rlimit {
            current: Some(bytes),
            maximum: Some(bytes),
        };
        setrlimit(Resource::Data, limit)
            .map_err(|error| Failure::Output(format!("--memory-bytes {bytes}: {error}")))?;
    }
    if arguments.until_input_ends {
        // As workers do; that it cannot is no reason to refuse a cloud.
        let _ = nice(NICENESS);
        std::thread::Builder::new()
            .name("input".to_owned())
            .spawn(|| {
                drop(io::copy(&mut io::stdin().lock(), &mut io::sink()));
                std::process::exit(1);
            })
            .map_err(|error| Failure::Output(format!("no thread: {error}")))?;
    }
    let bytes = read(&arguments.file)?;
    let hint = arguments
        .hint
        .as_ref()
        .and_then(|ending| Format::from_extension(&format!("cloud.{ending}")));
    let limits = limits(arguments.max_points, arguments.max_bytes);
    let read = parse(&bytes, hint, &limits, arguments.assume_orientation);
    let read = read.and_then(|parsed| Ok((sum_up(&parsed)?, parsed.cloud)));
    let (verdict, rows) = match read {
        Ok((mut summary, cloud)) => {
            let rows = rows(&cloud, arguments.points);
            drop(cloud);
            let cleaned = match &arguments.clean_to {
                Some(to) => summary.clean(&bytes, &limits, to),
                None => Ok(()),
            };
            match cleaned {
                Ok(()) => (Verdict::Cloud(summary), rows),
                Err(Error::DiskFull) => (Verdict::DiskFull, Vec::new()),
                Err(error) => return Err(Failure::Output(error.to_string())),
            }
        }
        Err(error) => (Verdict::from(error), Vec::new()),
    };
    Sink::new(Path::new("-"))?.write(|out| {
        serde_json::to_writer(&mut *out, &verdict)?;
        out.write_all(b"\n")?;
        out.write_all(&rows)
    })
}
