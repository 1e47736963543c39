//! `meshway presets`: what may be asked for.

use std::path::Path;

use clap::Args;
use serde_json::{Map, Value, json};

use super::Failure;
use super::files::Sink;
use crate::reconstruction::Preset;
use crate::reconstruction::settings::BOUNDS;

/// Arguments of `meshway presets`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Only this preset.
    preset: Option<Preset>,
    /// The bounds of every number instead.
    #[arg(long, conflicts_with = "preset")]
    bounds: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let shown: Map<String, Value> = if arguments.bounds {
        BOUNDS
            .iter()
            .map(|b| (b.pointer.to_owned(), json!({"min": b.min, "max": b.max})))
            .collect()
    } else {
        Preset::ALL
            .into_iter()
            .filter(|preset| arguments.preset.is_none_or(|only| only == *preset))
            .map(|preset| (preset.name().to_owned(), json!(preset.settings())))
            .collect()
    };
    Sink::new(Path::new("-"))?.write(|out| {
        serde_json::to_writer_pretty(&mut *out, &shown)?;
        out.write_all(b"\n")
    })
}
