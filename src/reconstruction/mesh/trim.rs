//! Cutting a mesh where it is further than a level from the points that it was made of.
//!
//! Triangles across the level are split there. A cut edge gets one new vertex, which both of its triangles
//! share, so that there are no cracks.

use super::TriangleMesh;
use super::topology::DisjointSets;
use crate::reconstruction::vector::{Bounds, Vec3, add, along, distance, normalized, scale, sub};

/// Share of an edge within which a cut does not come near its ends: it goes through the near one, and stops short
/// of the far one. A tenth keeps the angles of the pieces within reason and moves the boundary by less than the
/// mesh resolves.
const SNAP: f64 = 0.1;

/// Halvings of an edge where the level is not where linear interpolation has it; the rest of 1/64 is below
/// [`SNAP`].
const HALVINGS: usize = 6;

/// The part of `mesh` within `level` of the points, by its
/// [`distance_to_points`](TriangleMesh::distance_to_points); empty where none of it is.
///
/// A connected region further away is cut out where its box has a diagonal above `level`; smaller ones are gaps of
/// the sampling and stay. `distances` measures the new vertices: none of them is further than `level`. Manifold and
/// oriented meshes stay so. A mesh without distances is returned as it is.
pub fn trim(
    mesh: &TriangleMesh,
    level: f64,
    distances: &dyn Fn(&[Vec3]) -> Vec<f64>,
) -> TriangleMesh {
    if mesh.distance_to_points.len() != mesh.vertices.len() {
        return mesh.clone();
    }
    let far = far_regions(mesh, level);
    let cuts = Cuts::of(mesh, &far, level, distances);
    let mut trimmed = TriangleMesh {
        triangles: Vec::with_capacity(mesh.triangles.len()),
        ..mesh.clone()
    };
    for cut in &cuts.kept {
        cut.add_vertex(&mut trimmed);
    }
    let sides: Vec<Side> = far
        .iter()
        .zip(&cuts.through)
        .map(|(&far, &through)| match (far, through) {
            (true, _) => Side::Far,
            (false, true) => Side::On,
            (false, false) => Side::Near,
        })
        .collect();
    let on_far_side = flat_beyond(mesh, &sides, level, distances);
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        if on_far_side.binary_search(&t).is_ok() {
            continue;
        }
        near_part(*triangle, &sides, &cuts, &mut trimmed);
    }
    split_fans(&mut trimmed, &cuts.through);
    trimmed.drop_unused_vertices();
    trimmed
}

/// Where a vertex is, seen from the level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Near,
    /// The cut goes through it.
    On,
    Far,
}

/// Whether each vertex belongs to a region beyond `level` that is large enough to be cut out.
fn far_regions(mesh: &TriangleMesh, level: f64) -> Vec<bool> {
    let mut far: Vec<bool> = mesh.distance_to_points.iter().map(|d| *d > level).collect();
    let mut regions = DisjointSets::new(far.len());
    for [a, b, c] in &mesh.triangles {
        for (a, b) in [(*a, *b), (*b, *c), (*c, *a)] {
            if far[a as usize] && far[b as usize] {
                regions.unite(a, b);
            }
        }
    }
    let mut members: Vec<(u32, u32)> = (0..far.len() as u32)
        .filter(|v| far[*v as usize])
        .map(|v| (regions.find(v), v))
        .collect();
    members.sort_unstable();
    for region in members.chunk_by(|a, b| a.0 == b.0) {
        let places = region.iter().map(|(_, v)| &mesh.vertices[*v as usize]);
        if Bounds::of(places).is_none_or(|bounds| bounds.diagonal() <= level) {
            for (_, v) in region {
                far[*v as usize] = false;
            }
        }
    }
    far
}

/// A new vertex on an edge.
struct Cut {
    near: u32,
    far: u32,
    /// Where on the way from the near end to the far end, 0 to 1.
    share: f64,
    /// Distance from the points there.
    distance: f64,
}

impl Cut {
    fn place(&self, mesh: &TriangleMesh, share: f64) -> Vec3 {
        let [near, far] = [self.near, self.far].map(|v| mesh.vertices[v as usize]);
        along(near, share, sub(far, near))
    }

    fn add_vertex(&self, mesh: &mut TriangleMesh) {
        mesh.vertices.push(self.place(mesh, self.share));
        mesh.distance_to_points.push(self.distance);
        if let (Some(&near), Some(&far)) = (
            mesh.normals.get(self.near as usize),
            mesh.normals.get(self.far as usize),
        ) {
            let mixed = add(scale(near, 1.0 - self.share), scale(far, self.share));
            mesh.normals.push(normalized(mixed).unwrap_or(near));
        }
    }
}

/// Where the edges across the level are cut.
struct Cuts {
    /// Those that get a vertex, sorted by their ends.
    kept: Vec<Cut>,
    /// Number of vertices before them.
    before: usize,
    /// Vertices that the cut goes through.
    through: Vec<bool>,
}

impl Cuts {
    fn of(
        mesh: &TriangleMesh,
        far: &[bool],
        level: f64,
        distances: &dyn Fn(&[Vec3]) -> Vec<f64>,
    ) -> Self {
        let mut edges: Vec<(u32, u32)> = mesh
            .triangles
            .iter()
            .flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)])
            .filter_map(|(a, b)| match (far[a as usize], far[b as usize]) {
                (false, true) => Some((a, b)),
                (true, false) => Some((b, a)),
                _ => None,
            })
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let mut cuts = place_cuts(mesh, &edges, level, distances);
        let mut through = vec![false; far.len()];
        for cut in cuts.iter().filter(|cut| cut.share < SNAP) {
            through[cut.near as usize] = true;
        }
        cuts.retain(|cut| !through[cut.near as usize]);
        Self {
            kept: cuts,
            before: far.len(),
            through,
        }
    }

    /// The new vertex on an edge.
    fn vertex(&self, near: u32, far: u32) -> Option<u32> {
        let found = self
            .kept
            .binary_search_by_key(&(near, far), |cut| (cut.near, cut.far))
            .ok()?;
        Some((self.before + found) as u32)
    }
}

/// The furthest place on each edge, from its near end, that is known to be within `level`: by linear
/// interpolation, or by halving where the distance is not linear along the edge.
fn place_cuts(
    mesh: &TriangleMesh,
    edges: &[(u32, u32)],
    level: f64,
    distances: &dyn Fn(&[Vec3]) -> Vec<f64>,
) -> Vec<Cut> {
    let mut cuts: Vec<Cut> = Vec::with_capacity(edges.len());
    let mut beyond: Vec<f64> = Vec::with_capacity(edges.len());
    for &(near, far) in edges {
        let [from, to] = [near, far].map(|v| mesh.distance_to_points[v as usize]);
        // A far neighbour of a vertex beyond the level would be of the same region: `from` is within it.
        let share = ((level - from) / (to - from)).clamp(0.0, 1.0 - SNAP);
        cuts.push(Cut {
            near,
            far,
            share: 0.0,
            distance: from,
        });
        beyond.push(share);
    }
    for halving in 0..=HALVINGS {
        let trial = |(cut, beyond): (&Cut, &f64)| {
            if halving == 0 {
                *beyond
            } else {
                0.5 * (cut.share + beyond)
            }
        };
        let shares: Vec<f64> = cuts.iter().zip(&beyond).map(trial).collect();
        let places: Vec<Vec3> = cuts
            .iter()
            .zip(&shares)
            .map(|(cut, share)| cut.place(mesh, *share))
            .collect();
        let found = distances(&places);
        for (((cut, beyond), share), found) in
            cuts.iter_mut().zip(&mut beyond).zip(shares).zip(found)
        {
            if found <= level {
                cut.share = share;
                cut.distance = found;
            } else {
                *beyond = share;
            }
        }
    }
    cuts
}

/// Triangles between vertices that the cut goes through whose middle is beyond `level`: their corners do not tell
/// on which side they are.
fn flat_beyond(
    mesh: &TriangleMesh,
    sides: &[Side],
    level: f64,
    distances: &dyn Fn(&[Vec3]) -> Vec<f64>,
) -> Vec<usize> {
    let on = |t: &usize| {
        let corners = mesh.triangles[*t];
        corners.iter().all(|v| sides[*v as usize] == Side::On)
    };
    let flat: Vec<usize> = (0..mesh.triangles.len()).filter(on).collect();
    let middle = |t: &usize| {
        let [a, b, c] = mesh.corners(*t);
        scale(add(add(a, b), c), 1.0 / 3.0)
    };
    let middles: Vec<Vec3> = flat.iter().map(middle).collect();
    let measured = flat.into_iter().zip(distances(&middles));
    measured
        .filter(|(_, distance)| *distance > level)
        .map(|(t, _)| t)
        .collect()
}

/// Adds the part of a triangle on the near side to `trimmed`, turned as the triangle is.
fn near_part(triangle: [u32; 3], sides: &[Side], cuts: &Cuts, trimmed: &mut TriangleMesh) {
    let at = triangle.map(|v| sides[v as usize]);
    if at.contains(&Side::Far) && !at.contains(&Side::Near) {
        return;
    }
    let mut outline: Vec<u32> = Vec::with_capacity(4);
    for k in 0..3 {
        let [a, b] = [triangle[k], triangle[(k + 1) % 3]];
        if at[k] != Side::Far {
            outline.push(a);
        }
        match (at[k], at[(k + 1) % 3]) {
            (Side::Near, Side::Far) => outline.extend(cuts.vertex(a, b)),
            (Side::Far, Side::Near) => outline.extend(cuts.vertex(b, a)),
            _ => {}
        }
    }
    match outline[..] {
        [a, b, c] => trimmed.triangles.push([a, b, c]),
        [a, b, c, d] => {
            let place = |v: u32| trimmed.vertices[v as usize];
            let length = |a, b| distance(place(a), place(b));
            // The shorter diagonal makes the better triangles.
            let halves = if length(a, c) <= length(b, d) {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, b, d], [b, c, d]]
            };
            trimmed.triangles.extend(halves);
        }
        _ => {}
    }
}

/// Gives each fan of triangles around a vertex of `through` a vertex of its own: parts that touch in one point
/// only are apart, and no boundary runs through a vertex twice.
fn split_fans(mesh: &mut TriangleMesh, through: &[bool]) {
    // The vertex, another vertex of the triangle, and the corner at the vertex.
    let mut spokes: Vec<(u32, u32, u32)> = Vec::new();
    for (triangle, first) in mesh.triangles.iter().zip((0u32..).step_by(3)) {
        for k in 0..3 {
            let [v, after, before] = [0, 1, 2].map(|i| triangle[(k + i) % 3]);
            if through.get(v as usize) == Some(&true) {
                spokes.extend([after, before].map(|other| (v, other, first + k as u32)));
            }
        }
    }
    spokes.sort_unstable();
    let mut fans = DisjointSets::new(3 * mesh.triangles.len());
    for pair in spokes.windows(2) {
        if (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1) {
            fans.unite(pair[0].2, pair[1].2);
        }
    }
    for around in spokes.chunk_by(|a, b| a.0 == b.0) {
        let mut corners: Vec<(u32, u32)> = around
            .iter()
            .map(|(_, _, corner)| (fans.find(*corner), *corner))
            .collect();
        corners.sort_unstable();
        // The first fan keeps the vertex.
        for fan in corners.chunk_by(|a, b| a.0 == b.0).skip(1) {
            let copy = duplicate(mesh, around[0].0 as usize);
            for (_, corner) in fan {
                mesh.triangles[*corner as usize / 3][*corner as usize % 3] = copy;
            }
        }
    }
}

fn duplicate(mesh: &mut TriangleMesh, vertex: usize) -> u32 {
    let copy = mesh.vertices.len() as u32;
    mesh.vertices.push(mesh.vertices[vertex]);
    mesh.distance_to_points
        .push(mesh.distance_to_points[vertex]);
    if let Some(&normal) = mesh.normals.get(vertex) {
        mesh.normals.push(normal);
    }
    copy
}
