//! Golden traces: training runs of PyTorch that ours must repeat evaluation by evaluation.
//!
//! A trace is a pair of files, written by `make_reference.py`, which stands beside those of the
//! tests: a description with the loss at every evaluation (JSON), and samples, initial parameters,
//! first gradient and final prediction (safetensors, f64).

use safetensors::{Dtype, SafeTensorError, SafeTensors};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::network::{Architecture, Engine, Fused, Libtorch, Scalar};
use super::sampling::Samples;
use super::settings::Scheme;
use super::training::{Interrupt, Iterate, Lbfgs, Options};

/// Largest relative difference of a loss in a trace that passes. A relative change of the samples
/// by 1e-15 moves the losses by less than 1e-8, so that another order of summation stays within
/// this bound and a different rule of the optimiser does not.
pub const TOLERANCE: f64 = 1e-7;

/// First evaluations at which the fused engine is held against the trace: after more, the rounding
/// of f32 has grown into another path. It grows about tenfold every four evaluations, from where the
/// sums begin, whose order depends on the width of the processor's vectors: after 20, AVX-512 is off by
/// 6.3e-4 at most, AVX2 by 4.9e-2.
pub const FUSED_EVALUATIONS: usize = 10;

/// Largest relative difference of their losses that passes.
pub const FUSED_TOLERANCE: f64 = 1e-3;

/// The files of one trace, unread.
#[derive(Debug, Clone, Copy)]
pub struct Trace<'a> {
    /// File name without its ending.
    pub name: &'a str,
    /// Bytes of `NAME.json`.
    pub description: &'a [u8],
    /// Bytes of `NAME.safetensors`.
    pub tensors: &'a [u8],
}

/// How far our run is from the trace. Relative differences of arrays are by their largest
/// component.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TraceResult {
    /// Name of the trace.
    pub name: String,
    /// Evaluations that we made.
    pub evaluations: u64,
    /// Evaluations in the trace.
    pub expected_evaluations: u64,
    /// Largest relative difference of a loss.
    pub largest_relative_difference: f64,
    /// Relative difference of the gradient at the initial parameters.
    pub gradient_difference: f64,
    /// Relative difference of f at the samples in the end.
    pub prediction_difference: f64,
    /// Largest relative difference of a loss of the fused engine, in f32, over the first
    /// [`FUSED_EVALUATIONS`]; none where it has not the scheme.
    pub fused_difference: Option<f64>,
    /// Whether the number of evaluations is exact, every loss within [`TOLERANCE`], and those of the
    /// fused engine within [`FUSED_TOLERANCE`].
    pub passed: bool,
}

/// Why a trace cannot be checked.
#[derive(Debug, Error)]
pub enum Error {
    /// The description is not what the script writes.
    #[error("description of the trace: {0}")]
    Description(#[from] serde_json::Error),
    /// The file of tensors is damaged, or one is missing.
    #[error("tensors of the trace: {0}")]
    Tensors(#[from] SafeTensorError),
    /// A tensor has another type or size than the description asks for.
    #[error("tensor {name} of the trace: expected {expected} values of F64")]
    Shape {
        /// Name of the tensor.
        name: String,
        /// Values that it should have.
        expected: usize,
    },
    /// The network is empty or larger than any that the settings allow.
    #[error("network of the trace: width {width}, hidden_layers {hidden_layers}")]
    Network {
        /// Neurons of each hidden layer.
        width: usize,
        /// Number of hidden layers.
        hidden_layers: usize,
    },
    /// The run failed.
    #[error(transparent)]
    Run(#[from] super::Error),
}

#[derive(Debug, Deserialize)]
struct Description {
    scheme: Scheme,
    width: usize,
    hidden_layers: usize,
    learning_rate: f64,
    history: usize,
    tolerance_gradient: f64,
    tolerance_change: f64,
    max_iterations: u64,
    n_surface: usize,
    n_interior: usize,
    n_exterior: usize,
    function_evaluations: u64,
    losses: Vec<f64>,
}

impl Description {
    fn architecture(&self) -> Result<Architecture, Error> {
        let (width, hidden_layers) = (self.width, self.hidden_layers);
        if !(1..=512).contains(&width) || !(1..=32).contains(&hidden_layers) {
            return Err(Error::Network {
                width,
                hidden_layers,
            });
        }
        Ok(Architecture {
            scheme: self.scheme,
            width,
            hidden_layers,
            // The script puts the residual on hidden layers 1, 3, 5, ….
            residual_every: 2,
        })
    }
}

/// Repeats the run of a trace in f64 and compares.
///
/// # Errors
/// When the files cannot be read, or the run fails.
pub fn verify(trace: &Trace<'_>) -> Result<TraceResult, Error> {
    let expected: Description = serde_json::from_slice(trace.description)?;
    let tensors = Tensors(SafeTensors::deserialize(trace.tensors)?);
    let architecture = expected.architecture()?;
    let samples = tensors.samples(&expected)?;
    let initial = tensors.parameters(&architecture, "initial")?;
    let expected_gradient = tensors.parameters(&architecture, "gradient0")?;
    let expected_prediction = tensors.values("prediction_final", samples.points.len())?;

    let fused_difference = match Fused::new(architecture.clone(), &samples) {
        Some(engine) => {
            let initial = initial.iter().map(|p| *p as f32).collect();
            let (losses, _) = repeat(&engine, initial, &expected)?;
            Some(difference(losses.iter().take(FUSED_EVALUATIONS), &expected))
        }
        None => None,
    };
    let engine = Libtorch::<f64>::new(architecture, &samples)?;
    let mut gradient = vec![0.0; initial.len()];
    engine.loss_and_gradient(&initial, &mut gradient)?;
    let (losses, parameters) = repeat(&engine, initial, &expected)?;
    let mut prediction = vec![0.0; samples.points.len()];
    let field = engine.field(&parameters)?;
    field.values(&samples.points, &mut prediction)?;

    let largest_relative_difference = difference(losses.iter(), &expected);
    let evaluations = losses.len() as u64;
    let exact =
        evaluations == expected.function_evaluations && evaluations == expected.losses.len() as u64;
    Ok(TraceResult {
        name: trace.name.to_owned(),
        evaluations,
        expected_evaluations: expected.function_evaluations,
        largest_relative_difference,
        gradient_difference: relative_difference(&gradient, &expected_gradient),
        prediction_difference: relative_difference(&prediction, &expected_prediction),
        fused_difference,
        passed: exact
            && largest_relative_difference <= TOLERANCE
            && fused_difference.is_none_or(|difference| difference <= FUSED_TOLERANCE),
    })
}

/// Largest relative difference between losses and those of the trace.
fn difference<'a>(losses: impl Iterator<Item = &'a f64>, expected: &Description) -> f64 {
    let pairs = losses.zip(&expected.losses);
    largest(pairs.map(|(a, b)| (a - b).abs() / b.abs()))
}

/// The loss at every evaluation, and the parameters in the end.
fn repeat<T: Scalar>(
    engine: &dyn Engine<T>,
    initial: Vec<T>,
    expected: &Description,
) -> Result<(Vec<f64>, Vec<T>), super::Error> {
    let options = Options {
        learning_rate: expected.learning_rate,
        history: expected.history,
        tolerance_gradient: expected.tolerance_gradient,
        tolerance_change: expected.tolerance_change,
        max_iterations: expected.max_iterations,
        // As in the script.
        max_evaluations: expected.max_iterations.saturating_mul(25),
    };
    let mut losses = Vec::new();
    let mut objective = |parameters: &mut [T], gradient: &mut [T]| {
        let loss = engine.loss_and_gradient(parameters, gradient)?;
        losses.push(loss);
        Ok(loss)
    };
    let run = || {
        let mut lbfgs = Lbfgs::new(initial.len(), options, 1);
        let mut at = Iterate::new(initial, &mut objective)?;
        loop {
            match lbfgs.step(&mut at, &mut objective) {
                Ok(step) if step.termination.is_none() => {}
                Ok(_) | Err(Interrupt::Stop(_)) => return Ok(at.parameters),
                Err(failed) => return Err(failed),
            }
        }
    };
    match run() {
        Ok(parameters) => Ok((losses, parameters)),
        Err(Interrupt::Failed(error)) => Err(error),
        Err(Interrupt::Stop(_)) => Err(super::Error::Cancelled),
    }
}

struct Tensors<'a>(SafeTensors<'a>);

impl Tensors<'_> {
    fn values(&self, name: &str, expected: usize) -> Result<Vec<f64>, Error> {
        let tensor = self.0.tensor(name)?;
        let (values, rest) = tensor.data().as_chunks::<8>();
        if tensor.dtype() != Dtype::F64 || values.len() != expected || !rest.is_empty() {
            let name = name.to_owned();
            return Err(Error::Shape { name, expected });
        }
        Ok(values.iter().map(|v| f64::from_le_bytes(*v)).collect())
    }

    fn samples(&self, expected: &Description) -> Result<Samples, Error> {
        let counts = [expected.n_interior, expected.n_surface, expected.n_exterior];
        let count = counts.into_iter().fold(0, usize::saturating_add);
        let coordinates = self.values("samples", count.saturating_mul(3))?;
        let (points, _) = coordinates.as_chunks::<3>();
        Ok(Samples {
            points: points.to_vec(),
            targets: self.values("targets", count)?,
            one_sided: vec![false; count],
            weights: vec![1.0; count],
        })
    }

    /// The tensors of all layers whose names begin with `prefix`, in the order of our parameters.
    fn parameters(&self, architecture: &Architecture, prefix: &str) -> Result<Vec<f64>, Error> {
        let mut parameters = Vec::new();
        for layer in architecture.layers() {
            let name = format!("{prefix}.{}", layer.name);
            parameters.extend(self.values(&format!("{name}.weight"), layer.weight.len())?);
            parameters.extend(self.values(&format!("{name}.bias"), layer.bias.len())?);
        }
        Ok(parameters)
    }
}

fn relative_difference(values: &[f64], expected: &[f64]) -> f64 {
    let difference = values.iter().zip(expected).map(|(a, b)| (a - b).abs());
    largest(difference) / largest(expected.iter().map(|v| v.abs()))
}

/// The largest value; NaN if one is NaN.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |max, v| if v > max || v.is_nan() { v } else { max })
}
