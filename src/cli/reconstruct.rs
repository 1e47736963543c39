//! `meshway reconstruct`: a cloud in, a mesh and its record out.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use super::Failure;
use super::files::{Sink, read, read_cloud};
use super::progress::Progress;
use crate::reconstruction::cloud::{Label, PointCloud};
use crate::reconstruction::mesh::write::{Format, write};
use crate::reconstruction::report::Verdict;
use crate::reconstruction::settings::assignments;
use crate::reconstruction::training::Metrics;
use crate::reconstruction::{
    Event, Input, Observer, Preset, Reconstruction, Report, Settings, Warning, in_pool,
    reconstruct, set_threads,
};

/// Arguments of `meshway reconstruct`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Point cloud: PLY, XYZ, CSV, PTS, PTX, OBJ, OFF, STL, PCD or NPY, also gzipped.
    cloud: PathBuf,
    /// Points inside the surface, in addition to the labels of the cloud.
    #[arg(long, value_name = "CLOUD")]
    interior: Option<PathBuf>,
    /// Points outside the surface, in addition to the labels of the cloud.
    #[arg(long, value_name = "CLOUD")]
    exterior: Option<PathBuf>,
    /// The mesh; the ending chooses the format: ply, obj, stl, off, glb. `-` is standard output.
    #[arg(short, long, value_name = "MESH")]
    output: PathBuf,
    /// Format of the mesh, where the ending does not say it: ply, `ply_ascii`, obj, stl, off, glb.
    #[arg(long, value_name = "FORMAT")]
    format: Option<String>,
    /// Named settings to start from.
    #[arg(long, value_enum, default_value_t)]
    preset: Preset,
    /// JSON file with settings that differ from the preset.
    #[arg(long, value_name = "JSON")]
    settings: Option<PathBuf>,
    /// One setting, as in network.scheme=hw; may be given many times.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Quality report and the record that makes the run again, as JSON.
    #[arg(long, value_name = "JSON")]
    report: Option<PathBuf>,
    /// One row an accepted iteration.
    #[arg(long, value_name = "CSV")]
    metrics: Option<PathBuf>,
    /// Gradient histograms at `training.histogram_evaluations`, as JSON.
    #[arg(long, value_name = "JSON")]
    gradients: Option<PathBuf>,
    /// Folder for meshes at `training.snapshot_evaluations`.
    #[arg(long, value_name = "FOLDER")]
    snapshots: Option<PathBuf>,
    /// Threads to compute with, at most the cores of the machine (the default).
    #[arg(long)]
    threads: Option<usize>,
    /// Exit code 5 where the verdict on the mesh is poor; mesh and report are written all the same.
    #[arg(long)]
    strict: bool,
    /// Print errors only, and the warning of a mesh that is likely wrong.
    #[arg(short, long)]
    quiet: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let settings = settings(arguments)?;
    // First of all: reading, too, uses the threads.
    set_threads(threads(arguments.threads)?).map_err(|error| Failure::Usage(error.to_string()))?;
    in_pool(|| run_with(arguments, &settings))
}

fn run_with(arguments: &Arguments, settings: &Settings) -> Result<(), Failure> {
    let sinks = Sinks::new(arguments)?;
    let progress = Progress::new(arguments.quiet);
    let (cloud, inputs, warnings) = cloud(arguments, &progress)?;

    let outcome = reconstruct(&cloud, settings, &progress);
    progress.finish();
    let mut result = outcome.map_err(|error| Failure::of(error, &arguments.cloud))?;
    result.report.read_from(inputs, warnings);
    sinks.write(&result, &progress)?;
    progress.say(&result.report.summary());
    if let Some(name) = sinks.mesh.name() {
        progress.say(&format!("mesh: {name}"));
    }
    match poor(&result.report) {
        Some(failure) if arguments.strict => Err(failure),
        Some(failure) => {
            failure.print();
            Ok(())
        }
        None => Ok(()),
    }
}

/// A mesh that is likely wrong, in one line; none where it is not.
fn poor(report: &Report) -> Option<Failure> {
    if report.verdict != Verdict::Poor {
        return None;
    }
    let (first, others) = report.verdict_reasons.split_first()?;
    let more = match others.len() {
        0 => String::new(),
        count => format!("; {count} more in `verdict_reasons` of the report"),
    };
    Some(Failure::Poor(format!("{}{more}", first.message)))
}

fn settings(arguments: &Arguments) -> Result<Settings, Failure> {
    let mut given = match &arguments.settings {
        None => Value::Object(serde_json::Map::new()),
        Some(path) => {
            serde_json::from_slice(&read(path)?).map_err(|error| Failure::input(path, error))?
        }
    };
    merge(&mut given, assignments(&arguments.set)?);
    Ok(Settings::resolve(arguments.preset, &given)?)
}

fn merge(base: &mut Value, over: Value) {
    match (base, over) {
        (Value::Object(base), Value::Object(over)) => {
            for (name, value) in over {
                merge(base.entry(name).or_insert(Value::Null), value);
            }
        }
        (base, over) => *base = over,
    }
}

fn threads(asked: Option<usize>) -> Result<usize, Failure> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    match asked {
        None => Ok(cores),
        Some(threads) if (1..=cores).contains(&threads) => Ok(threads),
        Some(threads) => Err(Failure::Usage(format!(
            "--threads is {threads}, must be from 1 to {cores}, the cores of this machine"
        ))),
    }
}

/// The cloud of all files, what the report records of each, and what their readers warn of.
fn cloud(
    arguments: &Arguments,
    progress: &Progress,
) -> Result<(PointCloud, Vec<Input>, Vec<Warning>), Failure> {
    let parts = [
        (Some(&arguments.cloud), None),
        (arguments.interior.as_ref(), Some(Label::Interior)),
        (arguments.exterior.as_ref(), Some(Label::Exterior)),
    ];
    let mut whole: Option<PointCloud> = None;
    let (mut inputs, mut warnings) = (Vec::new(), Vec::new());
    for (path, label) in parts {
        let Some(path) = path else { continue };
        let (part, source, input) = read_cloud(path)?;
        for warning in &source.warnings {
            progress.event(Event::Warning(warning));
        }
        warnings.extend(source.warnings);
        inputs.push(input);
        let part = match label {
            Some(label) => part.with_label(label),
            None => part,
        };
        match &mut whole {
            None => whole = Some(part),
            Some(whole) => whole.append(part),
        }
    }
    Ok((whole.unwrap_or_default(), inputs, warnings))
}

/// All the places that results go to, checked before the work begins.
struct Sinks {
    mesh: Sink,
    format: Format,
    report: Option<Sink>,
    metrics: Option<Sink>,
    gradients: Option<Sink>,
    snapshots: Option<PathBuf>,
}

impl Sinks {
    fn new(arguments: &Arguments) -> Result<Self, Failure> {
        let optional = |path: &Option<PathBuf>| path.as_deref().map(Sink::new).transpose();
        let mesh = Sink::new(&arguments.output)?;
        let format = format(&mesh, arguments.format.as_deref())?;
        if mesh.is_terminal() {
            return Err(Failure::Usage(
                "-o -: a mesh does not belong on a screen; send it to a file or a pipe".to_owned(),
            ));
        }
        if let Some(folder) = &arguments.snapshots
            && !folder.is_dir()
        {
            return Err(Failure::Usage(format!(
                "{}: there is no such folder",
                folder.display()
            )));
        }
        Ok(Self {
            mesh,
            format,
            report: optional(&arguments.report)?,
            metrics: optional(&arguments.metrics)?,
            gradients: optional(&arguments.gradients)?,
            snapshots: arguments.snapshots.clone(),
        })
    }

    fn write(&self, result: &Reconstruction, progress: &Progress) -> Result<(), Failure> {
        self.mesh
            .write(|out| write(&result.mesh, self.format, out))?;
        if let Some(report) = &self.report {
            report.write(|out| json(out, &result.report))?;
        }
        if let Some(metrics) = &self.metrics {
            metrics.write(|out| csv(out, &progress.metrics()))?;
        }
        if let Some(gradients) = &self.gradients {
            gradients.write(|out| json(out, &*progress.gradients()))?;
        }
        if let Some(folder) = &self.snapshots {
            for (evaluation, mesh) in progress.snapshots().iter() {
                let name = format!("{evaluation}.{}", self.format.extension());
                Sink::new(&folder.join(name))?.write(|out| write(mesh, self.format, out))?;
            }
        }
        Ok(())
    }
}

fn format(mesh: &Sink, asked: Option<&str>) -> Result<Format, Failure> {
    let known = "ply, ply_ascii, obj, stl, off, glb";
    match (asked, mesh.name()) {
        (Some(asked), _) => Format::from_name(asked)
            .ok_or_else(|| Failure::Usage(format!("--format is {asked}, must be one of: {known}"))),
        (None, None) => Ok(Format::PlyBinary),
        (None, Some(name)) => Path::new(name)
            .extension()
            .and_then(|ending| Format::from_extension(&ending.to_string_lossy()))
            .ok_or_else(|| {
                Failure::Usage(format!(
                    "{name}: the ending names no mesh format; use .ply, .obj, .stl, .off or .glb, \
                     or --format"
                ))
            }),
    }
}

fn json(out: &mut dyn Write, value: &impl serde::Serialize) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, value)?;
    out.write_all(b"\n")
}

fn csv(out: &mut dyn Write, metrics: &[Metrics]) -> io::Result<()> {
    write!(
        out,
        "iteration,evaluation,loss,validation_loss,gradient_norm,step_length"
    )?;
    let layers = metrics.first().map_or(0, |m| m.weight_norms.len());
    for layer in 0..layers {
        write!(out, ",weight_norm_{layer}")?;
    }
    writeln!(out, ",blocks")?;
    for m in metrics {
        let validation = m
            .validation_loss
            .map(|loss| loss.to_string())
            .unwrap_or_default();
        write!(
            out,
            "{},{},{},{validation},{},{}",
            m.iteration, m.evaluation, m.loss, m.gradient_norm, m.step_length
        )?;
        // Rows of blocks have no norms.
        for layer in 0..layers {
            let norm = m.weight_norms.get(layer).map(f64::to_string);
            write!(out, ",{}", norm.unwrap_or_default())?;
        }
        let blocks = m.blocks.map(|count| count.to_string());
        writeln!(out, ",{}", blocks.unwrap_or_default())?;
    }
    Ok(())
}
