//! Binary STL: an 80-byte title, a count, and 50 bytes a triangle.

use std::io::{self, Write};

use super::{Format, count_u32, fits_f32, holds, to_f32, write_f32};
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::vector::{norm, normalized, sub};

pub(super) fn write(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    if !tells_vertices_apart(mesh) {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "the coordinates are too large for their distances: the 32 bits of STL would tear the \
             mesh; write it as ply, obj, off or glb, or move the cloud towards the origin",
        ));
    }
    // Not "solid": that is how the text variant begins.
    let mut title = "Meshway".to_owned();
    for tag in mesh.space.tags() {
        title.push(' ');
        title.push_str(&tag);
    }
    write!(out, "{title:80}")?;
    out.write_all(&count_u32(mesh.triangles.len())?.to_le_bytes())?;
    for t in 0..mesh.triangles.len() {
        // Zero where a triangle has no area: the format lets the reader find the normal then.
        let normal = normalized(mesh.area_vector(t)).unwrap_or_default();
        write_f32(to_f32(normal), out)?;
        for corner in mesh.corners(t) {
            write_f32(to_f32(corner), out)?;
        }
        out.write_all(&[0, 0])?;
    }
    Ok(())
}

/// Bytes of a file.
pub(super) fn length(mesh: &TriangleMesh) -> usize {
    84 + 50 * mesh.triangles.len()
}

/// Whether rounding to 32 bits moves vertices by little of a mean edge.
fn tells_vertices_apart(mesh: &TriangleMesh) -> bool {
    let Some(bounds) = mesh.bounds() else {
        return true;
    };
    if fits_f32(mesh) || mesh.triangles.is_empty() {
        return true;
    }
    let lengths = (0..mesh.triangles.len()).map(|t| {
        let [a, b, _] = mesh.corners(t);
        norm(sub(b, a))
    });
    let mean = lengths.sum::<f64>() / mesh.triangles.len() as f64;
    holds(Format::Stl, &bounds, mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_that_32_bits_would_tear_is_refused() {
        let mut mesh = TriangleMesh {
            vertices: vec![[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]],
            triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
            ..TriangleMesh::default()
        };
        let mut written = |offset: f64| {
            for vertex in &mut mesh.vertices {
                vertex[1] += offset;
            }
            write(&mesh, &mut Vec::new())
        };
        assert!(written(0.0).is_ok());
        // Some thousands of its size: a file like before.
        assert!(written(1_000.0).is_ok());
        let refused = written(5_400_000.0).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::InvalidInput);
        assert!(refused.to_string().contains("ply"), "{refused}");
    }
}
