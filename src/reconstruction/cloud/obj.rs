//! Vertices and vertex normals of Wavefront OBJ.

use super::collector::Collector;
use super::text::{Lines, parse};
use super::{Error, Limits};
use crate::reconstruction::space::Space;
use crate::reconstruction::vector::Vec3;

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let mut points: Vec<(Vec3, usize)> = Vec::new();
    let mut normals: Vec<Vec3> = Vec::new();
    let mut in_step = true;
    for line in Lines::new(bytes, 0).joined().content() {
        let mut tokens = line.tokens();
        match tokens.next() {
            Some(b"v") => {
                if points.len() == limits.max_points {
                    let limit = limits.max_points;
                    return Err(Error::TooManyPoints { limit });
                }
                // What follows (a weight, a colour) is not used.
                points.push((line.vector(&mut tokens)?, line.number));
            }
            Some(b"vn") => normals.push(line.vector(&mut tokens)?),
            Some(b"f") => in_step = in_step && tokens.all(same_index),
            _ => {}
        }
    }
    // Normals have a numbering of their own; only if it is that of the vertices are they theirs.
    let usable = in_step && normals.len() == points.len();
    let mut collector = Collector::new(limits, usable, false);
    if !usable && !normals.is_empty() {
        let message = "the normals were ignored: they do not belong to the vertices one to one";
        collector.warn("normals_ignored", message);
        normals.clear();
    }
    collector.space(space(bytes));
    collector.reserve(points.len())?;
    for (i, ([x, y, z], line)) in points.into_iter().enumerate() {
        let [nx, ny, nz] = normals.get(i).copied().unwrap_or_default();
        collector.push(&[x, y, z, nx, ny, nz, 0.0], line)?;
    }
    Ok(collector)
}

/// What the comments before the first line of content say of the coordinates.
pub(in crate::reconstruction) fn space(bytes: &[u8]) -> Space {
    let lines = Lines::new(bytes, 0).map(|line| line.bytes.trim_ascii());
    let head = lines.take_while(|line| line.is_empty() || line.starts_with(b"#"));
    Space::from_tags(&head.collect::<Vec<_>>().join(&b' '))
}

/// Whether a corner of a face (`v`, `v/vt`, `v//vn`, `v/vt/vn`) has equal indices for vertex and
/// normal.
fn same_index(corner: &[u8]) -> bool {
    let mut parts = corner.split(|&b| b == b'/');
    let (vertex, normal) = (parts.next(), parts.nth(1));
    normal.is_none_or(|normal| vertex.and_then(parse) == parse(normal))
}
