//! What the winding number of oriented points says about their own normals.

use rayon::prelude::*;

use super::neighbours::{Neighbourhoods, quantile};
use super::winding::{Oriented, Winding};
use crate::reconstruction::vector::{Vec3, along};

/// The share of the points from which to the next the winding number changes less than the doubt takes.
const DOUBT_QUANTILE: f64 = 0.75;

/// The doubt over that change.
const DOUBT_OVER_CHANGE: f64 = 2.0;

/// So many points tell what the winding number is worth.
const ASKED: usize = 2_000;

/// The winding number of a closed surface itself: half way from outside to inside.
pub(super) const LEVEL: f64 = 0.5;

/// How far from [`LEVEL`] the winding number of a sheet may be that closes: the middle of a hemisphere is as
/// far, flat sheets are at twice that.
const OPEN: f64 = 0.25;

/// The winding number of oriented points, and what it says one local spacing beside some of them.
pub(super) struct Sides {
    pub(super) winding: Winding,
    /// Places beside every so many points.
    asked: Vec<Asked>,
}

/// The winding number one local spacing inside and outside of a point, and of the one nearest to it.
struct Asked {
    here: [f64; 2],
    next: [f64; 2],
}

impl Sides {
    pub(super) fn new(oriented: Oriented<'_>, near: &Neighbourhoods) -> Self {
        let winding = Winding::new(oriented);
        let count = oriented.points.len();
        let asked = (0..count)
            .into_par_iter()
            .step_by(count.div_ceil(ASKED))
            .map(|i| Asked {
                here: beside(&winding, oriented, i),
                next: beside(&winding, oriented, near.of(i).next().unwrap_or(i)),
            })
            .collect();
        Self { winding, asked }
    }

    /// Share of the points at which the winding number has both sides where the normal says.
    pub(super) fn confidence(&self) -> f64 {
        self.share(|[inner, outer]| inner > LEVEL && outer < LEVEL)
    }

    /// Share of the points at which the winding number is larger where the normal says outside: on closed and
    /// open sheets alike, such a normal points to the wrong side.
    pub(super) fn reversed(&self) -> f64 {
        self.share(|[inner, outer]| inner < outer)
    }

    /// How much the winding number changes from one point to the next, one spacing inside and outside them:
    /// what sampling, noise and wrong normals make of it. Holes change it slowly.
    pub(super) fn doubt(&self) -> f64 {
        let mut changes: Vec<f64> = self
            .asked
            .iter()
            .flat_map(|Asked { here, next }| [0, 1].map(|side| (here[side] - next[side]).abs()))
            .collect();
        DOUBT_OVER_CHANGE * quantile(&mut changes, DOUBT_QUANTILE)
    }

    /// Share of the view from the points that the surface lacks: its winding number falls short of [`LEVEL`] by as
    /// large a share of it.
    pub(super) fn missing(&self) -> f64 {
        let levels = self.asked.iter().map(|asked| middle(asked.here));
        let mean = levels.sum::<f64>() / self.asked.len().max(1) as f64;
        (1.0 - mean / LEVEL).max(0.0)
    }

    /// Whether the points are those of a sheet that is far from closed: at most of them the winding number jumps
    /// by one, but not from 0 to 1. Through a body thinner than the spacing it does not jump.
    pub(super) fn open(&self) -> bool {
        let jumps = |[inner, outer]: [f64; 2]| inner - outer > 0.5;
        self.share(|here| jumps(here) && (middle(here) - LEVEL).abs() > OPEN) > 0.5
    }

    /// The winding number of the surface at each of the points: half way between both sides.
    pub(super) fn levels(&self, oriented: Oriented<'_>) -> Vec<f64> {
        let [inner, outer] = [-1.0, 1.0].map(|side| {
            let places = (0..oriented.points.len()).map(|i| place_beside(oriented, i, side));
            self.winding.at_all(&places.collect::<Vec<_>>())
        });
        let both = inner.into_iter().zip(outer);
        both.map(|(inner, outer)| middle([inner, outer])).collect()
    }

    fn share(&self, holds: impl Fn([f64; 2]) -> bool) -> f64 {
        let count = self.asked.iter().filter(|asked| holds(asked.here)).count();
        count as f64 / self.asked.len().max(1) as f64
    }
}

fn beside(winding: &Winding, oriented: Oriented<'_>, i: usize) -> [f64; 2] {
    [-1.0, 1.0].map(|side| winding.at(place_beside(oriented, i, side)))
}

/// The place one local spacing inside, at -1, or outside of point `i`, at 1.
fn place_beside(oriented: Oriented<'_>, i: usize, side: f64) -> Vec3 {
    along(
        oriented.points[i],
        side * oriented.spacings[i],
        oriented.normals[i],
    )
}

fn middle([inner, outer]: [f64; 2]) -> f64 {
    0.5 * (inner + outer)
}
