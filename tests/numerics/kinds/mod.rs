//! Kinds of clouds as users bring them, each with a true surface, through a whole run.
//!
//! The clouds are made here and none was used to choose a constant.

mod contours;
mod normals;
mod several;
mod strays;
mod thin;
mod voxels;

use std::f64::consts::PI;

use meshway::reconstruction::cloud::PointCloud;
use meshway::reconstruction::mesh::SurfaceTree;
use meshway::reconstruction::random::{Generator, Purpose, stream};
use meshway::reconstruction::report::Verdict;
use meshway::reconstruction::settings::Preset;
use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use meshway::reconstruction::vector::Vec3;
use meshway::reconstruction::{Error, Reconstruction, reconstruct};
use rand::RngExt;
use rand_distr::StandardNormal;

use crate::uncertainty::Silent;

/// A cloud of bare points.
pub(crate) fn bare(points: Vec<Vec3>) -> PointCloud {
    PointCloud {
        points,
        normals: None,
        labels: None,
        ..PointCloud::default()
    }
}

pub(crate) fn random(seed: u64) -> Generator {
    stream(seed, Purpose::Shape)
}

/// A vector of three independent normal deviates.
pub(crate) fn deviate(random: &mut Generator) -> Vec3 {
    std::array::from_fn(|_| random.sample(StandardNormal))
}

/// Points spread evenly over the unit sphere.
pub(crate) fn spiral(count: usize) -> Vec<Vec3> {
    let turn = PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (sin, cos) = (turn * i as f64).sin_cos();
            let around = (1.0 - z * z).sqrt();
            [around * cos, around * sin, z]
        })
        .collect()
}

/// Radii of the ring that many tests use: around the axis, and of the tube.
pub(crate) const RING: (f64, f64) = (10.0, 4.0);

pub(crate) const RING_VOLUME: f64 = 2.0 * PI * PI * RING.0 * RING.1 * RING.1;

const RING_SHAPE: Shape = Shape::Torus {
    major: RING.0,
    minor: RING.1,
};

/// Points of the ring, uniform by area, with their outward normals.
pub(crate) fn ring(points: usize, seed: u64) -> (Vec<Vec3>, Vec<Vec3>) {
    let recipe = Recipe {
        points,
        seed,
        normals: true,
        ..Recipe::default()
    };
    let cloud = sample(&RING_SHAPE, &recipe);
    (cloud.points, cloud.normals.unwrap())
}

/// Distance of a point from the ring.
pub(crate) fn from_ring(p: Vec3) -> f64 {
    RING_SHAPE.signed(p).abs()
}

/// What the settings `fast` make of a cloud.
pub(crate) fn run(cloud: &PointCloud) -> Result<Reconstruction, Error> {
    run_with(Preset::Fast, cloud)
}

fn run_with(preset: Preset, cloud: &PointCloud) -> Result<Reconstruction, Error> {
    tch::set_num_threads(1);
    reconstruct(cloud, &preset.settings(), &Silent)
}

/// What is known of a body.
pub(crate) struct Truth {
    pub(crate) components: usize,
    pub(crate) genus: i64,
    pub(crate) volume: f64,
    /// By how much the volume may differ, as a share.
    pub(crate) tolerance: f64,
}

impl Truth {
    /// One ball-like body, to 2 %.
    pub(crate) fn body(volume: f64) -> Self {
        Self {
            components: 1,
            genus: 0,
            volume,
            tolerance: 0.02,
        }
    }

    pub(crate) fn ring() -> Self {
        Self {
            genus: 1,
            ..Self::body(RING_VOLUME)
        }
    }
}

/// The run of a cloud whose mesh must have these pieces, handles and volume, and not be called poor.
#[track_caller]
pub(crate) fn right(cloud: &PointCloud, truth: &Truth) -> Reconstruction {
    let made = run(cloud).unwrap();
    is_right(&made, truth);
    made
}

/// The same with the default settings, which fit more closely.
#[track_caller]
pub(crate) fn right_by_default(cloud: &PointCloud, truth: &Truth) -> Reconstruction {
    let made = run_with(Preset::default(), cloud).unwrap();
    is_right(&made, truth);
    made
}

#[track_caller]
fn is_right(made: &Reconstruction, truth: &Truth) {
    let report = &made.report;
    let mesh = &report.mesh;
    let summary = report.summary();
    assert!(mesh.topology.closed, "{summary}");
    assert_eq!(mesh.topology.components, truth.components, "{summary}");
    assert_eq!(mesh.topology.genus, Some(truth.genus), "{summary}");
    let volume = mesh.volume.unwrap();
    let off = volume / truth.volume - 1.0;
    assert!(
        off.abs() <= truth.tolerance,
        "volume off by {off}: {summary}"
    );
    assert_ne!(report.verdict, Verdict::Poor, "{summary}");
}

/// Codes of the warnings of a run.
pub(crate) fn codes(made: &Reconstruction) -> Vec<&'static str> {
    made.report
        .warnings
        .iter()
        .map(|warning| warning.code)
        .collect()
}

/// The message of the one warning with a code.
#[track_caller]
pub(crate) fn message<'a>(made: &'a Reconstruction, code: &str) -> &'a str {
    let mut found = made
        .report
        .warnings
        .iter()
        .filter(|warning| warning.code == code);
    let warning = found.next();
    assert!(found.next().is_none(), "{code} is told twice");
    let told = codes(made);
    &warning
        .unwrap_or_else(|| panic!("no {code} in {told:?}"))
        .message
}

/// The largest distance of `points` from the mesh.
pub(crate) fn furthest(made: &Reconstruction, points: &[Vec3]) -> f64 {
    let surface = SurfaceTree::new(&made.mesh).unwrap();
    surface.distances(points).into_iter().fold(0.0, f64::max)
}

/// Volume of an ellipsoid of these half axes.
pub(crate) fn ellipsoid_volume([a, b, c]: Vec3) -> f64 {
    4.0 / 3.0 * PI * a * b * c
}
