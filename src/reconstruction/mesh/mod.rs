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

use super::space::{Frame, Space};
use super::vector::{Vec3, multiplied};

pub use distance::{
    Closest, Distances, INDEXED_TRIANGLES, PointTree, SurfacePoint, SurfaceTree, closest_to_each,
    sample_surface,
};
pub use simplify::{Limits, Simplified, simplify};
pub use topology::{Topology, components};
pub use trim::trim;

/// Name in PLY and VTP files of [`TriangleMesh::distance_to_points`].
const DISTANCE: &str = "distance_to_points";

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
    /// and VTP have it, as `distance_to_points`.
    pub distance_to_points: Vec<f64>,
    /// What the coordinates mean, as far as it is known.
    pub space: Space,
}

impl TriangleMesh {
    /// The mesh in another frame; none where one of the two frames is unknown. Which way the triangles face
    /// does not change: frames differ by a rotation.
    pub fn in_frame(mut self, frame: Frame) -> Option<Self> {
        if frame == self.space.frame {
            return Some(self);
        }
        let factors = self.space.frame.turn(frame)?;
        for vector in self.vertices.iter_mut().chain(&mut self.normals) {
            *vector = multiplied(*vector, factors);
        }
        self.space.frame = frame;
        Some(self)
    }
}
