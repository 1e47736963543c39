//! Orientation of many points, by way of an even subset of them.

use rayon::prelude::*;

use super::contradiction::contradiction;
use super::{CLEARLY_LESS, CONTRADICTS, Estimated, MANY, ROUGH, orient, refined, spanning};
use crate::reconstruction::random::{Purpose, stream};
use crate::reconstruction::sampling::jets::Jets;
use crate::reconstruction::sampling::neighbours::{Neighbourhoods, Tree, median};
use crate::reconstruction::sampling::normals::{estimate, plane, shared};
use crate::reconstruction::sampling::selection::{even_subset, pick};
use crate::reconstruction::sampling::winding::Oriented;
use crate::reconstruction::vector::{Vec3, dot};

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
        let followed = self.refine(shared(self.points, &tree, &coarse.normals), coarse.noise);
        let mut contradicted = self.contradiction(&followed.normals);
        let mut best = followed;
        if !self.is_rough(coarse.noise)
            && let Some(grown) = self.grown(&best.normals, &tree, &bends(&coarse.normals, &near))
        {
            let grown = self.refine(grown, coarse.noise);
            let less = self.contradiction(&grown.normals);
            if CLEARLY_LESS * less < contradicted {
                (best, contradicted) = (grown, less);
            }
        }
        if contradicted < CONTRADICTS {
            return best;
        }
        let flat = estimate(self.points, self.tree, self.neighbours.count());
        let spanned = spanning::propagated(self.points, &flat, self.neighbours);
        let spanned = self.refine(spanned, coarse.noise);
        if self.contradiction(&spanned.normals) < CLEARLY_LESS * contradicted {
            spanned
        } else {
            best
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
        if self.is_rough(coarse.noise) {
            return Estimated {
                normals: shared(self.points, &tree, &coarse.normals),
                noise: coarse.noise,
            };
        }
        self.refine(normals.to_vec(), coarse.noise)
    }

    /// Directions near those of `normals`, where noise leaves any to be found; and the least noise that is seen.
    fn refine(&self, normals: Vec<Vec3>, noise: f64) -> Estimated {
        if self.is_rough(noise) {
            return Estimated { normals, noise };
        }
        let jets = Jets::nearest(self.points, &normals, self.neighbours);
        Estimated {
            noise: noise.min(jets.noise()),
            normals: jets.normals,
        }
    }

    fn is_rough(&self, noise: f64) -> bool {
        noise > ROUGH * median(&mut self.spacings.clone())
    }

    fn contradiction(&self, normals: &[Vec3]) -> f64 {
        contradiction(Oriented {
            points: self.points,
            normals,
            areas: &self.neighbours.areas(self.points, normals, &self.spacings),
            spacings: &self.spacings,
        })
        .closed
    }
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
