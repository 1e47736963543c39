//! Samples off the surface: along the normals, in the box around it and on its shell.

use rand::RngExt;

use super::Samples;
use super::oriented::OrientedSurface;
use super::selection::pick;
use crate::reconstruction::nearby::Threads;
use crate::reconstruction::random::Generator;
use crate::reconstruction::settings::Targets;
use crate::reconstruction::vector::{Bounds, Vec3, along, dot};

/// Steps along the normal, in local spacings: far enough from the noise of the normal, near enough
/// that the surface is still the nearest one.
pub const STEPS: (f64, f64) = (0.3, 0.7);

/// A near sample may be so much closer to the surface than it was put, as a share of its step,
/// before it is taken to have come near another part.
const LEAST_CLEARANCE: f64 = 0.5;

/// Far samples on the shell of the box: one of so many.
const SHELL_EVERY: usize = 5;

/// Turns signed distances into targets.
#[derive(Debug, Clone, Copy)]
pub struct Grading {
    /// Kind of targets.
    pub targets: Targets,
    /// Distance at which graded targets reach ±1, unit frame.
    pub band: f64,
}

impl Grading {
    /// Target at a place with the given distance to the surface.
    pub fn target(&self, inside: bool, distance: f64) -> f64 {
        let size = match self.targets {
            Targets::Binary => 1.0,
            Targets::Graded => (distance / self.band).min(1.0),
        };
        if inside { size } else { -size }
    }
}

/// Makes samples around a surface.
pub struct Sampler<'a> {
    /// The surface.
    pub surface: &'a OrientedSurface,
    /// Its targets.
    pub grading: Grading,
    /// Spacing of the trained points over that of `surface`, of which they are a subset.
    pub thinning: f64,
    /// Whether the points are so sparse that distances of far samples are no more than a bound.
    pub sparse: bool,
    /// Which threads ask the surface.
    pub threads: Threads,
}

/// A step from a point along its normal, outwards where it is positive.
pub type Step = (usize, f64);

impl Sampler<'_> {
    /// `pairs` pairs of samples along the normals of the points at `indices`, unit frame.
    ///
    /// A sample is kept only if the winding number confirms its side and no other part of the
    /// surface is closer; in thin parts the step is halved once.
    pub fn near(&self, indices: &[usize], pairs: usize, random: &mut Generator) -> Samples {
        let shares: Vec<(usize, f64)> = indices
            .iter()
            .flat_map(|&i| (0..pairs).map(move |pair| (i, pair)))
            .map(|(i, pair)| (i, share_of_pair(pair, pairs, random)))
            .collect();
        let steps: Vec<Step> = shares
            .into_iter()
            .flat_map(|(i, share)| self.both_ways(i, share))
            .collect();
        self.along(&steps).into_iter().flatten().collect()
    }

    /// The steps inwards and outwards of a pair at point `i` that has this share of the spacing there.
    pub fn both_ways(&self, i: usize, share: f64) -> [Step; 2] {
        let step = share * self.thinning * self.surface.spacings[i];
        [(i, -step), (i, step)]
    }

    /// The near sample of each of `steps`; none where the surface allows none.
    fn along(&self, steps: &[Step]) -> Vec<Option<(Vec3, f64)>> {
        let kept = steps.iter().zip(self.kept(steps));
        kept.map(|(&(i, _), length)| Some(self.at_step((i, length?))))
            .collect()
    }

    /// The length that the surface allows each of `steps`, which is its own or half of it; none where it allows neither.
    pub fn kept(&self, steps: &[Step]) -> Vec<Option<f64>> {
        let whole = self.confirmed(steps);
        let missing: Vec<usize> = (0..steps.len()).filter(|&k| !whole[k]).collect();
        let halved = |&k: &usize| (steps[k].0, 0.5 * steps[k].1);
        let halved: Vec<Step> = missing.iter().map(halved).collect();
        let mut kept: Vec<Option<f64>> = steps.iter().map(|step| Some(step.1)).collect();
        for ((k, &(_, length)), is_kept) in missing
            .into_iter()
            .zip(&halved)
            .zip(self.confirmed(&halved))
        {
            kept[k] = is_kept.then_some(length);
        }
        kept
    }

    /// The sample at a step that was kept.
    pub fn at_step(&self, step: Step) -> (Vec3, f64) {
        let target = self.grading.target(step.1 < 0.0, step.1.abs());
        (self.place(step), target)
    }

    fn place(&self, (i, length): Step) -> Vec3 {
        along(self.surface.points[i], length, self.surface.normals[i])
    }

    /// Whether the place at each step along the normal of a point is where it should be.
    fn confirmed(&self, steps: &[Step]) -> Vec<bool> {
        let surface = self.surface;
        let queries: Vec<Vec3> = steps.iter().map(|&step| self.place(step)).collect();
        let places = surface.places(&queries, self.threads);
        let is_clear = |k: &usize| {
            let ((i, length), place) = (steps[*k], &places[*k]);
            dot(surface.normals[place.nearest], surface.normals[i]) > 0.0
                && surface.distance(place) >= LEAST_CLEARANCE * length.abs()
        };
        let clear: Vec<usize> = (0..steps.len()).filter(is_clear).collect();
        let mut found = vec![false; steps.len()];
        let sides = surface.inside(&pick(&places, &clear), self.threads);
        for (&k, inside) in clear.iter().zip(sides) {
            found[k] = inside == Some(steps[k].1 < 0.0);
        }
        found
    }

    /// Up to `count` samples in `region` and on its shell, unit frame; places that the winding
    /// number leaves open get none.
    ///
    /// Their distances are those to a point or to its tangent plane, and off by as much as the spacing. Where
    /// that is as much as the band, an exact target bends the field; a bound keeps the side all the same.
    pub fn far(&self, region: &Bounds, count: usize, random: &mut Generator) -> Samples {
        let found = self.known(&far_places(region, count, random));
        let mut found: Vec<_> = found.into_iter().flatten().collect();
        let samples = |found: Vec<(f64, (Vec3, f64))>| -> Samples {
            found.into_iter().map(|(_, sample)| sample).collect()
        };
        if !self.sparse {
            return samples(found);
        }
        // The bounds that hold, which are the far ones, in blocks that cost no gradient.
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        samples(found).at_least()
    }

    /// The sample at each of `places`; none where the side is not sure.
    pub fn at_each(&self, places: &[Vec3]) -> Vec<Option<(Vec3, f64)>> {
        let found = self.known(places).into_iter();
        found.map(|found| Some(found?.1)).collect()
    }

    /// The same with their distances.
    fn known(&self, queries: &[Vec3]) -> Vec<Option<(f64, (Vec3, f64))>> {
        let places = self.surface.places(queries, self.threads);
        let sides = self.surface.inside(&places, self.threads);
        let told = queries.iter().zip(&places).zip(sides);
        told.map(|((q, place), inside)| {
            let distance = self.surface.distance(place);
            Some((distance, (*q, self.grading.target(inside?, distance))))
        })
        .collect()
    }
}

/// The step of one of so many pairs at a point, in local spacings: each pair has its own part of the range.
pub fn share_of_pair(pair: usize, pairs: usize, random: &mut Generator) -> f64 {
    let share = (pair as f64 + random.random::<f64>()) / pairs as f64;
    STEPS.0 + (STEPS.1 - STEPS.0) * share
}

/// `count` places in `region` and on its shell.
pub fn far_places(region: &Bounds, count: usize, random: &mut Generator) -> Vec<Vec3> {
    (0..count)
        .map(|k| place(region, k % SHELL_EVERY == 0, random))
        .collect()
}

/// A place in `region`, uniform in its volume or, on the shell, on a random face.
fn place(region: &Bounds, shell: bool, random: &mut Generator) -> Vec3 {
    let extent = region.extent();
    let mut p: Vec3 = std::array::from_fn(|a| region.min[a] + extent[a] * random.random::<f64>());
    if shell {
        let face = random.random_range(0..6_usize);
        p[face / 2] = if face % 2 == 0 {
            region.min[face / 2]
        } else {
            region.max[face / 2]
        };
    }
    p
}
