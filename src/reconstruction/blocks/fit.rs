//! Fitting the networks of all blocks, several at a time.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use super::ahead::Ahead;
use super::block::Block;
use super::board::{Board, Next};
use super::input::{BlockInput, Fitted};
use super::samples::Places;
use super::share::Share;
use crate::reconstruction::error::Error;
use crate::reconstruction::network::Scalar;
use crate::reconstruction::observer::{Event, Helpers, Observer};
use crate::reconstruction::plan::{BlockPlan, Plan};
use crate::reconstruction::sampling::Uncertainty;
use crate::reconstruction::training::Identity;
use crate::reconstruction::vector::Vec3;

/// What all blocks share.
pub(super) struct Task<'a> {
    pub(super) blocks: &'a [Block],
    pub(super) places: &'a Places<'a>,
    pub(super) plan: &'a Plan<'a>,
    pub(super) planned: &'a BlockPlan,
    /// Points that no block is fitted to, and which of them are in the reach of each.
    pub(super) held_out: &'a [Vec3],
    pub(super) held_out_of: &'a [Vec<u32>],
    /// What the coarse field says of their distances; nothing where the blocks are not told.
    pub(super) held_out_coarse: &'a [f64],
    /// How far the points of the cloud can be trusted, in the frame of the run.
    pub(super) uncertainty: Uncertainty,
    /// Whether the engine is the fused one.
    pub(super) is_fused: bool,
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

impl Task<'_> {
    /// Who may fit blocks of this run: the bits of the other engines depend on more than [`processor`] tells.
    ///
    /// [`processor`]: super::share::processor
    pub(super) fn helpers<'o>(&self, observer: &'o dyn Observer) -> Option<&'o dyn Helpers> {
        observer.helpers().filter(|_| self.is_fused)
    }

    /// Takes what helpers have fitted, chooses the shares that they want, and offers one that is ready: between one and the
    /// next the run tells how far it is, and hears whether it shall stop.
    fn exchange<T: Scalar>(&self, board: &Mutex<Board<T>>, helpers: &dyn Helpers) {
        while let Some((share, networks)) = helpers.fitted() {
            lock(board).take(share, &networks);
        }
        lock(board).choose(helpers.wanted());
        let ready = lock(board).ready();
        if let Some((share, blocks)) = ready {
            // Not in parallel: a thread that waits for others may begin one of their loops, and not come back.
            let blocks = blocks.into_iter().map(|k| self.input(k)).collect();
            let input = Share { blocks }.encode();
            if lock(board).offered(share, Identity::of(&input)) {
                helpers.offer(share, input);
            }
        }
    }
}

/// Networks of blocks, where they are fitted.
pub(super) type Done<T> = Vec<Option<Fitted<T>>>;

/// What the calling thread does between two blocks.
pub(super) struct Between<'a, 'b, T> {
    /// Hears of what is done so far, and at the end of whether the run was stopped.
    pub(super) told: &'a mut dyn FnMut(&Board<T>, bool),
    /// The surface, which goes on while others fit blocks.
    pub(super) ahead: Option<&'a mut Ahead<'b, T>>,
}

/// Fits the blocks that are not `done`, on all threads of the pool and with the helpers of the observer. A block is the
/// same whatever else is done beside it, and whoever fits it.
///
/// # Errors
/// [`Error::Cancelled`] where the observer stops the run; what an engine reports; as for
/// [`extract`](crate::reconstruction::surface::extract).
pub(super) fn fit<T: Scalar>(
    task: &Task<'_>,
    done: Done<T>,
    observer: &dyn Observer,
    Between { told, mut ahead }: Between<'_, '_, T>,
) -> Result<Done<T>, Error> {
    let helpers = task.helpers(observer);
    let stop = AtomicBool::new(false);
    let board = Mutex::new(Board::new(done));
    let failure = Mutex::new(None);
    let goes_on = |done: Result<(), Error>| {
        if let Err(error) = done {
            stop.store(true, Ordering::Relaxed);
            lock(&failure).get_or_insert(error);
        }
        !stop.load(Ordering::Relaxed)
    };
    let ask = |(share, block)| {
        task.places.ask(block);
        lock(&board).asked(share);
    };
    let work = |watch: &dyn Observer| -> bool {
        let Some(next) = lock(&board).next() else {
            return false;
        };
        goes_on(match next {
            Next::Places { .. } if watch.cancelled() => Err(Error::Cancelled),
            Next::Places { share, block } => {
                ask((share, block));
                Ok(())
            }
            Next::Fit { block, withdrawn } => {
                if let (Some(share), Some(helpers)) = (withdrawn, helpers) {
                    helpers.withdraw(share);
                }
                let fitted = task.input(block).fit(watch);
                fitted.map(|fitted| lock(&board).put(block, fitted))
            }
        })
    };
    let exchange = || {
        if let Some(helpers) = helpers {
            task.exchange(&board, helpers);
        }
    };
    let watch = Watch {
        observer,
        stop: &stop,
    };
    // What others wait for comes first.
    let attend = || {
        exchange();
        let next = || lock(&board).next_places();
        while !watch.cancelled()
            && let Some(places) = next()
        {
            ask(places);
            exchange();
        }
    };
    let others = rayon::current_num_threads() - 1;
    let at_work = AtomicUsize::new(0);
    rayon::in_place_scope(|scope| {
        for _ in 0..others {
            scope.spawn(|_| {
                at_work.fetch_add(1, Ordering::Relaxed);
                while work(&Flag(&stop)) {}
            });
        }
        exchange();
        while work(&watch) {
            exchange();
            told(&lock(&board), false);
            // The surface is made in parallel: a thread that waits for others there may begin one of the loops above, and not
            // come back.
            let may_wait = at_work.load(Ordering::Relaxed) == others;
            if let Some(ahead) = ahead.as_mut().filter(|_| may_wait)
                && let Some(ready) = ahead.ready(&board)
                && !goes_on(ahead.go_on(&ready, &|| watch.cancelled(), &attend))
            {
                break;
            }
        }
    });
    let board = board.into_inner().unwrap_or_else(PoisonError::into_inner);
    told(&board, stop.load(Ordering::Relaxed));
    match failure.into_inner().unwrap_or_default() {
        Some(error) => Err(error),
        None => Ok(board.done),
    }
}

pub(super) fn lock<V>(mutex: &Mutex<V>) -> std::sync::MutexGuard<'_, V> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
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
