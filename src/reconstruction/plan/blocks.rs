//! Whether a cloud may be cut into blocks, and what each of them gets.

use crate::reconstruction::network::Architecture;
use crate::reconstruction::plan::Findings;
use crate::reconstruction::sampling::MANY;
use crate::reconstruction::settings::{Settings, Training};

/// Evaluations of the one network after which it is asked whether it will do.
const LOOK: u64 = 150;

/// An earlier look where residuals tell what is missed: what nobody expects of it then. Of clean clouds of 3000 and
/// 8000 points, sphere, torus and uterus are at 0.1 spacings at most by then, hand, bunny and vertebra at 0.24 and
/// more.
const EARLY_LOOK: Look = Look {
    evaluations: 50,
    tolerated: 4.0,
};

/// Points of a block where residuals tell what is missed, over those of others: exact points that are few carry more
/// of the shape each. Chosen on figure, bracket, hand and vertebra of 3000 points.
const FEW_POINTS: f64 = 0.55;

/// What an ensemble that uncertain points are fitted with misses at that look, over what it will in the end, at most.
/// Chosen on a sphere and a bunny of 8000 points.
const UNSETTLED: f64 = 3.0;

/// What one network may leave of a cloud, in spacings of its points. Chosen on the bunny and the hand of the bench.
const LEFT_OF_SPACING: f64 = 0.05;

/// What it may leave, over the noise of the points it was fitted to, shared by as many as all points are for each of
/// them: what points that it has not seen can tell. Chosen on sphere, bunny, vertebra and hand of the bench, and on a
/// bone and a figure.
const LEFT_OF_NOISE: f64 = 0.5;

/// Points that are held out of the blocks, at most: enough to tell the error of a mesh.
const HELD_OUT: usize = 2_500;

/// The network of a block is looked at after the evaluations of a round, and goes on for as many up to so many
/// times.
const ROUNDS: u64 = 3;

/// Pairs of L-BFGS: over 100 to 150 evaluations 15 did as well as 40.
const PAIRS: usize = 15;

/// What the network of a block may leave of its points, in spacings. Chosen on a ball with bumps.
const LEFT: f64 = 0.02;

/// A look at the one network before its training ends: whether blocks shall go on from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Evaluations after which it is taken.
    pub evaluations: u64,
    /// What the network may miss by then, over what it may in the end.
    pub tolerated: f64,
}

/// The blocks of a cloud, should it need them.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockPlan {
    /// How many there are.
    pub count: usize,
    /// Points of the cloud that are held out of them.
    pub held_out: usize,
    /// The network of each.
    pub architecture: Architecture,
    /// The looks at the one network, in their order.
    pub looks: Vec<Look>,
    /// Evaluations after which the network of a block is asked the same; each time.
    pub round: u64,
    /// The training of the network of a block.
    pub training: Training,
}

impl BlockPlan {
    /// None where the settings want none, the cloud is that of one block, or nothing is known of its surface.
    pub(super) fn new(settings: &Settings, findings: &Findings) -> Option<Self> {
        let (points, most) = (findings.points, settings.network.block_points);
        let uncertainty = findings.uncertainty?;
        if most == 0 || points <= most {
            return None;
        }
        let tells_details = uncertainty.tells_details();
        let most = if tells_details && points <= MANY {
            ((FEW_POINTS * most as f64) as usize).max(1)
        } else {
            most
        };
        let share = (settings.sampling.validation_fraction * points as f64) as usize;
        let held_out = share.min(HELD_OUT);
        let round = settings.training.block_evaluations;
        Some(Self {
            count: (points - held_out).div_ceil(most),
            held_out,
            architecture: Architecture::of_block(&settings.network),
            looks: if tells_details {
                vec![EARLY_LOOK, look(1.0)]
            } else if findings.is_uncertain() {
                vec![look(UNSETTLED)]
            } else {
                vec![look(1.0)]
            },
            round,
            training: Training {
                max_evaluations: ROUNDS * round,
                history: PAIRS,
                patience: 0,
                time_limit_seconds: 0.0,
                histogram_evaluations: Vec::new(),
                snapshot_evaluations: Vec::new(),
                ..settings.training.clone()
            },
        })
    }

    /// How far one network that was fitted to such a share of the points, of such spacing and noise, may miss the
    /// others without blocks.
    pub fn tolerated(spacing: f64, noise: f64, fitted: f64) -> f64 {
        (LEFT_OF_SPACING * spacing).max(LEFT_OF_NOISE * noise * fitted.sqrt())
    }

    /// How far the network of a block may leave its points: their noise, and a share of their spacing.
    pub fn allowed(spacing: f64, noise: f64) -> f64 {
        noise.hypot(LEFT * spacing)
    }

    /// The training of the network of block `k`, which has first weights of its own.
    pub fn seed(&self, k: usize) -> u64 {
        self.training.seed.wrapping_add(1 + k as u64)
    }
}

fn look(tolerated: f64) -> Look {
    Look {
        evaluations: LOOK,
        tolerated,
    }
}
