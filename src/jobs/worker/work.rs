//! The work on a job: reconstruction, or a substitute in tests.

use std::io;

use serde_json::Value;

use crate::jobs::{Cloud, FailureReason, Fault, LocalFile, NewMesh, Problem};
use crate::reconstruction::medical::Choice;
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::mesh::write::{Format, write};
use crate::reconstruction::{Error, Event, Input, Observer, Settings, cloud, reconstruct};

/// Does the work of one attempt, on a thread of its own.
pub type Work = dyn Fn(&Assignment, &dyn Observer) -> Result<Product, Failure> + Send + Sync;

/// What a job works on.
#[derive(Debug)]
pub struct Assignment {
    /// The cloud as its row has it.
    pub cloud: Cloud,
    /// The file with its bytes.
    pub file: LocalFile,
    /// Complete settings.
    pub settings: Settings,
    /// Which part of the file is meant, where it has several.
    pub source: Option<Choice>,
}

/// What a job gives.
#[derive(Debug, Clone)]
pub struct Product {
    /// The surface, in the coordinates of the input.
    pub mesh: TriangleMesh,
    /// The quality report: a JSON object.
    pub report: Value,
    /// The trained network as a file.
    pub model: Vec<u8>,
}

/// Why there is no product.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// The observer asked to stop.
    Stopped,
    /// Another attempt would fail the same way.
    Final(Problem),
    /// Another attempt may go better.
    Transient(FailureReason),
}

impl Failure {
    /// A defect of ours, or of the machine.
    #[expect(clippy::needless_pass_by_value, reason = "for `map_err`")]
    pub(super) fn internal(detail: impl ToString) -> Self {
        Self::Transient(FailureReason::Internal {
            detail: detail.to_string(),
        })
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        match &error {
            Error::Cancelled | Error::Interrupted => Self::Stopped,
            error if error.code() == "internal" => Self::internal(error),
            Error::Settings(settings) => {
                let faults = settings.violations().iter().map(|violation| Fault {
                    pointer: violation.pointer.clone(),
                    detail: violation.detail.clone(),
                });
                Self::Final(Problem {
                    errors: faults.collect(),
                    ..Problem::new(error.code(), error.to_string())
                })
            }
            error => Self::Final(Problem::new(error.code(), error.to_string())),
        }
    }
}

/// The work of the service: reads the cloud and reconstructs its surface.
///
/// # Errors
/// [`Failure`], sorted by whether another attempt can help.
pub fn reconstruction(
    assignment: &Assignment,
    observer: &dyn Observer,
) -> Result<Product, Failure> {
    let file = &assignment.file;
    let unread = |error| Failure::internal(format!("{}: {error}", file.path().display()));
    let bytes = file.read().map_err(unread)?;
    // The upload checked the file against the operator's limits.
    let limits = cloud::Limits {
        max_points: usize::MAX,
        max_expanded_bytes: usize::MAX,
        max_expansion: f64::INFINITY,
    };
    let options = cloud::Options {
        // The upload found it, perhaps by the file name, which is not stored.
        hint: Some(assignment.cloud.summary.format),
        limits: &limits,
        // Whoever uploaded the file had to allow it.
        assume_orientation: true,
    };
    let (points, mut source) =
        cloud::read_part(&bytes, &options, assignment.source.as_ref()).map_err(Error::from)?;
    if assignment.cloud.summary.keeps_identifiers {
        source.identifiers = cloud::identifiers(&bytes, &limits).map_err(Error::from)?;
    }
    drop(bytes);
    for warning in &source.warnings {
        observer.event(Event::Warning(warning));
    }
    let mut result = reconstruct(&points, &assignment.settings, observer)?;
    let input = Input {
        name: String::new(),
        sha256: assignment.cloud.sha256.clone(),
        bytes: assignment.cloud.bytes,
        points: points.points.len(),
    };
    let mesh = &result.mesh;
    result.report.read_from(vec![input], source, mesh);
    Ok(Product {
        mesh: result.mesh,
        report: serde_json::to_value(&result.report).map_err(Failure::internal)?,
        model: result.model.encode().map_err(Failure::internal)?,
    })
}

/// No attempt finds what somebody has removed.
pub(super) fn cloud_missing() -> Failure {
    Failure::Final(Problem::new(
        "cloud_missing",
        "the bytes of the cloud are not where they were put any more; upload the cloud again",
    ))
}

/// A mesh in the encoding that is stored.
pub(super) fn encode(mesh: &TriangleMesh) -> io::Result<NewMesh> {
    let mut data = Vec::new();
    write(mesh, Format::PlyBinary, &mut data)?;
    Ok(NewMesh::new(
        mesh.vertices.len() as u64,
        mesh.triangles.len() as u64,
        data,
    ))
}
