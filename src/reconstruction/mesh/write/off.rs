//! Geomview OFF, and NOFF where there are normals.

use std::io::{self, Write};

use super::{has_normals, write_tables};
use crate::reconstruction::mesh::TriangleMesh;

pub(super) fn write(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "{}", if has_normals(mesh) { "NOFF" } else { "OFF" })?;
    // The number of edges is never read.
    writeln!(out, "{} {} 0", mesh.vertices.len(), mesh.triangles.len())?;
    write_tables(mesh, &[], out)
}
