//! The formats that meshes are read from, to compare them with ours: PLY, OBJ, OFF, STL.
//!
//! The bytes come from outside: no count in them is trusted, nothing is allocated beyond a small
//! multiple of their number, and every index is checked where it is read.

mod obj;
mod off;
mod ply;
mod ply_header;
mod stl;

use super::TriangleMesh;
use crate::reconstruction::cloud::Error;
use crate::reconstruction::vector::Vec3;

/// Largest accepted magnitude of a coordinate: the sixth power of it, which the products behind
/// areas and projections reach, is still far from overflow.
const COORDINATE_LIMIT: f64 = 1e15;

/// Reads a mesh. The content decides on the format; only OBJ, which has no mark of its own, may need
/// the file's `name`. A file without faces gives a mesh without triangles; polygons become fans.
///
/// Normals are kept where the file has one for each vertex.
///
/// # Errors
/// What is wrong in the file, with the line, or the record of a binary file; `UnsupportedFormat` for
/// anything else than the four formats.
pub fn read(bytes: &[u8], name: Option<&str>) -> Result<TriangleMesh, Error> {
    let extension = name
        .and_then(|name| name.rsplit_once('.'))
        .map(|(_, extension)| extension.to_ascii_lowercase());
    let mesh = if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
        ply::read(bytes)
    } else if stl::is_binary(bytes) {
        stl::read_binary(bytes)
    } else {
        let text = String::from_utf8_lossy(bytes);
        if off::is_off(&text) {
            off::read(&text)
        } else if stl::is_text(&text) {
            stl::read_text(&text)
        } else if extension.as_deref() == Some("obj") || obj::is_obj(&text) {
            obj::read(&text)
        } else {
            Err(Error::UnsupportedFormat(
                "this is not a mesh in PLY, OBJ, OFF or STL".into(),
            ))
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

/// The beginning of a word of the file, short enough for a message.
fn excerpt(word: &str) -> String {
    word.chars().take(40).collect()
}

/// Lines with their number from 1, without what follows a `#`, blank ones left out.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line.split('#').next().unwrap_or_default().trim()))
        .filter(|(_, line)| !line.is_empty())
}

/// The next word as a number.
fn number<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<f64, Error> {
    let word = words
        .next()
        .ok_or_else(|| row(line, "a number is missing at the end"))?;
    word.parse()
        .map_err(|_| row(line, format!("'{}' is not a number", excerpt(word))))
}

/// The next three words as a vector.
fn vector<'a>(words: &mut impl Iterator<Item = &'a str>, line: usize) -> Result<Vec3, Error> {
    Ok([
        number(words, line)?,
        number(words, line)?,
        number(words, line)?,
    ])
}

/// `v` as the position of a vertex: finite, and not so large that squares overflow.
fn position(v: Vec3, line: usize) -> Result<Vec3, Error> {
    for value in v {
        if !value.is_finite() {
            return Err(row(line, format!("coordinate {value} is not finite")));
        }
        if value.abs() > COORDINATE_LIMIT {
            return Err(Error::TooLarge {
                value,
                limit: COORDINATE_LIMIT,
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
