//! The library by itself: a cloud in memory, reconstructed, and its mesh written to a file.
//!
//! ```text
//! cargo run --release --example reconstruct -- mesh.ply
//! ```
#![expect(clippy::print_stderr, reason = "an example talks to its reader")]

use std::error::Error;
use std::f64::consts::PI;
use std::fs::File;
use std::time::Instant;

use meshway::reconstruction::cloud::PointCloud;
use meshway::reconstruction::mesh::write::{Format, write};
use meshway::reconstruction::vector::Vec3;
use meshway::reconstruction::{Event, Observer, Preset, Settings, in_pool, reconstruct};
use serde_json::json;

/// Prints the stages. The library knows neither clock nor terminal: it asks its observer.
struct Terminal {
    start: Instant,
}

impl Observer for Terminal {
    fn event(&self, event: Event<'_>) {
        match event {
            Event::Phase(phase) => eprintln!("{:6.1} s  {phase:?}", self.seconds()),
            Event::Warning(warning) => eprintln!("{:6.1} s  {}", self.seconds(), warning.message),
            _ => {}
        }
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

/// Points on the unit sphere, along a spiral.
fn sphere(count: usize) -> Vec<Vec3> {
    let golden = PI * (3.0 - 5_f64.sqrt());
    let point = |k: usize| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / count as f64;
        let ring = (1.0 - z * z).sqrt();
        let (y, x) = (golden * k as f64).sin_cos();
        [ring * x, ring * y, z]
    };
    (0..count).map(point).collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).unwrap_or("mesh.ply".to_owned());
    let cloud = PointCloud {
        points: sphere(500),
        ..PointCloud::default()
    };
    let settings = Settings::resolve(Preset::Fast, &json!({"training": {"seed": 7}}))?;
    let terminal = Terminal {
        start: Instant::now(),
    };
    let result = in_pool(|| reconstruct(&cloud, &settings, &terminal))?;
    write(&result.mesh, Format::PlyBinary, &mut File::create(&path)?)?;
    eprintln!("{}\nmesh: {path}", result.report.summary());
    Ok(())
}
