//! How meshes are written: format, frame and colours, checked before the work begins.

use std::io::{self, Write};
use std::path::Path;

use clap::{Args, ValueEnum};

use super::Failure;
use super::files::Sink;
use crate::reconstruction::Report;
use crate::reconstruction::cloud::PointCloud;
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::mesh::write::dicom::{self, Instance};
use crate::reconstruction::mesh::write::{self, Format, holds, write_colored};
use crate::reconstruction::space::Frame;

/// The frame that a mesh is asked for in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(super) enum Space {
    /// That of the cloud.
    #[default]
    Source,
    /// x to the left of the patient, y to the back, z to the head.
    Lps,
    /// x to the right of the patient, y to the front, z to the head.
    Ras,
}

/// What the vertices are coloured by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub(super) enum Colors {
    /// Nothing.
    #[default]
    None,
    /// Their distance to the points: dark blue on the points, yellow where the surface was guessed.
    Distance,
}

/// Arguments on how meshes are written.
#[derive(Debug, Args)]
pub(super) struct EncodingArguments {
    /// Format of the mesh, where the ending does not say it: ply, `ply_ascii`, obj, stl, off, glb, 3mf, vtp, dcm.
    #[arg(long, value_name = "FORMAT")]
    format: Option<String>,
    /// Frame of the mesh's coordinates: lps and ras turn it, where the cloud says its frame.
    #[arg(long, value_name = "FRAME", value_enum, default_value_t)]
    space: Space,
    /// Colours of the vertices, in PLY and GLB.
    #[arg(long, value_name = "COLORS", value_enum, default_value_t)]
    colors: Colors,
}

/// Format, frame and colours of meshes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Encoding {
    format: Format,
    space: Space,
    colors: Colors,
}

impl Encoding {
    /// The format that the arguments name; without a name binary PLY.
    pub(super) fn named(asked: &EncodingArguments) -> Result<Self, Failure> {
        let format = asked
            .format
            .as_deref()
            .map_or(Ok(Format::PlyBinary), named)?;
        Self::new(format, asked)
    }

    /// The format that the arguments name, or that of the ending of the file.
    pub(super) fn of(mesh: &Sink, asked: &EncodingArguments) -> Result<Self, Failure> {
        let (None, Some(name)) = (&asked.format, mesh.name()) else {
            return Self::named(asked);
        };
        let ending = Path::new(name).extension();
        let format = ending.and_then(|ending| Format::from_extension(&ending.to_string_lossy()));
        let format = format.ok_or_else(|| {
            Failure::Usage(format!(
                "{name}: the ending names no mesh format; use .ply, .obj, .stl, .off, .glb, .3mf, .vtp or \
                 .dcm, or --format"
            ))
        })?;
        Self::new(format, asked)
    }

    fn new(format: Format, asked: &EncodingArguments) -> Result<Self, Failure> {
        if asked.colors != Colors::None && !format.has_colors() {
            return Err(Failure::Usage(format!(
                "--colors: {} has no colours; use ply or glb",
                format.name()
            )));
        }
        Ok(Self {
            format,
            space: asked.space,
            colors: asked.colors,
        })
    }

    /// Ending of file names, without the dot.
    pub(super) fn extension(self) -> &'static str {
        self.format.extension()
    }

    /// Refuses a cloud whose mesh could not be written: `resolution` edges along its diagonal are as fine as
    /// a mesh can be; what it really has is looked at when it is written.
    pub(super) fn check(self, cloud: &PointCloud, resolution: usize) -> Result<(), String> {
        let needed = match (self.format, self.space) {
            (Format::Dicom, _) => Some("a DICOM file"),
            (_, Space::Source) => None,
            (..) => Some("--space"),
        };
        if let Some(what) = needed.filter(|_| cloud.space.frame == Frame::Unknown) {
            return Err(format!(
                "{what} needs the frame of the cloud, which the file does not say; a line \"comment SPACE=LPS\" \
                 in a PLY file does"
            ));
        }
        match cloud.bounds() {
            Some(bounds)
                if !holds(self.format, &bounds, bounds.diagonal() / resolution as f64) =>
            {
                Err(
                    "lies too far from the origin for the 32 bits of STL; write ply, obj, off or glb"
                        .to_owned(),
                )
            }
            _ => Ok(()),
        }
    }

    /// Writes a mesh; where the cloud was given with patient and study, a DICOM file takes them over.
    pub(super) fn write(
        self,
        mesh: &TriangleMesh,
        report: &Report,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let frame = match self.space {
            Space::Source => mesh.space.frame,
            Space::Lps => Frame::Lps,
            Space::Ras => Frame::Ras,
        };
        let turned = if frame == mesh.space.frame {
            None
        } else {
            // The frame was found to be known before.
            let turned = mesh.clone().in_frame(frame);
            Some(turned.ok_or(io::ErrorKind::InvalidInput)?)
        };
        let mesh = turned.as_ref().unwrap_or(mesh);
        if self.format != Format::Dicom {
            let colors = match self.colors {
                Colors::None => None,
                Colors::Distance => write::Colors::up_to(report.surface.support_distance),
            };
            return write_colored(mesh, self.format, colors, out);
        }
        let identifiers = report.identifiers.clone().unwrap_or_default();
        let instance = Instance {
            identifiers,
            ..Instance::of(mesh)
        };
        dicom::write(mesh, &instance, out)
    }
}

fn named(asked: &str) -> Result<Format, Failure> {
    Format::from_name(asked).ok_or_else(|| {
        let known = Format::ALL.map(Format::name).join(", ");
        Failure::Usage(format!("--format is {asked}, must be one of: {known}"))
    })
}
