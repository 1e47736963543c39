//! Whether a simplified mesh is as sound as the one that it was made of, and where it is not.

use std::cmp::Reverse;

use super::crossings::crossing_triangles;
use super::{Original, Part};
use crate::reconstruction::mesh::topology::irregular_vertices;
use crate::reconstruction::mesh::{Closest, SurfaceTree, Topology, TriangleMesh};
use crate::reconstruction::vector::{Vec3, add, dot, scale};

/// What was found of a part.
pub(super) struct Check {
    /// Nothing speaks against it.
    pub(super) sound: bool,
    /// Largest distance that was found between it and the original.
    pub(super) error: f64,
    /// Its wrong triangles.
    wrong: Vec<bool>,
    /// What of it is closest to each vertex of the original.
    closest: Vec<Closest>,
}

impl Check {
    /// Checks `part`, which may be `limit` away from `original`; none where nothing is left of it.
    pub(super) fn of(original: &Original<'_>, part: &Part, limit: f64) -> Option<Self> {
        let mesh = &part.mesh;
        let tree = SurfaceTree::new(mesh)?;
        let mut wrong = faulty(mesh, &tree);
        excuse(&mut wrong, original.mesh, part);

        let there = original.tree.distances(&middles(mesh));
        for (wrong, distances) in wrong.iter_mut().zip(there.as_chunks::<4>().0) {
            *wrong |= distances.iter().any(|d| *d > limit);
        }
        let closest = tree.closest_to_each(&original.mesh.vertices);
        for closest in closest.iter().filter(|closest| closest.distance > limit) {
            wrong[closest.triangle] = true;
        }
        let back = closest.iter().map(|closest| closest.distance);
        Some(Self {
            sound: !wrong.contains(&true) && alike(&original.topology, &Topology::of(mesh)),
            error: there.into_iter().chain(back).fold(0.0, f64::max),
            wrong,
            closest,
        })
    }

    /// Number of wrong triangles.
    pub(super) fn wrong(&self) -> usize {
        self.wrong.iter().filter(|wrong| **wrong).count()
    }

    /// Adds vertices near each wrong triangle to those that are `kept`, at most so many: the furthest from it.
    /// Whether there were any.
    pub(super) fn keep_more(&self, part: &Part, kept: &mut [bool], most: usize) -> bool {
        let mut near = self.lost(&self.wrong, kept);
        if near.is_empty() {
            near = self.lost(&around(&part.mesh, &self.wrong), kept);
        }
        near.sort_unstable_by_key(|(triangle, distance, v)| (*triangle, Reverse(*distance), *v));
        for of_triangle in near.chunk_by(|a, b| a.0 == b.0) {
            for (_, _, v) in of_triangle.iter().take(most) {
                kept[*v as usize] = true;
            }
        }
        !near.is_empty()
    }

    /// The vertices that are not kept and closest to one of `triangles`: this, the bits of the distance, the vertex.
    fn lost(&self, triangles: &[bool], kept: &[bool]) -> Vec<(usize, u64, u32)> {
        let all = (0u32..).zip(&self.closest).zip(kept);
        let lost = all.filter(|((_, closest), kept)| !**kept && triangles[closest.triangle]);
        // Of numbers that are not negative, the bits have the order of the values.
        lost.map(|((v, closest), _)| (closest.triangle, closest.distance.to_bits(), v))
            .collect()
    }
}

/// Triangles that no sound mesh has: without area, turned over, through another, where the mesh is no manifold.
fn faulty(mesh: &TriangleMesh, tree: &SurfaceTree) -> Vec<bool> {
    let irregular = irregular_vertices(&mesh.triangles, mesh.vertices.len());
    let is_irregular = |v: &u32| irregular.binary_search(v).is_ok();
    let mut faulty: Vec<bool> = (0..mesh.triangles.len())
        .map(|t| turned(mesh, t) || mesh.triangles[t].iter().any(is_irregular))
        .collect();
    for t in crossing_triangles(mesh, tree) {
        faulty[t] = true;
    }
    faulty
}

/// Whether a triangle has no area, or faces against the normals of its corners.
fn turned(mesh: &TriangleMesh, t: usize) -> bool {
    let area = mesh.area_vector(t);
    let normals = mesh.triangles[t].map(|v| mesh.normals.get(v as usize).copied());
    match normals {
        [Some(a), Some(b), Some(c)] => dot(area, add(a, add(b, c))) <= 0.0,
        _ => dot(area, area) <= 0.0,
    }
}

/// Takes those from the `faulty` triangles that the original has too.
fn excuse(faulty: &mut [bool], original: &TriangleMesh, part: &Part) {
    let rotated = |[a, b, c]: [u32; 3]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min();
    let mut suspects: Vec<(Option<[u32; 3]>, usize)> = (0..faulty.len())
        .filter(|t| faulty[*t])
        .map(|t| (rotated(part.corners(t)), t))
        .collect();
    if suspects.is_empty() {
        return;
    }
    suspects.sort_unstable();
    for triangle in &original.triangles {
        let triangle = rotated(*triangle);
        if let Ok(found) = suspects.binary_search_by_key(&triangle, |(suspect, _)| *suspect) {
            faulty[suspects[found].1] = false;
        }
    }
}

/// Those of the triangles, and all that have a corner in common with one of them.
fn around(mesh: &TriangleMesh, triangles: &[bool]) -> Vec<bool> {
    let mut corners = vec![false; mesh.vertices.len()];
    for t in (0..triangles.len()).filter(|t| triangles[*t]) {
        for v in mesh.triangles[t] {
            corners[v as usize] = true;
        }
    }
    let touches = |triangle: &[u32; 3]| triangle.iter().any(|v| corners[*v as usize]);
    mesh.triangles.iter().map(touches).collect()
}

/// Whether simplification has kept what it must.
fn alike(before: &Topology, after: &Topology) -> bool {
    after.components == before.components
        && after.euler_characteristic == before.euler_characteristic
        && after.closed == before.closed
        && after.manifold >= before.manifold
        && after.oriented >= before.oriented
        && after.degenerate_triangles <= before.degenerate_triangles
}

/// The middle of each triangle and of its three sides.
fn middles(mesh: &TriangleMesh) -> Vec<Vec3> {
    let of = |t| {
        let [a, b, c] = mesh.corners(t);
        let between = |a, b| scale(add(a, b), 0.5);
        let centre = scale(add(a, add(b, c)), 1.0 / 3.0);
        [centre, between(a, b), between(b, c), between(c, a)]
    };
    (0..mesh.triangles.len()).flat_map(of).collect()
}
