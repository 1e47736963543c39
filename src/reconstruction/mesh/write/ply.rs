//! PLY, after G. Turk, The PLY Polygon File Format, 1994; with a property of our own,
//! `distance_to_points`, in the precision of the coordinates.

use std::io::{self, Write};

use super::{distances, fits_f32, has_normals, to_f32, write_f32, write_tables};
use crate::reconstruction::mesh::{DISTANCE, TriangleMesh};

pub(super) fn write_binary(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    let short = fits_f32(mesh);
    header(mesh, "binary_little_endian", short, out)?;
    let (normals, distances) = (has_normals(mesh), distances(mesh));
    for (i, &vertex) in mesh.vertices.iter().enumerate() {
        if short {
            write_f32(to_f32(vertex), out)?;
        } else {
            vertex
                .iter()
                .try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
        }
        if normals {
            write_f32(to_f32(mesh.normals[i]), out)?;
        }
        match distances.get(i) {
            Some(&distance) if short => out.write_all(&(distance as f32).to_le_bytes())?,
            Some(distance) => out.write_all(&distance.to_le_bytes())?,
            None => {}
        }
    }
    for triangle in &mesh.triangles {
        let mut record = [0; 13];
        record[0] = 3;
        for (field, v) in record[1..].chunks_exact_mut(4).zip(triangle) {
            field.copy_from_slice(&v.to_le_bytes());
        }
        out.write_all(&record)?;
    }
    Ok(())
}

pub(super) fn write_ascii(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    header(mesh, "ascii", fits_f32(mesh), out)?;
    write_tables(mesh, has_normals(mesh), distances(mesh), out)
}

fn header(
    mesh: &TriangleMesh,
    encoding: &str,
    short: bool,
    out: &mut impl Write,
) -> io::Result<()> {
    let coordinate = if short { "float" } else { "double" };
    writeln!(out, "ply\nformat {encoding} 1.0\ncomment Meshway")?;
    for tag in mesh.space.tags() {
        writeln!(out, "comment {tag}")?;
    }
    writeln!(out, "element vertex {}", mesh.vertices.len())?;
    for name in ["x", "y", "z"] {
        writeln!(out, "property {coordinate} {name}")?;
    }
    if has_normals(mesh) {
        writeln!(
            out,
            "property float nx\nproperty float ny\nproperty float nz"
        )?;
    }
    if !distances(mesh).is_empty() {
        writeln!(out, "property {coordinate} {DISTANCE}")?;
    }
    writeln!(out, "element face {}", mesh.triangles.len())?;
    // Signed, as the format's own examples have it: some programs read nothing else.
    writeln!(out, "property list uchar int vertex_indices\nend_header")
}
