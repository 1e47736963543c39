//! The surface as its points tell it: normals, spacing, which side is inside, how far it is.

use rayon::prelude::*;

use super::neighbours::{Neighbourhoods, Tree, quantile};
use super::normals::{NormalSource, Normals, normals};
use super::winding::{Oriented, Winding};
use crate::reconstruction::observer::Warning;
use crate::reconstruction::vector::{Vec3, along, dot, sub};

/// A place is surely inside or outside where its winding number is so near to 1 or 0: a band of 0.3 around
/// one half stays undecided.
const MOST_DOUBT: f64 = 0.35;

/// As near to 1 or 0 it is anywhere: the clusters of the winding number.
const LEAST_DOUBT: f64 = 0.02;

/// The share of the points from which to the next the winding number changes less than the doubt takes.
const DOUBT_QUANTILE: f64 = 0.75;

/// The doubt over that change.
const DOUBT_OVER_CHANGE: f64 = 2.0;

/// So many points tell what the winding number is worth.
const ASKED: usize = 2_000;

/// The winding number of the surface itself: half way from outside to inside.
const LEVEL: f64 = 0.5;

/// How far from its nearest point a place of the surface may be, in local spacings: the largest gaps
/// of a random sampling.
const GAP: f64 = 2.0;

/// Oriented points with what is needed to ask about places around them.
pub struct OrientedSurface {
    /// Positions.
    pub points: Vec<Vec3>,
    /// Outward unit normals.
    pub normals: Vec<Vec3>,
    /// Local spacings.
    pub spacings: Vec<f64>,
    /// Where the normals come from.
    pub source: NormalSource,
    /// Standard deviation of the points from the surface.
    pub noise: f64,
    /// Share of the points whose normal the winding number of all of them bears out, 0 to 1: above one half
    /// one local spacing inside of the point and below it as far outside.
    pub confidence: f64,
    /// How far the winding number is unsure one spacing away from the points.
    doubt: f64,
    tree: Tree,
    winding: Winding,
}

impl OrientedSurface {
    /// The surface through `points`, at least two, all different. Of a `sparse` cloud the winding number
    /// is taken as unsure as it can be.
    pub fn new(
        points: Vec<Vec3>,
        given: Option<&[Vec3]>,
        neighbours: usize,
        sparse: bool,
        warnings: &mut Vec<Warning>,
    ) -> Self {
        let tree = Tree::new(&points);
        let near = Neighbourhoods::new(&tree, &points, neighbours);
        let Normals {
            directions: normals,
            source,
            noise,
        } = normals(&points, given, &tree, &near, warnings);
        let spacings = near.spacings(&points);
        let areas = near.areas(&points, &normals, &spacings);
        let winding = Winding::new(Oriented {
            points: &points,
            normals: &normals,
            areas: &areas,
            spacings: &spacings,
        });
        let beside = |i: usize| {
            [-1.0, 1.0].map(|side| winding.at(along(points[i], side * spacings[i], normals[i])))
        };
        let asked: Vec<Asked> = (0..points.len())
            .into_par_iter()
            .step_by(points.len().div_ceil(ASKED))
            .map(|i| Asked {
                here: beside(i),
                next: beside(near.of(i).next().unwrap_or(i)),
            })
            .collect();
        Self {
            points,
            normals,
            spacings,
            source,
            noise,
            confidence: confidence(&asked),
            doubt: if sparse { f64::INFINITY } else { doubt(&asked) },
            tree,
            winding,
        }
    }

    /// Whether `q` is inside; `None` where the points leave it open.
    ///
    /// What the points do not surround evenly, they surround by a part of the sphere: around a hole the
    /// winding number is neither 0 nor 1, and the field shall find its own way there. The finer the
    /// sampling, and the farther away, the less else keeps it from either.
    pub fn inside(&self, q: Vec3) -> Option<bool> {
        let winding = self.winding.at(q);
        let (i, distance) = self.tree.nearest(q);
        let away = (distance / self.spacings[i]).max(1.0);
        let doubt = (self.doubt / away).clamp(LEAST_DOUBT, MOST_DOUBT);
        if winding > 1.0 - doubt {
            Some(true)
        } else if winding < doubt {
            Some(false)
        } else {
            None
        }
    }

    /// Index of the point nearest to `q`, and the distance of `q` to the surface there.
    ///
    /// Close by, that is the distance to the tangent plane; it is never less than what it would
    /// be if the foot lay as far beside the point as gaps between points allow.
    pub fn nearest(&self, q: Vec3) -> (usize, f64) {
        let (i, to_point) = self.tree.nearest(q);
        let to_plane = dot(sub(q, self.points[i]), self.normals[i]).abs();
        let gap = GAP * self.spacings[i];
        let least = (to_point * to_point - gap * gap).max(0.0);
        (i, to_plane.max(least.sqrt()))
    }
}

/// The winding number one local spacing inside and outside of a point, and of the one nearest to it.
struct Asked {
    here: [f64; 2],
    next: [f64; 2],
}

/// How much the winding number changes from one point to the next, one spacing inside and outside them: what
/// sampling, noise and wrong normals make of it. Holes change it slowly.
fn doubt(asked: &[Asked]) -> f64 {
    let mut changes: Vec<f64> = asked
        .iter()
        .flat_map(|Asked { here, next }| [0, 1].map(|side| (here[side] - next[side]).abs()))
        .collect();
    DOUBT_OVER_CHANGE * quantile(&mut changes, DOUBT_QUANTILE)
}

/// Share of the points at which the winding number has both sides where the normal says.
fn confidence(asked: &[Asked]) -> f64 {
    let borne_out = asked
        .iter()
        .filter(|asked| asked.here[0] > LEVEL && asked.here[1] < LEVEL);
    borne_out.count() as f64 / asked.len() as f64
}
