//! From a field to the closed mesh of its zero set.

use super::error::Error;
use super::vector::Vec3;

/// A scalar field on R³: positive inside, zero on the surface.
pub trait Field {
    /// Writes f at each of `points` into `values`, which has the same length.
    ///
    /// # Errors
    /// What the engine behind the field reports.
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error>;

    /// The same, and ∇f into `gradients`.
    ///
    /// # Errors
    /// What the engine behind the field reports.
    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error>;
}
