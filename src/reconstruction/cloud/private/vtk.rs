//! Texts in polygon data of VTK: the title, comments, and arrays of text.

use super::{Fill, Place, range_of};
use crate::reconstruction::cloud::text::Lines;
use crate::reconstruction::cloud::vtk::Tags;

/// Types of arrays of text in legacy files.
const TEXTS: [&[u8]; 3] = [b"string", b"utf8_string", b"unicode_string"];

/// What the parts of a legacy file begin with, behind which an array of text ends at the latest.
const PARTS: [&[u8]; 10] = [
    b"POINT_DATA",
    b"CELL_DATA",
    b"FIELD",
    b"SCALARS",
    b"VECTORS",
    b"NORMALS",
    b"TENSORS",
    b"LOOKUP_TABLE",
    b"TEXTURE_COORDINATES",
    b"METADATA",
];

/// The title of a legacy file, and the arrays of text of one that is text.
pub(in crate::reconstruction::cloud) fn of_legacy(bytes: &[u8]) -> Vec<Place> {
    let mut lines = Lines::new(bytes, 0);
    let title = lines.nth(1);
    let mut places: Vec<Place> = title
        .map(|title| Place::new(range_of(title.bytes, bytes), Fill::BlanksAroundTags))
        .into_iter()
        .collect();
    let is_text = lines
        .next()
        .is_some_and(|line| line.bytes.eq_ignore_ascii_case(b"ASCII"));
    if !is_text {
        return places;
    }
    let mut left = 0;
    for line in lines {
        let words: Vec<_> = line.tokens().take(5).collect();
        let first = words.first().copied().unwrap_or_default();
        left = match words.as_slice() {
            _ if PARTS.contains(&first) => 0,
            [_, width, count, kind] if left == 0 && TEXTS.contains(kind) => {
                number(width) * number(count)
            }
            _ if left > 0 => {
                places.push(Place::new(range_of(line.bytes, bytes), Fill::Words));
                left - 1
            }
            _ => 0,
        };
    }
    places
}

fn number(word: &[u8]) -> usize {
    let number = std::str::from_utf8(word)
        .ok()
        .and_then(|word| word.parse().ok());
    // Of more lines there are not enough anyway.
    number.unwrap_or(0).min(1 << 24)
}

/// Comments, and arrays of text that are written in the tags.
pub(in crate::reconstruction::cloud) fn of_xml(bytes: &[u8]) -> Vec<Place> {
    let mut places = comments(bytes);
    for tag in Tags::of(bytes).take_while(|tag| tag.name != b"AppendedData") {
        let is_array = tag.name == b"Array" || tag.name == b"DataArray";
        let is_text = tag
            .get(b"type")
            .is_some_and(|kind| kind.eq_ignore_ascii_case(b"string"));
        if !is_array || !is_text || tag.get(b"Name") == Some(b"SPACE".as_slice()) {
            continue;
        }
        let text = &bytes[tag.end..];
        let end = text
            .iter()
            .position(|&byte| byte == b'<')
            .unwrap_or(text.len());
        let fill = match tag.get(b"format") {
            Some(b"ascii") => Fill::Codes,
            _ => Fill::Base64,
        };
        places.push(Place::new(range_of(&text[..end], bytes), fill));
    }
    places
}

/// What is in comments outside of tags: whatever looks like a tag is read as one.
fn comments(bytes: &[u8]) -> Vec<Place> {
    let text = &bytes[..find(bytes, b"<AppendedData").unwrap_or(bytes.len())];
    let (mut places, mut at) = (Vec::new(), 0);
    while let Some(begin) = find(&text[at..], b"<!--") {
        let start = at + begin + 4;
        at = find(&text[start..], b"-->").map_or(text.len(), |end| start + end);
        let mut inside = &text[start..at];
        while let Some(open) = inside.iter().position(|&byte| byte == b'<') {
            places.push(Place::new(range_of(&inside[..open], bytes), Fill::Blanks));
            let tag = &inside[open..];
            let close = tag.iter().position(|&byte| byte == b'>');
            inside = &tag[close.map_or(tag.len(), |close| close + 1)..];
        }
        places.push(Place::new(range_of(inside, bytes), Fill::Blanks));
    }
    places
}

fn find(bytes: &[u8], mark: &[u8]) -> Option<usize> {
    bytes.windows(mark.len()).position(|window| window == mark)
}
