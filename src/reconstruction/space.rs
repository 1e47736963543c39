//! What coordinates mean: which way their axes point in a patient, and their unit.
//!
//! Two frames are in use, both right-handed and with z to the head; half a turn about z leads from one
//! to the other. Programs for medical images (3D Slicer, ITK-SNAP) name the frame in the free text of
//! a file: `SPACE=LPS`.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::vector::Vec3;

/// Which way the axes point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// x to the left of the patient, y to the back, z to the head: DICOM, ITK.
    Lps,
    /// x to the right of the patient, y to the front, z to the head: NIfTI, FreeSurfer.
    Ras,
    /// The file does not say it.
    #[default]
    Unknown,
}

impl Frame {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Lps, Self::Ras, Self::Unknown];

    /// Its name in JSON and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lps => "lps",
            Self::Ras => "ras",
            Self::Unknown => "unknown",
        }
    }

    /// The frame of this name, in any case; unknown where the name is.
    pub fn from_name(name: &str) -> Self {
        let named = |frame: &Self| frame.name().eq_ignore_ascii_case(name);
        Self::ALL.into_iter().find(named).unwrap_or_default()
    }

    /// What x, y and z are multiplied by on the way from this frame to another one; none where one of the two
    /// is unknown.
    pub fn turn(self, to: Self) -> Option<Vec3> {
        match (self, to) {
            (Self::Unknown, _) | (_, Self::Unknown) => None,
            (from, to) if from == to => Some([1.0; 3]),
            _ => Some([-1.0, -1.0, 1.0]),
        }
    }
}

/// What a length of 1 is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub enum Unit {
    /// A thousandth of a millimetre.
    #[serde(rename = "um")]
    Micrometre,
    /// A millimetre, as in all medical images.
    #[serde(rename = "mm")]
    Millimetre,
    /// A centimetre.
    #[serde(rename = "cm")]
    Centimetre,
    /// A metre.
    #[serde(rename = "m")]
    Metre,
    /// The file does not say it.
    #[default]
    #[serde(rename = "unknown")]
    Unknown,
}

impl Unit {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Micrometre,
        Self::Millimetre,
        Self::Centimetre,
        Self::Metre,
        Self::Unknown,
    ];

    /// Its symbol, in JSON too.
    pub fn name(self) -> &'static str {
        match self {
            Self::Micrometre => "um",
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Metre => "m",
            Self::Unknown => "unknown",
        }
    }

    /// The unit of this symbol, in any case; unknown where the symbol is.
    pub fn from_name(name: &str) -> Self {
        let named = |unit: &Self| unit.name().eq_ignore_ascii_case(name);
        Self::ALL.into_iter().find(named).unwrap_or_default()
    }

    /// How many millimetres it has.
    pub fn millimetres(self) -> Option<f64> {
        match self {
            Self::Micrometre => Some(1e-3),
            Self::Millimetre => Some(1.0),
            Self::Centimetre => Some(10.0),
            Self::Metre => Some(1e3),
            Self::Unknown => None,
        }
    }
}

/// Frame and unit of coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
// Clouds and reports of earlier versions have neither.
#[serde(default)]
pub struct Space {
    /// Which way the axes point.
    pub frame: Frame,
    /// What a length of 1 is.
    pub unit: Unit,
}

impl Space {
    /// That of everything read from medical images.
    pub const PATIENT: Self = Self {
        frame: Frame::Lps,
        unit: Unit::Millimetre,
    };

    /// What a free text says, as in `SPACE=RAS unit=mm`. A frame without a unit is in millimetres: the
    /// programs that write the tag know no other.
    pub fn from_tags(text: &[u8]) -> Self {
        let frame = tag(text, FRAME).map_or(Frame::Unknown, Frame::from_name);
        let unit = match tag(text, UNIT) {
            Some(name) => Unit::from_name(name),
            None if frame == Frame::Unknown => Unit::Unknown,
            None => Unit::Millimetre,
        };
        Self { frame, unit }
    }

    /// The texts that tell it, one for the frame and one for the unit; none for what is unknown.
    pub fn tags(self) -> impl Iterator<Item = String> {
        let frame = match self.frame {
            Frame::Unknown => None,
            known => Some(format!("SPACE={}", known.name().to_ascii_uppercase())),
        };
        let unit = match self.unit {
            Unit::Unknown => None,
            known => Some(format!("unit={}", known.name())),
        };
        frame.into_iter().chain(unit)
    }

    /// Where the tags of a free text are; of one whose value is not known, without the value.
    pub(super) fn places_of_tags(text: &[u8]) -> Vec<Range<usize>> {
        let place = |(range, value): (Range<usize>, &str), is_known: bool| {
            let end = range.end - if is_known { 0 } else { value.len() };
            range.start..end
        };
        let frames = tags(text, FRAME).map(|tag| {
            let is_known = Frame::ALL
                .map(Frame::name)
                .contains(&&*tag.1.to_ascii_lowercase());
            place(tag, is_known)
        });
        let units = tags(text, UNIT).map(|tag| {
            let is_known = Unit::ALL
                .map(Unit::name)
                .contains(&&*tag.1.to_ascii_lowercase());
            place(tag, is_known)
        });
        let mut places: Vec<_> = frames.chain(units).collect();
        places.sort_by_key(|place| place.start);
        places
    }
}

/// Names of the tags.
const FRAME: &str = "space";
const UNIT: &str = "unit";

/// The letters behind `name=`, in any case.
fn tag<'t>(text: &'t [u8], name: &'static str) -> Option<&'t str> {
    tags(text, name).next().map(|(_, value)| value)
}

/// All `name=` with the letters behind them, and where they are; the name is a word of its own.
fn tags<'t>(text: &'t [u8], name: &'static str) -> impl Iterator<Item = (Range<usize>, &'t str)> {
    let is_word = |byte: &u8| byte.is_ascii_alphanumeric() || *byte == b'_';
    let starts = 0..text.len().saturating_sub(name.len());
    let starts = starts.filter(move |&at| {
        let end = at + name.len();
        let begins = at == 0 || !is_word(&text[at - 1]);
        begins && text[at..end].eq_ignore_ascii_case(name.as_bytes()) && text[end] == b'='
    });
    starts.filter_map(move |at| {
        let value = &text[at + name.len() + 1..];
        let letters = value.iter().take_while(|byte| byte.is_ascii_alphabetic());
        let letters = letters.count();
        let end = at + name.len() + 1 + letters;
        Some((at..end, std::str::from_utf8(&value[..letters]).ok()?))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tags_of_other_programs_are_read() {
        let ras = |unit| Space {
            frame: Frame::Ras,
            unit,
        };
        for (text, expected) in [
            ("3D Slicer output. SPACE=LPS", Space::PATIENT),
            ("Exported by ITK-SNAP; SPACE=RAS;", ras(Unit::Millimetre)),
            ("space=ras UNIT=m", ras(Unit::Metre)),
            ("SPACE=RAS unit=furlong", ras(Unit::Unknown)),
            ("MYSPACE=LPS", Space::default()),
            ("SPACE=LPSX", Space::default()),
            ("SPACE=", Space::default()),
            ("SPACE", Space::default()),
            ("", Space::default()),
        ] {
            assert_eq!(Space::from_tags(text.as_bytes()), expected, "{text}");
        }
    }

    #[test]
    fn tags_are_read_as_they_were_written() {
        for frame in Frame::ALL {
            for unit in Unit::ALL {
                let space = Space { frame, unit };
                let text = space.tags().collect::<Vec<_>>().join(" ");
                let read = Space::from_tags(text.as_bytes());
                let implied = frame != Frame::Unknown && unit == Unit::Unknown;
                let unit = if implied { Unit::Millimetre } else { unit };
                assert_eq!(read, Space { frame, unit }, "{text}");
                assert_eq!(serde_json::to_value(frame).unwrap(), frame.name());
                assert_eq!(serde_json::to_value(unit).unwrap(), unit.name());
            }
        }
    }

    #[test]
    fn half_a_turn_leads_from_one_frame_to_the_other() {
        assert_eq!(Frame::Lps.turn(Frame::Ras), Some([-1.0, -1.0, 1.0]));
        assert_eq!(Frame::Ras.turn(Frame::Lps), Some([-1.0, -1.0, 1.0]));
        assert_eq!(Frame::Ras.turn(Frame::Ras), Some([1.0; 3]));
        assert_eq!(Frame::Unknown.turn(Frame::Ras), None);
        assert_eq!(Frame::Ras.turn(Frame::Unknown), None);
    }
}
