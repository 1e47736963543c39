//! Geomview OFF as text, with any of its prefixes for normals, colours and texture coordinates.

use super::{Face, excerpt, lines, number, position, row, vector};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::mesh::TriangleMesh;

/// Whether the first word is `OFF`, perhaps with prefixes.
pub(super) fn is_off(text: &str) -> bool {
    lines(text)
        .next()
        .and_then(|(_, line)| line.split_ascii_whitespace().next())
        .is_some_and(|word| word.len() <= 8 && word.ends_with("OFF"))
}

pub(super) fn read(text: &str) -> Result<TriangleMesh, Error> {
    let mut lines = lines(text);
    let (line, first) = lines.next().ok_or(Error::Empty)?;
    let (kind, counts) = first
        .split_once(|c: char| c.is_ascii_whitespace())
        .unwrap_or((first, ""));
    let prefix = kind.trim_end_matches("OFF").trim_start_matches("ST");
    if prefix.contains(['4', 'n']) || counts.trim() == "BINARY" {
        return Err(Error::UnsupportedFormat(
            "only three-dimensional OFF files as text can be read".into(),
        ));
    }
    let has_normals = prefix.contains('N');
    // Some programs write the counts behind the first word.
    let (line, counts) = if counts.trim().is_empty() {
        lines
            .next()
            .ok_or_else(|| row(line, "the numbers of vertices and faces are missing"))?
    } else {
        (line, counts)
    };
    let mut words = counts.split_ascii_whitespace();
    let vertices = count(words.next(), line)?;
    let faces = count(words.next(), line)?;

    let mut mesh = TriangleMesh::default();
    for found in 0..vertices {
        let (line, content) = lines
            .next()
            .ok_or_else(|| cut_short("the list of vertices", vertices, found))?;
        let mut words = content.split_ascii_whitespace();
        mesh.vertices
            .push(position(vector(&mut words, line)?, line)?);
        if has_normals {
            mesh.normals.push(vector(&mut words, line)?);
        }
    }
    for found in 0..faces {
        let (line, content) = lines
            .next()
            .ok_or_else(|| cut_short("the list of faces", faces, found))?;
        let mut words = content.split_ascii_whitespace();
        let corners = count(words.next(), line)?;
        let mut face = Face {
            number: found + 1,
            line,
            corners: Vec::new(),
        };
        for _ in 0..corners {
            face.push(number(&mut words, line)?, mesh.vertices.len())?;
        }
        face.triangulate(&mut mesh.triangles)?;
    }
    Ok(mesh)
}

fn count(word: Option<&str>, line: usize) -> Result<usize, Error> {
    let word = word.unwrap_or_default();
    word.parse()
        .map_err(|_| row(line, format!("'{}' is not a count", excerpt(word))))
}

fn cut_short(what: &str, declared: usize, found: usize) -> Error {
    Error::Truncated {
        what: what.into(),
        declared: declared as u64,
        found: found as u64,
    }
}
