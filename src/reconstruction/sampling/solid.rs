//! Clouds that are no surface points: voxels of a segmentation, points that fill a body.
//!
//! The centre of a voxel at the boundary lies up to half a voxel inside of the surface. The middles of the faces
//! between voxels inside and places outside lie on both sides of it, and as far on one as on the other; so that
//! they are what a surface is put through.

use std::collections::HashSet;

use rayon::prelude::*;

use super::body::Body;
use super::lattice::Lattice;
use super::neighbours::{Neighbourhoods, SPACING_NEIGHBOURS, Tree, median, spacing};
use super::stairs::smoothed;
use crate::reconstruction::cloud::{self, PointCloud};
use crate::reconstruction::observer::Warning;
use crate::reconstruction::settings::{OffSurface, Settings};
use crate::reconstruction::symmetric::{covariance, eigen};
use crate::reconstruction::vector::{Bounds, Vec3, sub};

/// Neighbours of a lattice point that lie in its plane where the points are of flat faces, not of stairs.
const FLAT: usize = 24;

/// Least over largest variance of points in a plane, as rounding leaves it.
const IN_PLANE: f64 = 1e-9;

/// Edge of the boxes in which points of a filled body are counted, in spacings: one of random points in a volume
/// holds eight, so that none is empty.
const BOX: f64 = 2.2;

/// So many points tell how far apart they are.
const ASKED: usize = 20_000;

/// Share of the boxes that have boxes with points all around them from which on points may fill a body.
const INNER_BOXES: f64 = 0.15;

/// Depth of a filled body over half of the shortest edge of its box: noise around a surface stays far below.
const DEEP: f64 = 0.3;

/// Standard deviation of the points of a boundary from the surface, in edges of a cube as large as a voxel. Local
/// fits see a quarter of it, because steps move neighbours together. Measured are 0.09 to 0.13, on ellipsoids and an
/// organ; errors that go together average out less, so a mesh is nearer to the truth with more than that.
const NOISE: f64 = 0.15;

/// A surface point cloud in place of one of voxels.
pub(in crate::reconstruction) struct Boundary {
    /// Points between the body and what is outside, with outward normals.
    pub(in crate::reconstruction) cloud: PointCloud,
    /// Standard deviation of these points from the surface.
    pub(in crate::reconstruction) noise: f64,
    /// What was done.
    pub(in crate::reconstruction) warning: Warning,
}

/// The boundary of the body whose voxels the points of `cloud` are; none where they are surface points.
///
/// # Errors
/// [`cloud::Error::Filled`] where the points fill a body and lie on no lattice.
pub(in crate::reconstruction) fn boundary(
    cloud: &PointCloud,
    settings: &Settings,
) -> Result<Option<Boundary>, cloud::Error> {
    let surface_is_told = cloud.labels.is_some() || cloud.normals.is_some();
    if surface_is_told || settings.sampling.off_surface == OffSurface::Labels {
        return Ok(None);
    }
    if let Some(lattice) = Lattice::of(&cloud.points)
        && let Some(body) = Body::of(&lattice)
        && !is_flat(&cloud.points)
    {
        return Ok(Some(told(cloud, &body)));
    }
    if fills_a_body(&cloud.points) {
        return Err(cloud::Error::Filled);
    }
    Ok(None)
}

fn told(given: &PointCloud, body: &Body) -> Boundary {
    let faces: Vec<(Vec3, Vec3)> = body.faces().collect();
    let [x, y, z] = body.edges;
    let count = given.points.len();
    let message = format!(
        "the {count} points are voxels of {x:.4} x {y:.4} x {z:.4}, or faces of them; the surface is put between \
         the solid volume and the outside, through {} faces whose steps are smoothed away",
        faces.len()
    );
    let edge = (x * y * z).cbrt();
    let (points, normals) = smoothed(&faces, edge);
    Boundary {
        cloud: PointCloud {
            points,
            normals: Some(normals),
            space: given.space,
            ..PointCloud::default()
        },
        noise: NOISE * edge,
        warning: Warning::new("voxels", message),
    }
}

/// Whether most of the points lie in planes with their neighbours: faces of a body made of flat parts.
fn is_flat(points: &[Vec3]) -> bool {
    let tree = Tree::new(points);
    let near = Neighbourhoods::new(&tree, points, FLAT);
    let mut shares = near.map(|i| {
        let arms: Vec<Vec3> = near.of(i).map(|j| sub(points[j], points[i])).collect();
        let (values, _) = eigen(covariance(&arms));
        values[0].max(0.0) / values[2].max(f64::MIN_POSITIVE)
    });
    median(&mut shares) < IN_PLANE
}

/// Whether the points are all through a body: boxes with points have such boxes around them, and this for a good
/// part of the way to its middle.
fn fills_a_body(points: &[Vec3]) -> bool {
    let Some(bounds) = Bounds::of(points) else {
        return false;
    };
    let tree = Tree::new(points);
    let edge = BOX * typical_spacing(points, &tree);
    if edge.is_subnormal() || edge == 0.0 {
        return false;
    }
    let mut boxes: Vec<[i64; 3]> = points
        .par_iter()
        .map(|p| std::array::from_fn(|axis| ((p[axis] - bounds.min[axis]) / edge) as i64))
        .collect();
    boxes.par_sort_unstable();
    boxes.dedup();
    let all: HashSet<[i64; 3]> = boxes.into_iter().collect();
    let inner = eroded(&all);
    let share = inner.len() as f64 / all.len() as f64;
    let (mut depth, mut left) = (0.5, inner);
    while !left.is_empty() {
        depth += 1.0;
        left = eroded(&left);
    }
    let shortest = bounds.extent().into_iter().fold(f64::INFINITY, f64::min);
    share >= INNER_BOXES && depth * edge >= DEEP * 0.5 * shortest
}

/// Median distance to the nearest points, of some of them where they are many.
fn typical_spacing(points: &[Vec3], tree: &Tree) -> f64 {
    let asked = (0..points.len())
        .into_par_iter()
        .step_by(points.len().div_ceil(ASKED));
    let mut spacings: Vec<f64> = asked
        .map(|i| {
            let near = tree.nearest_n(points[i], SPACING_NEIGHBOURS + 1);
            spacing(near.into_iter().map(|(_, distance)| distance))
        })
        .collect();
    median(&mut spacings)
}

/// Those of the boxes that have others of them on all 26 sides.
fn eroded(boxes: &HashSet<[i64; 3]>) -> HashSet<[i64; 3]> {
    let around = |[x, y, z]: [i64; 3], k: i64| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
    boxes
        .iter()
        .copied()
        .filter(|&here| (0..27).all(|k| boxes.contains(&around(here, k))))
        .collect()
}
