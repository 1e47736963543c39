//! Which part of a file a surface is made of.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::contents::LONGEST_NAME;
use super::{Item, Kind, Parts};
use crate::reconstruction::cloud::Error;

/// Most items that a message lists.
const LISTED: usize = 8;

/// Most characters of a message for the list of items.
const ROOM: usize = 200;

/// A part of a file, named as the user knows it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Choice {
    /// Value of a label.
    Label(i64),
    /// Name or number of a segment.
    Segment(String),
    /// Name or number of a region of interest.
    Roi(String),
}

impl Choice {
    /// Reads the form `label:5`, `segment:Liver`, `roi:Heart`.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let form = "must have the form label:5, segment:NAME or roi:NAME";
        let (kind, what) = text.split_once(':').ok_or(form)?;
        match kind {
            _ if what.is_empty() => Err(form.to_owned()),
            "label" => {
                let value = what.parse();
                value
                    .map(Self::Label)
                    .map_err(|_| "the label must be a whole number".to_owned())
            }
            "segment" => Ok(Self::Segment(what.to_owned())),
            "roi" => Ok(Self::Roi(what.to_owned())),
            _ => Err(form.to_owned()),
        }
    }

    /// Reads one part or several: `label:1,3`, and `label:all`, which is every part of a file, whatever it is
    /// called, and gives an empty list. Names may have commas, so that a segment or a region stands alone.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse_several(text: &str) -> Result<Vec<Self>, String> {
        match text.strip_prefix("label:") {
            Some("all") => Ok(Vec::new()),
            Some(values) => {
                let one = |value: &str| Self::parse(&format!("label:{}", value.trim()));
                values.split(',').map(one).collect()
            }
            None => Self::parse(text).map(|choice| vec![choice]),
        }
    }

    fn chooses(&self, item: &Item) -> bool {
        match self {
            Self::Label(value) => item.number == *value,
            Self::Segment(name) | Self::Roi(name) => item.name.as_ref() == Some(name),
        }
    }

    fn by_number(&self, item: &Item) -> bool {
        match self {
            Self::Label(_) => false,
            Self::Segment(name) | Self::Roi(name) => name.parse() == Ok(item.number),
        }
    }
}

impl fmt::Display for Choice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Label(value) => write!(f, "label {value}"),
            Self::Segment(name) => write!(f, "segment {}", shown(name)),
            Self::Roi(name) => write!(f, "ROI {}", shown(name)),
        }
    }
}

impl Parts {
    /// The item that is chosen; without a choice the only one.
    ///
    /// # Errors
    /// [`Error::SourceMissing`] and [`Error::SourceUnknown`], both with what there is.
    pub fn choose(&self, choice: Option<&Choice>) -> Result<usize, Error> {
        let filled = |item: &Item| item.slices > 0;
        let Some(choice) = choice else {
            let mut all = self
                .items
                .iter()
                .enumerate()
                .filter(|(_, item)| filled(item));
            return match (all.next(), all.next()) {
                (Some((only, _)), None) => Ok(only),
                (None, _) => Err(Error::Slices("nothing is labelled".to_owned())),
                (Some(_), Some(_)) => Err(Error::SourceMissing(format!(
                    "the file holds {}; choose one",
                    self.listed()
                ))),
            };
        };
        let positions = |is: &dyn Fn(&Item) -> bool| -> Vec<usize> {
            let items = self.items.iter().enumerate();
            items.filter(|(_, item)| is(item)).map(|(i, _)| i).collect()
        };
        let mut found = positions(&|item| choice.chooses(item));
        if found.is_empty() {
            found = positions(&|item| choice.by_number(item));
        }
        match found[..] {
            [only] if filled(&self.items[only]) => Ok(only),
            [_] => Err(Error::SourceUnknown(format!("{choice} is empty"))),
            [] => Err(Error::SourceUnknown(format!(
                "there is no {choice}; the file holds {}",
                self.listed()
            ))),
            _ => Err(Error::SourceUnknown(format!(
                "{choice} is there {} times; choose by the number",
                found.len()
            ))),
        }
    }

    /// The items that are chosen, each once, in the order of the file; all that are not empty without a choice.
    ///
    /// # Errors
    /// As [`Parts::choose`].
    pub fn chosen(&self, choices: &[Choice]) -> Result<Vec<&Item>, Error> {
        let mut wanted = vec![false; self.items.len()];
        for choice in choices {
            wanted[self.choose(Some(choice))?] = true;
        }
        let items = self.items.iter().zip(wanted);
        let taken = items.filter(|(item, wanted)| *wanted || choices.is_empty() && item.slices > 0);
        Ok(taken.map(|(item, _)| item).collect())
    }

    /// The items in words, as far as a message has room.
    fn listed(&self) -> String {
        let one = |item: &Item| match &item.name {
            Some(name) => format!("{} ({})", item.number, shown(name)),
            None => item.number.to_string(),
        };
        let kind = match self.kind {
            Kind::Labels => "labels",
            Kind::Segments => "segments",
            Kind::Rois => "ROIs",
        };
        // Names are shown whole, and as many of them as a message has room for.
        let mut room = ROOM;
        let fits = |text: &String| {
            let fits = text.chars().count() <= room;
            room = room.saturating_sub(text.chars().count() + 2);
            fits
        };
        let first: Vec<_> = self
            .items
            .iter()
            .take(LISTED)
            .map(one)
            .take_while(fits)
            .collect();
        let more = match self.items.len().saturating_sub(first.len()) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        format!("the {kind} {}{more}", first.join(", "))
    }
}

/// A name as a message shows it: it may be anything. Those of a file are shown whole, as they are to be chosen by.
fn shown(name: &str) -> String {
    let mut clean = name.chars().filter(|c| !c.is_control());
    let mut shown: String = clean.by_ref().take(LONGEST_NAME).collect();
    if clean.next().is_some() {
        shown.push('…');
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts() -> Parts {
        let item = |number, name: &str, slices| Item {
            number,
            name: Some(name.to_owned()),
            color: None,
            voxels: None,
            contours: Some(1),
            slices,
            volume_mm3: 1.0,
        };
        let items = vec![item(1, "Heart", 3), item(2, "Lung", 4), item(3, "Lung", 4)];
        Parts {
            kind: Kind::Rois,
            items,
        }
    }

    #[test]
    fn a_choice_is_by_name_or_number() {
        let parts = parts();
        let choose = |text: &str| parts.choose(Some(&Choice::parse(text).unwrap()));
        assert_eq!(choose("roi:Heart").unwrap(), 0);
        assert_eq!(choose("roi:2").unwrap(), 1);
        assert_eq!(choose("label:3").unwrap(), 2);
        assert_eq!(choose("roi:Lung").unwrap_err().code(), "source_unknown");
        assert_eq!(choose("label:9").unwrap_err().code(), "source_unknown");
        assert_eq!(parts.choose(None).unwrap_err().code(), "source_missing");
    }

    #[test]
    fn several_are_taken_once_each_and_all_without_the_empty_ones() {
        let mut parts = parts();
        let numbers = |parts: &Parts, text: &str| {
            let chosen = parts.chosen(&Choice::parse_several(text).unwrap());
            let numbers =
                chosen.map(|items| items.iter().map(|item| item.number).collect::<Vec<_>>());
            numbers.map_err(|error| error.code())
        };
        assert_eq!(numbers(&parts, "label:3, 1,3"), Ok(vec![1, 3]));
        assert_eq!(numbers(&parts, "roi:Heart"), Ok(vec![1]));
        assert_eq!(numbers(&parts, "label:1,9"), Err("source_unknown"));
        parts.items[1].slices = 0;
        assert_eq!(numbers(&parts, "label:all"), Ok(vec![1, 3]));
        assert!(
            Choice::parse_several("label:1,").is_err() && Choice::parse_several("all").is_err()
        );
    }

    #[test]
    fn names_are_listed_whole_and_as_many_as_there_is_room_for() {
        let mut parts = parts();
        let long = "Left lung, lower lobe, segment VI";
        parts.items[1].name = Some(long.to_owned());
        let message = parts.choose(None).unwrap_err().to_string();
        assert!(message.contains(&format!("2 ({long})")), "{message}");
        for item in &mut parts.items {
            item.name = Some("x".repeat(LONGEST_NAME));
        }
        parts.items.extend(parts.items.clone());
        let message = parts.choose(None).unwrap_err().to_string();
        assert!(
            message.contains("and 4 more") && message.len() < 300,
            "{message}"
        );
        let unknown = Choice::Roi("y".repeat(1000));
        let message = parts.choose(Some(&unknown)).unwrap_err().to_string();
        assert!(message.contains("y…;"), "{message}");
    }

    #[test]
    fn other_forms_are_none() {
        for text in ["", "5", "label:", "label:x", "mask:1"] {
            assert!(Choice::parse(text).is_err(), "{text}");
        }
    }
}
