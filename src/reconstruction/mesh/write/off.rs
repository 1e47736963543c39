//! Geomview OFF. Without normals: NOFF, which has them, is refused by readers that know OFF only.

use std::io::{self, Write};

use super::{Columns, write_tables};
use crate::reconstruction::mesh::TriangleMesh;

pub(super) fn write(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "OFF")?;
    // The number of edges is never read.
    writeln!(out, "{} {} 0", mesh.vertices.len(), mesh.triangles.len())?;
    write_tables(mesh, &Columns::default(), out)
}
