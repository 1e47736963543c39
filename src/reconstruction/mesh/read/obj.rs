//! Wavefront OBJ: `v`, `vn` and `f`; everything else is passed over.

use super::{Face, excerpt, lines, position, row, vector};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::mesh::TriangleMesh;

/// Whether the first line that is no comment is one of OBJ.
pub(super) fn is_obj(text: &str) -> bool {
    const KEYWORDS: [&str; 8] = ["v", "vn", "vt", "f", "o", "g", "mtllib", "usemtl"];
    lines(text)
        .next()
        .and_then(|(_, line)| line.split_ascii_whitespace().next())
        .is_some_and(|word| KEYWORDS.contains(&word))
}

pub(super) fn read(text: &str) -> Result<TriangleMesh, Error> {
    let mut mesh = TriangleMesh::default();
    // OBJ gives normals to corners; they belong to vertices only where the two are numbered alike.
    let mut normals_follow_vertices = true;
    let mut faces = 0;
    for (line, content) in lines(text) {
        let mut words = content.split_ascii_whitespace();
        match words.next() {
            Some("v") => mesh
                .vertices
                .push(position(vector(&mut words, line)?, line)?),
            Some("vn") => mesh.normals.push(vector(&mut words, line)?),
            Some("f") => {
                faces += 1;
                let mut face = Face {
                    number: faces,
                    line,
                    corners: Vec::new(),
                };
                for word in words {
                    let mut references = word.split('/');
                    let vertex = index(references.next(), mesh.vertices.len(), line)?;
                    face.push(vertex, mesh.vertices.len())?;
                    if let Some(normal) = references.nth(1) {
                        let normal = index(Some(normal), mesh.normals.len(), line)?;
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
fn index(word: Option<&str>, count: usize, line: usize) -> Result<f64, Error> {
    let word = word.unwrap_or_default();
    let reference: i64 = word
        .parse()
        .map_err(|_| row(line, format!("'{}' is not an index", excerpt(word))))?;
    Ok(if reference < 0 {
        count as f64 + reference as f64
    } else {
        reference as f64 - 1.0
    })
}
