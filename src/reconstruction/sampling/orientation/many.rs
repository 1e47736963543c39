//! Orientation of many points, by way of an even subset of them.

use super::contradiction::contradiction;
use super::{CLEARLY_LESS, CONTRADICTS, Estimated, MANY, ROUGH, orient, refined, spanning};
use crate::reconstruction::random::{Purpose, stream};
use crate::reconstruction::sampling::jets::Jets;
use crate::reconstruction::sampling::neighbours::{Neighbourhoods, Tree, median};
use crate::reconstruction::sampling::normals::{estimate, shared};
use crate::reconstruction::sampling::selection::{even_subset, pick};
use crate::reconstruction::sampling::winding::Oriented;
use crate::reconstruction::vector::Vec3;

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
        let contradicted = self.contradiction(&followed.normals);
        if contradicted < CONTRADICTS {
            return followed;
        }
        let flat = estimate(self.points, self.tree, self.neighbours.count());
        let spanned = spanning::propagated(self.points, &flat, self.neighbours);
        let spanned = self.refine(spanned, coarse.noise);
        if self.contradiction(&spanned.normals) < CLEARLY_LESS * contradicted {
            spanned
        } else {
            followed
        }
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
