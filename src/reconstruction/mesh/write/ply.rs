//! PLY, after G. Turk, The PLY Polygon File Format, 1994; with a property of our own,
//! `distance_to_points`, in the precision of the coordinates, and with colours by it where they are asked for.

use std::io::{self, Write};

use super::{Colors, Columns, distances, fits_f32, has_normals, to_f32, write_f32, write_tables};
use crate::reconstruction::mesh::{DISTANCE, TriangleMesh};

pub(super) fn write_binary(
    mesh: &TriangleMesh,
    colors: Option<Colors>,
    out: &mut impl Write,
) -> io::Result<()> {
    let short = fits_f32(mesh);
    header(mesh, colors, ("binary_little_endian", short), out)?;
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
        if let (Some(colors), Some(&distance)) = (colors, distances.get(i)) {
            out.write_all(&colors.bytes(distance))?;
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

pub(super) fn write_ascii(
    mesh: &TriangleMesh,
    colors: Option<Colors>,
    out: &mut impl Write,
) -> io::Result<()> {
    header(mesh, colors, ("ascii", fits_f32(mesh)), out)?;
    let columns = Columns {
        normals: has_normals(mesh),
        distances: distances(mesh),
        colors,
    };
    write_tables(mesh, &columns, out)
}

fn header(
    mesh: &TriangleMesh,
    colors: Option<Colors>,
    (encoding, short): (&str, bool),
    out: &mut impl Write,
) -> io::Result<()> {
    let coordinate = if short { "float" } else { "double" };
    writeln!(out, "ply\nformat {encoding} 1.0\ncomment Meshway")?;
    for tag in mesh.space.tags() {
        writeln!(out, "comment {tag}")?;
    }
    if let Some(colors) = colors {
        let (scale, most) = (Colors::SCALE, colors.most());
        writeln!(out, "comment colors: {scale} of {DISTANCE}, 0 to {most}")?;
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
    if colors.is_some() {
        writeln!(
            out,
            "property uchar red\nproperty uchar green\nproperty uchar blue"
        )?;
    }
    writeln!(out, "element face {}", mesh.triangles.len())?;
    // Signed, as the format's own examples have it: some programs read nothing else.
    writeln!(out, "property list uchar int vertex_indices\nend_header")
}
