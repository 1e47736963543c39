//! Binary STL: an 80-byte title, a count, and 50 bytes a triangle.

use std::io::{self, Write};

use super::{count_u32, to_f32, write_f32};
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::vector::normalized;

pub(super) fn write(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    // Not "solid": that is how the text variant begins.
    let mut title = [b' '; 80];
    title[..7].copy_from_slice(b"Meshway");
    out.write_all(&title)?;
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
