//! Wavefront OBJ; indices count from 1.

use std::io::{self, Write};

use super::{fits_f32, has_normals, to_f32, write_text};
use crate::reconstruction::mesh::TriangleMesh;

pub(super) fn write(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "# Meshway")?;
    for tag in mesh.space.tags() {
        writeln!(out, "# {tag}")?;
    }
    let short = fits_f32(mesh);
    for &vertex in &mesh.vertices {
        out.write_all(b"v ")?;
        if short {
            write_text(to_f32(vertex), out)?;
        } else {
            write_text(vertex, out)?;
        }
        out.write_all(b"\n")?;
    }
    let normals = has_normals(mesh);
    if normals {
        for &normal in &mesh.normals {
            out.write_all(b"vn ")?;
            write_text(to_f32(normal), out)?;
            out.write_all(b"\n")?;
        }
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| u64::from(v) + 1);
        if normals {
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")?;
        } else {
            writeln!(out, "f {a} {b} {c}")?;
        }
    }
    Ok(())
}
