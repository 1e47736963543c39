//! The network f: R³ → R: its shape, its first weights, and the engines that evaluate it.
//!
//! Parameters are one flat vector in the order of [`Architecture::layers`]: the optimiser sees
//! nothing but this vector, so it knows neither layers nor tensors.

mod architecture;
mod ensemble;
mod fused;
mod initialisation;
mod libtorch;
mod output_layer;
mod plain;
mod scalar;

pub use architecture::{Architecture, Layer};
pub use ensemble::{Ensemble, MeanField};
pub use fused::{Fused, Threads, instruction_sets};
pub(super) use fused::{TILE_POINTS, vector_width};
pub use initialisation::initial_parameters;
pub use libtorch::Libtorch;
pub use output_layer::OutputEquations;
pub use plain::PlainNetwork;
pub use scalar::Scalar;

use super::error::Error;
use super::sampling::Samples;
use super::settings;
use super::surface::Field;

/// Evaluates networks of one architecture, one at a time, over fixed training samples.
///
/// `Libtorch` is the reference that any other implementation is tested against.
pub trait Engine<T: Scalar> {
    /// Its name in settings and reports.
    fn name(&self) -> &'static str;

    /// Shape of the network.
    fn architecture(&self) -> &Architecture;

    /// Number of training samples.
    fn training_samples(&self) -> usize;

    /// L = 1/n Σ wᵢ (f(pᵢ) - yᵢ)² over the training samples, and ∂L/∂parameters into `gradient`,
    /// which is as long as `parameters`. Neither needs to be finite. One-sided samples that f
    /// passes ([`Samples::free_range`]) add nothing.
    ///
    /// # Errors
    /// What the engine reports, such as lengths that do not fit the architecture.
    fn loss_and_gradient(&self, parameters: &[T], gradient: &mut [T]) -> Result<f64, Error>;

    /// The same once the output layer of `parameters` is set to what makes L + `decay`/2 |c|² least, where c are its
    /// parameters and no sample is one-sided.
    ///
    /// # Errors
    /// As for [`Self::loss_and_gradient`].
    fn solved_loss_and_gradient(
        &self,
        parameters: &mut [T],
        gradient: &mut [T],
        decay: f64,
    ) -> Result<f64, Error> {
        solve_then_evaluate(self, parameters, gradient, decay)
    }

    /// The normal equations of the output layer over the training samples, none of which is one-sided.
    ///
    /// # Errors
    /// As for [`Self::loss_and_gradient`].
    fn output_equations(&self, parameters: &[T]) -> Result<OutputEquations, Error>;

    /// The network with these parameters as a field over the coordinates it is trained in.
    ///
    /// # Errors
    /// As for [`Self::loss_and_gradient`].
    fn field(&self, parameters: &[T]) -> Result<Box<dyn Field + '_>, Error>;
}

/// The output layer first, then the loss: [`Engine::solved_loss_and_gradient`] in two steps.
fn solve_then_evaluate<T: Scalar, E: Engine<T> + ?Sized>(
    engine: &E,
    parameters: &mut [T],
    gradient: &mut [T],
    decay: f64,
) -> Result<f64, Error> {
    let solution = engine.output_equations(parameters)?.solve(decay);
    output_layer::set_output_layer(engine.architecture(), parameters, solution);
    engine.loss_and_gradient(parameters, gradient)
}

/// The engine that the settings ask for, over these samples.
///
/// # Errors
/// [`settings::Error::Conflict`] where `fused` is asked for and has not the scheme or the precision,
/// which [`settings::Settings::resolve`] refuses; when libtorch refuses a tensor.
pub fn engine<T: Scalar>(
    choice: settings::Engine,
    architecture: &Architecture,
    samples: &Samples,
) -> Result<Box<dyn Engine<T>>, Error> {
    engine_with(choice, architecture, samples, Threads::All)
}

/// The same on the calling thread alone, for networks that are fitted side by side.
///
/// # Errors
/// As for [`engine`].
pub fn sequential_engine<T: Scalar>(
    choice: settings::Engine,
    architecture: &Architecture,
    samples: &Samples,
) -> Result<Box<dyn Engine<T>>, Error> {
    engine_with(choice, architecture, samples, Threads::One)
}

fn engine_with<T: Scalar>(
    choice: settings::Engine,
    architecture: &Architecture,
    samples: &Samples,
    threads: Threads,
) -> Result<Box<dyn Engine<T>>, Error> {
    let libtorch = || Libtorch::new(architecture.clone(), samples);
    let fused = || T::fused(architecture, samples, threads);
    Ok(match choice {
        settings::Engine::Libtorch => Box::new(libtorch()?),
        settings::Engine::Fused => fused().ok_or_else(|| {
            settings::Error::conflict("/training/engine", settings::NO_FUSED_ENGINE)
        })?,
        settings::Engine::Auto => match fused() {
            Some(fused) => fused,
            None => Box::new(libtorch()?),
        },
    })
}
