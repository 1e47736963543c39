//! Orientation of many points, by way of an even subset of them.

use rayon::prelude::*;

use super::contradiction::contradiction;
use super::{CLEARLY_LESS, CONTRADICTS, Estimated, MANY, ROUGH, orient, refined, spanning};
use crate::reconstruction::random::{Purpose, stream};
use crate::reconstruction::sampling::jets::Quadrics;
use crate::reconstruction::sampling::neighbours::{Neighbourhoods, Tree, median};
use crate::reconstruction::sampling::normals::{estimate, plane, shared};
use crate::reconstruction::sampling::selection::{even_subset, pick};
use crate::reconstruction::sampling::winding::Oriented;
use crate::reconstruction::vector::{Vec3, bits, dot};

/// Points of the subset around a place that tell its side, where none of them has a neighbour of another direction.
/// This and [`BENT`] were chosen on a horse of 100,000 points (38 of them got a wrong side, of 85 that follow the
/// subset alone) and looked at on 500,000 (117 of 393) and a face (none of either).
const NEXT: usize = 8;

/// Cosine between normals of neighbours in the subset below which it is too coarse to tell the sides there.
const BENT: f64 = 0.8;

/// More points than are looked at one by one.
///
/// The subset tells the sides and the noise. Where the points are rough beside their own spacing, it tells the
/// directions too: its neighbourhoods are wider than the noise, those of the cloud are not. Otherwise they come from
/// fits to the nearest points of all.
pub(super) struct Many<'a> {
    points: &'a [Vec3],
    tree: &'a Tree,
    neighbours: &'a Neighbourhoods,
    spacings: Vec<f64>,
    /// Positions of the subset, and its points.
    chosen: Vec<usize>,
    some: Vec<Vec3>,
}

impl<'a> Many<'a> {
    pub(super) fn new(points: &'a [Vec3], tree: &'a Tree, neighbours: &'a Neighbourhoods) -> Self {
        let chosen = even_subset(points, MANY, &mut stream(0, Purpose::Selection));
        Self {
            points,
            tree,
            neighbours,
            spacings: neighbours.spacings(points),
            some: pick(points, &chosen),
            chosen,
        }
    }

    /// Outward normals from nothing.
    pub(super) fn orient(&self) -> Estimated {
        let tree = Tree::new(&self.some);
        let near = Neighbourhoods::new(&tree, &self.some, self.neighbours.count());
        let coarse = orient(&self.some, &tree, &near);
        let mut best = self.judged(shared(self.points, &tree, &coarse.normals), coarse.noise);
        if let Some(quadrics) = &best.quadrics
            && let Some(grown) = self.grown(&best.normals, &tree, &bends(&coarse.normals, &near))
        {
            let grown = self.judged_again(&best, quadrics, grown);
            if CLEARLY_LESS * grown.contradiction < best.contradiction {
                best = grown;
            }
        }
        if best.contradiction >= CONTRADICTS {
            let flat = estimate(self.points, self.tree, self.neighbours.count());
            let spanned = spanning::propagated(self.points, &flat, self.neighbours);
            let spanned = self.judged(spanned, coarse.noise);
            if spanned.contradiction < CLEARLY_LESS * best.contradiction {
                best = spanned;
            }
        }
        Estimated {
            noise: self.least_noise(best.quadrics.as_ref(), coarse.noise),
            normals: best.normals,
            areas: Some(best.areas),
        }
    }

    /// `normals` whose sides in folds come from the points themselves; `None` where the subset, of this `tree`, `bends`
    /// nowhere.
    fn grown(&self, normals: &[Vec3], tree: &Tree, bends: &[bool]) -> Option<Vec<Vec3>> {
        let known: Vec<bool> = self.neighbours.map(|i| {
            let near = tree.nearest_n(self.points[i], NEXT);
            !near.iter().any(|&(i, _)| bends[i])
        });
        if known.iter().all(|known| *known) {
            return None;
        }
        let count = self.neighbours.count();
        let directions: Vec<Vec3> = self.neighbours.map(|i| {
            if known[i] {
                normals[i]
            } else {
                plane(self.points, self.tree, self.points[i], count)
            }
        });
        Some(spanning::grown(
            self.points,
            &directions,
            self.neighbours,
            &known,
        ))
    }

    /// What fits tell of points whose outward `normals` are known.
    pub(super) fn refined(&self, normals: &[Vec3]) -> Estimated {
        let tree = Tree::new(&self.some);
        let near = Neighbourhoods::new(&tree, &self.some, self.neighbours.count());
        let coarse = refined(&self.some, &pick(normals, &self.chosen), &tree, &near);
        let (normals, quadrics) = if self.is_rough(coarse.noise) {
            (shared(self.points, &tree, &coarse.normals), None)
        } else {
            self.followed(normals.to_vec(), coarse.noise)
        };
        Estimated {
            normals,
            noise: self.least_noise(quadrics.as_ref(), coarse.noise),
            areas: None,
        }
    }

    /// Directions near those of `normals`, where noise leaves any to be found, and the quadrics that they are from.
    fn followed(&self, normals: Vec<Vec3>, noise: f64) -> (Vec<Vec3>, Option<Quadrics>) {
        if self.is_rough(noise) {
            return (normals, None);
        }
        let quadrics = Quadrics::new(self.points, &normals, self.neighbours);
        (quadrics.normals(normals), Some(quadrics))
    }

    /// The least noise that is seen.
    fn least_noise(&self, quadrics: Option<&Quadrics>, noise: f64) -> f64 {
        let of_quadrics = quadrics.map(|quadrics| quadrics.noise(self.neighbours));
        of_quadrics.map_or(noise, |found| noise.min(found))
    }

    fn is_rough(&self, noise: f64) -> bool {
        noise > ROUGH * median(&mut self.spacings.clone())
    }

    /// What becomes of `normals`, and how far that contradicts itself.
    fn judged(&self, normals: Vec<Vec3>, noise: f64) -> Judged {
        let (normals, quadrics) = self.followed(normals, noise);
        let areas = self.neighbours.areas(self.points, &normals, &self.spacings);
        Judged {
            contradiction: self.contradiction(&normals, &areas),
            normals,
            quadrics,
            areas,
        }
    }

    /// The same of `normals` of which most are those of `before`, with its `quadrics`: what is told of a point and its
    /// neighbours is worked out again where one of these has got another normal.
    fn judged_again(&self, before: &Judged, quadrics: &Quadrics, normals: Vec<Vec3>) -> Judged {
        let (points, neighbours) = (self.points, self.neighbours);
        let differing = |normals: &[Vec3]| -> Vec<bool> {
            let both = normals.par_iter().zip(&before.normals);
            neighbours.beside(
                &both
                    .map(|(now, then)| bits(*now) != bits(*then))
                    .collect::<Vec<_>>(),
            )
        };
        let quadrics = quadrics.again(points, &normals, (neighbours, &differing(&normals)));
        let normals = quadrics.normals(normals);
        let differing = differing(&normals);
        let areas = neighbours.map(|i| {
            if differing[i] {
                neighbours.area(i, points, &normals, self.spacings[i])
            } else {
                before.areas[i]
            }
        });
        Judged {
            contradiction: self.contradiction(&normals, &areas),
            normals,
            quadrics: Some(quadrics),
            areas,
        }
    }

    fn contradiction(&self, normals: &[Vec3], areas: &[f64]) -> f64 {
        contradiction(Oriented {
            points: self.points,
            normals,
            areas,
            spacings: &self.spacings,
        })
        .closed
    }
}

/// Outward unit normals, and what they tell.
struct Judged {
    normals: Vec<Vec3>,
    /// What their directions are from; none where the points are rough.
    quadrics: Option<Quadrics>,
    /// Areas that the points stand for.
    areas: Vec<f64>,
    contradiction: f64,
}

/// Which points have a neighbour whose normal has another direction: folds, edges and parts that nearly touch.
fn bends(normals: &[Vec3], neighbours: &Neighbourhoods) -> Vec<bool> {
    (0..normals.len())
        .into_par_iter()
        .map(|i| {
            let mut nearest = neighbours.of(i).take(NEXT);
            nearest.any(|j| dot(normals[i], normals[j]) < BENT)
        })
        .collect()
}
