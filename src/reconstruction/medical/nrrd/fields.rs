//! The header of NRRD: lines of `field: value` and `key:=value` up to an empty one.

use std::collections::HashMap;

use crate::reconstruction::cloud::Error;
use crate::reconstruction::medical::affine::header;

/// Longest header; those of segmentations grow with the number of segments.
const LONGEST: usize = 8 << 20;

/// What a header says. Fields are spelled in small letters without blanks, for programs write `byte skip`,
/// `byteskip` and `Byte Skip`; keys stay as they are.
#[derive(Debug, Default)]
pub(super) struct Fields<'a> {
    fields: HashMap<String, &'a str>,
    keys: HashMap<&'a str, &'a str>,
}

impl<'a> Fields<'a> {
    /// The header, and what comes behind it.
    ///
    /// # Errors
    /// [`Error::Header`] without an end, [`Error::UnsupportedFormat`] for data in other files.
    pub(super) fn of(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), Error> {
        let mut fields = HashMap::new();
        let mut keys = HashMap::new();
        let mut rest = bytes;
        loop {
            let end = rest.iter().take(LONGEST).position(|&b| b == b'\n');
            let end =
                end.ok_or_else(|| header("the header has no end: an empty line must follow it"))?;
            let line = rest[..end].strip_suffix(b"\r").unwrap_or(&rest[..end]);
            rest = &rest[end + 1..];
            if line.is_empty() {
                break;
            }
            // A name in another encoding than UTF-8 must not make the whole file useless.
            let Ok(line) = std::str::from_utf8(line) else {
                continue;
            };
            match Said::by(line) {
                Said::Key(key, value) => drop(keys.insert(key.trim(), value.trim())),
                Said::Field(field, value) => drop(fields.insert(spelled(field), value.trim())),
                Said::Nothing => {}
            }
        }
        if fields.contains_key("datafile") {
            return Err(Error::UnsupportedFormat(
                "the data lie in another file; save both as one .nrrd".to_owned(),
            ));
        }
        Ok((Self { fields, keys }, rest))
    }

    /// The value of a field.
    pub(super) fn get(&self, name: &str) -> Option<&'a str> {
        self.fields.get(&spelled(name)).copied()
    }

    /// The value of a field that is one of a few words, in small letters.
    pub(super) fn word(&self, name: &str) -> Option<String> {
        self.get(name).map(str::to_ascii_lowercase)
    }

    /// The value of a key.
    pub(super) fn key(&self, name: &str) -> Option<&'a str> {
        self.keys.get(name).copied()
    }

    pub(super) fn needed(&self, name: &str) -> Result<&'a str, Error> {
        self.get(name)
            .ok_or_else(|| header(format!("{name} is missing")))
    }

    pub(super) fn keys(&self) -> impl Iterator<Item = &'a str> + '_ {
        self.keys.keys().copied()
    }
}

/// What a line of a header says.
pub(in crate::reconstruction::medical) enum Said<'a> {
    /// A key with its value.
    Key(&'a str, &'a str),
    /// A field with its value.
    Field(&'a str, &'a str),
    /// It is a comment, or something that nobody reads.
    Nothing,
}

impl<'a> Said<'a> {
    pub(in crate::reconstruction::medical) fn by(line: &'a str) -> Self {
        if line.starts_with('#') {
            Self::Nothing
        } else if let Some((key, value)) = line.split_once(":=") {
            Self::Key(key, value)
        } else if let Some((field, value)) = line.split_once(": ").or(line.split_once(':')) {
            Self::Field(field, value)
        } else {
            Self::Nothing
        }
    }
}

pub(in crate::reconstruction::medical) fn spelled(field: &str) -> String {
    let letters = field.chars().filter(|c| !c.is_whitespace());
    letters.map(|c| c.to_ascii_lowercase()).collect()
}

/// Vectors in brackets, or `none`; `None` for anything else.
pub(super) fn vectors(text: &str) -> Option<Vec<Option<Vec<f64>>>> {
    let mut vectors = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            vectors.push(None);
            rest = after.trim_start();
        } else {
            let (inside, after) = rest.strip_prefix('(')?.split_once(')')?;
            let numbers: Result<Vec<f64>, _> =
                inside.split(',').map(|n| n.trim().parse()).collect();
            vectors.push(Some(numbers.ok()?));
            rest = after.trim_start();
        }
    }
    Some(vectors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vectors_are_read_with_none() {
        let read = vectors("none (1, 0,0) (0,-1.5,0)").unwrap();
        assert_eq!(
            read,
            [None, Some(vec![1.0, 0.0, 0.0]), Some(vec![0.0, -1.5, 0.0])]
        );
        assert_eq!(vectors("(1,2"), None);
        assert_eq!(vectors("1,2"), None);
    }

    #[test]
    fn fields_and_keys_are_told_apart() {
        let (fields, rest) =
            Fields::of(b"NRRD0004\r\ntype: short\r\nA_b:=c: d\r\n\r\nxyz").unwrap();
        assert_eq!(fields.get("type"), Some("short"));
        assert_eq!(fields.key("A_b"), Some("c: d"));
        assert_eq!(rest, b"xyz");
        assert!(Fields::of(b"NRRD0004\ntype: short\n").is_err());
    }

    #[test]
    fn fields_may_be_spelled_in_any_case_with_and_without_blanks() {
        let text = b"NRRD0004\nType: SHORT\nbyteskip: 5\nSpace Origin:(0,0,0)\n\n";
        let (fields, _) = Fields::of(text).unwrap();
        assert_eq!(fields.word("type").as_deref(), Some("short"));
        assert_eq!(fields.get("byte skip"), Some("5"));
        assert_eq!(fields.get("space origin"), Some("(0,0,0)"));
        assert!(Fields::of(b"NRRD0004\nDatafile: a.raw\n\n").is_err());
    }
}
