//! `meshway verify`: golden training traces, replayed.

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;

use super::Failure;
use super::files::{Sink, read};
use crate::reconstruction::verify::{
    FUSED_EVALUATIONS, FUSED_TOLERANCE, TOLERANCE, Trace, TraceResult, verify,
};

/// Arguments of `meshway verify`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Folder with pairs NAME.json and NAME.safetensors.
    folder: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let names = names(&arguments.folder)?;
    let stdout = Sink::new(Path::new("-"))?;
    stdout.write(|out| {
        writeln!(
            out,
            "{:<24} {:>11} {:>8} {:>27} {:>13}",
            "trace",
            "evaluations",
            "expected",
            "largest relative difference",
            format!("fused, {FUSED_EVALUATIONS}")
        )
    })?;
    let mut differing = 0;
    for name in &names {
        let result = replay(&arguments.folder, name)?;
        differing += usize::from(!result.passed);
        stdout.write(|out| {
            writeln!(
                out,
                "{name:<24} {:>11} {:>8} {:>27.3e} {:>13}{}",
                result.evaluations,
                result.expected_evaluations,
                result.largest_relative_difference,
                result
                    .fused_difference
                    .map_or_else(|| "-".to_owned(), |difference| format!("{difference:.3e}")),
                if result.passed { "" } else { "  differs" }
            )
        })?;
    }
    if differing == 0 {
        return Ok(());
    }
    Err(Failure::Output(format!(
        "{differing} of {} traces differ in the number of evaluations, by more than {TOLERANCE:e}, or \
         by more than {FUSED_TOLERANCE:e} with the fused engine",
        names.len()
    )))
}

fn replay(folder: &Path, name: &str) -> Result<TraceResult, Failure> {
    let json = folder.join(format!("{name}.json"));
    let trace = Trace {
        name,
        description: &read(&json)?,
        tensors: &read(&folder.join(format!("{name}.safetensors")))?,
    };
    verify(&trace).map_err(|error| Failure::input(&json, error))
}

fn names(folder: &Path) -> Result<Vec<String>, Failure> {
    let entries = fs::read_dir(folder)
        .map_err(|error| Failure::input(folder, format!("cannot be read: {error}")))?;
    let mut names: Vec<String> = entries
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .filter(|path| {
            path.extension()
                .is_some_and(|ending| ending == "safetensors")
        })
        .filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()))
        .collect();
    names.sort();
    if names.is_empty() {
        return Err(Failure::input(
            folder,
            "holds no .safetensors files of golden traces",
        ));
    }
    Ok(names)
}
