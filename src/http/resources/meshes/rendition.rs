//! What is made of the mesh that is stored, for a download.

use std::io::{self, Write};

use time::OffsetDateTime;

use crate::folder::names::MASK;
use crate::jobs::Job;
use crate::reconstruction::mesh::read;
use crate::reconstruction::mesh::write::dicom::{self, Instance};
use crate::reconstruction::mesh::write::{Colors, Format, write_colored};
use crate::reconstruction::slices::{Grid, write_mask};
use crate::reconstruction::space::Frame;

/// How a mesh is written.
#[derive(Debug, Clone, Copy)]
pub(in crate::http) struct Look {
    pub(super) format: Format,
    /// None for the frame of the cloud.
    pub(super) frame: Option<Frame>,
    pub(super) colors: Option<Colors>,
}

impl Look {
    /// Whether the mesh has it as it is stored.
    pub(super) fn is_stored(self) -> bool {
        self.format == Format::PlyBinary && self.frame.is_none() && self.colors.is_none()
    }

    fn name(self) -> String {
        let mut name = self.format.name().to_owned();
        if let Some(frame) = self.frame {
            name = format!("{name}-{}", frame.name());
        }
        if let Some(colors) = self.colors {
            // To the last bit: two jobs with one mesh may have other scales.
            name = format!("{name}-colors{:016x}", colors.most().to_bits());
        }
        name
    }
}

/// What a mesh becomes.
#[derive(Debug, Clone)]
pub(in crate::http) enum Rendition {
    /// A file of a format, in a frame or as it is, with colours or without.
    Mesh(Look),
    /// A file for a picture archive.
    Dicom(Box<Instance>),
    /// A label map, under the name of its job.
    Mask(Grid, String),
}

impl Rendition {
    /// The mesh of an evaluation of a job, 0 for the result.
    pub(super) fn of(job: &Job, evaluation: u64, look: Look) -> Self {
        if look.format != Format::Dicom {
            return Self::Mesh(look);
        }
        let report = job.report.as_ref();
        let identifiers = report.and_then(|report| report.get("identifiers").cloned());
        let identifiers = identifiers.and_then(|value| serde_json::from_value(value).ok());
        let instance = Instance {
            series: job.id.to_string(),
            number: evaluation + 1,
            made: job.finished_at.map(date_and_time).unwrap_or_default(),
            identifiers: identifiers.unwrap_or_default(),
        };
        Self::Dicom(Box::new(instance))
    }

    /// What tells it from all others of the same mesh: the ending of its file, see
    /// [`is_encoding`](crate::folder::names::is_encoding).
    pub(super) fn name(&self) -> String {
        match self {
            Self::Mesh(look) => look.name(),
            Self::Dicom(instance) => format!("dcm-{}-{}", instance.series, instance.number),
            Self::Mask(_, job) => format!("{MASK}-{job}"),
        }
    }

    /// Writes it; `ply` is the mesh as it is stored.
    ///
    /// # Errors
    /// `InvalidInput` where the format cannot hold the mesh, or the mesh has no distances to colour it by, `Unsupported` where it cannot be turned into the frame.
    pub(super) fn write(&self, ply: &[u8], out: &mut dyn Write) -> io::Result<()> {
        let mesh = read::read(ply, None).map_err(io::Error::other)?;
        match self {
            Self::Mesh(look) => {
                let mesh = match look.frame {
                    None => mesh,
                    Some(frame) => mesh.in_frame(frame).ok_or_else(unknown_frame)?,
                };
                write_colored(&mesh, look.format, look.colors, out)
            }
            Self::Dicom(instance) => dicom::write(&mesh, instance, out),
            Self::Mask(grid, _) => {
                let mesh = mesh.in_frame(Frame::Lps).ok_or_else(unknown_frame)?;
                write_mask(&mesh, grid, out)
            }
        }
    }
}

fn unknown_frame() -> io::Error {
    io::Error::new(
        io::ErrorKind::Unsupported,
        "the cloud does not say its frame, so its mesh is given as source only",
    )
}

/// A time in milliseconds since the epoch, in the notation of DICOM, in UTC.
fn date_and_time(milliseconds: i64) -> (String, String) {
    let time = OffsetDateTime::from_unix_timestamp(milliseconds.div_euclid(1000));
    let time = time.unwrap_or(OffsetDateTime::UNIX_EPOCH);
    let (date, clock) = (time.date(), time.time());
    (
        format!(
            "{:04}{:02}{:02}",
            date.year(),
            u8::from(date.month()),
            date.day()
        ),
        format!(
            "{:02}{:02}{:02}",
            clock.hour(),
            clock.minute(),
            clock.second()
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::folder::names::is_encoding;

    #[test]
    fn times_are_those_of_dicom() {
        let (date, time) = date_and_time(1_795_312_345_678);
        assert_eq!((date.as_str(), time.as_str()), ("20261122", "015225"));
        assert_eq!(date_and_time(-1).0, "19691231");
    }

    #[test]
    fn files_are_known_by_their_names() {
        let grid = Grid {
            size: [1; 3],
            affine: [[0.0; 4]; 3],
        };
        let plain = Look {
            format: Format::Stl,
            frame: None,
            colors: None,
        };
        let colored = Look {
            format: Format::Glb,
            frame: Some(Frame::Ras),
            colors: Colors::up_to(0.1),
        };
        for rendition in [
            Rendition::Mesh(plain),
            Rendition::Mesh(colored),
            Rendition::Dicom(Box::default()),
            Rendition::Mask(grid, "job_0123".to_owned()),
        ] {
            let name = format!("{}.{}", "0123456789abcdef".repeat(4), rendition.name());
            assert!(is_encoding(&name), "{name}");
        }
    }
}
