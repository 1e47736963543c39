//! Fewer triangles for the same surface: edges are collapsed where that moves it least.
//!
//! The collapses are those of meshoptimizer, by quadric errors. These are no distances, and its rules do not keep
//! every mesh manifold. So each of its results is measured and checked here. Where one is wrong, vertices are kept
//! that it lost, or less is collapsed, and all is done again.

mod check;
mod crossings;
mod search;

use meshopt::{SimplifyOptions, simplify_with_locks_decoder};

use super::{SurfaceTree, Topology, TriangleMesh};
use crate::reconstruction::error::Error;
use crate::reconstruction::vector::{scale, sub};
use search::Search;

/// Below this share of the edge of the box around the mesh, quadric errors in single precision are noise.
const NOISE: f64 = 5e-4;

/// Triangles of any shape start from a mesh of even ones with so many times as many as even ones need, and with this
/// share of the error.
const START_TRIANGLES: usize = 4;
const START_ERROR: f64 = 0.5;

/// What a simplified mesh is to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Number of triangles to come down to.
    pub triangles: usize,
    /// Furthest that the surface may move, in units of the mesh; goes before the number of triangles.
    pub error: f64,
}

/// A mesh with fewer triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct Simplified {
    /// It has some of the vertices, with all that belongs to them.
    pub mesh: TriangleMesh,
    /// How far the two surfaces are apart at most: from every old vertex to the new surface, and from the middle of
    /// every new triangle and of its sides to the old one.
    pub error: f64,
}

/// Simplifies `mesh` as far as `limits` allow, or not at all where nothing that they allow is sound.
///
/// What is closed, manifold and oriented stays so, with the same components and handles; no triangle turns over, or
/// runs through another, that did not before.
///
/// # Errors
/// [`Error::Cancelled`] when `stopped` says so.
///
/// # Determinism
/// The same mesh and limits give the same result, bit for bit, whatever the number of threads.
///
/// # Cost
/// A few seconds for each million triangles: some rounds of collapsing and measuring all of them.
pub fn simplify(
    mesh: TriangleMesh,
    limits: Limits,
    stopped: &dyn Fn() -> bool,
) -> Result<Simplified, Error> {
    let simplest = match Original::new(&mesh) {
        Some(original) if mesh.triangles.len() > limits.triangles && limits.error > 0.0 => {
            original.simplest(limits, stopped)?
        }
        _ => None,
    };
    Ok(match simplest {
        Some(Found { part, error }) => Simplified {
            mesh: part.mesh,
            error,
        },
        None => Simplified { mesh, error: 0.0 },
    })
}

/// What the triangles are to look like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shapes {
    /// Alike in length and breadth: errors count a little more where triangles become large.
    Even,
    /// As they come.
    Any,
}

/// The mesh to be simplified, and what is asked of it again and again.
struct Original<'a> {
    mesh: &'a TriangleMesh,
    topology: Topology,
    tree: SurfaceTree,
    /// Its vertices in a box of edge 1.
    positions: Vec<[f32; 3]>,
    /// Edge of that box.
    edge: f64,
}

/// A mesh with some vertices of the original.
struct Part {
    mesh: TriangleMesh,
    /// Which vertices of the original its vertices are.
    origins: Vec<u32>,
}

impl Part {
    /// The vertices of the original at the corners of a triangle.
    fn corners(&self, triangle: usize) -> [u32; 3] {
        self.mesh.triangles[triangle].map(|v| self.origins[v as usize])
    }

    fn triangles(&self) -> Vec<[u32; 3]> {
        let all = 0..self.mesh.triangles.len();
        all.map(|triangle| self.corners(triangle)).collect()
    }
}

/// A sound part, and how far it is from the original.
struct Found {
    part: Part,
    error: f64,
}

impl<'a> Original<'a> {
    /// None where no triangle has an area.
    fn new(mesh: &'a TriangleMesh) -> Option<Self> {
        let tree = SurfaceTree::new(mesh)?;
        let bounds = mesh.bounds()?;
        let (centre, edge) = (bounds.centre(), bounds.longest_edge());
        let in_box = |v| scale(sub(v, centre), 1.0 / edge).map(|x| x as f32);
        Some(Self {
            mesh,
            topology: Topology::of(mesh),
            tree,
            positions: mesh.vertices.iter().map(|v| in_box(*v)).collect(),
            edge,
        })
    }

    /// The simplest sound mesh that is found; none where none is.
    ///
    /// Even triangles come first: they fold less, also where errors are so small that they drown in the noise of
    /// single precision. Others need about half as many for the same error, and fold less where they come from even
    /// ones.
    fn simplest(&self, limits: Limits, stopped: &dyn Fn() -> bool) -> Result<Option<Found>, Error> {
        let all = &self.mesh.triangles;
        let even = |limits| Search::new(self, limits, Shapes::Even).run(all, stopped);
        let count = |found: &Found| found.part.mesh.triangles.len();
        let Some(found) = even(limits)? else {
            return Ok(None);
        };
        if count(&found) <= limits.triangles || limits.error < NOISE * self.edge {
            return Ok(Some(found));
        }
        let start = even(Limits {
            triangles: START_TRIANGLES * count(&found),
            error: START_ERROR * limits.error,
        })?;
        let start = start.map_or_else(|| all.clone(), |start| start.part.triangles());
        let any = Search::new(self, limits, Shapes::Any).run(&start, stopped)?;
        Ok([Some(found), any].into_iter().flatten().min_by_key(count))
    }

    /// Collapses edges of `triangles`, which is all of the original or a part, until so many are left as `limits`
    /// say, or until the next collapse would err by more, as meshoptimizer counts it. The vertices that are `kept`
    /// stay. With the result comes the largest error of a collapse.
    fn collapsed(
        &self,
        triangles: &[[u32; 3]],
        (limits, shapes): (Limits, Shapes),
        kept: &[bool],
    ) -> (Part, f64) {
        let mut reached = 0.0;
        let indices = simplify_with_locks_decoder(
            triangles.as_flattened(),
            &self.positions,
            kept,
            3 * limits.triangles.min(triangles.len()),
            (limits.error / self.edge) as f32,
            match shapes {
                Shapes::Even => SimplifyOptions::RegularizeLight,
                Shapes::Any => SimplifyOptions::None,
            },
            Some(&mut reached),
        );
        let (mesh, origins) = self.mesh.part(indices.as_chunks().0.to_vec());
        (Part { mesh, origins }, f64::from(reached) * self.edge)
    }
}
