//! Geomview OFF, and NOFF where there are normals.

use std::io::{self, Write};

use super::{fits_f32, has_normals, to_f32, write_text};
use crate::reconstruction::mesh::TriangleMesh;

pub(super) fn write(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    let normals = has_normals(mesh);
    let short = fits_f32(mesh);
    writeln!(out, "{}", if normals { "NOFF" } else { "OFF" })?;
    // The number of edges is never read.
    writeln!(out, "{} {} 0", mesh.vertices.len(), mesh.triangles.len())?;
    for (i, &vertex) in mesh.vertices.iter().enumerate() {
        if short {
            write_text(to_f32(vertex), out)?;
        } else {
            write_text(vertex, out)?;
        }
        if normals {
            out.write_all(b" ")?;
            write_text(to_f32(mesh.normals[i]), out)?;
        }
        out.write_all(b"\n")?;
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(out, "3 {a} {b} {c}")?;
    }
    Ok(())
}
