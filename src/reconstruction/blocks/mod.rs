//! Many networks, one field: where one network leaves more of a cloud than its noise explains, the cloud is cut
//! into blocks, and a small network is fitted to each.
//!
//! The one network, fitted to an even subset as far as it came, is the coarse field. It rules where no block does.

mod ahead;
mod block;
mod board;
mod checkpoint;
mod field;
mod fit;
mod input;
mod lookup;
mod misfit;
mod model;
mod partition;
mod samples;
mod series;
mod share;

use super::cloud::PointCloud;
use super::error::Error;
use super::mesher::Mesher;
use super::network::{Engine, Fused, Scalar, sequential_engine};
use super::observer::{Event, Observer};
use super::plan::{BlockPlan, Plan};
use super::random::{Purpose, stream};
use super::report::{BlocksReport, EachBlock};
use super::sampling::neighbours::median;
use super::sampling::selection::{Split, pick};
use super::sampling::{Frame, Prepared, Samples, Scan};
use super::settings::CoarseInput;
use super::surface::{Begun, Field};
use super::vector::Vec3;
use ahead::Ahead;
use board::Board;
use fit::{Between, Task};
use input::Fitted;
use lookup::Lookup;
use misfit::misfit;
use samples::{CoarseLengths, Places, members};
use series::Series;

pub use block::Block;
use field::{BlockField, Coarse};
pub use model::BlockModel;
pub use share::{ShareError, ShareRefusal, fit_share, processor};

pub(super) use checkpoint::State;

/// Whether the field of one network misses more of the points that it was not fitted to than `tolerated` times what
/// the plan tolerates in the end.
///
/// # Errors
/// What the field reports.
pub(super) fn needed(
    field: &dyn Field,
    prepared: &Prepared,
    scan: &Scan,
    tolerated: f64,
) -> Result<bool, Error> {
    let held_out = pick(&scan.surface.points, &scan.held_out);
    let found = misfit(field, &held_out, scan.band)?;
    let noise = scan.uncertainty.noise;
    let missed = if scan.uncertainty.tells_details() {
        let beyond_noise = (found.size.powi(2) - noise.powi(2)).max(0.0).sqrt();
        found.shared.max(beyond_noise)
    } else {
        found.shared
    };
    let spacing = median(&mut scan.surface.spacings.clone());
    let fitted = prepared.counts.surface as f64 / prepared.points as f64;
    let in_the_end = BlockPlan::tolerated(spacing, noise, fitted);
    Ok(missed > tolerated * in_the_end)
}

/// The networks of all blocks over a coarse one.
pub(super) struct Refined<T> {
    blocks: Vec<Block>,
    fitted: Vec<Fitted<T>>,
    /// Evaluates their networks.
    engine: Box<dyn Engine<T>>,
    coarse_band: f64,
    coarse_input: CoarseInput,
    /// Their surface, if it was begun.
    begun: Option<Begun>,
}

/// What is cut into blocks, and for what.
pub(super) struct Ground<'a> {
    pub(super) cloud: &'a PointCloud,
    pub(super) plan: &'a Plan<'a>,
    pub(super) scan: &'a Scan,
    pub(super) observer: &'a dyn Observer,
}

/// Cuts the cloud into blocks and fits them over the `coarse` field of the state; `prepared` tells of all the points from
/// then on. None where the plan has no blocks.
///
/// # Errors
/// [`Error::Cancelled`] where the observer stops the run; what an engine reports; where others help, as for
/// [`extract`](super::surface::extract).
pub(super) fn refine<T: Scalar>(
    ground: &Ground<'_>,
    prepared: &mut Prepared,
    (state, coarse): (&State<T>, &dyn Field),
) -> Result<Option<Refined<T>>, Error> {
    let &Ground {
        cloud,
        plan,
        scan,
        observer,
    } = ground;
    let Some(planned) = &plan.blocks else {
        return Ok(None);
    };
    let (settings, surface) = (plan.settings, &scan.surface);
    let mut choice = stream(settings.training.seed, Purpose::HeldOut);
    let split = Split::holding_out(&surface.points, planned.held_out, &mut choice);
    let fitted = &split.trained;
    let points = pick(&surface.points, fitted);
    let spacings = pick(&surface.spacings, fitted);
    let blocks = partition::partition(&points, &spacings, planned.count);
    let given = labelled(prepared, scan);
    let mut random = stream(settings.training.seed, Purpose::Blocks);
    let mut places = Places::new(&blocks, surface, fitted, &given, &mut random);
    let held_out = pick(&surface.points, &split.held_out);
    let mut held_out_coarse = Vec::new();
    if settings.network.coarse_input == CoarseInput::Residual {
        let coarse = CoarseLengths {
            field: coarse,
            band: scan.band,
        };
        places = places.over(&coarse)?;
        held_out_coarse = coarse.at(&held_out)?;
    }
    let lookup = Lookup::new(blocks.iter().map(|block| block.reach).collect());
    let nothing: Samples = [([0.0; 3], 0.0)].into_iter().collect();
    let engine = sequential_engine(plan.engine, &planned.architecture, &nothing)?;
    let task = Task {
        is_fused: engine.name() == Fused::NAME,
        held_out: &held_out,
        held_out_of: &members(&lookup, blocks.len(), &held_out),
        held_out_coarse: &held_out_coarse,
        blocks: &blocks,
        places: &places,
        plan,
        planned,
        uncertainty: scan.uncertainty,
    };
    let start = state.coarse.evaluations as f64 / settings.training.max_evaluations as f64;
    let done = if state.done.len() == blocks.len() {
        state.done.clone()
    } else {
        vec![None; blocks.len()]
    };
    let mut series = Series::new(&state.coarse, &done);
    let mut told = |board: &Board<T>, stopped: bool| {
        // Before the checkpoint, which says that they were told.
        series.tell(&board.done, observer);
        let share = board.fitted as f64 / board.done.len() as f64;
        observer.event(Event::Progress(start + (1.0 - start) * share));
        if observer.checkpoint_due() || stopped && observer.released() {
            observer.event(Event::Checkpoint {
                evaluation: state.coarse.evaluations,
                data: &state.encode(&board.done),
            });
        }
    };
    tell_of_all(prepared, scan, (&split, blocks.len()));
    let below = Coarse {
        field: Box::new(coarse),
        band: scan.band,
        input: settings.network.coarse_input,
    };
    let outline = Mesher::new(cloud, plan, prepared, observer).request(&|| false, &|_| ());
    let ahead = task.helpers(observer).is_some();
    let mut ahead = ahead
        .then(|| Ahead::new(outline, (&blocks, &lookup), engine.as_ref(), below))
        .transpose()?;
    let between = Between {
        told: &mut told,
        ahead: ahead.as_mut(),
    };
    let done = fit::fit(&task, done, observer, between)?;
    prepared.counts.near = places.generated();
    let begun = ahead.map(Ahead::begun);
    Ok(Some(Refined {
        blocks,
        fitted: done.into_iter().flatten().collect(),
        engine,
        coarse_band: scan.band,
        coarse_input: settings.network.coarse_input,
        begun,
    }))
}

/// Has `prepared` tell of all points, as they were split for so many blocks.
fn tell_of_all(prepared: &mut Prepared, scan: &Scan, (split, blocks): (&Split, usize)) {
    prepared.spacing = median(&mut pick(&scan.surface.spacings, &split.trained));
    prepared.counts.surface = split.trained.len();
    prepared.counts.held_out = split.held_out.len();
    prepared.surface = pick(&scan.indices, &split.trained);
    prepared.held_out = pick(&scan.indices, &split.held_out);
    prepared.blocks = blocks;
}

/// The places that the user labelled, with their signed distances.
fn labelled(prepared: &Prepared, scan: &Scan) -> Vec<(Vec3, f64)> {
    let counts = &prepared.counts;
    let labelled = counts.surface..counts.surface + counts.interior + counts.exterior;
    labelled
        .map(|i| {
            let place = prepared.training.points[i];
            let distance = scan.surface.distance(&scan.surface.place(place));
            (place, distance.copysign(prepared.training.targets[i]))
        })
        .collect()
}

impl<T: Scalar> Refined<T> {
    /// The field of the blocks over that of the `coarse` network.
    ///
    /// # Errors
    /// What an engine reports.
    pub(super) fn field<'a>(
        &'a self,
        coarse: Box<dyn Field + 'a>,
    ) -> Result<BlockField<'a>, Error> {
        let coarse = Coarse {
            field: coarse,
            band: self.coarse_band,
            input: self.coarse_input,
        };
        let networks = self.blocks.iter().zip(&self.fitted);
        let networks = networks.map(|(block, fitted)| (*block, &fitted.parameters[..]));
        BlockField::of_networks(coarse, self.engine.as_ref(), networks)
    }

    /// Their surface, if it was begun; once.
    pub(super) fn begun(&mut self) -> Option<Begun> {
        self.begun.take()
    }

    /// What the report says of them.
    pub(super) fn report(&self, frame: &Frame) -> BlocksReport {
        let count = self.fitted.len();
        let sum = |value: &dyn Fn(&Fitted<T>) -> f64| self.fitted.iter().map(value).sum::<f64>();
        let architecture = self.engine.architecture();
        BlocksReport {
            count,
            width: architecture.width,
            hidden_layers: architecture.hidden_layers,
            parameters: count * architecture.parameter_count(),
            evaluations: self.fitted.iter().map(|fitted| fitted.evaluations).sum(),
            loss: sum(&|fitted| fitted.loss) / count.max(1) as f64,
            each: self.each(frame),
        }
    }

    /// What the report says of each, in units of the input.
    fn each(&self, frame: &Frame) -> EachBlock {
        let mut each = EachBlock::default();
        for (block, fitted) in self.blocks.iter().zip(&self.fitted) {
            let length = |f: f64| frame.length_to_world(f * block.band);
            each.points.push(fitted.points);
            each.evaluations.push(fitted.evaluations);
            each.first_loss.push(fitted.first_loss);
            each.loss.push(fitted.loss);
            each.held_out_error
                .push(fitted.held_out.map(|square| length(square.sqrt())));
            each.termination.push(fitted.termination);
        }
        each
    }

    /// What is kept of the blocks.
    pub(super) fn model(&self) -> BlockModel {
        BlockModel {
            architecture: self.engine.architecture().clone(),
            coarse_band: self.coarse_band,
            coarse_input: self.coarse_input,
            blocks: self.blocks.clone(),
            parameters: self
                .fitted
                .iter()
                .flat_map(|fitted| fitted.parameters.iter().map(|p| p.to_f64()))
                .collect(),
        }
    }
}
