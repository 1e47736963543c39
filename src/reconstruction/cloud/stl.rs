//! Vertices of stereolithography files, each once.
//!
//! STL repeats a vertex in every facet around it; equal coordinates are taken as one vertex. The
//! normals of facets are not normals of vertices and are not used.

use std::collections::HashSet;

use super::binary::{ByteOrder, Scalar, enough};
use super::collector::Collector;
use super::text::Lines;
use super::{Error, Limits};
use crate::reconstruction::vector::Vec3;

/// A free text of 80 bytes, then the number of facets.
const HEADER: usize = 84;

/// A normal and three vertices in f32, then two bytes of attributes.
const FACET: usize = 50;

/// Whether the length is that of the binary form with the declared number of facets.
pub(super) fn has_binary_length(bytes: &[u8]) -> bool {
    let declared = declared(bytes);
    declared.is_some_and(|facets| bytes.len() as u64 == HEADER as u64 + facets * FACET as u64)
}

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let is_text = bytes.trim_ascii_start().starts_with(b"solid")
        && !bytes[..bytes.len().min(512)].contains(&0);
    let vertices = Vertices {
        collector: Collector::new(limits, false, false),
        seen: HashSet::new(),
    };
    if is_text && !has_binary_length(bytes) {
        ascii(bytes, vertices)
    } else {
        binary(bytes, vertices)
    }
}

/// The vertices so far, without repetition.
struct Vertices<'l> {
    collector: Collector<'l>,
    seen: HashSet<[u64; 3]>,
}

impl Vertices<'_> {
    fn push(&mut self, [x, y, z]: Vec3, line: usize) -> Result<(), Error> {
        // Adding zero makes -0 and 0 the same.
        if self.seen.insert([x, y, z].map(|v| (v + 0.0).to_bits())) {
            self.collector.push(&[x, y, z, 0.0, 0.0, 0.0, 0.0], line)?;
        }
        Ok(())
    }
}

fn ascii<'l>(bytes: &[u8], mut vertices: Vertices<'l>) -> Result<Collector<'l>, Error> {
    let (mut corners, mut ended) = (0u64, false);
    for line in Lines::new(bytes, 0) {
        let mut tokens = line.tokens();
        match tokens.next() {
            Some(b"vertex") => {
                let mut vertex = [0.0; 3];
                for value in &mut vertex {
                    let token = tokens
                        .next()
                        .ok_or_else(|| line.error("expected three numbers"))?;
                    *value = line.number(token)?;
                }
                vertices.push(vertex, line.number)?;
                corners += 1;
            }
            Some(b"solid") => ended = false,
            Some(b"endsolid") => ended = true,
            _ => {}
        }
    }
    if corners % 3 != 0 || !ended {
        return Err(Error::Truncated {
            what: "the list of facets up to \"endsolid\"".to_owned(),
            declared: corners / 3 + 1,
            found: corners / 3,
        });
    }
    Ok(vertices.collector)
}

fn binary<'l>(bytes: &[u8], mut vertices: Vertices<'l>) -> Result<Collector<'l>, Error> {
    let facets = declared(bytes).ok_or_else(|| Error::Truncated {
        what: "the binary header, in bytes".to_owned(),
        declared: HEADER as u64,
        found: bytes.len() as u64,
    })?;
    let body = &bytes[HEADER..];
    let facets = facets as usize;
    enough("the list of facets", facets, FACET, body.len())?;
    for (i, facet) in body.chunks_exact(FACET).take(facets).enumerate() {
        for corner in facet[12..48].chunks_exact(12) {
            let number = |k: usize| Scalar::F32.read(ByteOrder::Little, &corner[4 * k..]);
            let vertex = [0, 1, 2].map(|k| number(k).expect("a corner has 12 bytes"));
            vertices.push(vertex, i + 1)?;
        }
    }
    Ok(vertices.collector)
}

fn declared(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(HEADER - 4..)?.first_chunk()?;
    Some(u64::from(u32::from_le_bytes(*count)))
}
