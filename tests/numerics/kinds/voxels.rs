//! Voxels of label maps, points that fill a body, and points of a body that only look like them.

use std::collections::HashSet;

use meshway::reconstruction::Error;
use meshway::reconstruction::cloud::{self, PointCloud};
use meshway::reconstruction::vector::Vec3;
use rand::RngExt;

use super::{Truth, bare, codes, ellipsoid_volume, message, random, right, right_by_default, run};

const AXES: Vec3 = [13.0, 10.0, 11.0];

/// Edges of a voxel.
const EDGES: Vec3 = [0.8, 0.8, 1.6];

fn middle(voxel: [i32; 3]) -> Vec3 {
    std::array::from_fn(|axis| (f64::from(voxel[axis]) + 0.3) * EDGES[axis])
}

/// 1 on the ellipsoid, less inside.
fn level(p: Vec3) -> f64 {
    (0..3).map(|a| (p[a] / AXES[a]).powi(2)).sum::<f64>().sqrt()
}

/// The voxels whose middles are in the ellipsoid.
fn voxels() -> HashSet<[i32; 3]> {
    let all = (0..60_i32.pow(3)).map(|k| [k % 60 - 30, k / 60 % 60 - 30, k / 3600 - 30]);
    all.filter(|voxel| level(middle(*voxel)) < 1.0).collect()
}

/// The six voxels at the faces of one.
fn beside(voxel: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (0..6).map(move |side| {
        let mut other = voxel;
        other[side / 2] += if side % 2 == 0 { 1 } else { -1 };
        other
    })
}

/// Points in an order that does not depend on the run.
fn sorted(mut points: Vec<Vec3>) -> PointCloud {
    points.sort_by(|a, b| a.partial_cmp(b).unwrap());
    bare(points)
}

#[track_caller]
fn one_smooth_body(cloud: &PointCloud) {
    let made = right(cloud, &Truth::body(ellipsoid_volume(AXES)));
    message(&made, "voxels");
    let worst = made
        .mesh
        .vertices
        .iter()
        .map(|v| (level(*v) - 1.0).abs())
        .fold(0.0, f64::max);
    // Half a voxel would be the steps themselves.
    assert!(worst * AXES[1] < 0.8 * EDGES[2], "{worst}");
}

#[test]
fn all_voxels_of_a_body_become_its_surface() {
    one_smooth_body(&sorted(voxels().into_iter().map(middle).collect()));
}

#[test]
fn the_voxels_at_its_boundary_do_too() {
    let all = voxels();
    let boundary = |voxel: &[i32; 3]| beside(*voxel).any(|other| !all.contains(&other));
    let points = all.iter().copied().filter(boundary).map(middle);
    one_smooth_body(&sorted(points.collect()));
}

#[test]
fn the_middles_of_its_faces_do_too() {
    let all = voxels();
    let faces = all.iter().flat_map(|&voxel| {
        beside(voxel)
            .filter(|other| !all.contains(other))
            .map(move |other| {
                let (a, b) = (middle(voxel), middle(other));
                std::array::from_fn(|axis| 0.5 * (a[axis] + b[axis]))
            })
    });
    one_smooth_body(&sorted(faces.collect()));
}

#[test]
fn points_at_random_through_a_body_are_refused_by_name() {
    let mut random = random(12);
    let points = (0..20_000)
        .map(|_| -> Vec3 {
            std::array::from_fn(|a| AXES[a] * (2.0 * random.random::<f64>() - 1.0))
        })
        .filter(|p| level(*p) < 1.0);
    let error = run(&bare(points.collect())).err().unwrap();
    assert!(
        matches!(error, Error::Cloud(cloud::Error::Filled)),
        "{error}"
    );
}

#[test]
fn a_cube_drawn_on_a_lattice_is_no_label_map() {
    let mut points = HashSet::new();
    for (u, v) in (0..441).map(|k| (k % 21, k / 21)) {
        for side in [0, 20] {
            points.extend([[side, u, v], [u, side, v], [u, v, side]]);
        }
    }
    let cloud = sorted(points.into_iter().map(|p| p.map(f64::from)).collect());
    let made = right_by_default(&cloud, &Truth::body(8_000.0));
    assert!(!codes(&made).contains(&"voxels"));
    // Its edges are no rounder than its spacing.
    let edge: Vec<Vec3> = (0..=20).map(|x| [f64::from(x), 0.0, 0.0]).collect();
    let furthest = super::furthest(&made, &edge);
    assert!(furthest < 1.0, "{furthest}");
}
