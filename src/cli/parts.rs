//! Several parts of a medical file, each with a surface and files of its own.

use std::path::{Path, PathBuf};

use super::Failure;
use super::files::{PartArguments, read};
use crate::reconstruction::cloud::{self, Found};
use crate::reconstruction::medical::{Choice, Item};

/// What stands for the name and for the number of a part in the name of a file.
const MARKS: [&str; 2] = ["{name}", "{number}"];

/// A part that a surface is made of, with its names in files.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Part {
    number: i64,
    name: String,
}

impl Part {
    /// The part alone: its number says which it is, whatever the file calls its parts.
    pub(super) fn choice(&self) -> Choice {
        Choice::Label(self.number)
    }

    /// The path with the name and the number of the part.
    ///
    /// # Errors
    /// A path with neither, where all parts would be written over each other.
    pub(super) fn path(&self, path: &Path) -> Result<PathBuf, Failure> {
        let text = path.to_string_lossy();
        if !MARKS.iter().any(|mark| text.contains(mark)) {
            return Err(Failure::Usage(format!(
                "{text}: several parts need a file each; write {{name}} or {{number}} into its name, as in \
                 out/{{name}}.stl"
            )));
        }
        let number = self.number.to_string();
        Ok(PathBuf::from(
            text.replace(MARKS[0], &self.name)
                .replace(MARKS[1], &number),
        ))
    }
}

/// The parts of a file that are asked for, in the order of the file; none where it is one part or no choice at all.
///
/// # Errors
/// A file that cannot be read, and parts that it does not hold.
pub(super) fn several(path: &Path, asked: &PartArguments) -> Result<Option<Vec<Part>>, Failure> {
    let Some(choices) = asked.several() else {
        return Ok(None);
    };
    let bytes = read(path)?;
    let limits = cloud::Limits::default();
    let found = cloud::look(&bytes, &asked.options(path, &limits));
    let (found, _) = found.map_err(|error| Failure::cloud(path, &error))?;
    let Found::Slices(contents) = found else {
        let detail = "has no parts to choose from; leave the choice out";
        return Err(Failure::input(path, detail));
    };
    let chosen = contents.parts.chosen(&choices);
    let chosen = chosen.map_err(|error| Failure::cloud(path, &error))?;
    Ok(Some(named(&chosen)))
}

/// Names that a file can have, no two alike.
fn named(items: &[&Item]) -> Vec<Part> {
    let plain = |item: &Item| {
        let kept = |c: char| {
            if c.is_alphanumeric() || "-_".contains(c) {
                c
            } else {
                '_'
            }
        };
        let name = item
            .name
            .as_deref()
            .map(|name| name.chars().map(kept).collect::<String>());
        name.unwrap_or_else(|| item.number.to_string())
    };
    // Some disks take A and a for the same.
    let same = |a: &Item, b: &Item| plain(a).to_lowercase() == plain(b).to_lowercase();
    let part = |item: &&Item| {
        let number = item.number;
        let alone = items.iter().filter(|other| same(item, other)).count() == 1;
        let name = plain(item);
        Part {
            number,
            name: if alone {
                name
            } else {
                format!("{name}-{number}")
            },
        }
    };
    items.iter().map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::medical::{Kind, Parts};

    fn item(number: i64, name: Option<&str>, slices: u64) -> Item {
        Item {
            number,
            name: name.map(str::to_owned),
            color: None,
            voxels: None,
            contours: None,
            slices,
            volume_mm3: 1.0,
        }
    }

    #[test]
    fn parts_have_files_of_their_own() {
        let items = vec![
            item(1, Some("Lung/left"), 3),
            item(2, Some("lung left"), 3),
            item(3, None, 3),
            item(4, Some("Empty"), 0),
        ];
        let parts = Parts {
            kind: Kind::Segments,
            items,
        };
        let all = named(&parts.chosen(&[]).unwrap());
        let paths = all
            .iter()
            .map(|part| part.path(Path::new("out/{name}.stl")).unwrap());
        let paths: Vec<_> = paths.map(|path| path.display().to_string()).collect();
        assert_eq!(
            paths,
            ["out/Lung_left-1.stl", "out/lung_left-2.stl", "out/3.stl"]
        );
        let choices = [Choice::Label(3), Choice::Segment("Lung/left".to_owned())];
        let two = named(&parts.chosen(&choices).unwrap());
        let numbers: Vec<_> = two.iter().map(|part| part.number).collect();
        assert_eq!(numbers, [1, 3]);
        assert!(two[0].path(Path::new("out.stl")).is_err());
        let path = two[1].path(Path::new("{number}/mesh.ply")).unwrap();
        assert_eq!(path, Path::new("3/mesh.ply"));
    }
}
