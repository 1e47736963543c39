//! Polygonal data of VTK in XML (VTK File Formats, section XML): the document, then all numbers behind it as
//! they are in memory, each block with its length before it. Normals and distances are point data.

use std::io::{self, Write};

use super::{distances, fits_f32, has_normals, to_f32, write_f32};
use crate::reconstruction::mesh::{DISTANCE, TriangleMesh};
use crate::reconstruction::vector::Vec3;

/// Bytes of the length before each block.
const LENGTH: usize = 8;

pub(super) fn write(mesh: &TriangleMesh, out: &mut impl Write) -> io::Result<()> {
    let short = fits_f32(mesh);
    let (float, bytes) = if short {
        ("Float32", 4)
    } else {
        ("Float64", 8)
    };
    let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
    let mut blocks = Blocks::default();
    let points = blocks.array("Points", (float, 3), 3 * bytes * vertices);
    let mut attributes = String::new();
    if has_normals(mesh) {
        attributes += &blocks.array("Normals", ("Float32", 3), 12 * vertices);
    }
    if !distances(mesh).is_empty() {
        attributes += &blocks.array(DISTANCE, (float, 1), bytes * vertices);
    }
    let connectivity = blocks.array("connectivity", ("Int64", 1), 24 * triangles);
    let offsets = blocks.array("offsets", ("Int64", 1), 8 * triangles);
    let active = [
        has_normals(mesh).then_some(r#" Normals="Normals""#),
        (!distances(mesh).is_empty()).then_some(r#" Scalars="distance_to_points""#),
    ];
    let active: String = active.into_iter().flatten().collect();
    write!(
        out,
        r#"<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<PolyData>
{}<Piece NumberOfPoints="{vertices}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="{triangles}">
<PointData{active}>
{attributes}</PointData>
<Points>
{points}</Points>
<Polys>
{connectivity}{offsets}</Polys>
</Piece>
</PolyData>
<AppendedData encoding="raw">
_"#,
        field_data(mesh)
    )?;
    write_vectors(&mesh.vertices, short, out)?;
    if has_normals(mesh) {
        write_vectors(&mesh.normals, true, out)?;
    }
    if !distances(mesh).is_empty() {
        write_length(bytes * vertices, out)?;
        for &distance in distances(mesh) {
            if short {
                out.write_all(&(distance as f32).to_le_bytes())?;
            } else {
                out.write_all(&distance.to_le_bytes())?;
            }
        }
    }
    write_length(24 * triangles, out)?;
    for &corner in mesh.triangles.as_flattened() {
        out.write_all(&i64::from(corner).to_le_bytes())?;
    }
    write_length(8 * triangles, out)?;
    for last in 1..=triangles as i64 {
        out.write_all(&(3 * last).to_le_bytes())?;
    }
    out.write_all(b"\n</AppendedData>\n</VTKFile>\n")
}

/// Where the next block of numbers begins.
#[derive(Default)]
struct Blocks {
    next: usize,
}

impl Blocks {
    /// The element that refers to the next block, of so many bytes.
    fn array(&mut self, name: &str, (kind, components): (&str, usize), bytes: usize) -> String {
        let offset = self.next;
        self.next += LENGTH + bytes;
        format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" \
             format=\"appended\" offset=\"{offset}\"/>\n"
        )
    }
}

/// The frame under the name that 3D Slicer reads, and the unit: texts are codes that end in 0.
fn field_data(mesh: &TriangleMesh) -> String {
    let arrays: String = mesh
        .space
        .tags()
        .filter_map(|tag| {
            let (name, value) = tag.split_once('=')?;
            let codes: Vec<String> = value.bytes().map(|byte| byte.to_string()).collect();
            let codes = codes.join(" ");
            Some(format!(
                "<Array type=\"String\" Name=\"{name}\" NumberOfTuples=\"1\" format=\"ascii\">\
                 {codes} 0</Array>\n"
            ))
        })
        .collect();
    if arrays.is_empty() {
        return arrays;
    }
    format!("<FieldData>\n{arrays}</FieldData>\n")
}

fn write_vectors(vectors: &[Vec3], short: bool, out: &mut impl Write) -> io::Result<()> {
    write_length(if short { 12 } else { 24 } * vectors.len(), out)?;
    for &vector in vectors {
        if short {
            write_f32(to_f32(vector), out)?;
        } else {
            for v in vector {
                out.write_all(&v.to_le_bytes())?;
            }
        }
    }
    Ok(())
}

fn write_length(bytes: usize, out: &mut impl Write) -> io::Result<()> {
    out.write_all(&(bytes as u64).to_le_bytes())
}
