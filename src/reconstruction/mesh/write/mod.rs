//! The formats that meshes are written to, streamed: no file is ever held in memory as a whole.
//!
//! The same mesh gives the same bytes: no file carries a date, a path or a version.

mod colors;
pub mod dicom;
mod glb;
mod obj;
mod off;
mod ply;
mod stl;
mod three_mf;
mod vtp;
mod zip;

use std::fmt::Display;
use std::io::{self, BufWriter, Write};

use serde::{Deserialize, Serialize};

pub use self::colors::Colors;
use self::dicom::Instance;
use super::TriangleMesh;
use crate::reconstruction::vector::{Bounds, Vec3};

/// A file format for meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// PLY, binary, little-endian; with normals and the distances to the points.
    #[default]
    #[serde(rename = "ply")]
    PlyBinary,
    /// PLY as text; with the same.
    PlyAscii,
    /// Wavefront OBJ; with normals.
    Obj,
    /// STL, binary: 32-bit coordinates without shared vertices, so far from the origin it loses
    /// digits that the other formats keep.
    Stl,
    /// Geomview OFF.
    Off,
    /// glTF 2.0 in one binary file; with normals.
    Glb,
    /// 3MF, for printing: without normals.
    #[serde(rename = "3mf")]
    ThreeMf,
    /// Polygonal data of VTK; with normals and the distances to the points.
    Vtp,
    /// DICOM Encapsulated STL, in LPS and millimetres; only where frame and unit are known.
    #[serde(rename = "dcm")]
    Dicom,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 9] = [
        Self::PlyBinary,
        Self::PlyAscii,
        Self::Obj,
        Self::Stl,
        Self::Off,
        Self::Glb,
        Self::ThreeMf,
        Self::Vtp,
        Self::Dicom,
    ];

    /// Its name in JSON, on the command line and in URLs.
    pub fn name(self) -> &'static str {
        match self {
            Self::PlyBinary => "ply",
            Self::PlyAscii => "ply_ascii",
            Self::Obj => "obj",
            Self::Stl => "stl",
            Self::Off => "off",
            Self::Glb => "glb",
            Self::ThreeMf => "3mf",
            Self::Vtp => "vtp",
            Self::Dicom => "dcm",
        }
    }

    /// The format of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }

    /// The format that a file name with this ending asks for, with or without the dot, in any
    /// case; `ply` is binary.
    pub fn from_extension(extension: &str) -> Option<Self> {
        let extension = extension.trim_start_matches('.').to_ascii_lowercase();
        Self::ALL
            .into_iter()
            .find(|format| format.extension() == extension)
    }

    /// Ending of its file names, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::PlyAscii => "ply",
            named => named.name(),
        }
    }

    /// Whether its vertices can have [`Colors`].
    pub fn has_colors(self) -> bool {
        matches!(self, Self::PlyBinary | Self::PlyAscii | Self::Glb)
    }

    /// Media type; PLY, OFF and VTP have no registered one.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::PlyBinary | Self::PlyAscii => "application/x-ply",
            Self::Obj => "model/obj",
            Self::Stl => "model/stl",
            Self::Off => "application/x-off",
            Self::Glb => "model/gltf-binary",
            Self::ThreeMf => "model/3mf",
            Self::Vtp => "application/x-vtp",
            Self::Dicom => "application/dicom",
        }
    }
}

/// Writes `mesh` to `out`, buffered.
///
/// # Errors
/// What `out` reports; `InvalidInput` where the mesh has more than the 32-bit counts of STL, GLB and 3MF
/// can hold, lies so far from the origin that the 32-bit coordinates of STL would tear it, or does not say
/// its frame, which DICOM needs.
pub fn write(mesh: &TriangleMesh, format: Format, out: &mut dyn Write) -> io::Result<()> {
    write_colored(mesh, format, None, out)
}

/// [`write`](write()) with colours by distance, where they are asked for.
///
/// # Errors
/// Those of `write`, and `InvalidInput` where the format has no colours or the mesh no distances.
pub fn write_colored(
    mesh: &TriangleMesh,
    format: Format,
    colors: Option<Colors>,
    out: &mut dyn Write,
) -> io::Result<()> {
    let why_not = match colors {
        Some(_) if !format.has_colors() => Some("only ply and glb have colours"),
        Some(_) if distances(mesh).len() != mesh.vertices.len() => {
            Some("the mesh does not have the distances to its points, so it has no colours")
        }
        _ => None,
    };
    if let Some(why) = why_not {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    }
    let mut out = BufWriter::with_capacity(1 << 16, out);
    match format {
        Format::PlyBinary => ply::write_binary(mesh, colors, &mut out),
        Format::PlyAscii => ply::write_ascii(mesh, colors, &mut out),
        Format::Obj => obj::write(mesh, &mut out),
        Format::Stl => stl::write(mesh, &mut out),
        Format::Off => off::write(mesh, &mut out),
        Format::Glb => glb::write(mesh, colors, &mut out),
        Format::ThreeMf => three_mf::write(mesh, &mut out),
        Format::Vtp => vtp::write(mesh, &mut out),
        Format::Dicom => dicom::write(mesh, &Instance::of(mesh), &mut out),
    }?;
    out.flush()
}

/// Whether 32-bit coordinates keep the vertices to a millionth of the diagonal. A mesh around the
/// origin always passes; one whose coordinates are some ten times its size or more does not.
fn fits_f32(mesh: &TriangleMesh) -> bool {
    let Some(bounds) = mesh.bounds() else {
        return true;
    };
    // Rounding to 24 bits moves a number by at most 2⁻²⁴ of itself, and a tiny one by 2⁻¹⁵⁰.
    let rounding = (largest(&bounds) * 2f64.powi(-24)).max(2f64.powi(-150));
    rounding <= 1e-6 * bounds.diagonal()
}

/// Whether the format tells vertices apart that lie within `bounds`, `edge` from each other: the 32
/// bits of STL may move them by a small part of that only.
pub fn holds(format: Format, bounds: &Bounds, edge: f64) -> bool {
    /// Most that a coordinate may be moved, as a share of an edge.
    const MOST: f64 = 1.0 / 64.0;
    !matches!(format, Format::Stl | Format::Dicom)
        || largest(bounds) * f64::from(f32::EPSILON) <= MOST * edge
}

fn largest(bounds: &Bounds) -> f64 {
    let coordinates = [bounds.min, bounds.max].into_iter().flatten();
    coordinates.fold(0.0, |largest: f64, v| largest.max(v.abs()))
}

/// Whether every vertex has a normal.
fn has_normals(mesh: &TriangleMesh) -> bool {
    !mesh.normals.is_empty() && mesh.normals.len() == mesh.vertices.len()
}

/// The distances to the points; none unless every vertex has one.
fn distances(mesh: &TriangleMesh) -> &[f64] {
    if mesh.distance_to_points.len() == mesh.vertices.len() {
        &mesh.distance_to_points
    } else {
        &[]
    }
}

fn to_f32(v: Vec3) -> [f32; 3] {
    v.map(|v| v as f32)
}

fn write_f32(v: [f32; 3], out: &mut impl Write) -> io::Result<()> {
    v.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))
}

/// The shortest decimals that read back as the same numbers, between blanks.
fn write_text<T: Display>([x, y, z]: [T; 3], out: &mut impl Write) -> io::Result<()> {
    write!(out, "{x} {y} {z}")
}

/// What stands behind the coordinates of a vertex.
#[derive(Default)]
struct Columns<'a> {
    normals: bool,
    /// One each, or none.
    distances: &'a [f64],
    /// Of the distances.
    colors: Option<Colors>,
}

/// The vertices, then the triangles, a line each: the body of PLY and OFF.
fn write_tables(
    mesh: &TriangleMesh,
    columns: &Columns<'_>,
    out: &mut impl Write,
) -> io::Result<()> {
    let short = fits_f32(mesh);
    for (i, &vertex) in mesh.vertices.iter().enumerate() {
        if short {
            write_text(to_f32(vertex), out)?;
        } else {
            write_text(vertex, out)?;
        }
        if columns.normals {
            out.write_all(b" ")?;
            write_text(to_f32(mesh.normals[i]), out)?;
        }
        let distance = columns.distances.get(i).copied();
        match distance {
            Some(distance) if short => write!(out, " {}", distance as f32)?,
            Some(distance) => write!(out, " {distance}")?,
            None => {}
        }
        if let (Some(colors), Some(distance)) = (columns.colors, distance) {
            out.write_all(b" ")?;
            write_text(colors.bytes(distance), out)?;
        }
        out.write_all(b"\n")?;
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(out, "3 {a} {b} {c}")?;
    }
    Ok(())
}

/// A count as the 32 bits that the format has for it.
fn count_u32(count: usize) -> io::Result<u32> {
    u32::try_from(count).map_err(|_| {
        io::Error::new(
            io::ErrorKind::InvalidInput,
            "the mesh is too large for this format; write it as ply",
        )
    })
}
