//! `meshway sample`: labelled clouds of analytic shapes.

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use super::files::Sink;
use crate::reconstruction::cloud::{write_ply, write_xyz};
use crate::reconstruction::shapes::{Recipe, Shape, sample};

/// Arguments of `meshway sample`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// `sphere`, `sphere:RADIUS`, `torus`, `torus:MAJOR:MINOR`, `hand`, `uterus` or `abdomen`.
    shape: String,
    /// Points on the surface.
    #[arg(short = 'n', long, default_value_t = 3_000)]
    points: usize,
    /// Points inside, labelled 1.
    #[arg(long, default_value_t = 0)]
    interior: usize,
    /// Points outside, labelled -1.
    #[arg(long, default_value_t = 0)]
    exterior: usize,
    /// Percentage of the surface points to leave out, all in one place: a hole.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0)]
    missing: f64,
    /// Standard deviation of the noise, in % of the bounding-box diagonal.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0)]
    noise: f64,
    /// Give the true normals.
    #[arg(long)]
    normals: bool,
    /// Give labels even where all points are on the surface.
    #[arg(long)]
    labels: bool,
    /// Seed of the choice of points.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The cloud; the ending chooses the format: ply or xyz. `-` is standard output (xyz).
    #[arg(short, long, value_name = "CLOUD")]
    output: PathBuf,
}

/// Most points of one kind: what the readers accept.
const MAX_POINTS: usize = 5_000_000;

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let shape: Shape = arguments
        .shape
        .parse()
        .map_err(|error| Failure::Usage(format!("{error}")))?;
    check(arguments)?;
    let sink = Sink::new(&arguments.output)?;
    let ending = sink
        .name()
        .and_then(|name| name.rsplit_once('.'))
        .map(|(_, ending)| ending);
    let write = match ending {
        None | Some("xyz") => write_xyz,
        Some("ply") => write_ply,
        Some(other) => {
            return Err(Failure::Usage(format!(
                "a cloud is written as .ply or .xyz, not .{other}"
            )));
        }
    };
    let cloud = sample(
        &shape,
        &Recipe {
            points: arguments.points,
            interior: arguments.interior,
            exterior: arguments.exterior,
            missing_percent: arguments.missing,
            noise_percent: arguments.noise,
            normals: arguments.normals,
            seed: arguments.seed,
            labels: arguments.labels,
        },
    );
    sink.write(|out| write(&cloud, out))
}

fn check(arguments: &Arguments) -> Result<(), Failure> {
    for (name, count) in [
        ("--points", arguments.points),
        ("--interior", arguments.interior),
        ("--exterior", arguments.exterior),
    ] {
        if count > MAX_POINTS {
            return Err(Failure::Usage(format!(
                "{name} is {count}, must be at most {MAX_POINTS}"
            )));
        }
    }
    for (name, value, max) in [
        ("--missing", arguments.missing, 95.0),
        ("--noise", arguments.noise, 100.0),
    ] {
        if !(0.0..=max).contains(&value) {
            return Err(Failure::Usage(format!(
                "{name} is {value}, must be from 0 to {max}"
            )));
        }
    }
    Ok(())
}
