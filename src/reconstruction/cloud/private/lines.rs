//! Texts in the formats of lines: OBJ, OFF, STL, PCD.

use super::{Fill, Place, range_of};
use crate::reconstruction::cloud::stl;
use crate::reconstruction::cloud::text::{Line, Lines};

/// Statements of OBJ whose words are numbers.
const NUMBERS_OF_OBJ: [&[u8]; 18] = [
    b"v", b"vn", b"vt", b"vp", b"f", b"l", b"p", b"s", b"deg", b"cstype", b"bmat", b"step",
    b"curv", b"curv2", b"surf", b"parm", b"trim", b"end",
];

/// Statements of OBJ of which the first word stays: they show the format.
const NAMES_OF_OBJ: [&[u8]; 4] = [b"o", b"g", b"mtllib", b"usemtl"];

/// How a file of STL in text begins.
const SOLID: &[u8] = b"solid";

/// How a file of the Point Cloud Library begins, and what the library writes behind the version.
const MARK_OF_PCD: &[u8] = b"# .PCD";
const TITLE_OF_PCD: &[u8] = b"- Point Cloud Data file format";

/// Comments, and the names of objects, groups and materials.
pub(in crate::reconstruction::cloud) fn of_obj(bytes: &[u8]) -> Vec<Place> {
    let mut places = Vec::new();
    for line in Lines::new(bytes, 0).joined() {
        if line.is_blank() {
            places.extend(comment(line, bytes));
            continue;
        }
        let word = line.tokens().next().unwrap_or_default();
        if NUMBERS_OF_OBJ.contains(&word) {
            places.extend(trailing(line, bytes));
        } else if NAMES_OF_OBJ.contains(&word) {
            places.push(behind(line, word, bytes));
        } else {
            places.push(whole(line, bytes));
        }
    }
    places
}

/// Comments.
pub(in crate::reconstruction::cloud) fn of_off(bytes: &[u8]) -> Vec<Place> {
    comments(Lines::new(bytes, 0), bytes)
}

/// The title of the binary form; names and whatever else is no number in the text form.
pub(in crate::reconstruction::cloud) fn of_stl(bytes: &[u8]) -> Vec<Place> {
    if !stl::is_text(bytes) {
        let title = &bytes[..bytes.len().min(stl::TITLE)];
        // Some programs begin it as the text form begins.
        let word = if stl::starts_as_text(title) {
            title.len() - title.trim_ascii_start().len() + SOLID.len()
        } else {
            0
        };
        return vec![Place::new(word..title.len(), Fill::BlanksAroundTags)];
    }
    let mut places = Vec::new();
    let begin = bytes.len() - bytes.trim_ascii_start().len();
    for line in Lines::new(bytes, 0) {
        let mut tokens = line.tokens();
        let word = tokens.next().unwrap_or_default();
        if range_of(word, bytes).start == begin && !word.is_empty() {
            // Its letters show the format, whatever follows them.
            let word = word.get(..SOLID.len()).unwrap_or(word);
            places.push(behind(line, word, bytes));
            continue;
        }
        places.extend(match word.to_ascii_lowercase().as_slice() {
            b"vertex" | b"facet" | b"outer" | b"endloop" | b"endfacet" => trailing(line, bytes),
            b"solid" | b"endsolid" => Some(behind(line, word, bytes)),
            b"end" => tokens.next().map(|word| behind(line, word, bytes)),
            _ => Some(whole(line, bytes)),
        });
    }
    places
}

/// Comments of the header, and of the points in text.
pub(in crate::reconstruction::cloud) fn of_pcd(
    bytes: &[u8],
    header: usize,
    text: bool,
) -> Vec<Place> {
    let mut places = Vec::new();
    for line in bytes[..header].split(|&byte| byte == b'\n') {
        let content = line.trim_ascii_start();
        let Some(mut comment) = content.strip_prefix(b"#") else {
            continue;
        };
        if line.starts_with(MARK_OF_PCD) && range_of(line, bytes).start == 0 {
            comment = behind_title(&line[MARK_OF_PCD.len()..]);
        }
        places.push(Place::new(range_of(comment, bytes), Fill::Blanks));
    }
    if text {
        places.extend(comments(Lines::new(&bytes[header..], 0), bytes));
    }
    places
}

/// What follows the version and the title of the library.
fn behind_title(text: &[u8]) -> &[u8] {
    let is_version = |byte: &u8| byte.is_ascii_digit() || b" v.".contains(byte);
    let version = text.iter().take_while(|byte| is_version(byte)).count();
    let rest = &text[version..];
    rest.strip_prefix(TITLE_OF_PCD).unwrap_or(rest)
}

/// The comments in lines of numbers.
pub(super) fn comments<'a>(lines: Lines<'a>, bytes: &[u8]) -> Vec<Place> {
    let place = |line: Line<'a>| match line.comment() {
        Some(_) => comment(line, bytes),
        None => trailing(line, bytes),
    };
    lines.filter_map(place).collect()
}

/// The text of a line that is a comment.
pub(super) fn comment(line: Line<'_>, bytes: &[u8]) -> Option<Place> {
    let range = range_of(line.comment()?, bytes);
    Some(Place::new(range, Fill::BlanksAroundTags))
}

/// The comment at the end of a line of numbers.
fn trailing(line: Line<'_>, bytes: &[u8]) -> Option<Place> {
    if !line.bytes.contains(&b'#') {
        return None;
    }
    let last = line.tokens().last();
    let end = last.map_or(0, |last| range_of(last, line.bytes).end);
    remark(&line.bytes[end..], bytes)
}

/// What is behind the mark of a comment in the rest of a line.
pub(super) fn remark(rest: &[u8], bytes: &[u8]) -> Option<Place> {
    let mark = rest.iter().position(|&byte| byte == b'#')?;
    Some(Place::new(range_of(&rest[mark + 1..], bytes), Fill::Blanks))
}

/// The words behind the first one of a line.
fn behind(line: Line<'_>, word: &[u8], bytes: &[u8]) -> Place {
    let start = range_of(word, bytes).end;
    Place::new(
        start..range_of(line.bytes, bytes).end,
        Fill::BlanksAroundTags,
    )
}

fn whole(line: Line<'_>, bytes: &[u8]) -> Place {
    Place::new(range_of(line.bytes, bytes), Fill::Blanks)
}
