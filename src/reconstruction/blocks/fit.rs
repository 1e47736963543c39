//! Fitting the networks of all blocks, several at a time.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::block::Block;
use super::input::{BlockInput, Fitted};
use super::samples::Places;
use crate::reconstruction::error::Error;
use crate::reconstruction::network::Scalar;
use crate::reconstruction::observer::{Event, Observer};
use crate::reconstruction::plan::{BlockPlan, Plan};
use crate::reconstruction::sampling::Uncertainty;
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

    /// All that the fit of block `k` depends on.
    fn input(&self, k: usize) -> BlockInput {
        let (settings, planned, block) = (self.plan.settings, self.planned, &self.blocks[k]);
        let uncertainty = self.uncertainty(block);
        let weight = uncertainty.surface_weight();
        let (samples, on_surface) = self.places.of(k, block, settings.sampling.targets, weight);
        let decay = settings.training.smoothing * uncertainty.weight_decay(1);
        let (held_out, held_out_targets) = self.held_out_of[k]
            .iter()
            .map(|&i| {
                let coarse = self.held_out_coarse.get(i as usize).copied();
                let place = block.frame.to_unit(self.held_out[i as usize]);
                (place, -coarse.unwrap_or_default() / block.band)
            })
            .unzip();
        BlockInput {
            precision: settings.network.precision,
            engine: self.plan.engine,
            architecture: planned.architecture.clone(),
            training: planned.training.clone(),
            seed: planned.seed(k),
            round: planned.round,
            weight_decay: decay / samples.len().max(1) as f64,
            allowed: BlockPlan::allowed(uncertainty.spacing, uncertainty.noise),
            band: block.band,
            samples,
            on_surface,
            held_out,
            held_out_targets,
        }
    }
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
        match task.input(k).fit(watch) {
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

fn lock<V>(mutex: &Mutex<V>) -> std::sync::MutexGuard<'_, V> {
    mutex
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
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
