//! PLY in its three encodings: positions and normals of `vertex`, polygons of `face`.

use super::ply_header::{Element, Encoding, Header, Property, Scalar};
use super::{Face, number, position, row};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::mesh::TriangleMesh;

pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh, Error> {
    let (header, rest) = Header::read(bytes)?;
    let declared = header.elements.iter().find(|e| e.name == "vertex");
    let vertices = declared.map_or(0, |element| element.count) as usize;
    let text;
    let source = if header.encoding == Encoding::Ascii {
        text = String::from_utf8_lossy(rest);
        Source::Text {
            lines: text.lines(),
            words: "".split_ascii_whitespace(),
        }
    } else {
        Source::Binary {
            rest,
            big_endian: header.encoding == Encoding::BigEndian,
        }
    };
    let mut body = Body {
        source,
        line: header.lines,
    };
    let mut mesh = TriangleMesh::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => read_vertices(element, &mut body, &mut mesh)?,
            "tristrips" => {
                return Err(Error::UnsupportedFormat(
                    "PLY files with triangle strips cannot be read".into(),
                ));
            }
            _ => read_faces(element, vertices, &mut body, &mut mesh)?,
        }
    }
    Ok(mesh)
}

fn read_vertices(
    element: &Element,
    body: &mut Body<'_>,
    mesh: &mut TriangleMesh,
) -> Result<(), Error> {
    let columns = ["x", "y", "z", "nx", "ny", "nz"].map(|name| element.scalar_column(name));
    let [Some(x), Some(y), Some(z), normal @ ..] = columns else {
        return Err(Error::NoCoordinates(
            "element vertex has not all of x, y and z".into(),
        ));
    };
    let mut record = Vec::new();
    for found in 0..element.count {
        body.start(element, found)?;
        record.clear();
        for property in &element.properties {
            let mut value = 0.0;
            body.values(property, |v| {
                value = v;
                Ok(())
            })
            .map_err(|fault| fault.of(element, found))?;
            record.push(value);
        }
        mesh.vertices
            .push(position([record[x], record[y], record[z]], body.line)?);
        if let [Some(x), Some(y), Some(z)] = normal {
            mesh.normals.push([record[x], record[y], record[z]]);
        }
    }
    Ok(())
}

/// Reads the faces; of other elements, passes over the records.
fn read_faces(
    element: &Element,
    vertices: usize,
    body: &mut Body<'_>,
    mesh: &mut TriangleMesh,
) -> Result<(), Error> {
    let polygon = element.properties.iter().position(|property| {
        let name = property.name.as_str();
        element.name == "face"
            && property.length.is_some()
            && matches!(name, "vertex_indices" | "vertex_index")
    });
    for found in 0..element.count {
        body.start(element, found)?;
        let mut face = Face {
            number: found as usize + 1,
            line: body.line,
            corners: Vec::new(),
        };
        for (column, property) in element.properties.iter().enumerate() {
            let wanted = polygon == Some(column);
            body.values(property, |v| {
                if wanted {
                    face.push(v, vertices)
                } else {
                    Ok(())
                }
            })
            .map_err(|fault| fault.of(element, found))?;
        }
        if polygon.is_some() {
            face.triangulate(&mut mesh.triangles)?;
        }
    }
    Ok(())
}

/// What stands behind the header.
struct Body<'a> {
    source: Source<'a>,
    /// Present line of the file; of binary data, number of the record in its element.
    line: usize,
}

enum Source<'a> {
    Text {
        lines: std::str::Lines<'a>,
        words: std::str::SplitAsciiWhitespace<'a>,
    },
    Binary {
        rest: &'a [u8],
        big_endian: bool,
    },
}

/// Why a record could not be read.
enum Fault {
    /// The bytes end within it.
    Cut,
    Other(Error),
}

impl Fault {
    fn of(self, element: &Element, found: u64) -> Error {
        match self {
            Self::Cut => cut_short(element, found),
            Self::Other(error) => error,
        }
    }
}

fn cut_short(element: &Element, found: u64) -> Error {
    Error::Truncated {
        what: format!("element {}", super::excerpt(&element.name)),
        declared: element.count,
        found,
    }
}

impl Body<'_> {
    /// Goes to record number `found` of `element`: text has one on each line.
    fn start(&mut self, element: &Element, found: u64) -> Result<(), Error> {
        match &mut self.source {
            Source::Text { lines, words } => {
                for line in lines {
                    self.line += 1;
                    *words = line.split_ascii_whitespace();
                    if !line.trim_ascii().is_empty() {
                        return Ok(());
                    }
                }
                Err(cut_short(element, found))
            }
            Source::Binary { .. } => {
                self.line = found as usize + 1;
                Ok(())
            }
        }
    }

    /// Gives the value of `property`, or each of its list, to `take`.
    fn values(
        &mut self,
        property: &Property,
        mut take: impl FnMut(f64) -> Result<(), Error>,
    ) -> Result<(), Fault> {
        let length = match property.length {
            Some(scalar) => self.value(scalar)?,
            None => 1.0,
        };
        if length < 0.0 || length.fract() != 0.0 {
            let detail = format!("{length} is not the length of a list");
            return Err(Fault::Other(row(self.line, detail)));
        }
        for _ in 0..length as u64 {
            take(self.value(property.scalar)?).map_err(Fault::Other)?;
        }
        Ok(())
    }

    fn value(&mut self, scalar: Scalar) -> Result<f64, Fault> {
        match &mut self.source {
            Source::Text { words, .. } => number(words, self.line).map_err(Fault::Other),
            Source::Binary { rest, big_endian } => {
                let (value, size) = scalar.decode(rest, *big_endian).ok_or(Fault::Cut)?;
                *rest = &rest[size..];
                Ok(value)
            }
        }
    }
}
