//! Wavefront OBJ: `v`, `vn` and `f`; everything else is passed over.

use super::{Face, position};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::obj::space;
use crate::reconstruction::cloud::text::{Line, Lines, excerpt};
use crate::reconstruction::mesh::TriangleMesh;

pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh, Error> {
    let mut mesh = TriangleMesh {
        space: space(bytes),
        ..TriangleMesh::default()
    };
    // OBJ gives normals to corners; they belong to vertices only where the two are numbered alike.
    let mut normals_follow_vertices = true;
    let mut faces = 0;
    for line in Lines::new(bytes, 0).joined().content() {
        let mut tokens = line.tokens();
        match tokens.next() {
            Some(b"v") => {
                let point = line.vector(&mut tokens)?;
                mesh.vertices.push(position(point, line.number)?);
            }
            Some(b"vn") => mesh.normals.push(line.vector(&mut tokens)?),
            Some(b"f") => {
                faces += 1;
                let mut face = Face::new(faces, line.number);
                for token in tokens {
                    let mut references = token.split(|&b| b == b'/');
                    let vertex = references.next().unwrap_or_default();
                    let vertex = index(vertex, mesh.vertices.len(), line)?;
                    face.push(vertex, mesh.vertices.len())?;
                    if let Some(normal) = references.nth(1) {
                        let normal = index(normal, mesh.normals.len(), line)?;
                        normals_follow_vertices &= normal.total_cmp(&vertex).is_eq();
                    }
                }
                face.triangulate(&mut mesh.triangles)?;
            }
            _ => {}
        }
    }
    if !normals_follow_vertices || mesh.normals.len() != mesh.vertices.len() {
        mesh.normals.clear();
    }
    Ok(mesh)
}

/// A reference, which counts from 1, or backwards from the last with a minus sign, as an index
/// from 0.
fn index(token: &[u8], count: usize, line: Line<'_>) -> Result<f64, Error> {
    let text = std::str::from_utf8(token).ok();
    let reference: Option<i64> = text.and_then(|text| text.parse().ok());
    let found = || line.error(format!("expected an index, found \"{}\"", excerpt(token)));
    let reference = reference.ok_or_else(found)?;
    Ok(if reference < 0 {
        count as f64 + reference as f64
    } else {
        reference as f64 - 1.0
    })
}
