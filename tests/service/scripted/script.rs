//! What a scripted job does.

use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use meshway::jobs::worker::{Failure, Product};
use meshway::jobs::{FailureReason, Problem};
use meshway::reconstruction::mesh::TriangleMesh;
use meshway::reconstruction::{Event, Observer, Phase};
use serde_json::json;
use thiserror::Error;

/// What a scripted job does.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Script {
    /// Gives a sphere at once.
    Instant,
    /// Gives a sphere after so many seconds, with progress on the way; stops when asked.
    Sleep(f64),
    /// Gives a sphere after as many milliseconds as the seed of the job's settings says.
    Seed,
    /// Gives a sphere once this file is there; stops when asked.
    Until(PathBuf),
    /// Aborts the process.
    Crash,
    /// Exits the process.
    Exit,
    /// Never ends, and never looks at its flags.
    Hang,
    /// Fails with this code.
    Fail(String),
    /// Panics.
    Panic,
    /// Takes memory without end.
    Oom,
}

/// A text that names no script.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "known are instant, sleep:SECONDS, until:FILE, seed, crash, exit, hang, fail:CODE, panic, oom"
)]
pub(crate) struct InvalidScript;

impl FromStr for Script {
    type Err = InvalidScript;

    fn from_str(text: &str) -> Result<Self, InvalidScript> {
        Ok(match text.split_once(':') {
            Some(("sleep", seconds)) => {
                let seconds: f64 = seconds.parse().map_err(|_| InvalidScript)?;
                if !(0.0..=1e6).contains(&seconds) {
                    return Err(InvalidScript);
                }
                Self::Sleep(seconds)
            }
            Some(("until", file)) => Self::Until(file.into()),
            Some(("fail", code)) => Self::Fail(code.to_owned()),
            None if text == "instant" => Self::Instant,
            None if text == "seed" => Self::Seed,
            None if text == "crash" => Self::Crash,
            None if text == "exit" => Self::Exit,
            None if text == "hang" => Self::Hang,
            None if text == "panic" => Self::Panic,
            None if text == "oom" => Self::Oom,
            _ => return Err(InvalidScript),
        })
    }
}

/// Time between two looks at the flags.
const STEP: Duration = Duration::from_millis(10);
/// Memory that is taken in one step, and in all: a machine without a limit must survive.
const GULP_BYTES: usize = 16 << 20;
const MOST_GULPS: usize = 128;

impl Script {
    /// Does what the script says.
    ///
    /// # Errors
    /// [`Failure`], where the script fails or is asked to stop.
    ///
    /// # Panics
    /// Where the script does.
    pub(crate) fn run(&self, seed: u64, observer: &dyn Observer) -> Result<Product, Failure> {
        observer.event(Event::Phase(Phase::Training));
        match self {
            Self::Instant => {}
            Self::Sleep(seconds) => sleep(*seconds, observer)?,
            Self::Until(file) => until(file, observer)?,
            Self::Seed => sleep(seed as f64 / 1_000.0, observer)?,
            Self::Crash => std::process::abort(),
            Self::Exit => std::process::exit(7),
            Self::Hang => loop {
                std::thread::sleep(STEP);
            },
            Self::Fail(code) => {
                return Err(Failure::Final(Problem::new(
                    code.as_str(),
                    "as the script says",
                )));
            }
            Self::Panic => panic!("as the script says"),
            Self::Oom => {
                let mut memory = Vec::new();
                for _ in 0..MOST_GULPS {
                    // Ones, because untouched zeros take no memory.
                    memory.push(vec![1_u8; GULP_BYTES]);
                    std::thread::sleep(STEP);
                }
                let detail = format!("{} gulps were taken", memory.len());
                return Err(Failure::Transient(FailureReason::Internal { detail }));
            }
        }
        Ok(Product {
            mesh: sphere(16, 32),
            report: json!({ "script": true }),
            // The smallest safetensors file: the length of its header, and the header.
            model: [&2_u64.to_le_bytes()[..], b"{}"].concat(),
        })
    }
}

fn until(file: &Path, observer: &dyn Observer) -> Result<(), Failure> {
    while !file.exists() {
        if observer.cancelled() || observer.released() {
            return Err(Failure::Stopped);
        }
        std::thread::sleep(STEP);
    }
    Ok(())
}

fn sleep(seconds: f64, observer: &dyn Observer) -> Result<(), Failure> {
    let start = observer.seconds();
    loop {
        if observer.cancelled() || observer.released() {
            return Err(Failure::Stopped);
        }
        let share = (observer.seconds() - start) / seconds;
        if share >= 1.0 || seconds <= 0.0 {
            return Ok(());
        }
        observer.event(Event::Progress(share));
        std::thread::sleep(STEP);
    }
}

/// The unit sphere over a grid of latitudes and longitudes, closed at the poles.
fn sphere(bands: u32, sectors: u32) -> TriangleMesh {
    let mut vertices = vec![[0.0, 0.0, 1.0]];
    for band in 1..bands {
        let polar = PI * f64::from(band) / f64::from(bands);
        for sector in 0..sectors {
            let azimuth = TAU * f64::from(sector) / f64::from(sectors);
            let (ring, height) = polar.sin_cos();
            vertices.push([ring * azimuth.cos(), ring * azimuth.sin(), height]);
        }
    }
    vertices.push([0.0, 0.0, -1.0]);
    let at = |band: u32, sector: u32| 1 + (band - 1) * sectors + sector % sectors;
    let south = vertices.len() as u32 - 1;
    let mut triangles = Vec::new();
    for sector in 0..sectors {
        triangles.push([0, at(1, sector), at(1, sector + 1)]);
        for band in 1..bands - 1 {
            let (a, b) = (at(band, sector), at(band, sector + 1));
            let (c, d) = (at(band + 1, sector), at(band + 1, sector + 1));
            triangles.extend([[a, c, b], [b, c, d]]);
        }
        triangles.push([at(bands - 1, sector), south, at(bands - 1, sector + 1)]);
    }
    TriangleMesh {
        normals: vertices.clone(),
        vertices,
        triangles,
        ..TriangleMesh::default()
    }
}
