//! The surface as its points tell it: normals, spacing, which side is inside, how far it is.

use std::sync::Arc;

use super::evenness::even_scale;
use super::neighbours::{Neighbourhoods, Tree, median};
use super::normals::{NormalSource, shared};
use super::sides::{LEVEL, Sides};
use super::told::Told;
use super::winding::Winding;
use crate::reconstruction::nearby::{Threads, Walk, map_nearby};
use crate::reconstruction::observer::Warning;
use crate::reconstruction::vector::{Vec3, dot, sub};

/// A place is surely inside or outside where its winding number is so near to 1 or 0: a band of 0.3 around
/// one half stays undecided.
const MOST_DOUBT: f64 = 0.35;

/// As near to 1 or 0 it is anywhere: the clusters of the winding number.
const LEAST_DOUBT: f64 = 0.02;

/// How far from its nearest point a place of the surface may be, in local spacings: the largest gaps
/// of a random sampling.
const GAP: f64 = 2.0;

/// Up to so many local spacings from an open sheet, its own winding number is what divides inside from outside.
const BESIDE: f64 = 2.0;

/// From so many on, it is that of the bag which closes the sheet.
const AWAY: f64 = 6.0;

/// Winding numbers that divide inside from outside.
struct OpenSheet {
    /// At each point, and beside the sheet there.
    at_points: Vec<f64>,
    /// Away from it: half of what the sheet has on its inner side, so that the surface closes where the sheet
    /// fills half as much of the view.
    away: f64,
}

/// Points, the tree over them, and the neighbours of each.
pub struct Located {
    pub(super) points: Vec<Vec3>,
    pub(super) tree: Arc<Tree>,
    pub(super) near: Neighbourhoods,
}

impl Located {
    /// `points`, at least one, with so many neighbours of each.
    pub fn new(points: Vec<Vec3>, neighbours: usize) -> Self {
        let tree = Arc::new(Tree::new(&points));
        Self {
            near: Neighbourhoods::new(&tree, &points, neighbours),
            points,
            tree,
        }
    }
}

/// A place beside oriented points.
#[derive(Clone, Copy, Default)]
pub struct Place {
    /// The place itself.
    q: Vec3,
    /// Index of the point nearest to it, ...
    pub nearest: usize,
    /// ... and how far away that is.
    to_point: f64,
}

/// Oriented points with what is needed to ask about places around them.
pub struct OrientedSurface {
    /// Positions.
    pub points: Vec<Vec3>,
    /// Outward unit normals.
    pub normals: Vec<Vec3>,
    /// Local spacings: those of the points that are worked with, which are even.
    pub spacings: Vec<f64>,
    /// Number of the points that the orientation was worked out on: all, or an even subset of them.
    pub even_points: usize,
    /// Spacing of the even subset over that along slices or scan lines; 1 without a subset.
    pub anisotropy: f64,
    /// Area of the surface: that of the cells of its points.
    pub area: f64,
    /// Where the normals come from.
    pub source: NormalSource,
    /// Standard deviation of the points from the surface.
    pub noise: f64,
    /// Share of the points whose normal the winding number of all of them bears out, 0 to 1: above one half
    /// one local spacing inside of the point and below it as far outside.
    pub confidence: f64,
    /// Share of the view from the points that the surface lacks ([`Uncertainty::missing`](super::Uncertainty::missing)).
    pub missing: f64,
    /// How far the winding number is unsure one spacing away from the points.
    doubt: f64,
    /// What divides inside from outside where the points are those of an open sheet.
    open: Option<OpenSheet>,
    tree: Arc<Tree>,
    winding: Winding,
}

impl OrientedSurface {
    /// The surface through points, at least two, all different. Of a `sparse` cloud the winding number is taken as
    /// unsure as it can be.
    pub fn new(
        located: Located,
        given: Option<&[Vec3]>,
        sparse: bool,
        warnings: &mut Vec<Warning>,
    ) -> Self {
        let Some(chosen) = even_scale(&located.points, &located.tree, 0.0) else {
            return Self::even(located, given, sparse, warnings);
        };
        let neighbours = located.near.count();
        let Located { points, tree, .. } = located;
        let pick = |from: &[Vec3]| -> Vec<Vec3> { chosen.iter().map(|&i| from[i]).collect() };
        let some = pick(&points);
        let given = given.map(pick);
        let some = Located::new(some, neighbours);
        let even = Self::even(some, given.as_deref(), sparse, warnings);
        even.extended_to(points, tree)
    }

    fn even(
        located: Located,
        given: Option<&[Vec3]>,
        sparse: bool,
        warnings: &mut Vec<Warning>,
    ) -> Self {
        let Located { points, tree, near } = located;
        let told = Told::new(&points, given, (&tree, near), warnings);
        let oriented = told.oriented(&points);
        let sides = Sides::new(oriented, &told.near);
        Self {
            open: sides.open().then(|| OpenSheet::new(sides.levels(oriented))),
            even_points: points.len(),
            anisotropy: 1.0,
            area: told.areas.iter().sum(),
            source: told.normals.source,
            noise: told.normals.noise,
            confidence: sides.confidence(),
            missing: sides.missing(),
            doubt: if sparse || sides.open() {
                f64::INFINITY
            } else {
                sides.doubt()
            },
            tree,
            winding: sides.winding,
            points,
            normals: told.normals.directions,
            spacings: told.spacings,
        }
    }

    /// The same surface seen from all of `points`, over which `tree` was made.
    fn extended_to(self, points: Vec<Vec3>, tree: Arc<Tree>) -> Self {
        let nearest = map_nearby(&points, |i| self.tree.nearest(points[i]).0);
        let mut along = Neighbourhoods::new(&tree, &points, 2).spacings(&points);
        let across = median(&mut self.spacings.clone());
        let of_nearest = |values: &[f64]| nearest.iter().map(|&i| values[i]).collect();
        Self {
            anisotropy: across / median(&mut along).max(f64::MIN_POSITIVE),
            normals: shared(&points, &self.tree, &self.normals),
            spacings: of_nearest(&self.spacings),
            open: self.open.map(|sheet| OpenSheet {
                at_points: of_nearest(&sheet.at_points),
                ..sheet
            }),
            points,
            tree,
            ..self
        }
    }

    /// Where each of `queries` is beside the points.
    pub fn places(&self, queries: &[Vec3], threads: Threads) -> Vec<Place> {
        let walk = Walk::on(threads, queries);
        walk.map(|i| self.place(queries[i]))
    }

    /// Where a place is beside the points.
    pub fn place(&self, q: Vec3) -> Place {
        let (nearest, to_point) = self.tree.nearest(q);
        Place {
            q,
            nearest,
            to_point,
        }
    }

    /// Whether each of `places` is inside; `None` where the points leave it open.
    ///
    /// What the points do not surround evenly, they surround by a part of the sphere: around a hole the
    /// winding number is neither 0 nor 1, and the field shall find its own way there. The finer the
    /// sampling, and the farther away, the less else keeps it from either.
    pub fn inside(&self, places: &[Place], threads: Threads) -> Vec<Option<bool>> {
        let queries: Vec<Vec3> = places.iter().map(|place| place.q).collect();
        let windings = self.winding.at_each(&queries, threads);
        let told = windings.into_iter().zip(places);
        told.map(|(winding, place)| self.side(winding, place))
            .collect()
    }

    /// Whether a place with such a winding number is inside.
    fn side(&self, winding: f64, place: &Place) -> Option<bool> {
        let i = place.nearest;
        let away = (place.to_point / self.spacings[i]).max(1.0);
        let doubt = (self.doubt / away).clamp(LEAST_DOUBT, MOST_DOUBT);
        let winding = winding + LEVEL - self.level(i, away);
        if winding > 1.0 - doubt {
            Some(true)
        } else if winding < doubt {
            Some(false)
        } else {
            None
        }
    }

    /// The winding number that divides inside from outside so many spacings away from point `i`.
    fn level(&self, i: usize, away: f64) -> f64 {
        let share = ((AWAY - away) / (AWAY - BESIDE)).clamp(0.0, 1.0);
        self.open.as_ref().map_or(LEVEL, |sheet| {
            sheet.away + share * (sheet.at_points[i] - sheet.away)
        })
    }

    /// The distance of a place to the surface.
    ///
    /// Close by, that is the distance to the tangent plane; it is never less than what it would
    /// be if the foot lay as far beside the point as gaps between points allow.
    pub fn distance(&self, place: &Place) -> f64 {
        let i = place.nearest;
        let to_plane = dot(sub(place.q, self.points[i]), self.normals[i]).abs();
        let gap = GAP * self.spacings[i];
        let least = (place.to_point * place.to_point - gap * gap).max(0.0);
        to_plane.max(least.sqrt())
    }
}

impl OpenSheet {
    fn new(at_points: Vec<f64>) -> Self {
        let inner = median(&mut at_points.clone()) + LEVEL;
        Self {
            at_points,
            away: 0.5 * inner,
        }
    }
}
