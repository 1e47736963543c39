//! Fitting the network: L-BFGS, Adam, the loop around them, and what it tells.

mod adam;
mod checkpoint;
mod histogram;
mod holdout;
mod iterate;
mod lbfgs;
mod line_search;
mod linear_algebra;
mod method;
mod monitor;
mod pairs;
mod problem;
mod run;
mod series;

use serde::{Deserialize, Serialize};

pub use adam::Adam;
pub use checkpoint::Identity;
pub(super) use checkpoint::{Refusal, seal, unseal};
pub use iterate::{Interrupt, Iterate, Objective, Step};
pub use lbfgs::{Lbfgs, Options};
pub use monitor::{Enough, Hooks, Snapshot};
pub use problem::Problem;
pub use run::{Trained, train};
pub use series::{Column, csv};

/// Why training ended. Not converging is a result, not an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Termination {
    /// Every component of the gradient is within `tolerance_gradient`.
    ConvergedGradient,
    /// Loss or parameters change by no more than `tolerance_change`.
    ConvergedChange,
    /// `max_evaluations` were made.
    MaxEvaluations,
    /// `max_iterations` were made.
    MaxIterations,
    /// `time_limit_seconds` went by.
    TimeLimit,
    /// For `patience` evaluations the validation loss has not improved, or, without one, the loss has not
    /// fallen by 1 %.
    NoImprovement,
    /// The observer asked to stop.
    Cancelled,
    /// One network is not enough for the cloud: those of its blocks go on.
    HandedOver,
}

/// One accepted iteration of the optimiser; or where the fitting of blocks stands, all of the first ones together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Accepted iterations so far.
    pub iteration: u64,
    /// Evaluations of loss and gradient so far: what the figures of \[N24\] call epochs.
    pub evaluation: u64,
    /// Mean weighted squared error on the training samples, and the weight decay.
    pub loss: f64,
    /// The error alone, on the validation samples; none without a hold-out.
    pub validation_loss: Option<f64>,
    /// Euclidean norm of the gradient.
    pub gradient_norm: f64,
    /// Accepted step length along the search direction.
    pub step_length: f64,
    /// Frobenius norm of each layer's weights, input to output; gates after them. Of an ensemble, the root of
    /// the mean square over its members.
    pub weight_norms: Vec<f64>,
    /// The first so many blocks are fitted, and the numbers are those of all of them; none while the networks of the
    /// whole are trained.
    #[serde(default)]
    pub blocks: Option<u64>,
}

/// Distribution of the loss gradient over each layer's weights at one evaluation; over those of all members
/// of an ensemble.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GradientHistogram {
    /// Function evaluation at which it was taken.
    pub evaluation: u64,
    /// One histogram a layer.
    pub layers: Vec<LayerHistogram>,
}

/// Equal bins between the smallest and the largest component of one layer's gradient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LayerHistogram {
    /// Name of the layer, as in the parameter file: `linear.0`, …, `gate.0`, ….
    pub layer: String,
    /// Left edge of the first bin.
    pub min: f64,
    /// Right edge of the last bin.
    pub max: f64,
    /// Number of components in each bin.
    pub counts: Vec<u64>,
}
