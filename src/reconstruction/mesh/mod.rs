//! Triangle meshes: topology, measures, distances, and the formats they are written to.

use super::vector::Vec3;

/// A triangle mesh with shared vertices.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions.
    pub vertices: Vec<Vec3>,
    /// One unit normal a vertex, pointing outwards; empty when there are none.
    pub normals: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}
