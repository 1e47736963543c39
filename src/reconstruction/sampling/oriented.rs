//! The surface as its points tell it: normals, spacing, which side is inside, how far it is.

use super::neighbours::{Neighbourhoods, Tree};
use super::normals::{NormalSource, normals};
use super::winding::{Oriented, Winding};
use crate::reconstruction::observer::Warning;
use crate::reconstruction::vector::{Vec3, dot, sub};

/// Winding number from which a place is surely inside. With 1 - it for outside, a band of 0.3 around
/// one half stays undecided: holes and noise leave it there, whole surfaces do not.
const INSIDE: f64 = 0.65;

/// Winding number up to which a place is surely outside.
const OUTSIDE: f64 = 1.0 - INSIDE;

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
    tree: Tree,
    winding: Winding,
}

impl OrientedSurface {
    /// The surface through `points`, at least two, all different.
    pub fn new(
        points: Vec<Vec3>,
        given: Option<&[Vec3]>,
        neighbours: usize,
        warnings: &mut Vec<Warning>,
    ) -> Self {
        let tree = Tree::new(&points);
        let near = Neighbourhoods::new(&tree, &points, neighbours);
        let (normals, source) = normals(&points, given, &tree, &near, warnings);
        let spacings = near.spacings(&points);
        let areas = near.areas(&points, &normals, &spacings);
        let winding = Winding::new(Oriented {
            points: &points,
            normals: &normals,
            areas: &areas,
            spacings: &spacings,
        });
        Self {
            points,
            normals,
            spacings,
            source,
            tree,
            winding,
        }
    }

    /// Whether `q` is inside; `None` where the points leave it open.
    pub fn inside(&self, q: Vec3) -> Option<bool> {
        let winding = self.winding.at(q);
        if winding > INSIDE {
            Some(true)
        } else if winding < OUTSIDE {
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
