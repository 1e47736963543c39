//! Texts in a file that may name somebody, overwritten before the file is kept.
//!
//! Each format names the places of its texts; here they are overwritten, each with as many bytes, so
//! that the structure of the file stays. What the readers use is no such place: a cleaned file is read
//! as the same cloud. What is cleaned once has nothing left to clean.

pub(super) mod lines;
pub(super) mod table;
pub(super) mod vtk;

use std::borrow::Cow;
use std::io::Write;
use std::ops::Range;

use flate2::Compression;
use flate2::bufread::GzDecoder;
use flate2::write::GzEncoder;
use sha2::{Digest, Sha256};

use super::cells::Cell;
use super::format::Cleaner;
use super::{Error, Format, Limits, Options, unpack};
use crate::reconstruction::space::Space;

/// What a text is overwritten with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::reconstruction) enum Fill {
    /// Blanks. Line ends, tabs and zeros stay.
    Blanks,
    /// The same, but for the tags that tell the frame and the unit.
    BlanksAroundTags,
    /// Zeros.
    Zeros,
    /// Words that name nothing, and zeros for numbers; what parts words stays.
    Words,
    /// Another identifier of DICOM of the same length, always the same for the same one.
    Identifier,
    /// The codes of blanks, for text that is written as numbers.
    Codes,
    /// Zeros, for what is written as base64.
    Base64,
}

/// Where a text is, and what it is overwritten with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::reconstruction) struct Place {
    pub(in crate::reconstruction) range: Range<usize>,
    pub(in crate::reconstruction) fill: Fill,
}

impl Place {
    pub(in crate::reconstruction) fn new(range: Range<usize>, fill: Fill) -> Self {
        Self { range, fill }
    }
}

/// A file without the texts that it had.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cleaned {
    /// The file, packed as it was.
    pub bytes: Vec<u8>,
    /// Texts that were overwritten.
    pub texts: u64,
}

/// The file without texts that may name somebody; `None` if it has none.
///
/// # Errors
/// As [`super::read()`]: it is meant for files that were read.
pub fn cleaned(bytes: &[u8], options: &Options<'_>) -> Result<Option<Cleaned>, Error> {
    let limits = options.limits;
    let unpacked = unpack(bytes, limits)?;
    let gzipped = matches!(unpacked, Cow::Owned(_));
    let mut texts = if gzipped { names_of_members(bytes) } else { 0 };
    let mut content = unpacked.into_owned();
    let format = Format::detect(super::content(&content)?, options.hint)?;
    let mark = content.len() - super::content(&content)?.len();
    // Readers do not see the mark of UTF-8.
    let mark: Vec<u8> = content.drain(..mark).collect();
    texts += match format.cleaner() {
        Cleaner::Places(places) => {
            let places = places(&content)?;
            overwrite(&mut content, &places)
        }
        Cleaner::Whole(clean) => clean(&mut content, limits)?,
    };
    if texts == 0 {
        return Ok(None);
    }
    content.splice(..0, mark);
    let bytes = if gzipped {
        packed(&content, limits)?
    } else {
        content
    };
    Ok(Some(Cleaned { bytes, texts }))
}

/// Overwrites the texts, and counts those in which there was something.
pub(in crate::reconstruction) fn overwrite(bytes: &mut [u8], places: &[Place]) -> u64 {
    let changed = places.iter().map(|place| {
        let text = bytes.get_mut(place.range.clone()).unwrap_or_default();
        u64::from(match place.fill {
            Fill::Blanks => blank(text),
            Fill::BlanksAroundTags => blank_around_tags(text),
            Fill::Zeros => replace(text, |_| 0),
            Fill::Words => words(text),
            Fill::Identifier => identifiers(text),
            Fill::Codes => codes(text),
            Fill::Base64 => replace(text, |byte| {
                let is_digit = byte.is_ascii_alphanumeric() || b"+/".contains(&byte);
                if is_digit { b'A' } else { byte }
            }),
        })
    });
    changed.sum()
}

/// Where a part of some bytes lies in them.
pub(in crate::reconstruction) fn range_of(part: &[u8], all: &[u8]) -> Range<usize> {
    if part.is_empty() {
        return 0..0;
    }
    let start = part.as_ptr().addr() - all.as_ptr().addr();
    start..start + part.len()
}

fn replace(text: &mut [u8], with: impl Fn(u8) -> u8) -> bool {
    let mut changed = false;
    for byte in text {
        let other = with(*byte);
        changed |= *byte != other;
        *byte = other;
    }
    changed
}

fn blank(text: &mut [u8]) -> bool {
    let mut changed = false;
    for i in 0..text.len() {
        // Lines of OBJ go on behind it.
        let joins = text[i] == b'\\' && matches!(text.get(i + 1), None | Some(b'\n' | b'\r'));
        if text[i] != 0 && !text[i].is_ascii_whitespace() && !joins {
            text[i] = b' ';
            changed = true;
        }
    }
    changed
}

fn blank_around_tags(text: &mut [u8]) -> bool {
    let (mut changed, mut start) = (false, 0);
    for tag in Space::places_of_tags(text) {
        changed |= blank(text.get_mut(start..tag.start).unwrap_or_default());
        start = start.max(tag.end);
    }
    blank(&mut text[start..]) || changed
}

/// Numbers stay numbers, and what stands for nothing still does.
fn words(text: &mut [u8]) -> bool {
    let parts = |byte: &u8| byte.is_ascii_whitespace() || b",;|\"'#".contains(byte);
    let words = text.split_mut(parts).map(|word| match Cell::of(word) {
        Cell::Number(_) => replace(word, |byte| if byte.is_ascii_digit() { b'0' } else { byte }),
        Cell::Missing => false,
        Cell::Text => replace(word, |_| b'~'),
    });
    words.fold(false, |changed, word| changed | word)
}

/// Numbers between blanks that are the codes of characters; those of one digit are none of text.
fn codes(text: &mut [u8]) -> bool {
    let mut changed = false;
    for code in text.split_mut(|byte| !byte.is_ascii_digit()) {
        if let [zeros @ .., tens, ones] = code {
            changed |= replace(zeros, |_| b'0');
            changed |= (*tens, *ones) != (b'3', b'2');
            (*tens, *ones) = (b'3', b'2');
        }
    }
    changed
}

/// What identifiers begin with that the standard itself gives to things.
const OF_STANDARD: &[u8] = b"1.2.840.10008";

/// What identifiers begin with that are a number alone.
const NUMBER_ALONE: &[u8] = b"2.25.";

/// An identifier shorter than this has no room for another one.
const SHORTEST: usize = 8;

/// The last digits of an identifier that was made here tell that it was, where there is room.
const CHECK: usize = 8;

fn identifiers(text: &mut [u8]) -> bool {
    let mut changed = false;
    for one in text.split_mut(|&byte| byte == b'\\') {
        let end = one
            .iter()
            .rposition(|&byte| byte != 0 && byte != b' ')
            .map_or(0, |last| last + 1);
        changed |= identifier(&mut one[..end]);
    }
    changed
}

fn identifier(text: &mut [u8]) -> bool {
    if text.len() < SHORTEST || text.starts_with(OF_STANDARD) || is_made(text) {
        return false;
    }
    let other = digits(text);
    let (begin, number) = text.split_at_mut(NUMBER_ALONE.len());
    begin.copy_from_slice(NUMBER_ALONE);
    for (to, digit) in number.iter_mut().zip(other) {
        *to = digit;
    }
    if let Some((number, _)) = checked(text) {
        let check: Vec<u8> = digits(number).take(CHECK).collect();
        let at = text.len() - CHECK;
        text[at..].copy_from_slice(&check);
    }
    true
}

/// The number of an identifier that is a number alone, and its last digits, where it has so many.
fn checked(text: &[u8]) -> Option<(&[u8], &[u8])> {
    let number = text.strip_prefix(NUMBER_ALONE)?;
    let check = number.len().checked_sub(CHECK).filter(|&at| at >= CHECK)?;
    Some(number.split_at(check))
}

fn is_made(text: &[u8]) -> bool {
    checked(text)
        .is_some_and(|(number, check)| check.iter().copied().eq(digits(number).take(check.len())))
}

/// Digits that show nothing of what they are made from, without end; no zero comes first.
fn digits(text: &[u8]) -> impl Iterator<Item = u8> + use<> {
    let hash: [u8; 32] = Sha256::digest(text).into();
    let first = b'1' + hash[0] % 9;
    let rest = hash.into_iter().cycle().skip(1);
    std::iter::once(first).chain(rest.enumerate().map(|(i, byte)| {
        // The second time around, the other half of a byte.
        b'0' + if i / 32 % 2 == 0 {
            byte % 10
        } else {
            (byte / 10) % 10
        }
    }))
}

/// Names in the headers of what is packed: a program writes what a file was called there.
fn names_of_members(mut packed: &[u8]) -> u64 {
    let mut names = 0;
    while !packed.is_empty() {
        let mut member = GzDecoder::new(packed);
        if std::io::copy(&mut member, &mut std::io::sink()).is_err() {
            break;
        }
        if let Some(header) = member.header() {
            let texts = [header.filename(), header.comment(), header.extra()];
            names += texts
                .into_iter()
                .flatten()
                .filter(|text| !text.is_empty())
                .count() as u64;
        }
        packed = member.into_inner();
    }
    names
}

/// The content packed again, so that the limits allow to unpack it.
fn packed(content: &[u8], limits: &Limits) -> Result<Vec<u8>, Error> {
    let pack = |level| {
        let mut encoder = GzEncoder::new(Vec::new(), level);
        encoder.write_all(content)?;
        encoder.finish()
    };
    let failed = |error: std::io::Error| Error::Compression(error.to_string());
    let bytes = pack(Compression::default()).map_err(failed)?;
    if unpack(&bytes, limits).is_ok() {
        return Ok(bytes);
    }
    // It was packed worse before, or blanks pack better than what they stand for.
    pack(Compression::none()).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn identified(text: &str) -> String {
        let mut bytes = text.as_bytes().to_vec();
        identifiers(&mut bytes);
        assert_eq!(bytes.len(), text.len());
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn identifiers_become_others_that_stay() {
        let study = "1.3.6.1.4.1.14519.5.2.1.7777.4006.11111";
        let made = identified(study);
        assert!(
            made.starts_with("2.25.") && !made.starts_with("2.25.0"),
            "{made}"
        );
        assert!(made[5..].bytes().all(|byte| byte.is_ascii_digit()));
        assert_eq!(identified(&made), made);
        assert_eq!(identified(study), made);
        assert_ne!(identified("1.3.6.1.4.1.14519.5.2.1.7777.4006.11112"), made);
        for kept in [
            "1.2.840.10008.1.2.1",
            "1.2.3",
            "",
            "1.2.840.10008.5.1.4.1.1.66.4\0",
        ] {
            assert_eq!(identified(kept), kept);
        }
        let (two, long) = (
            format!("{study}\\{study}"),
            "1.".to_owned() + &"9".repeat(90),
        );
        assert_eq!(identified(&two), format!("{made}\\{made}"));
        assert!(identified(&long).len() == 92 && identified(&long) != long);
        // Numbers of others are no numbers of ours.
        assert_ne!(
            identified("2.25.123456789012345678901234"),
            "2.25.123456789012345678901234"
        );
    }

    #[test]
    fn texts_are_overwritten_and_tags_stay() {
        for (text, fill, expected, texts) in [
            ("Rossi^Anna\0\t", Fill::Blanks, "          \0\t", 1),
            (" \r\n", Fill::Blanks, " \r\n", 0),
            (
                "by Rossi SPACE=LPS,unit=mm",
                Fill::BlanksAroundTags,
                "         SPACE=LPS unit=mm",
                1,
            ),
            (
                "SPACE=Rossi SPACE=RAS",
                Fill::BlanksAroundTags,
                "SPACE=      SPACE=RAS",
                1,
            ),
            ("MYSPACE=LPS", Fill::BlanksAroundTags, "           ", 1),
            ("Rossi, Anna 7", Fill::Words, "~~~~~, ~~~~ 0", 1),
            ("82 111 0 115", Fill::Codes, "32 032 0 032", 1),
            ("Rossi", Fill::Zeros, "\0\0\0\0\0", 1),
        ] {
            let mut bytes = text.as_bytes().to_vec();
            let place = [Place::new(0..bytes.len(), fill)];
            assert_eq!(overwrite(&mut bytes, &place), texts, "{text}");
            assert_eq!(String::from_utf8_lossy(&bytes), expected);
            assert_eq!(overwrite(&mut bytes, &place), 0, "{text}");
        }
    }

    #[test]
    fn what_packs_better_without_texts_can_still_be_unpacked() {
        let content = b"1 2 3 # \n".repeat(200_000);
        let tight = Limits {
            max_expansion: 1.5,
            ..Limits::default()
        };
        let bytes = packed(&content, &tight).unwrap();
        assert_eq!(unpack(&bytes, &tight).unwrap(), content);
    }
}
