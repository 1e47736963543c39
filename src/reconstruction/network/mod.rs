//! The network f: R³ → R: its shape, its first weights, and the engines that evaluate it.
//!
//! Parameters are one flat vector in the order of [`Architecture::layers`]: the optimiser sees
//! nothing but this vector, so it knows neither layers nor tensors.

mod architecture;
mod initialisation;
mod libtorch;
mod model;
mod plain;
mod scalar;

pub use architecture::{Architecture, Layer};
pub use initialisation::initial_parameters;
pub use libtorch::Libtorch;
pub use model::{Model, ModelError};
pub use plain::PlainNetwork;
pub use scalar::Scalar;

use super::error::Error;
use super::surface::Field;

/// Evaluates a network of one architecture over fixed training and validation samples.
///
/// `Libtorch` is the reference that any other implementation is tested against.
pub trait Engine<T: Scalar> {
    /// Shape of the network.
    fn architecture(&self) -> &Architecture;

    /// Number of training samples.
    fn training_samples(&self) -> usize;

    /// Number of validation samples; 0 without a hold-out.
    fn validation_samples(&self) -> usize;

    /// L = 1/n Σ wᵢ (f(pᵢ) - yᵢ)² over the training samples, and ∂L/∂parameters into `gradient`,
    /// which is as long as `parameters`. Neither needs to be finite.
    ///
    /// # Errors
    /// What the engine reports, such as lengths that do not fit the architecture.
    fn loss_and_gradient(&self, parameters: &[T], gradient: &mut [T]) -> Result<f64, Error>;

    /// L over the validation samples; `None` without a hold-out.
    ///
    /// # Errors
    /// As for [`Self::loss_and_gradient`].
    fn validation_loss(&self, parameters: &[T]) -> Result<Option<f64>, Error>;

    /// The network with these parameters as a field over the coordinates it is trained in.
    ///
    /// # Errors
    /// As for [`Self::loss_and_gradient`].
    fn field(&self, parameters: &[T]) -> Result<Box<dyn Field + '_>, Error>;
}
