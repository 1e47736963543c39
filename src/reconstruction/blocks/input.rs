//! What the fit of one block depends on, complete: wherever it is fitted, its network is the same.

use std::cell::Cell;

use serde::{Deserialize, Serialize};

use crate::reconstruction::error::Error;
use crate::reconstruction::network::{Architecture, Scalar, initial_parameters, sequential_engine};
use crate::reconstruction::observer::{Event, Observer};
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::settings::{Engine, Training};
use crate::reconstruction::surface::Field;
use crate::reconstruction::training::{Hooks, Identity, Problem, Termination, train};
use crate::reconstruction::vector::Vec3;

/// One block to be fitted, in the frame of its network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct BlockInput {
    pub(super) engine: Engine,
    pub(super) architecture: Architecture,
    pub(super) training: Training,
    /// Of the first weights.
    pub(super) seed: u64,
    /// Evaluations after which it is asked whether the network will do; each time.
    pub(super) round: u64,
    pub(super) weight_decay: f64,
    /// What the network may leave of the points, in the frame of the run.
    pub(super) allowed: f64,
    /// The band of the block, in the frame of the run.
    pub(super) band: f64,
    pub(super) samples: Samples,
    /// The first so many samples are points of the cloud.
    pub(super) on_surface: usize,
    /// Points that the block is not fitted to, and what its network should say there.
    pub(super) held_out: Vec<Vec3>,
    pub(super) held_out_targets: Vec<f64>,
}

/// The network of a block.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub(super) struct Fitted<T> {
    pub(super) parameters: Vec<T>,
    pub(super) loss: f64,
    pub(super) evaluations: u64,
    pub(super) iterations: u64,
    /// Points of the cloud that it was fitted to.
    pub(super) points: usize,
    /// Loss after the first step.
    pub(super) first_loss: f64,
    /// Norm of the gradient at the end.
    pub(super) gradient_norm: f64,
    /// Length of the last step.
    pub(super) step_length: f64,
    /// Mean square of the field at the points held out in its reach; none where there are none.
    pub(super) held_out: Option<f64>,
    pub(super) termination: Termination,
}

impl BlockInput {
    /// Whether its parts fit each other, so that a fit can begin.
    pub(super) fn is_sound(&self) -> bool {
        let (samples, shape) = (&self.samples, &self.architecture);
        let count = samples.points.len();
        let lengths = [
            samples.targets.len(),
            samples.weights.len(),
            samples.one_sided.len(),
        ];
        lengths.iter().all(|length| *length == count)
            && self.on_surface <= count
            && self.held_out.len() == self.held_out_targets.len()
            && self.round > 0
            && [shape.width, shape.hidden_layers, shape.residual_every]
                .iter()
                .all(|part| *part > 0)
    }

    /// Fits its network, on the calling thread.
    ///
    /// # Errors
    /// [`Error::Cancelled`] where the observer stops the fit; what an engine reports.
    pub(super) fn fit<T: Scalar>(&self, observer: &dyn Observer) -> Result<Fitted<T>, Error> {
        let (samples, count) = (&self.samples, self.on_surface);
        let on_surface = (&samples.points[..count], &samples.targets[..count]);
        let engine = sequential_engine::<T>(self.engine, &self.architecture, samples)?;
        let problem = Problem {
            engine: engine.as_ref(),
            validation: &Samples::default(),
            weight_decay: self.weight_decay,
            output_layer: self.training.output_layer,
        };
        let parameters = initial_parameters(&self.architecture, self.seed);
        let allowed = self.allowed.powi(2);
        let steps = Steps::new(observer);
        let hooks = Hooks {
            observer: &steps,
            snapshot: &mut |_, _| Ok(()),
            enough: &mut |evaluations, parameters| {
                Ok(
                    evaluations.start / self.round < evaluations.end / self.round
                        && mean_square(&problem.field(parameters)?, on_surface.0, on_surface.1)?
                            * self.band.powi(2)
                            <= allowed,
                )
            },
            identity: Identity::default(),
        };
        let trained = train(problem, parameters, &self.training, hooks)?;
        if trained.termination == Termination::Cancelled {
            return Err(Error::Cancelled);
        }
        let field = problem.field(&trained.parameters)?;
        let held_out = (!self.held_out.is_empty())
            .then(|| mean_square(&field, &self.held_out, &self.held_out_targets))
            .transpose()?;
        let [first_loss, gradient_norm, step_length] = steps.seen.get();
        Ok(Fitted {
            points: count,
            first_loss,
            gradient_norm,
            step_length,
            held_out,
            termination: trained.termination,
            parameters: trained.parameters,
            loss: trained.loss,
            evaluations: trained.evaluations,
            iterations: trained.iterations,
        })
    }
}

/// Mean square of what the field leaves of the targets at these points.
fn mean_square(field: &dyn Field, points: &[Vec3], targets: &[f64]) -> Result<f64, Error> {
    let mut values = vec![0.0; points.len()];
    field.values(points, &mut values)?;
    let squares = values.iter().zip(targets).map(|(f, y)| (f - y).powi(2));
    Ok(squares.sum::<f64>() / points.len().max(1) as f64)
}

/// Notes the steps of a block: its loss after the first, norm of the gradient and length of the last.
struct Steps<'a> {
    observer: &'a dyn Observer,
    seen: Cell<[f64; 3]>,
}

impl<'a> Steps<'a> {
    fn new(observer: &'a dyn Observer) -> Self {
        Self {
            observer,
            seen: Cell::new([f64::NAN; 3]),
        }
    }
}

impl Observer for Steps<'_> {
    fn event(&self, event: Event<'_>) {
        if let Event::Metrics(step) = event {
            let [first, ..] = self.seen.get();
            let first = if step.iteration == 1 {
                step.loss
            } else {
                first
            };
            self.seen.set([first, step.gradient_norm, step.step_length]);
        }
    }

    fn cancelled(&self) -> bool {
        self.observer.cancelled()
    }

    fn seconds(&self) -> f64 {
        0.0
    }
}
