//! What can go wrong in a reconstruction, each with a stable code.

use thiserror::Error;

use super::{cloud, settings};

/// Why no mesh came out.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// The input cannot be read or used.
    #[error(transparent)]
    Cloud(#[from] cloud::Error),
    /// The settings are out of bounds or contradict each other or the cloud.
    #[error(transparent)]
    Settings(#[from] settings::Error),
    /// The loss or its gradient stopped being finite.
    #[error(
        "training diverged at evaluation {evaluation}: {}; try a smaller training.learning_rate, \
         normalised coordinates or another scheme",
        not_finite(*loss)
    )]
    TrainingDiverged {
        /// Function evaluation at which it happened.
        evaluation: u64,
        /// The loss that was seen.
        loss: f64,
    },
    /// The trained field has no zero inside the grid, or nothing of it is supported by the points.
    #[error("the trained field has no surface: {0}")]
    NoSurface(String),
    /// The mesh would be larger than its limit.
    #[error("the mesh would have more than {limit} triangles; lower surface.resolution")]
    MeshTooLarge {
        /// Most triangles that are allowed.
        limit: usize,
    },
    /// The threads of the process are set already.
    #[error("{asked} threads are asked for, but this process was set to {set}")]
    Threads {
        /// Threads asked for.
        asked: usize,
        /// Threads set before.
        set: usize,
    },
    /// The observer asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// The observer asked to make room; training can go on from its last checkpoint.
    #[error("interrupted")]
    Interrupted,
    /// The tensor library refused an operation; a defect of ours or of the installation.
    #[error("libtorch: {0}")]
    Libtorch(#[from] tch::TchError),
}

impl Error {
    /// Stable `snake_case` name, the same in reports, logs and over HTTP.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Cloud(error) => error.code(),
            Self::Settings(error) => error.code(),
            Self::TrainingDiverged { .. } => "training_diverged",
            Self::NoSurface(_) => "no_surface",
            Self::MeshTooLarge { .. } => "mesh_too_large",
            Self::Cancelled => "cancelled",
            Self::Interrupted => "interrupted",
            Self::Threads { .. } | Self::Libtorch(_) => "internal",
        }
    }
}

fn not_finite(loss: f64) -> String {
    if loss.is_finite() {
        format!("the loss is {loss}, but its gradient is not finite")
    } else {
        format!("the loss is {loss}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn divergence_names_what_is_not_finite() {
        let said = |loss| {
            let evaluation = 7;
            Error::TrainingDiverged { evaluation, loss }.to_string()
        };
        assert!(said(f64::NAN).contains("evaluation 7: the loss is NaN; try"));
        assert!(said(3.5).contains("the loss is 3.5, but its gradient is not finite; try"));
    }
}
