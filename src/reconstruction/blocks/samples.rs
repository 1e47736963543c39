//! The samples of all blocks. Each place is asked about once, when the first block that may hold it is fitted.
//!
//! Which places there are depends on all blocks, and costs little. What is known of them costs as much as some of the
//! fitting, and depends on the points alone. So a block can be fitted, or given to others, before most places are
//! asked about.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::block::Block;
use super::lookup::Lookup;
use crate::reconstruction::error::Error;
use crate::reconstruction::nearby::{Threads, map_nearby};
use crate::reconstruction::random::Generator;
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::sampling::oriented::OrientedSurface;
use crate::reconstruction::sampling::samples::{
    Grading, STEPS, Sampler, Step, far_places, share_of_pair,
};
use crate::reconstruction::sampling::selection::pick;
use crate::reconstruction::settings::Targets;
use crate::reconstruction::surface::Field;
use crate::reconstruction::vector::{Bounds, Vec3};

/// Samples in the reach of a block for each point of the cloud there.
const FAR_SHARE: f64 = 0.2;

/// Points that are worked with at a time, which bounds the memory beside what is kept of them.
const AT_A_TIME: usize = 1 << 19;

/// Distances are told up to this, in the frame of the run, which is a sixth of its box: no block has a wider band.
const FARTHEST: f64 = 1.0;

/// Places with their signed distances from the surface, in the frame of the run.
pub(super) struct Places<'a> {
    sampler: Sampler<'a>,
    /// The points of the surface that networks are fitted to. Below, they have their numbers among these.
    fitted: &'a [usize],
    /// Those in the reach of each block, ascending.
    points_of: Vec<Vec<u32>>,
    /// What a coarse field says of their distances; nothing where the blocks are not told.
    coarse: Vec<f64>,
    /// The places around them, in a part for each block: those beside points that no block before it holds, and those
    /// in its reach.
    parts: Vec<Part>,
    /// The parts that may have places in the reach of each block.
    parts_of: Vec<Vec<u32>>,
}

/// Some places.
#[derive(Default)]
struct Part {
    /// Pairs beside points: the point, and the steps of its pair as a share of the spacing there.
    pairs: Vec<(u32, f64)>,
    /// Places whose distances the user told.
    given: Vec<Known>,
    /// Places away from the surface.
    far: Vec<Vec3>,
    /// Number of the first of them.
    first_far: u32,
    /// What is known of those that were not given, once somebody has asked: of both places of each pair the steps that
    /// the surface allows, of the others the distances; no number of those that the surface leaves open.
    known: OnceLock<Vec<f64>>,
    /// What a coarse field says of the distances of all whose distance is known; nothing where the blocks are not told.
    coarse: Vec<f64>,
}

/// A place whose distance is known.
#[derive(Clone, Copy)]
struct Known {
    /// Its number in the order of all: pairs, given ones, those away from the surface.
    number: u32,
    place: Vec3,
    distance: f64,
    /// What a coarse field says of the distance; 0 where the blocks are not told.
    coarse: f64,
}

impl Known {
    fn new(number: u32, (place, distance): (Vec3, f64)) -> Self {
        Self {
            number,
            place,
            distance,
            coarse: 0.0,
        }
    }
}

impl<'a> Places<'a> {
    /// The points of `surface` at `fitted`, one pair beside each, places in the reach of every block, and the
    /// `given` ones, whose distances are known.
    pub(super) fn new(
        blocks: &[Block],
        surface: &'a OrientedSurface,
        fitted: &'a [usize],
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
            threads: Threads::Caller,
        };
        let points = pick(&surface.points, fitted);
        let reaches: Vec<Bounds> = blocks.iter().map(|block| block.reach).collect();
        let lookup = Lookup::new(reaches.clone());
        let points_of = members(&lookup, blocks.len(), &points);
        let mut parts: Vec<Part> = blocks.iter().map(|_| Part::default()).collect();
        let owners = owners(&points_of, points.len());
        for (n, owner) in (0..).zip(owners) {
            let share = share_of_pair(0, 1, random);
            if let Some(part) = parts.get_mut(owner as usize) {
                part.pairs.push((n, share));
            }
        }
        let first_given = 2 * points.len();
        for (n, &given) in given.iter().enumerate() {
            let mut owner = None;
            lookup.holding(given.0, |k| owner = owner.or(Some(k)));
            if let Some(k) = owner {
                let known = Known::new((first_given + n) as u32, given);
                parts[k].given.push(known);
            }
        }
        let mut first_far = first_given + given.len();
        for ((part, block), points) in parts.iter_mut().zip(blocks).zip(&points_of) {
            let count = (FAR_SHARE * points.len() as f64).ceil() as usize;
            part.far = far_places(&block.reach, count, random);
            part.first_far = first_far as u32;
            first_far += count;
        }
        let around = parts.iter().zip(blocks);
        let around = around.map(|(part, block)| part.bounds(block, (surface, fitted)));
        Self {
            parts_of: Lookup::new(around.collect()).meeting_each(&reaches),
            sampler,
            fitted,
            points_of,
            coarse: Vec::new(),
            parts,
        }
    }

    /// The same places, of which networks fit what `coarse` leaves.
    ///
    /// # Errors
    /// What the field reports.
    pub(super) fn over(mut self, coarse: &CoarseLengths<'_>) -> Result<Self, Error> {
        self.ask_all();
        self.coarse = coarse.at(&pick(&self.sampler.surface.points, self.fitted))?;
        let of_each: Vec<Vec<Vec3>> = self
            .parts
            .iter()
            .map(|part| self.known(part).map(|known| known.place).collect())
            .collect();
        let mut lengths = coarse.at(&of_each.concat())?.into_iter();
        for (part, places) in self.parts.iter_mut().zip(of_each) {
            part.coarse = lengths.by_ref().take(places.len()).collect();
        }
        Ok(self)
    }

    /// Number of places beside the surface and away from it whose distance was not given.
    pub(super) fn generated(&self) -> usize {
        self.ask_all();
        let known = |part| self.known(part).count() - part.given.len();
        self.parts.iter().map(known).sum()
    }

    /// Has all places asked about, on all threads.
    fn ask_all(&self) {
        self.parts.par_iter().for_each(|part| {
            self.asked(part);
        });
    }

    /// Asks about the places of block `k`, on the calling thread.
    pub(super) fn ask(&self, k: usize) {
        for &part in &self.parts_of[k] {
            self.asked(&self.parts[part as usize]);
        }
    }

    /// What is known of the parts that may have places in the reach of block `k`.
    fn known_around(&self, k: usize) -> impl Iterator<Item = Known> {
        let parts = self.parts_of[k].iter();
        parts.flat_map(|&part| self.known(&self.parts[part as usize]))
    }

    /// The places of a part whose distances are known.
    fn known<'p>(&'p self, part: &'p Part) -> impl Iterator<Item = Known> + 'p {
        let (steps, distances) = self.asked(part).split_at(2 * part.pairs.len());
        let beside = (0..).zip(steps).filter(|(_, length)| !length.is_nan());
        let beside = beside.map(|(at, length)| {
            let (n, _) = part.pairs[at / 2];
            let step = (self.fitted[n as usize], *length);
            let (place, target) = self.sampler.at_step(step);
            Known::new(2 * n + (at % 2) as u32, (place, FARTHEST * target))
        });
        let away = (part.first_far..).zip(part.far.iter().zip(distances));
        let away = away.filter(|(_, (_, distance))| !distance.is_nan());
        let found =
            beside.chain(away.map(|(n, (place, distance))| Known::new(n, (*place, *distance))));
        let all = part.given.iter().copied().chain(found).enumerate();
        all.map(|(at, known)| Known {
            coarse: part.coarse.get(at).copied().unwrap_or_default(),
            ..known
        })
    }

    /// What the surface says of the places of a part.
    fn asked<'p>(&self, part: &'p Part) -> &'p [f64] {
        part.known.get_or_init(|| {
            let steps = part.pairs.iter();
            let steps = steps.flat_map(|(n, share)| {
                let point = self.fitted[*n as usize];
                self.sampler.both_ways(point, *share)
            });
            let beside = self.sampler.kept(&steps.collect::<Vec<Step>>());
            let away = self.sampler.at_each(&part.far).into_iter();
            let away = away.map(|sample| Some(FARTHEST * sample?.1));
            let all = beside.into_iter().chain(away);
            all.map(|known| known.unwrap_or(f64::NAN)).collect()
        })
    }

    /// Samples of block `k` in its own frame, and how many of them, the first ones, are on the surface, where they have
    /// this weight. Asks about places on the calling thread.
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
        let sample = |place: Vec3, target: f64, coarse: f64| {
            (block.frame.to_unit(place), target - coarse / block.band)
        };
        let on_surface = self.points_of[k].iter().map(|&i| {
            let coarse = self.coarse.get(i as usize).copied();
            let point = self.sampler.surface.points[self.fitted[i as usize]];
            sample(point, 0.0, coarse.unwrap_or_default())
        });
        let mut samples = on_surface.collect::<Samples>().weighing(weight);
        let around = self.known_around(k);
        let mut around: Vec<Known> = around
            .filter(|known| block.reach.contains(known.place))
            .collect();
        around.sort_unstable_by_key(|known| known.number);
        samples.extend(around.into_iter().map(|known| {
            let target = grading.target(known.distance > 0.0, known.distance.abs());
            sample(known.place, target, known.coarse)
        }));
        (samples, self.points_of[k].len())
    }
}

impl Part {
    /// A box around all its places, wherever its pairs come to lie; it is that of `block`.
    fn bounds(&self, block: &Block, (surface, fitted): (&OrientedSurface, &[usize])) -> Bounds {
        let spacings = self.pairs.iter();
        let spacings = spacings.map(|(n, _)| surface.spacings[fitted[*n as usize]]);
        block.reach.padded(STEPS.1 * spacings.fold(0.0, f64::max))
    }
}

/// The first block that holds each of so many points, where `points_of` tells those of each block; one beyond the last
/// where none does.
fn owners(points_of: &[Vec<u32>], points: usize) -> Vec<u32> {
    let mut owners = vec![points_of.len() as u32; points];
    for (k, points) in points_of.iter().enumerate().rev() {
        for &i in points {
            owners[i as usize] = k as u32;
        }
    }
    owners
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

/// The places that each of so many blocks holds, ascending.
pub(super) fn members(lookup: &Lookup, blocks: usize, places: &[Vec3]) -> Vec<Vec<u32>> {
    let mut members = vec![Vec::new(); blocks];
    for (chunk, some) in places.chunks(AT_A_TIME).enumerate() {
        let held: Vec<Vec<u32>> = map_nearby(some, |i| {
            let mut held = Vec::new();
            lookup.holding(some[i], |k| held.push(k as u32));
            held
        });
        for (i, held) in held.iter().enumerate() {
            for k in held {
                members[*k as usize].push((chunk * AT_A_TIME + i) as u32);
            }
        }
    }
    members
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::blocks::partition::partition;
    use crate::reconstruction::random::{Purpose, stream};
    use crate::reconstruction::sampling::oriented::Located;

    /// Points of a ball.
    fn ball() -> OrientedSurface {
        let points: Vec<Vec3> = (0..3000)
            .map(|i| {
                let height = (f64::from(i) + 0.5) / 1500.0 - 1.0;
                let (sin, cos) = (2.4 * f64::from(i)).sin_cos();
                let around = (1.0 - height * height).sqrt();
                [around * cos, around * sin, height]
            })
            .collect();
        let located = Located::new(points.clone(), 16);
        OrientedSurface::new(located, Some(&points), false, &mut Vec::new())
    }

    #[test]
    fn a_block_has_all_places_in_its_reach_whichever_asks_first() {
        let surface = ball();
        let fitted: Vec<usize> = (0..surface.points.len()).collect();
        let blocks = partition(&surface.points, &surface.spacings, 17);
        // The second one is in no block.
        let given = [([0.0, 0.0, 0.97], 0.03), ([3.0; 3], -4.0)];
        let places = || {
            let mut random = stream(1, Purpose::Blocks);
            Places::new(&blocks, &surface, &fitted, &given, &mut random)
        };
        let of = |places: &Places<'_>, k| places.of(k, &blocks[k], Targets::Graded, 1.0);
        let forwards = places();
        let found: Vec<(Samples, usize)> = (0..blocks.len()).map(|k| of(&forwards, k)).collect();
        let backwards = places();
        for k in (0..blocks.len()).rev() {
            assert_eq!(of(&backwards, k), found[k], "block {k}");
        }
        let parts = forwards.parts.iter();
        let all: Vec<Known> = parts.flat_map(|part| forwards.known(part)).collect();
        assert_eq!(forwards.generated(), all.len() - 1);
        for (block, (samples, on_surface)) in blocks.iter().zip(&found) {
            let around = all.iter().filter(|known| block.reach.contains(known.place));
            assert_eq!(samples.len() - on_surface, around.count());
            // Two beside each point, but for those beyond the reach, and some away from them.
            assert!(2 * samples.len() > 5 * on_surface);
        }
    }
}
