//! Fitting the networks of all blocks, several at a time.

use std::cell::Cell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use serde::{Deserialize, Serialize};

use super::block::Block;
use super::samples::Places;
use crate::reconstruction::error::Error;
use crate::reconstruction::network::{Scalar, initial_parameters, sequential_engine};
use crate::reconstruction::observer::{Event, Observer};
use crate::reconstruction::plan::{BlockPlan, Plan};
use crate::reconstruction::sampling::{Samples, Uncertainty};
use crate::reconstruction::surface::Field;
use crate::reconstruction::training::{Hooks, Identity, Problem, Termination, train};
use crate::reconstruction::vector::Vec3;

/// What all blocks share.
pub(super) struct Task<'a> {
    pub(super) blocks: &'a [Block],
    pub(super) places: &'a Places,
    pub(super) plan: &'a Plan<'a>,
    pub(super) planned: &'a BlockPlan,
    /// Points that no block is fitted to, and which of them are in the reach of each.
    pub(super) held_out: &'a [Vec3],
    pub(super) held_out_of: &'a [Vec<u32>],
    /// What the coarse field says of their distances; nothing where the blocks are not told.
    pub(super) held_out_coarse: &'a [f64],
    /// How far the points of the cloud can be trusted, in the frame of the run.
    pub(super) uncertainty: Uncertainty,
}

impl Task<'_> {
    /// How far the points of a block can be trusted.
    fn uncertainty(&self, block: &Block) -> Uncertainty {
        Uncertainty {
            spacing: block.spacing(),
            band: block.band,
            sparse: false,
            ..self.uncertainty
        }
    }
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

/// Networks of blocks, where they are fitted.
pub(super) type Done<T> = Vec<Option<Fitted<T>>>;

/// Fits the blocks that are not `done`, on all threads of the pool; after each that the calling thread has fitted,
/// `told` hears of what is done so far, and at the end of whether it was stopped. A block is the same whatever else is
/// fitted beside it.
///
/// # Errors
/// [`Error::Cancelled`] where the observer stops the run; what an engine reports.
pub(super) fn fit<T: Scalar>(
    task: &Task<'_>,
    done: Done<T>,
    observer: &dyn Observer,
    told: &mut dyn FnMut(&Done<T>, bool),
) -> Result<Done<T>, Error> {
    let open: Vec<usize> = (0..done.len()).filter(|&k| done[k].is_none()).collect();
    let next = AtomicUsize::new(0);
    let stop = AtomicBool::new(false);
    let done = Mutex::new(done);
    let failure = Mutex::new(None);
    let work = |watch: &dyn Observer| -> bool {
        let Some(&k) = open.get(next.fetch_add(1, Ordering::Relaxed)) else {
            return false;
        };
        match fit_block(task, k, watch) {
            Ok(fitted) => lock(&done)[k] = Some(fitted),
            Err(error) => {
                stop.store(true, Ordering::Relaxed);
                lock(&failure).get_or_insert(error);
            }
        }
        !stop.load(Ordering::Relaxed)
    };
    rayon::in_place_scope(|scope| {
        for _ in 1..rayon::current_num_threads() {
            scope.spawn(|_| while work(&Flag(&stop)) {});
        }
        let watch = Watch {
            observer,
            stop: &stop,
        };
        while work(&watch) {
            told(&lock(&done), false);
        }
    });
    told(&lock(&done), stop.load(Ordering::Relaxed));
    match failure.into_inner().unwrap_or_default() {
        Some(error) => Err(error),
        None => Ok(done.into_inner().unwrap_or_default()),
    }
}

/// Mean square of what the field leaves of the targets at these points.
fn mean_square(field: &dyn Field, points: &[Vec3], targets: &[f64]) -> Result<f64, Error> {
    let mut values = vec![0.0; points.len()];
    field.values(points, &mut values)?;
    let squares = values.iter().zip(targets).map(|(f, y)| (f - y).powi(2));
    Ok(squares.sum::<f64>() / points.len().max(1) as f64)
}

fn lock<V>(mutex: &Mutex<V>) -> std::sync::MutexGuard<'_, V> {
    mutex
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn fit_block<T: Scalar>(
    task: &Task<'_>,
    k: usize,
    observer: &dyn Observer,
) -> Result<Fitted<T>, Error> {
    let (settings, planned) = (task.plan.settings, task.planned);
    let block = &task.blocks[k];
    let uncertainty = task.uncertainty(block);
    let weight = uncertainty.surface_weight();
    let targets = settings.sampling.targets;
    let (samples, count) = task.places.of(k, block, targets, weight);
    let on_surface = (&samples.points[..count], &samples.targets[..count]);
    let engine = sequential_engine::<T>(task.plan.engine, &planned.architecture, &samples)?;
    let decay = settings.training.smoothing * uncertainty.weight_decay(1);
    let problem = Problem {
        engine: engine.as_ref(),
        validation: &Samples::default(),
        weight_decay: decay / samples.len().max(1) as f64,
        output_layer: planned.training.output_layer,
    };
    let parameters = initial_parameters(&planned.architecture, planned.seed(k));
    let allowed = BlockPlan::allowed(uncertainty.spacing, uncertainty.noise).powi(2);
    let steps = Steps::new(observer);
    let hooks = Hooks {
        observer: &steps,
        snapshot: &mut |_, _| Ok(()),
        enough: &mut |evaluations, parameters| {
            Ok(
                evaluations.start / planned.round < evaluations.end / planned.round
                    && mean_square(&problem.field(parameters)?, on_surface.0, on_surface.1)?
                        * block.band.powi(2)
                        <= allowed,
            )
        },
        identity: Identity::default(),
    };
    let trained = train(problem, parameters, &planned.training, hooks)?;
    if trained.termination == Termination::Cancelled {
        return Err(Error::Cancelled);
    }
    let (held_out, left): (Vec<Vec3>, Vec<f64>) = task.held_out_of[k]
        .iter()
        .map(|&i| {
            let coarse = task.held_out_coarse.get(i as usize).copied();
            let place = block.frame.to_unit(task.held_out[i as usize]);
            (place, -coarse.unwrap_or_default() / block.band)
        })
        .unzip();
    let field = problem.field(&trained.parameters)?;
    let held_out = (!held_out.is_empty())
        .then(|| mean_square(&field, &held_out, &left))
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

/// Stops a block where another one has failed or the run ends.
struct Flag<'a>(&'a AtomicBool);

impl Observer for Flag<'_> {
    fn event(&self, _: Event<'_>) {}

    fn cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    fn seconds(&self) -> f64 {
        0.0
    }
}

/// The same on the thread that may ask the observer of the run.
struct Watch<'a> {
    observer: &'a dyn Observer,
    stop: &'a AtomicBool,
}

impl Observer for Watch<'_> {
    fn event(&self, _: Event<'_>) {}

    fn cancelled(&self) -> bool {
        if self.observer.cancelled() || self.observer.released() {
            self.stop.store(true, Ordering::Relaxed);
        }
        self.stop.load(Ordering::Relaxed)
    }

    fn seconds(&self) -> f64 {
        0.0
    }
}
