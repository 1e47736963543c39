//! The samples of all blocks, made once; each block takes those in its reach.

use rayon::prelude::*;

use super::block::Block;
use super::lookup::Lookup;
use crate::reconstruction::random::Generator;
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::sampling::oriented::OrientedSurface;
use crate::reconstruction::sampling::samples::{Grading, Sampler};
use crate::reconstruction::settings::Targets;
use crate::reconstruction::vector::Vec3;

/// Samples in the reach of a block for each point of the cloud there.
const FAR_SHARE: f64 = 0.2;

/// Places with their signed distances from the surface, in the frame of the run.
pub(super) struct Places {
    points: Vec<Vec3>,
    distances: Vec<f64>,
    /// The first so many are points of the cloud.
    on_surface: usize,
    /// The places of each block, ascending.
    of_blocks: Vec<Vec<u32>>,
}

/// Distances are told up to this, in the frame of the run, which is a sixth of its box: no block has a wider band.
const FARTHEST: f64 = 1.0;

impl Places {
    /// The points of `surface` at `fitted`, one pair beside each, places in the reach of every block, and the
    /// `given` ones, whose distances are known.
    pub(super) fn new(
        blocks: &[Block],
        surface: &OrientedSurface,
        fitted: &[usize],
        given: &[(Vec3, f64)],
        random: &mut Generator,
    ) -> Self {
        let sampler = Sampler {
            surface,
            grading: Grading {
                targets: Targets::Graded,
                band: FARTHEST,
            },
            thinning: 1.0,
            sparse: false,
        };
        let mut samples: Samples = fitted.iter().map(|&i| (surface.points[i], 0.0)).collect();
        let on_surface = samples.len();
        samples.append(sampler.near(fitted, 1, random));
        samples.extend(given.iter().copied());
        let lookup = Lookup::new(blocks.iter().map(|block| block.reach).collect());
        let mut counts = vec![0_usize; blocks.len()];
        for i in fitted {
            lookup.holding(surface.points[*i], |k| counts[k] += 1);
        }
        for (block, count) in blocks.iter().zip(counts) {
            let far = (FAR_SHARE * count as f64).ceil() as usize;
            samples.append(sampler.far(&block.reach, far, random));
        }
        let Samples {
            points, targets, ..
        } = samples;
        Self {
            of_blocks: members(&lookup, blocks.len(), &points),
            distances: targets.iter().map(|target| FARTHEST * target).collect(),
            points,
            on_surface,
        }
    }

    /// Number of places of each kind: beside the surface and away from it.
    pub(super) fn generated(&self) -> usize {
        self.points.len() - self.on_surface
    }

    /// Samples of block `k` in its own frame; those on the surface have this weight.
    pub(super) fn of(&self, k: usize, block: &Block, targets: Targets, weight: f64) -> Samples {
        let grading = Grading {
            targets,
            band: block.band,
        };
        let mut samples = Samples::default();
        for &i in &self.of_blocks[k] {
            let i = i as usize;
            let is_point = i < self.on_surface;
            let distance = self.distances[i];
            let target = if is_point {
                0.0
            } else {
                grading.target(distance > 0.0, distance.abs())
            };
            samples.extend([(block.frame.to_unit(self.points[i]), target)]);
            if is_point && let Some(last) = samples.weights.last_mut() {
                *last = weight;
            }
        }
        samples
    }
}

/// The places that each of so many blocks holds.
pub(super) fn members(lookup: &Lookup, blocks: usize, points: &[Vec3]) -> Vec<Vec<u32>> {
    let held: Vec<Vec<u32>> = points
        .par_iter()
        .map(|p| {
            let mut held = Vec::new();
            lookup.holding(*p, |k| held.push(k as u32));
            held
        })
        .collect();
    let mut members = vec![Vec::new(); blocks];
    for (i, held) in held.iter().enumerate() {
        for k in held {
            members[*k as usize].push(i as u32);
        }
    }
    members
}
