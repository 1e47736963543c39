//! Fitting the networks of all blocks, several at a time.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use serde::{Deserialize, Serialize};

use super::block::Block;
use super::samples::Places;
use crate::reconstruction::error::Error;
use crate::reconstruction::network::{Architecture, Scalar, initial_parameters, sequential_engine};
use crate::reconstruction::observer::{Event, Observer};
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::settings::{Settings, Training};
use crate::reconstruction::surface::Field;
use crate::reconstruction::training::{Hooks, Identity, Problem, Termination, train};
use crate::reconstruction::vector::Vec3;

/// Pairs of L-BFGS: over 100 to 150 evaluations 15 did as well as 40.
const PAIRS: usize = 15;

/// What it may leave of its points, in spacings. Chosen on a ball with bumps.
const LEFT: f64 = 0.02;

/// What all blocks share.
pub(super) struct Task<'a> {
    pub(super) blocks: &'a [Block],
    pub(super) places: &'a Places,
    pub(super) architecture: &'a Architecture,
    pub(super) settings: &'a Settings,
    /// Weight of a point of the cloud in each block.
    pub(super) weights: &'a [f64],
    /// Weight decay of each block, times its samples.
    pub(super) decays: &'a [f64],
    /// Standard deviation of the points from the surface, in the frame of the run.
    pub(super) noise: f64,
}

impl Task<'_> {
    /// What the network of a block may leave of its points: their noise, and a share of their spacing.
    fn allowed(&self, block: &Block) -> f64 {
        self.noise.hypot(LEFT * block.spacing())
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

/// Mean square of the field at the points of the cloud.
fn left(field: &dyn Field, samples: &Samples) -> Result<f64, Error> {
    let points: Vec<Vec3> = (0..samples.len())
        .filter(|&i| samples.targets[i] == 0.0)
        .map(|i| samples.points[i])
        .collect();
    let mut values = vec![0.0; points.len()];
    field.values(&points, &mut values)?;
    Ok(values.iter().map(|f| f * f).sum::<f64>() / points.len().max(1) as f64)
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
    let settings = task.settings;
    let block = &task.blocks[k];
    let samples = task
        .places
        .of(k, block, settings.sampling.targets, task.weights[k]);
    let engine = sequential_engine::<T>(settings.training.engine, task.architecture, &samples)?;
    let problem = Problem {
        engine: engine.as_ref(),
        validation: &Samples::default(),
        weight_decay: task.decays[k] / samples.len().max(1) as f64,
        output_layer: settings.training.output_layer,
    };
    let seed = settings.training.seed.wrapping_add(1 + k as u64);
    let parameters = initial_parameters(task.architecture, seed);
    let round = settings.training.block_evaluations;
    let allowed = task.allowed(block).powi(2);
    let training = Training {
        max_evaluations: settings.training.most_block_evaluations(),
        history: PAIRS,
        patience: 0,
        time_limit_seconds: 0.0,
        histogram_evaluations: Vec::new(),
        snapshot_evaluations: Vec::new(),
        ..settings.training.clone()
    };
    let hooks = Hooks {
        observer,
        snapshot: &mut |_, _| Ok(()),
        enough: &mut |evaluations, parameters| {
            Ok(evaluations.start / round < evaluations.end / round
                && left(&problem.field(parameters)?, &samples)? * block.band.powi(2) <= allowed)
        },
        identity: Identity::default(),
    };
    let trained = train(problem, parameters, &training, hooks)?;
    if trained.termination == Termination::Cancelled {
        return Err(Error::Cancelled);
    }
    Ok(Fitted {
        parameters: trained.parameters,
        loss: trained.loss,
        evaluations: trained.evaluations,
        iterations: trained.iterations,
    })
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
