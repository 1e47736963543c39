//! `meshway reconstruct`: a cloud in, a mesh and its record out.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;

use super::Failure;
use super::encoding::{Encoding, EncodingArguments};
use super::files::{OnePart, PartArguments, Sink, read, read_cloud};
use super::parts::{Part, several};
use super::progress::Progress;
use crate::reconstruction::cloud::{Label, PointCloud, Source};
use crate::reconstruction::report::Verdict;
use crate::reconstruction::settings::assignments;
use crate::reconstruction::training::{Column, csv};
use crate::reconstruction::{
    Event, Input, Observer, Preset, Reconstruction, Report, Settings, in_pool, reconstruct,
    set_threads,
};

/// Arguments of `meshway reconstruct`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Point clouds: PLY, XYZ, CSV, PTS, PTX, OBJ, OFF, STL, PCD or NPY, also gzipped; segmentations:
    /// NIfTI, NRRD, MHA, DICOM SEG and RT-STRUCT; `-` is standard input. Of several each gets a mesh of its name, and --output and the like are folders.
    #[arg(required = true, value_name = "CLOUD")]
    clouds: Vec<PathBuf>,
    /// Points inside the surface, in addition to the labels of the cloud.
    #[arg(long, value_name = "CLOUD")]
    interior: Option<PathBuf>,
    /// Points outside the surface, in addition to the labels of the cloud.
    #[arg(long, value_name = "CLOUD")]
    exterior: Option<PathBuf>,
    #[command(flatten)]
    part: PartArguments,
    /// The mesh; the ending chooses the format: ply, obj, stl, off, glb, 3mf, vtp, dcm. `-` is standard output.
    #[arg(short, long, value_name = "MESH")]
    output: PathBuf,
    #[command(flatten)]
    encoding: EncodingArguments,
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
    // All places first: none must be found out after the others were worked on.
    let runs = runs(arguments)?;
    in_pool(|| {
        let mut first = Ok(());
        for run in &runs {
            let result = run_with(arguments, &settings, run);
            // The others are worked on all the same; the first failure is printed by the caller, the others here.
            match (&first, result) {
                (Ok(()), result) => first = result,
                (Err(_), Err(failure)) => failure.print(),
                (Err(_), Ok(())) => {}
            }
        }
        first
    })
}

/// A cloud that a mesh is made of, and where the results go.
struct Run<'a> {
    path: &'a Path,
    part: OnePart,
    sinks: Sinks,
}

impl<'a> Run<'a> {
    fn new(
        arguments: &Arguments,
        path: &'a Path,
        part: OnePart,
        asked: Option<&Part>,
    ) -> Result<Self, Failure> {
        let sinks = Sinks::new(arguments, path, asked)?;
        Ok(Self { path, part, sinks })
    }
}

/// One run for each cloud, or for each part of one that is asked for.
fn runs(arguments: &Arguments) -> Result<Vec<Run<'_>>, Failure> {
    let mut runs = Vec::new();
    for path in &arguments.clouds {
        match several(path, &arguments.part)? {
            None => runs.push(Run::new(arguments, path, arguments.part.one(), None)?),
            Some(_) if arguments.clouds.len() > 1 || path == Path::new("-") => {
                return Err(Failure::Usage(
                    "several parts are made of one file at a time, which is not standard input"
                        .to_owned(),
                ));
            }
            Some(parts) => {
                for part in &parts {
                    let one = arguments.part.of(part.choice());
                    runs.push(Run::new(arguments, path, one, Some(part))?);
                }
            }
        }
    }
    Ok(runs)
}

fn run_with(arguments: &Arguments, settings: &Settings, run: &Run<'_>) -> Result<(), Failure> {
    let Run { path, part, sinks } = run;
    let progress = Progress::new(arguments.quiet);
    let (cloud, inputs, source) = cloud(arguments, path, part, &progress)?;
    let refused = sinks.encoding.check(&cloud, settings.surface.resolution);
    refused.map_err(|detail| Failure::Usage(format!("{}: {detail}", path.display())))?;

    let outcome = reconstruct(&cloud, settings, &progress);
    progress.finish();
    let mut result = outcome.map_err(|error| Failure::of(error, path))?;
    let mesh = &result.mesh;
    result.report.read_from(inputs, source, mesh);
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

/// The cloud of all files, what the report records of each, and how the first was read, with the warnings of all.
fn cloud(
    arguments: &Arguments,
    path: &Path,
    part: &OnePart,
    progress: &Progress,
) -> Result<(PointCloud, Vec<Input>, Source), Failure> {
    let (mut whole, mut first, input) = read_cloud(path, part)?;
    let mut inputs = vec![input];
    for (path, label) in [
        (&arguments.interior, Label::Interior),
        (&arguments.exterior, Label::Exterior),
    ] {
        let Some(path) = path else { continue };
        // What is told to be inside or outside is a cloud of its own.
        let (part, source, input) = read_cloud(path, &OnePart::default())?;
        first.warnings.extend(source.warnings);
        inputs.push(input);
        whole.append(part.with_label(label));
    }
    for warning in &first.warnings {
        progress.event(Event::Warning(warning));
    }
    Ok((whole, inputs, first))
}

/// All the places that results go to, checked before the work begins.
struct Sinks {
    mesh: Sink,
    encoding: Encoding,
    report: Option<Sink>,
    metrics: Option<Sink>,
    gradients: Option<Sink>,
    snapshots: Option<PathBuf>,
}

impl Sinks {
    fn new(arguments: &Arguments, cloud: &Path, part: Option<&Part>) -> Result<Self, Failure> {
        let several = arguments.clouds.len() > 1;
        if several && (arguments.interior.is_some() || arguments.exterior.is_some()) {
            return Err(Failure::Usage(
                "--interior and --exterior belong to one cloud; give one at a time".to_owned(),
            ));
        }
        // Of several clouds each has its own file in the folder that is named, of several parts by their marks.
        let sink = |path: &Path, ending: &str| match part {
            Some(part) => Sink::new(&part.path(path)?),
            None if several => Sink::new(&path.join(own_name(arguments, cloud, ending)?)),
            None => Sink::new(path),
        };
        let optional = |path: &Option<PathBuf>, ending: &str| {
            let path = path.as_deref();
            path.map(|path| sink(path, ending)).transpose()
        };
        let (mesh, encoding) = if several {
            let encoding = Encoding::named(&arguments.encoding)?;
            (sink(&arguments.output, encoding.extension())?, encoding)
        } else {
            let mesh = sink(&arguments.output, "")?;
            let encoding = Encoding::of(&mesh, &arguments.encoding)?;
            (mesh, encoding)
        };
        if (several || part.is_some()) && arguments.snapshots.is_some() {
            return Err(Failure::Usage(
                "--snapshots belongs to one mesh; give one cloud and one part at a time".to_owned(),
            ));
        }
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
            encoding,
            report: optional(&arguments.report, "json")?,
            metrics: optional(&arguments.metrics, "csv")?,
            gradients: optional(&arguments.gradients, "gradients.json")?,
            snapshots: arguments.snapshots.clone(),
        })
    }

    fn write(&self, result: &Reconstruction, progress: &Progress) -> Result<(), Failure> {
        let (encoding, made) = (self.encoding, &result.report);
        self.mesh
            .write(|out| encoding.write(&result.mesh, made, out))?;
        if let Some(report) = &self.report {
            report.write(|out| json(out, &result.report))?;
        }
        if let Some(metrics) = &self.metrics {
            metrics
                .write(|out| out.write_all(csv(&Column::ALL, &progress.metrics()).as_bytes()))?;
        }
        if let Some(gradients) = &self.gradients {
            gradients.write(|out| json(out, &*progress.gradients()))?;
        }
        if let Some(folder) = &self.snapshots {
            for (evaluation, mesh) in progress.snapshots().iter() {
                let name = format!("{evaluation}.{}", encoding.extension());
                Sink::new(&folder.join(name))?.write(|out| encoding.write(mesh, made, out))?;
            }
        }
        Ok(())
    }
}

/// The name of a file about one cloud of several; it must not be that of another one.
fn own_name(arguments: &Arguments, cloud: &Path, ending: &str) -> Result<String, Failure> {
    let stem = |path: &Path| {
        let name = path.file_name().map(|name| name.to_string_lossy());
        let name = name.unwrap_or_default();
        let name = name.strip_suffix(".gz").unwrap_or(&name);
        let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
        stem.to_owned()
    };
    let own = stem(cloud);
    let clouds = arguments.clouds.iter();
    if clouds.filter(|path| stem(path) == own).count() > 1 {
        return Err(Failure::Usage(format!(
            "two of the clouds are named {own}; their meshes would have one name"
        )));
    }
    Ok(format!("{own}.{ending}"))
}

fn json(out: &mut dyn Write, value: &impl serde::Serialize) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, value)?;
    out.write_all(b"\n")
}
