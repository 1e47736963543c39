//! From points to training samples: frame, normals, winding number, off-surface samples, hold-out.

use super::vector::Vec3;

/// Points with targets and weights of the least-squares fit, in the frame of training.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Samples {
    /// Positions, `[n, 3]`.
    pub points: Vec<Vec3>,
    /// Targets, `[n]`.
    pub targets: Vec<f64>,
    /// Weights, `[n]`; 1 in [N24].
    pub weights: Vec<f64>,
}
