//! The formats that meshes are read from, to compare them with ours: PLY, OBJ, OFF, STL,
//! and GLB as we write it.
//!
//! Headers, vertices and numbers are read as those of clouds are; only the faces are new here. The
//! bytes come from outside: no count in them is trusted, nothing is allocated beyond a small multiple
//! of their number, and every index is checked where it is read.

mod glb;
mod obj;
mod off;
mod ply;
mod stl;

use super::TriangleMesh;
use crate::reconstruction::cloud::{Error, Format, Limits, MAX_COORDINATE, content, unpack};
use crate::reconstruction::vector::Vec3;

/// Reads a mesh, gzipped or not. The content decides on the format; where it leaves that open, the
/// file's `name`. A file without faces gives a mesh without triangles; polygons become fans.
///
/// Normals are kept where the file has one for each vertex.
///
/// # Errors
/// What is wrong in the file, with the line, or the record of a binary file; `UnsupportedFormat` for
/// anything else than the five formats.
pub fn read(bytes: &[u8], name: Option<&str>) -> Result<TriangleMesh, Error> {
    let unpacked = unpack(bytes, &Limits::default())?;
    let bytes = content(&unpacked)?;
    let mesh = if bytes.starts_with(glb::MAGIC) {
        glb::read(bytes)
    } else {
        match Format::detect(bytes, name.and_then(Format::from_extension))? {
            Format::Ply => ply::read(bytes),
            Format::Obj => obj::read(bytes),
            Format::Off => off::read(bytes),
            Format::Stl => stl::read(bytes),
            _ => Err(Error::UnsupportedFormat(
                "this is not a mesh in PLY, OBJ, OFF, STL or GLB".to_owned(),
            )),
        }
    }?;
    if mesh.vertices.is_empty() {
        return Err(Error::Empty);
    }
    if u32::try_from(mesh.vertices.len()).is_err() {
        return Err(Error::TooManyPoints {
            limit: u32::MAX as usize,
        });
    }
    Ok(mesh)
}

/// A row of the file that cannot be used.
fn row(line: usize, detail: impl Into<String>) -> Error {
    Error::Row {
        line,
        detail: detail.into(),
    }
}

/// `v` as the position of a vertex: finite, and not so large that squares overflow.
fn position(v: Vec3, line: usize) -> Result<Vec3, Error> {
    for value in v {
        if !value.is_finite() {
            return Err(row(line, format!("coordinate {value} is not finite")));
        }
        if value.abs() > MAX_COORDINATE {
            return Err(Error::TooLarge {
                value,
                limit: MAX_COORDINATE,
            });
        }
    }
    Ok(v)
}

/// One face while it is read.
struct Face {
    /// Its number in the file, from 1.
    number: usize,
    /// Line, or record, for messages.
    line: usize,
    corners: Vec<u32>,
}

impl Face {
    fn new(number: usize, line: usize) -> Self {
        Self {
            number,
            line,
            corners: Vec::new(),
        }
    }

    /// Adds the corner at `index`, counted from 0, of `vertices`.
    fn push(&mut self, index: f64, vertices: usize) -> Result<(), Error> {
        if index.fract() != 0.0 || !(0.0..vertices as f64).contains(&index) {
            let number = self.number;
            return Err(row(
                self.line,
                format!("face {number} refers to vertex {index}, counted from 0, of {vertices}"),
            ));
        }
        self.corners.push(index as u32);
        Ok(())
    }

    /// Adds the fan of triangles around the first corner to `triangles`.
    fn triangulate(&self, triangles: &mut Vec<[u32; 3]>) -> Result<(), Error> {
        let [first, rest @ ..] = self.corners.as_slice() else {
            return Err(row(self.line, format!("face {} is empty", self.number)));
        };
        if rest.len() < 2 {
            return Err(row(
                self.line,
                format!("face {} has fewer than 3 vertices", self.number),
            ));
        }
        triangles.extend(rest.windows(2).map(|edge| [*first, edge[0], edge[1]]));
        Ok(())
    }
}
