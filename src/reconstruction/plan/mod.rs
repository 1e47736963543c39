//! What settings and cloud decide together, in one place.
//!
//! A [`Plan`] is made once, after the scan of the cloud, and drives the run: its networks and their training, its
//! blocks, its grid. A dry run makes one of the same settings and of [`Findings::assumed`], and asks for its
//! [`Cost`].

mod blocks;
mod cost;
mod findings;
mod grid;

use super::network::{Ensemble, Fused};
use super::sampling::Prepared;
use super::settings::{Engine, OffSurface, OutputLayer, Precision, Settings, Training};
use super::training::Identity;

pub use blocks::BlockPlan;
pub use cost::{Cost, grid_bytes, largest_resolution};
pub use findings::Findings;
pub use grid::Extent;

/// Generated samples for each pair of L-BFGS. Reading a pair takes as long as evaluating some tens of samples;
/// from 300 points, 20 to 100 pairs give the same surfaces, from 2000 and more every pair helps.
const SAMPLES_PER_PAIR: usize = 64;

/// What a run does with a cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan<'a> {
    /// The settings that it was made of.
    pub settings: &'a Settings,
    /// What it was made for.
    pub findings: Findings,
    /// The networks that fit the cloud as a whole.
    pub ensemble: Ensemble,
    /// What evaluates their loss and gradient: never `auto`.
    pub engine: Engine,
    /// How their output layer is found.
    pub output_layer: OutputLayer,
    /// λ of λ/2 |parameters|², which their training adds to the loss: what the noise asks for.
    pub weight_decay: f64,
    /// Their training: that of the settings, with as many pairs as the samples are worth.
    pub training: Training,
    /// What becomes of the cloud where those networks leave too much of it; none where they are used in any case.
    pub blocks: Option<BlockPlan>,
}

impl<'a> Plan<'a> {
    /// The plan of these settings for such a cloud.
    pub fn new(settings: &'a Settings, findings: Findings) -> Self {
        let ensemble = Ensemble::new(&settings.network, findings.is_uncertain());
        let smoothing = settings.training.smoothing;
        Self {
            engine: engine(settings, &ensemble),
            output_layer: output_layer(settings, &findings),
            weight_decay: findings
                .uncertainty
                .map_or(0.0, |u| smoothing * u.weight_decay(findings.samples)),
            training: Training {
                history: kept_pairs(settings, findings.samples),
                ..settings.training.clone()
            },
            blocks: BlockPlan::new(settings, &findings),
            ensemble,
            settings,
            findings,
        }
    }

    /// What checkpoints of a run of this plan over these samples are known by.
    pub fn identity(&self, prepared: &Prepared) -> Identity {
        Identity::new(self.settings, &prepared.training, &prepared.validation)
    }
}

/// The fastest engine that can do what is asked for, unless one is named.
fn engine(settings: &Settings, ensemble: &Ensemble) -> Engine {
    let fused =
        settings.network.precision == Precision::F32 && Fused::supports(&ensemble.architecture);
    match settings.training.engine {
        Engine::Auto if fused => Engine::Fused,
        Engine::Auto => Engine::Libtorch,
        named => named,
    }
}

/// The output layer is solved for where that is a linear problem: bounds make it none.
fn output_layer(settings: &Settings, findings: &Findings) -> OutputLayer {
    if findings.one_sided {
        OutputLayer::Trained
    } else {
        settings.training.output_layer
    }
}

/// Most pairs that L-BFGS keeps over so many training samples.
fn kept_pairs(settings: &Settings, samples: usize) -> usize {
    let asked = settings.training.history;
    match settings.sampling.off_surface {
        OffSurface::Labels => asked,
        OffSurface::Generated => asked.min(samples.div_ceil(SAMPLES_PER_PAIR)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::Preset;
    use crate::reconstruction::cloud::Counts;

    #[test]
    fn few_generated_samples_keep_few_pairs() {
        let balanced = Preset::Balanced.settings();
        assert_eq!(kept_pairs(&balanced, 640), 10);
        assert_eq!(kept_pairs(&balanced, 1_000_000), balanced.training.history);
        // Those of the paper's runs stay as asked for.
        assert_eq!(kept_pairs(&Preset::Paper.settings(), 640), 100);
    }

    #[test]
    fn the_engine_is_one_that_has_what_is_asked_for() {
        let mut settings = Preset::Balanced.settings();
        let of = |settings: &Settings| {
            let counted = Counts {
                surface: 1_000,
                ..Counts::default()
            };
            Plan::new(settings, Findings::assumed(settings, &counted)).engine
        };
        assert_eq!(of(&settings), Engine::Fused);
        settings.network.precision = Precision::F64;
        assert_eq!(of(&settings), Engine::Libtorch);
        settings.network.precision = Precision::F32;
        settings.training.engine = Engine::Libtorch;
        assert_eq!(of(&settings), Engine::Libtorch);
    }
}
