//! STL, binary and text. It has no shared vertices: corners at the very same place become one.

use std::collections::HashMap;

use super::position;
use crate::reconstruction::cloud::{Error, stl};
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::vector::bits;

pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh, Error> {
    let mut mesh = TriangleMesh {
        space: stl::space(bytes),
        ..TriangleMesh::default()
    };
    let mut indices = HashMap::new();
    let mut corners = Vec::new();
    stl::corners(bytes, |corner, line| {
        let corner = position(corner, line)?;
        let index = *indices.entry(bits(corner)).or_insert_with(|| {
            mesh.vertices.push(corner);
            mesh.vertices.len() as u32 - 1
        });
        corners.push(index);
        Ok(())
    })?;
    mesh.triangles = corners.as_chunks().0.to_vec();
    Ok(mesh)
}
