//! Samples off the surface: along the normals, in the box around it and on its shell.

use rand::RngExt;
use rayon::prelude::*;

use super::Samples;
use super::oriented::OrientedSurface;
use crate::reconstruction::nearby::map_nearby;
use crate::reconstruction::random::Generator;
use crate::reconstruction::settings::Targets;
use crate::reconstruction::vector::{Bounds, Vec3, along, dot};

/// Steps along the normal, in local spacings: far enough from the noise of the normal, near enough
/// that the surface is still the nearest one.
const STEPS: (f64, f64) = (0.3, 0.7);

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
}

impl Sampler<'_> {
    /// `pairs` pairs of samples along the normals of the points at `indices`, unit frame.
    ///
    /// A sample is kept only if the winding number confirms its side and no other part of the
    /// surface is closer; in thin parts the step is halved once.
    pub fn near(&self, indices: &[usize], pairs: usize, random: &mut Generator) -> Samples {
        let steps: Vec<(usize, f64)> = indices
            .iter()
            .flat_map(|&i| (0..pairs).map(move |pair| (i, pair)))
            .map(|(i, pair)| {
                let share = (pair as f64 + random.random::<f64>()) / pairs as f64;
                (i, STEPS.0 + (STEPS.1 - STEPS.0) * share)
            })
            .collect();
        let places: Vec<Vec3> = steps.iter().map(|&(i, _)| self.surface.points[i]).collect();
        let found: Vec<[Option<(Vec3, f64)>; 2]> = map_nearby(&places, |k| {
            let (i, share) = steps[k];
            let step = share * self.thinning * self.surface.spacings[i];
            [-step, step].map(|step| {
                self.confirmed(i, step)
                    .or_else(|| self.confirmed(i, 0.5 * step))
            })
        });
        found.into_iter().flatten().flatten().collect()
    }

    /// The sample `step` along the normal of point `i`, if it is where it should be.
    fn confirmed(&self, i: usize, step: f64) -> Option<(Vec3, f64)> {
        let surface = self.surface;
        let q = along(surface.points[i], step, surface.normals[i]);
        let (nearest, distance) = surface.nearest(q);
        let same_part = dot(surface.normals[nearest], surface.normals[i]) > 0.0
            && distance >= LEAST_CLEARANCE * step.abs();
        let inside = step < 0.0;
        (same_part && surface.inside(q) == Some(inside))
            .then(|| (q, self.grading.target(inside, step.abs())))
    }

    /// Up to `count` samples in `region` and on its shell, unit frame; places that the winding
    /// number leaves open get none.
    ///
    /// Their distances are those to a point or to its tangent plane, and off by as much as the spacing. Where
    /// that is as much as the band, an exact target bends the field; a bound keeps the side all the same.
    pub fn far(&self, region: &Bounds, count: usize, random: &mut Generator) -> Samples {
        let places: Vec<Vec3> = (0..count)
            .map(|k| place(region, k % SHELL_EVERY == 0, random))
            .collect();
        let mut found: Vec<(f64, (Vec3, f64))> = places
            .par_iter()
            .filter_map(|&q| {
                let inside = self.surface.inside(q)?;
                let (_, distance) = self.surface.nearest(q);
                Some((distance, (q, self.grading.target(inside, distance))))
            })
            .collect();
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
