//! Many networks, one field: where one network leaves more of a cloud than its noise explains, the cloud is cut
//! into blocks, and a small network is fitted to each.
//!
//! The one network, fitted to an even subset as far as it came, is the coarse field. It rules where no block does.

mod block;
mod checkpoint;
mod field;
mod fit;
mod lookup;
mod model;
mod partition;
mod samples;

use super::error::Error;
use super::network::{Architecture, Engine, Scalar, sequential_engine};
use super::observer::{Event, Observer};
use super::random::{Purpose, stream};
use super::report::BlocksReport;
use super::sampling::neighbours::median;
use super::sampling::{Prepared, Samples, Scan, Uncertainty, even_subset};
use super::settings::Settings;
use super::surface::Field;
use super::training::Identity;
use super::vector::{Vec3, norm};
use fit::{Done, Fitted, Task};
use samples::Places;

pub use block::Block;
use field::BlockField;
pub use model::BlockModel;

pub(super) use checkpoint::State;

/// Evaluations of the one network after which it is asked whether it will do, where the cloud has more points than
/// it is fitted to.
pub(super) const FIRST_LOOK: u64 = 150;

/// What one network may leave of a cloud, in spacings of its points. Chosen on the bunny and the hand of the bench.
const LEFT_OF_SPACING: f64 = 0.05;

/// What it may leave, over the noise.
const LEFT_OF_NOISE: f64 = 0.5;

/// Points that are held out of the blocks, at most: enough to tell the error of a mesh.
const HELD_OUT: usize = 2_500;

/// Whether the field of one network leaves more of the points that it was not fitted to than their noise explains.
///
/// # Errors
/// What the field reports.
pub(super) fn needed(
    field: &dyn Field,
    settings: &Settings,
    prepared: &Prepared,
    scan: &Scan,
) -> Result<bool, Error> {
    if settings.network.block_points == 0 || scan.indices.len() <= settings.network.block_points {
        return Ok(false);
    }
    let validation = &prepared.validation;
    let held_out: Vec<Vec3> = (0..validation.len())
        .filter(|&i| validation.targets[i] == 0.0)
        .map(|i| validation.points[i])
        .collect();
    if held_out.is_empty() {
        return Ok(false);
    }
    let mut values = vec![0.0; held_out.len()];
    let mut gradients = vec![[0.0; 3]; held_out.len()];
    field.values_and_gradients(&held_out, &mut values, &mut gradients)?;
    let squares = values.iter().zip(&gradients).map(|(f, slope)| {
        // Where the slope is that of no distance, the field is at its band or has not formed yet.
        let slope = norm(*slope).max(1.0 / scan.band);
        (f / slope).powi(2)
    });
    let variance = squares.sum::<f64>() / held_out.len() as f64;
    let noise = scan.uncertainty.noise;
    let left = (variance - noise * noise).max(0.0).sqrt();
    let spacing = median(&mut scan.surface.spacings.clone());
    Ok(left > (LEFT_OF_SPACING * spacing).max(LEFT_OF_NOISE * noise))
}

/// The networks of all blocks over a coarse one.
pub(super) struct Refined<T> {
    blocks: Vec<Block>,
    fitted: Vec<Fitted<T>>,
    /// Evaluates their networks.
    engine: Box<dyn Engine<T>>,
    coarse_band: f64,
}

/// Cuts the cloud into blocks and fits them; `prepared` tells of all the points from then on.
///
/// # Errors
/// [`Error::Cancelled`] where the observer stops the run; what an engine reports.
pub(super) fn refine<T: Scalar>(
    settings: &Settings,
    prepared: &mut Prepared,
    scan: &Scan,
    state: &State<T>,
    observer: &dyn Observer,
) -> Result<Refined<T>, Error> {
    let identity = Identity::new(settings, &prepared.training, &prepared.validation);
    let surface = &scan.surface;
    let held_out = held_out(settings, surface.points.len(), &surface.points);
    let is_held_out = |i: &usize| held_out.binary_search(i).is_ok();
    let fitted: Vec<usize> = (0..surface.points.len())
        .filter(|i| !is_held_out(i))
        .collect();
    let points: Vec<Vec3> = fitted.iter().map(|&i| surface.points[i]).collect();
    let spacings: Vec<f64> = fitted.iter().map(|&i| surface.spacings[i]).collect();
    let blocks = partition::partition(&points, &spacings, settings.network.block_points);
    let given = labelled(prepared, scan);
    let mut random = stream(settings.training.seed, Purpose::Blocks);
    let places = Places::new(&blocks, surface, &fitted, &given, &mut random);
    let uncertain = blocks.iter().map(|block| Uncertainty {
        spacing: block.spacing(),
        band: block.band,
        sparse: false,
        ..scan.uncertainty
    });
    let (weights, decays): (Vec<f64>, Vec<f64>) = uncertain
        .map(|u| {
            let decay = settings.training.smoothing * u.weight_decay(1);
            (u.surface_weight(), decay)
        })
        .unzip();
    let architecture = Architecture::of_block(&settings.network);
    let task = Task {
        blocks: &blocks,
        places: &places,
        architecture: &architecture,
        settings,
        weights: &weights,
        decays: &decays,
        noise: scan.uncertainty.noise,
    };
    let State { coarse, done } = state;
    let done = if done.len() == blocks.len() {
        done.clone()
    } else {
        vec![None; blocks.len()]
    };
    let start = coarse.evaluations as f64 / settings.training.max_evaluations as f64;
    let mut told = |done: &Done<T>, stopped: bool| {
        let share = done.iter().flatten().count() as f64 / done.len() as f64;
        observer.event(Event::Progress(start + (1.0 - start) * share));
        if observer.checkpoint_due() || stopped && observer.released() {
            observer.event(Event::Checkpoint {
                evaluation: coarse.evaluations,
                data: &State::encode(coarse, done, &identity),
            });
        }
    };
    let done = fit::fit(&task, done, observer, &mut told)?;
    let networks: Vec<Fitted<T>> = done.into_iter().flatten().collect();
    prepared.spacing = median(&mut spacings.clone());
    prepared.counts.surface = fitted.len();
    prepared.counts.near = places.generated() - given.len();
    prepared.counts.held_out = held_out.len();
    let to_cloud = |positions: &[usize]| positions.iter().map(|&i| scan.indices[i]).collect();
    prepared.surface = to_cloud(&fitted);
    prepared.held_out = to_cloud(&held_out);
    prepared.blocks = blocks.len();
    let nothing: Samples = [([0.0; 3], 0.0)].into_iter().collect();
    Ok(Refined {
        blocks,
        fitted: networks,
        engine: sequential_engine(settings.training.engine, &architecture, &nothing)?,
        coarse_band: scan.band,
    })
}

/// Positions of the points that no block is fitted to, ascending.
fn held_out(settings: &Settings, count: usize, points: &[Vec3]) -> Vec<usize> {
    let share = (settings.sampling.validation_fraction * count as f64) as usize;
    let mut choice = stream(settings.training.seed, Purpose::HeldOut);
    even_subset(points, share.min(HELD_OUT), &mut choice)
}

/// The places that the user labelled, with their signed distances.
fn labelled(prepared: &Prepared, scan: &Scan) -> Vec<(Vec3, f64)> {
    let counts = &prepared.counts;
    let labelled = counts.surface..counts.surface + counts.interior + counts.exterior;
    labelled
        .map(|i| {
            let place = prepared.training.points[i];
            let (_, distance) = scan.surface.nearest(place);
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
        let parts = self.blocks.iter().zip(&self.fitted).map(|(block, fitted)| {
            let field = self.engine.field(&fitted.parameters)?;
            Ok((*block, field))
        });
        let parts = parts.collect::<Result<Vec<_>, Error>>()?;
        Ok(BlockField::new(coarse, self.coarse_band, parts))
    }

    /// What the report says of them.
    pub(super) fn report(&self) -> BlocksReport {
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
        }
    }

    /// What is kept of the blocks.
    pub(super) fn model(&self) -> BlockModel {
        BlockModel {
            architecture: self.engine.architecture().clone(),
            coarse_band: self.coarse_band,
            blocks: self.blocks.clone(),
            parameters: self
                .fitted
                .iter()
                .flat_map(|fitted| fitted.parameters.iter().map(|p| p.to_f64()))
                .collect(),
        }
    }
}
