//! From the faces of voxels to points of the smooth surface between them.

use rayon::prelude::*;

use super::jets::moved;
use super::neighbours::{Neighbourhoods, Tree};
use crate::reconstruction::vector::{Vec3, add, dot, norm, normalized, sub};

/// Radius of the neighbourhoods over which steps are smoothed, in edges of a voxel: chosen on label maps of an
/// organ and of a vessel three voxels wide, whose steps vanish and whose volume stays within 2 %.
const REACH: f64 = 3.0;

/// Most faces in such a neighbourhood that are looked at.
const MOST: usize = 128;

/// Least cosine between normals on the same sheet.
const SAME_SHEET: f64 = 0.2;

/// Points of the smooth surface at the middles of `faces`, and its unit normals there. The faces come with outward
/// normals as long as they are large; `edge` is that of a cube as large as a voxel.
///
/// The normals are those of all faces around; along them, each middle is moved onto the quadric that fits the
/// middles around.
pub(super) fn smoothed(faces: &[(Vec3, Vec3)], edge: f64) -> (Vec<Vec3>, Vec<Vec3>) {
    let points: Vec<Vec3> = faces.iter().map(|(middle, _)| *middle).collect();
    let tree = Tree::new(&points);
    let near = Neighbourhoods::new(&tree, &points, MOST);
    let beside = |i: usize| {
        near.of(i)
            .map(move |j| (j, sub(faces[j].0, faces[i].0)))
            .take_while(|(_, arm)| norm(*arm) <= REACH * edge)
    };
    let normals: Vec<Vec3> = (0..faces.len())
        .into_par_iter()
        .map(|i| {
            // Faces that look the other way are those of the far side of a thin part.
            let own = faces[i].1;
            let sum = beside(i)
                .map(|(j, _)| faces[j].1)
                .filter(|normal| dot(*normal, own) >= 0.0)
                .fold(own, add);
            normalized(sum).unwrap_or(own)
        })
        .collect();
    (0..faces.len())
        .into_par_iter()
        .map(|i| {
            let arms: Vec<Vec3> = beside(i)
                .filter(|&(j, _)| dot(normals[i], normals[j]) > SAME_SHEET)
                .map(|(_, arm)| arm)
                .collect();
            moved(points[i], normals[i], &arms)
        })
        .unzip()
}
