//! Files in and out: whole inputs, and outputs that are there completely or not at all.

use std::fs;
use std::io::{self, BufWriter, IsTerminal, Read, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Args;
use sha2::{Digest, Sha256};

use super::Failure;
use crate::reconstruction::Input;
use crate::reconstruction::cloud::{self, PointCloud};
use crate::reconstruction::medical::Choice;

/// Reads a whole file, or standard input for `-`.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    let bytes = if path == Path::new("-") {
        let mut bytes = Vec::new();
        io::stdin().lock().read_to_end(&mut bytes).map(|_| bytes)
    } else {
        fs::read(path)
    };
    bytes.map_err(|error| Failure::input(path, format!("cannot be read: {error}")))
}

/// Which part of a medical file is meant, and how it is understood.
#[derive(Debug, Clone, Default, Args)]
pub(super) struct PartArguments {
    /// Value of the label that a surface is made of, where a label map has several. Of several, as in 1,3, each gets
    /// a surface of its own, and of `all` every part of the file, whatever it is called; write {name} or {number}
    /// into --output and the like.
    #[arg(
        long,
        value_name = "VALUE",
        group = "part",
        value_delimiter = ',',
        allow_hyphen_values = true
    )]
    label: Vec<LabelArgument>,
    /// Name or number of the segment, where a segmentation has several; may be given many times.
    #[arg(long, value_name = "NAME", group = "part")]
    segment: Vec<String>,
    /// Name or number of the region of interest, where a structure set has several; may be given many times.
    #[arg(long, value_name = "NAME", group = "part")]
    roi: Vec<String>,
    /// Take a label map that does not say how it lies in the patient as it lies in its own axes.
    #[arg(long)]
    assume_orientation: bool,
    /// Take over patient and study of a DICOM file into the report and into a mesh that is written as DICOM.
    #[arg(long)]
    keep_identifiers: bool,
}

/// A label, or all parts of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LabelArgument {
    All,
    Value(i64),
}

impl FromStr for LabelArgument {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "all" => Ok(Self::All),
            value => value
                .parse()
                .map(Self::Value)
                .map_err(|_| "must be a whole number or all".to_owned()),
        }
    }
}

impl PartArguments {
    /// The same file with one part of it.
    pub(super) fn of(&self, choice: Choice) -> OnePart {
        OnePart {
            choice: Some(choice),
            assume_orientation: self.assume_orientation,
            keep_identifiers: self.keep_identifiers,
        }
    }

    /// The only part that is asked for, if any is.
    pub(super) fn one(&self) -> OnePart {
        OnePart {
            choice: self.choices().pop(),
            assume_orientation: self.assume_orientation,
            keep_identifiers: self.keep_identifiers,
        }
    }

    /// What is asked for where it is several parts; empty for all of them.
    pub(super) fn several(&self) -> Option<Vec<Choice>> {
        if self.label.contains(&LabelArgument::All) {
            return Some(Vec::new());
        }
        let choices = self.choices();
        (choices.len() > 1).then_some(choices)
    }

    fn choices(&self) -> Vec<Choice> {
        let labels = self.label.iter().filter_map(|label| match label {
            LabelArgument::All => None,
            LabelArgument::Value(value) => Some(Choice::Label(*value)),
        });
        let segments = self.segment.iter().cloned().map(Choice::Segment);
        let rois = self.roi.iter().cloned().map(Choice::Roi);
        labels.chain(segments).chain(rois).collect()
    }

    /// How a file is read.
    pub(super) fn options<'a>(&self, path: &Path, limits: &'a cloud::Limits) -> cloud::Options<'a> {
        options(path, limits, self.assume_orientation)
    }
}

/// One part of a file, or the only one, and how the file is understood.
#[derive(Debug, Clone, Default)]
pub(super) struct OnePart {
    choice: Option<Choice>,
    assume_orientation: bool,
    keep_identifiers: bool,
}

fn options<'a>(
    path: &Path,
    limits: &'a cloud::Limits,
    assume_orientation: bool,
) -> cloud::Options<'a> {
    let name = path.file_name().map(|name| name.to_string_lossy());
    cloud::Options {
        hint: name.as_deref().and_then(cloud::Format::from_extension),
        limits,
        assume_orientation,
    }
}

/// Reads a point cloud, with what the report records of its file.
pub(super) fn read_cloud(
    path: &Path,
    part: &OnePart,
) -> Result<(PointCloud, cloud::Source, Input), Failure> {
    let bytes = read(path)?;
    let name = path
        .file_name()
        .map(|name| name.to_string_lossy().into_owned());
    let limits = cloud::Limits::default();
    let options = options(path, &limits, part.assume_orientation);
    let refused = |error| Failure::cloud(path, &error);
    let read = cloud::read_part(&bytes, &options, part.choice.as_ref());
    let (cloud, mut source) = read.map_err(refused)?;
    if part.keep_identifiers {
        source.identifiers = cloud::identifiers(&bytes, &limits).map_err(refused)?;
    }
    let input = Input {
        name: name.unwrap_or_default(),
        sha256: hex::encode(Sha256::digest(&bytes)),
        bytes: bytes.len() as u64,
        points: cloud.points.len(),
    };
    Ok((cloud, source, input))
}

/// Where a result goes: a file, or standard output for `-`.
#[derive(Debug, Clone)]
pub(super) enum Sink {
    Stdout,
    File(PathBuf),
}

impl Sink {
    /// The sink that `-o` names. A file is made in its folder now, and dropped again: a run of
    /// minutes must not end with a result that has no place.
    pub(super) fn new(path: &Path) -> Result<Self, Failure> {
        if path == Path::new("-") {
            return Ok(Self::Stdout);
        }
        if path.is_dir() {
            return Err(Failure::Usage(format!("{}: is a folder", path.display())));
        }
        let folder = folder(path);
        if !folder.is_dir() {
            return Err(Failure::Usage(format!(
                "{}: there is no such folder",
                folder.display()
            )));
        }
        // A device or a pipe takes no place in its folder.
        if !path.exists() || path.is_file() {
            tempfile::tempfile_in(folder).map_err(|error| Failure::output(path, &error))?;
        }
        Ok(Self::File(path.to_owned()))
    }

    /// The ending of the file name; none on standard output.
    pub(super) fn name(&self) -> Option<&str> {
        match self {
            Self::Stdout => None,
            Self::File(path) => path.file_name().and_then(|name| name.to_str()),
        }
    }

    /// Writes through `write` beside the target, and renames only when all is on disk.
    pub(super) fn write(
        &self,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), Failure> {
        match self {
            Self::Stdout => {
                let mut out = BufWriter::new(io::stdout().lock());
                match write(&mut out).and_then(|()| out.flush()) {
                    // The reader had enough, as in `| head`.
                    Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
                    result => result.map_err(|error| Failure::output(Path::new("-"), &error)),
                }
            }
            Self::File(path) => {
                write_beside(path, write).map_err(|error| Failure::output(path, &error))
            }
        }
    }

    /// Whether binary data would go to a screen.
    pub(super) fn is_terminal(&self) -> bool {
        matches!(self, Self::Stdout) && io::stdout().is_terminal()
    }
}

fn folder(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

fn write_beside(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    // A device or a pipe (`-o /dev/null`) is written to; renaming would replace it.
    if path.exists() && !path.is_file() {
        let mut out = BufWriter::new(fs::OpenOptions::new().write(true).open(path)?);
        return write(&mut out).and_then(|()| out.flush());
    }
    let mut beside = tempfile::Builder::new();
    beside.prefix(".meshway-");
    #[cfg(unix)]
    {
        // As for any new file: readable by all, less the umask; temporary files are private.
        use std::os::unix::fs::PermissionsExt;
        beside.permissions(fs::Permissions::from_mode(0o666));
    }
    let file = beside.tempfile_in(folder(path))?;
    let mut out = BufWriter::new(file);
    write(&mut out)?;
    let file = out.into_inner().map_err(io::IntoInnerError::into_error)?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}
