//! Vertices of stereolithography files, each once.
//!
//! STL repeats a vertex in every facet around it; equal coordinates are taken as one vertex. The
//! normals of facets are not normals of vertices and are not used.

use std::collections::HashSet;

use super::binary::{ByteOrder, Scalar, enough};
use super::collector::Collector;
use super::text::Lines;
use super::{Error, Limits};
use crate::reconstruction::space::Space;
use crate::reconstruction::vector::{Vec3, bits};

/// A free text of 80 bytes, then the number of facets.
const HEADER: usize = TITLE + 4;

/// Bytes of the free text.
pub(super) const TITLE: usize = 80;

/// A normal and three vertices in f32, then two bytes of attributes.
const FACET: usize = 50;

/// Whether the length is that of the binary form with the declared number of facets.
pub(super) fn has_binary_length(bytes: &[u8]) -> bool {
    let declared = declared(bytes);
    declared.is_some_and(|facets| bytes.len() as u64 == HEADER as u64 + facets * FACET as u64)
}

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let mut collector = Collector::new(limits, false, false);
    collector.space(space(bytes));
    let mut seen = HashSet::new();
    corners(bytes, |corner, line| {
        if seen.insert(bits(corner)) {
            let [x, y, z] = corner;
            collector.push(&[x, y, z, 0.0, 0.0, 0.0, 0.0], line)?;
        }
        Ok(())
    })?;
    Ok(collector)
}

/// Whether a file begins as the text form does, in any case.
pub(super) fn starts_as_text(bytes: &[u8]) -> bool {
    let start = bytes.trim_ascii_start().first_chunk::<5>();
    start.is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
}

/// What the title says of the coordinates: 80 bytes of the binary form, the first line of the text.
pub(in crate::reconstruction) fn space(bytes: &[u8]) -> Space {
    let title = if is_text(bytes) {
        Lines::new(bytes, 0)
            .next()
            .map_or(&[][..], |line| line.bytes)
    } else {
        &bytes[..bytes.len().min(TITLE)]
    };
    Space::from_tags(title)
}

/// Whether it is the text form.
pub(super) fn is_text(bytes: &[u8]) -> bool {
    let is_text = starts_as_text(bytes) && !bytes[..bytes.len().min(512)].contains(&0);
    // Some binary files begin with "solid" as well.
    is_text && !has_binary_length(bytes)
}

/// Gives `take` the corners of all facets, three for each, with the line or the number of the facet.
pub(in crate::reconstruction) fn corners(
    bytes: &[u8],
    take: impl FnMut(Vec3, usize) -> Result<(), Error>,
) -> Result<(), Error> {
    if is_text(bytes) {
        ascii(bytes, take)
    } else {
        binary(bytes, take)
    }
}

fn ascii(
    bytes: &[u8],
    mut take: impl FnMut(Vec3, usize) -> Result<(), Error>,
) -> Result<(), Error> {
    let (mut corners, mut ended) = (0u64, false);
    for line in Lines::new(bytes, 0) {
        let mut tokens = line.tokens();
        let Some(word) = tokens.next() else { continue };
        let mut word = word.to_ascii_lowercase();
        // Some programs part the words that end something.
        if word == b"end" {
            word.extend(tokens.next().unwrap_or_default().to_ascii_lowercase());
        }
        match word.as_slice() {
            b"vertex" => {
                take(line.vector(&mut tokens)?, line.number)?;
                corners += 1;
            }
            b"endloop" if !corners.is_multiple_of(3) => {
                return Err(line.error("the facet has not three vertices"));
            }
            b"solid" => ended = false,
            b"endsolid" => ended = true,
            _ => {}
        }
    }
    if !corners.is_multiple_of(3) || !ended {
        return Err(Error::Truncated {
            what: "the list of facets up to \"endsolid\"".to_owned(),
            declared: corners / 3 + 1,
            found: corners / 3,
        });
    }
    Ok(())
}

fn binary(
    bytes: &[u8],
    mut take: impl FnMut(Vec3, usize) -> Result<(), Error>,
) -> Result<(), Error> {
    let facets = declared(bytes).ok_or_else(|| Error::Truncated {
        what: "the binary header, in bytes".to_owned(),
        declared: HEADER as u64,
        found: bytes.len() as u64,
    })?;
    let body = &bytes[HEADER..];
    // Programs that do not know the number when they begin leave it 0.
    let facets = match facets as usize {
        0 => body.len() / FACET,
        facets => facets,
    };
    enough("the list of facets", facets, FACET, body.len())?;
    for (i, facet) in body.chunks_exact(FACET).take(facets).enumerate() {
        for corner in facet[12..48].chunks_exact(12) {
            let number = |k: usize| Scalar::F32.read(ByteOrder::Little, &corner[4 * k..]);
            let corner = [0, 1, 2].map(|k| number(k).expect("a corner has 12 bytes"));
            take(corner, i + 1)?;
        }
    }
    Ok(())
}

fn declared(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(HEADER - 4..)?.first_chunk()?;
    Some(u64::from(u32::from_le_bytes(*count)))
}
