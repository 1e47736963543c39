//! The samples of all blocks, made once; each block takes those in its reach.

use super::block::Block;
use super::lookup::Lookup;
use crate::reconstruction::error::Error;
use crate::reconstruction::nearby::map_nearby;
use crate::reconstruction::random::Generator;
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::sampling::oriented::OrientedSurface;
use crate::reconstruction::sampling::samples::{Grading, Sampler, far_places};
use crate::reconstruction::settings::Targets;
use crate::reconstruction::surface::Field;
use crate::reconstruction::vector::Vec3;

/// Samples in the reach of a block for each point of the cloud there.
const FAR_SHARE: f64 = 0.2;

/// Points that are worked with at a time, which bounds the memory beside what is kept of them.
const AT_A_TIME: usize = 1 << 19;

/// Places with their signed distances from the surface, in the frame of the run.
pub(super) struct Places {
    points: Vec<Vec3>,
    distances: Vec<f64>,
    /// What a coarse field says of the distances; nothing where the blocks are not told.
    coarse: Vec<f64>,
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
        for some in fitted.chunks(AT_A_TIME) {
            samples.append(sampler.near(some, 1, random));
        }
        samples.extend(given.iter().copied());
        let lookup = Lookup::new(blocks.iter().map(|block| block.reach).collect());
        let mut of_blocks = vec![Vec::new(); blocks.len()];
        add_members(&lookup, &samples.points, 0, &mut of_blocks);
        let before = samples.len();
        let mut places = Vec::new();
        for (k, block) in blocks.iter().enumerate() {
            let count = of_blocks[k].partition_point(|&i| (i as usize) < on_surface);
            let far = (FAR_SHARE * count as f64).ceil() as usize;
            places.extend(far_places(&block.reach, far, random));
            if places.len() >= AT_A_TIME || k + 1 == blocks.len() {
                samples.append(sampler.at(&places));
                places.clear();
            }
        }
        add_members(&lookup, &samples.points[before..], before, &mut of_blocks);
        let Samples {
            points, targets, ..
        } = samples;
        Self {
            of_blocks,
            distances: targets.iter().map(|target| FARTHEST * target).collect(),
            points,
            coarse: Vec::new(),
            on_surface,
        }
    }

    /// The same places, of which networks fit what `coarse` leaves.
    ///
    /// # Errors
    /// What the field reports.
    pub(super) fn over(self, coarse: &CoarseLengths<'_>) -> Result<Self, Error> {
        Ok(Self {
            coarse: coarse.at(&self.points)?,
            ..self
        })
    }

    /// Number of places of each kind: beside the surface and away from it.
    pub(super) fn generated(&self) -> usize {
        self.points.len() - self.on_surface
    }

    /// Samples of block `k` in its own frame, and how many of them, the first ones, are on the surface, where they have
    /// this weight.
    pub(super) fn of(
        &self,
        k: usize,
        block: &Block,
        targets: Targets,
        weight: f64,
    ) -> (Samples, usize) {
        let grading = Grading {
            targets,
            band: block.band,
        };
        let mut samples = Samples::default();
        let mut on_surface = 0;
        for &i in &self.of_blocks[k] {
            let i = i as usize;
            let is_point = i < self.on_surface;
            let distance = self.distances[i];
            let target = if is_point {
                0.0
            } else {
                grading.target(distance > 0.0, distance.abs())
            };
            let target = target - self.coarse.get(i).map_or(0.0, |length| length / block.band);
            samples.extend([(block.frame.to_unit(self.points[i]), target)]);
            if is_point && let Some(last) = samples.weights.last_mut() {
                *last = weight;
                on_surface += 1;
            }
        }
        (samples, on_surface)
    }
}

/// A coarse field as lengths in the frame of the run.
pub(super) struct CoarseLengths<'a> {
    pub(super) field: &'a dyn Field,
    /// Distance at which its targets reach ±1.
    pub(super) band: f64,
}

impl CoarseLengths<'_> {
    /// At each of `points`.
    ///
    /// # Errors
    /// What the field reports.
    pub(super) fn at(&self, points: &[Vec3]) -> Result<Vec<f64>, Error> {
        let mut lengths = vec![0.0; points.len()];
        let chunks = points.chunks(AT_A_TIME);
        for (points, lengths) in chunks.zip(lengths.chunks_mut(AT_A_TIME)) {
            self.field.values(points, lengths)?;
        }
        for length in &mut lengths {
            *length *= self.band;
        }
        Ok(lengths)
    }
}

/// The places that each of so many blocks holds.
pub(super) fn members(lookup: &Lookup, blocks: usize, points: &[Vec3]) -> Vec<Vec<u32>> {
    let mut members = vec![Vec::new(); blocks];
    add_members(lookup, points, 0, &mut members);
    members
}

/// Adds the places that each block holds of `points`, the first of which has number `first`.
fn add_members(lookup: &Lookup, points: &[Vec3], first: usize, members: &mut [Vec<u32>]) {
    for (chunk, some) in points.chunks(AT_A_TIME).enumerate() {
        let held: Vec<Vec<u32>> = map_nearby(some, |i| {
            let mut held = Vec::new();
            lookup.holding(some[i], |k| held.push(k as u32));
            held
        });
        for (i, held) in held.iter().enumerate() {
            for k in held {
                members[*k as usize].push((first + chunk * AT_A_TIME + i) as u32);
            }
        }
    }
}
