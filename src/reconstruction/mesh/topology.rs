//! What a mesh is as a surface: pieces, borders, orientation, genus.
//!
//! Everything follows from the indices alone: vertices at the same place with different indices
//! are different vertices. Edges are found by sorting, which needs no hashing and gives the same
//! order on every machine; a part of them at a time, so that large meshes take little memory.

use std::borrow::Cow;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::TriangleMesh;

/// What a mesh is as a surface.
///
/// Triangles that name a vertex twice count as degenerate and take no part in the rest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Topology {
    /// Pieces that share no vertex.
    pub components: usize,
    /// Every edge belongs to exactly two triangles.
    pub closed: bool,
    /// No edge belongs to more than two triangles, and the triangles around each vertex form one
    /// disk, or one half-disk on the border.
    pub manifold: bool,
    /// No two triangles run along an edge in the same direction.
    pub oriented: bool,
    /// Edges of one triangle only.
    pub boundary_edges: usize,
    /// Edges of more than two triangles.
    pub non_manifold_edges: usize,
    /// Vertices around which the triangles form more than one fan.
    pub non_manifold_vertices: usize,
    /// Triangles without area.
    pub degenerate_triangles: usize,
    /// Vertices - edges + triangles; vertices without a triangle do not count.
    pub euler_characteristic: i64,
    /// Number of handles, all components together; only for a closed, oriented manifold.
    pub genus: Option<i64>,
}

impl Topology {
    /// The topology of `mesh`.
    ///
    /// # Cost
    /// Sorts the 3 n half-edges, and takes 12 bytes for each triangle and 50 MB at most besides.
    pub fn of(mesh: &TriangleMesh) -> Self {
        let triangles = without_repeated_vertices(&mesh.triangles);
        let (_, components) = components_of(&triangles, mesh.vertices.len());
        let mut fans = Fans::new(&triangles);
        let mut edges = Edges::new();
        for_each_edge(&triangles, mesh.vertices.len(), |edge| {
            edges.add(edge, &triangles);
            fans.join(edge);
        });
        let fans_at = fans.at(mesh.vertices.len());
        let vertices = fans_at.iter().filter(|&&n| n > 0).count();
        let non_manifold_vertices = fans_at.iter().filter(|&&n| n > 1).count();

        let closed = !triangles.is_empty() && edges.boundary == 0 && edges.non_manifold == 0;
        let manifold = edges.non_manifold == 0 && non_manifold_vertices == 0;
        let euler_characteristic = vertices as i64 - edges.distinct as i64 + triangles.len() as i64;
        Self {
            components,
            closed,
            manifold,
            oriented: edges.oriented,
            boundary_edges: edges.boundary,
            non_manifold_edges: edges.non_manifold,
            non_manifold_vertices,
            degenerate_triangles: (0..mesh.triangles.len())
                .into_par_iter()
                .filter(|&t| mesh.triangle_area(t) <= 0.0)
                .count(),
            euler_characteristic,
            // χ = 2 - 2g on each component.
            genus: (closed && manifold && edges.oriented)
                .then(|| (2 * components as i64 - euler_characteristic) / 2),
        }
    }
}

/// Component of each triangle, and their number. Triangles that share a vertex are in the same
/// component; components are numbered in the order of their first triangle.
pub fn components(mesh: &TriangleMesh) -> (Vec<u32>, usize) {
    components_of(&mesh.triangles, mesh.vertices.len())
}

/// Vertices of edges with more than two triangles, or with two that run along them in the same direction, and
/// vertices with more than one fan; sorted.
pub(super) fn irregular_vertices(triangles: &[[u32; 3]], vertices: usize) -> Vec<u32> {
    let mut irregular = Vec::new();
    let mut fans = Fans::new(triangles);
    for_each_edge(triangles, vertices, |edge| {
        fans.join(edge);
        if edge.len() > 2 || !consistent(triangles, edge) {
            let ends = edge[0].ends;
            irregular.extend([(ends >> 32) as u32, ends as u32]);
        }
    });
    let fans_at = (0..).zip(fans.at(vertices));
    irregular.extend(fans_at.filter(|(_, n)| *n > 1).map(|(v, _)| v));
    irregular.sort_unstable();
    irregular.dedup();
    irregular
}

fn components_of(triangles: &[[u32; 3]], vertices: usize) -> (Vec<u32>, usize) {
    let mut pieces = DisjointSets::new(vertices);
    for [a, b, c] in triangles {
        pieces.unite(*a, *b);
        pieces.unite(*a, *c);
    }
    let mut numbers = vec![None; vertices];
    let mut count = 0;
    let ids = triangles
        .iter()
        .map(|triangle| {
            let number = &mut numbers[pieces.find(triangle[0]) as usize];
            *number.get_or_insert_with(|| {
                count += 1;
                count - 1
            })
        })
        .collect();
    (ids, count as usize)
}

fn without_repeated_vertices(triangles: &[[u32; 3]]) -> Cow<'_, [[u32; 3]]> {
    let proper = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
    if triangles.iter().all(proper) {
        Cow::Borrowed(triangles)
    } else {
        Cow::Owned(triangles.iter().copied().filter(proper).collect())
    }
}

/// One side of one triangle; corner `3 t + k` is where it starts.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    /// Both ends, the smaller one in the upper half.
    ends: u64,
    corner: u32,
}

/// Half-edges that are sorted at a time: 64 MB.
const SORTED: usize = 1 << 22;

/// Calls `each` with the half-edges of every edge, sorted; edges in the order of their ends.
fn for_each_edge(triangles: &[[u32; 3]], vertices: usize, mut each: impl FnMut(&[HalfEdge])) {
    let parts = (3 * triangles.len()).div_ceil(SORTED).max(1);
    let mut sorted = Vec::new();
    for part in 0..parts {
        // Edges belong to the part of their smaller end.
        let [first, end] = [part, part + 1].map(|part| (vertices * part / parts) as u64);
        sorted.clear();
        sorted.par_extend(half_edges(triangles).filter(|half| {
            let smaller = half.ends >> 32;
            first <= smaller && smaller < end
        }));
        sorted.par_sort_unstable();
        for edge in sorted.chunk_by(|a, b| a.ends == b.ends) {
            each(edge);
        }
    }
}

fn half_edges(triangles: &[[u32; 3]]) -> impl ParallelIterator<Item = HalfEdge> {
    let numbered = triangles.par_iter().enumerate();
    numbered.flat_map_iter(|(t, triangle)| {
        (0..3).map(move |k| {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            HalfEdge {
                ends: u64::from(a.min(b)) << 32 | u64::from(a.max(b)),
                corner: (3 * t + k) as u32,
            }
        })
    })
}

/// What counting the edges tells.
struct Edges {
    distinct: usize,
    boundary: usize,
    non_manifold: usize,
    oriented: bool,
}

impl Edges {
    fn new() -> Self {
        Self {
            distinct: 0,
            boundary: 0,
            non_manifold: 0,
            oriented: true,
        }
    }

    fn add(&mut self, edge: &[HalfEdge], triangles: &[[u32; 3]]) {
        self.distinct += 1;
        self.boundary += usize::from(edge.len() == 1);
        self.non_manifold += usize::from(edge.len() > 2);
        self.oriented &= consistent(triangles, edge);
    }
}

/// The fans around vertices, as sets of corners: two corners at a vertex are in the same fan when their triangles
/// share an edge there.
struct Fans<'a> {
    triangles: &'a [[u32; 3]],
    sets: DisjointSets,
}

impl<'a> Fans<'a> {
    fn new(triangles: &'a [[u32; 3]]) -> Self {
        Self {
            triangles,
            sets: DisjointSets::new(3 * triangles.len()),
        }
    }

    /// Joins the corners at both ends of an edge.
    fn join(&mut self, edge: &[HalfEdge]) {
        for pair in edge.windows(2) {
            let [a, b] = [pair[0].corner, pair[1].corner];
            if start(self.triangles, a) == start(self.triangles, b) {
                self.sets.unite(a, b);
                self.sets.unite(next(a), next(b));
            } else {
                self.sets.unite(a, next(b));
                self.sets.unite(next(a), b);
            }
        }
    }

    /// Number of fans at each of so many vertices.
    fn at(mut self, vertices: usize) -> Vec<u32> {
        let mut fans_at = vec![0u32; vertices];
        for corner in 0..3 * self.triangles.len() as u32 {
            if self.sets.find(corner) == corner {
                fans_at[start(self.triangles, corner) as usize] += 1;
            }
        }
        fans_at
    }
}

/// Whether no two triangles run along an edge in the same direction.
fn consistent(triangles: &[[u32; 3]], edge: &[HalfEdge]) -> bool {
    let upwards = edge
        .iter()
        .filter(|half| start(triangles, half.corner) == (half.ends >> 32) as u32)
        .count();
    upwards <= 1 && edge.len() - upwards <= 1
}

/// Vertex at a corner.
fn start(triangles: &[[u32; 3]], corner: u32) -> u32 {
    triangles[corner as usize / 3][corner as usize % 3]
}

/// The following corner of the same triangle.
fn next(corner: u32) -> u32 {
    if corner % 3 == 2 {
        corner - 2
    } else {
        corner + 1
    }
}

/// A forest in which the smallest member stands for its set.
pub(super) struct DisjointSets {
    parents: Vec<u32>,
}

impl DisjointSets {
    pub(super) fn new(members: usize) -> Self {
        Self {
            parents: (0..members as u32).collect(),
        }
    }

    pub(super) fn find(&mut self, mut member: u32) -> u32 {
        while self.parents[member as usize] != member {
            let grandparent = self.parents[self.parents[member as usize] as usize];
            self.parents[member as usize] = grandparent;
            member = grandparent;
        }
        member
    }

    pub(super) fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    #[test]
    fn edges_come_in_parts_whole_and_in_order() {
        // A strip of triangles with more half-edges than are sorted at a time.
        let count = SORTED as u32 / 2;
        let strip: Vec<[u32; 3]> = (0..count).map(|i| [i, i + 1, i + 2]).collect();
        let (mut edges, mut halves, mut last) = (0, 0, 0);
        for_each_edge(&strip, count as usize + 2, |edge| {
            assert!(edge.iter().all(|half| half.ends == edge[0].ends));
            assert!(edges == 0 || edge[0].ends > last);
            last = edge[0].ends;
            edges += 1;
            halves += edge.len();
        });
        assert_eq!((edges, halves), (2 * count + 1, 3 * count as usize));
    }

    #[test]
    fn a_manifold_has_no_irregular_vertices() {
        assert!(irregular_vertices(&TETRAHEDRON, 4).is_empty());
        assert!(irregular_vertices(&TETRAHEDRON[1..], 4).is_empty());
        assert!(irregular_vertices(&[], 4).is_empty());
    }

    #[test]
    fn irregular_vertices_are_those_of_too_many_triangles_turned_ones_and_several_fans() {
        let with = |more: &[[u32; 3]]| [&TETRAHEDRON, more].concat();
        assert_eq!(irregular_vertices(&with(&[[0, 1, 4]]), 5), [0, 1]);
        assert_eq!(irregular_vertices(&with(&[[3, 4, 5]]), 6), [3]);
        let mut turned = TETRAHEDRON;
        turned[0] = [0, 1, 2];
        assert_eq!(irregular_vertices(&turned, 4), [0, 1, 2]);
    }
}
