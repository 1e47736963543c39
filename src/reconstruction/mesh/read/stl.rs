//! STL, binary and text. It has no shared vertices: corners at the very same place become one.

use std::collections::HashMap;

use super::{position, row, vector};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::vector::Vec3;

const TITLE_BYTES: usize = 80;
const TRIANGLE_BYTES: usize = 50;

/// Whether the length is what the count behind the title says. The first word does not tell: some
/// binary files begin with `solid` as well.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    let count = bytes[TITLE_BYTES.min(bytes.len())..].first_chunk();
    count.is_some_and(|&count| {
        let length = u64::from(u32::from_le_bytes(count)) * TRIANGLE_BYTES as u64;
        bytes.len() as u64 == TITLE_BYTES as u64 + 4 + length
    })
}

/// Whether the text begins as STL.
pub(super) fn is_text(text: &str) -> bool {
    text.trim_start().starts_with("solid")
}

pub(super) fn read_binary(bytes: &[u8]) -> Result<TriangleMesh, Error> {
    let mut merged = Merged::default();
    let triangles = bytes[TITLE_BYTES + 4..].chunks_exact(TRIANGLE_BYTES);
    for (i, triangle) in triangles.enumerate() {
        let mut numbers = triangle
            .as_chunks::<4>()
            .0
            .iter()
            .map(|&bytes| f64::from(f32::from_le_bytes(bytes)));
        // The facet normal stands first.
        for _ in 0..3 {
            numbers.next();
        }
        for _ in 0..3 {
            let corner = std::array::from_fn(|_| numbers.next().unwrap_or_default());
            merged.push(position(corner, i + 1)?);
        }
    }
    Ok(merged.mesh())
}

pub(super) fn read_text(text: &str) -> Result<TriangleMesh, Error> {
    let mut merged = Merged::default();
    for (i, content) in text.lines().enumerate() {
        let line = i + 1;
        let mut words = content.split_ascii_whitespace();
        match words.next() {
            Some("vertex") => merged.push(position(vector(&mut words, line)?, line)?),
            Some("endloop") if merged.corners.len() % 3 != 0 => {
                return Err(row(line, "a facet has not 3 vertices"));
            }
            _ => {}
        }
    }
    if merged.corners.len() % 3 != 0 {
        return Err(Error::Truncated {
            what: "the last facet".into(),
            declared: 3,
            found: merged.corners.len() as u64 % 3,
        });
    }
    Ok(merged.mesh())
}

/// Corners of triangles, equal ones under one index, numbered as they come.
#[derive(Default)]
struct Merged {
    indices: HashMap<[u64; 3], u32>,
    vertices: Vec<Vec3>,
    corners: Vec<u32>,
}

impl Merged {
    fn push(&mut self, corner: Vec3) {
        // Adding zero makes -0 and 0 the same.
        let corner = corner.map(|v| v + 0.0);
        let index = *self
            .indices
            .entry(corner.map(f64::to_bits))
            .or_insert_with(|| {
                self.vertices.push(corner);
                (self.vertices.len() - 1) as u32
            });
        self.corners.push(index);
    }

    fn mesh(self) -> TriangleMesh {
        TriangleMesh {
            vertices: self.vertices,
            normals: Vec::new(),
            triangles: self.corners.as_chunks().0.to_vec(),
        }
    }
}
