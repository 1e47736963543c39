//! Triangle meshes: topology, measures, distances, and the formats they are written to.
//!
//! The types here hold what the surface made or a file gave; nothing in this room repairs a mesh.

mod distance;
mod measures;
pub mod read;
mod simplify;
mod topology;
mod trim;
pub mod write;

use super::vector::Vec3;

pub use distance::{
    Closest, Distances, PointTree, SurfacePoint, SurfaceTree, TRIANGLES_INDEXED, closest_to_each,
    sample_surface,
};
pub use simplify::{Limits, Simplified, simplify};
pub use topology::{Topology, components};
pub use trim::trim;

/// Name in PLY files of [`TriangleMesh::distance_to_points`].
const PLY_DISTANCE: &str = "distance_to_points";

/// A triangle mesh with shared vertices.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions.
    pub vertices: Vec<Vec3>,
    /// One unit normal a vertex, pointing outwards; empty when there are none.
    pub normals: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from outside; each below the number of vertices.
    pub triangles: Vec<[u32; 3]>,
    /// Distance from each vertex to the nearest surface point of the cloud that the mesh was made of, in units
    /// of the input: small where the surface was measured. Empty where there is no cloud. Of the formats, PLY
    /// alone has it, as the property `distance_to_points`.
    pub distance_to_points: Vec<f64>,
}
