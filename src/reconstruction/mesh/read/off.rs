//! Geomview OFF as text, with any of its prefixes for normals, colours and texture coordinates.

use super::{Face, position};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::off::{Header, complete};
use crate::reconstruction::cloud::text::{Line, Lines};
use crate::reconstruction::mesh::TriangleMesh;

pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh, Error> {
    let mut lines = Lines::new(bytes, 0).content();
    let header = Header::read(&mut lines)?;
    let mut mesh = TriangleMesh::default();
    for line in lines.by_ref().take(header.vertices) {
        let (point, normal) = header.vertex(line)?;
        mesh.vertices.push(position(point, line.number)?);
        if header.normals {
            mesh.normals.push(normal);
        }
    }
    complete("the list of vertices", header.vertices, mesh.vertices.len())?;
    let mut faces = 0;
    for line in lines.take(header.faces) {
        faces += 1;
        let face = face(line, faces, mesh.vertices.len())?;
        face.triangulate(&mut mesh.triangles)?;
    }
    complete("the list of faces", header.faces, faces)?;
    Ok(mesh)
}

/// The number of corners and the corners; a colour may follow.
fn face(line: Line<'_>, number: usize, vertices: usize) -> Result<Face, Error> {
    let mut face = Face::new(number, line.number);
    let mut numbers = line.tokens().map(|token| line.number(token));
    let mut next = || {
        let missing = || Err(line.error("a number is missing at the end"));
        numbers.next().unwrap_or_else(missing)
    };
    let corners = next()?;
    if corners < 0.0 || corners.fract() != 0.0 {
        return Err(line.error(format!("{corners} is not a number of corners")));
    }
    for _ in 0..corners as u64 {
        face.push(next()?, vertices)?;
    }
    Ok(face)
}
