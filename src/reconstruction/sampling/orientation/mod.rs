//! Outward normals of bare points: their side from the winding field, their direction from local fits.

mod consistency;
mod contradiction;
mod dipoles;
mod many;
mod spanning;

use super::jets::{Jets, WIDEST};
use super::neighbours::{Neighbourhoods, Tree, median};
use super::normals::estimate;
use super::selection::even_subset;
use super::winding::Oriented;
use crate::reconstruction::random::{Purpose, stream};
use crate::reconstruction::vector::Vec3;
use consistency::Consistent;
use contradiction::{Contradiction, contradiction};
use many::Many;

pub(super) use contradiction::least_contradiction;
pub(super) use spanning::points_inwards;

/// Most points between which all pairs are summed; the others follow their field.
const MOST_PAIRED: usize = 5_000;

/// Most points on which sides and the sizes of fits are worked out; those of larger clouds follow an even subset.
pub(in crate::reconstruction) const MANY: usize = 20_000;

/// Contradiction of the sides that follow a subset from which on all points are asked for theirs: parts so thin
/// that the subset takes both faces for one have more.
const CONTRADICTS: f64 = 0.1;

/// Width of the kernel, in spacings, where there is no noise.
const LEAST_WIDTH: f64 = 0.5;

/// Width of the kernel in spacings over the square of the noise in spacings: measured on clouds from
/// 300 to 8000 points with noise of 0.5 and 1 % of the diagonal.
const WIDTH_OF_NOISE: f64 = 11.0;

/// Rounds in which noise and normals settle.
const ROUNDS: usize = 3;

/// A width is worth another round if it is so many times the last one.
const WORTH: f64 = 1.25;

/// Noise in spacings above which its estimate falls short, because the nearest points are those
/// with similar noise.
const ROUGH: f64 = 0.35;

/// Width in spacings beyond which it is not doubled.
const WIDE: f64 = 2.5;

/// A doubled width is kept if the contradiction falls below this share.
const IMPROVED: f64 = 0.8;

/// The spanning tree is believed if its contradiction is below this share of the winding field's.
const CLEARLY_LESS: f64 = 0.5;

/// The same where nothing closes, and only the sides of neighbours count.
const LESS: f64 = 0.8;

/// Contradiction of the best sides from which on no sides make a closed surface of the points: a flat sheet is at
/// 0.5, what lacks less than half of its surface below 0.15.
const NOTHING_CLOSES: f64 = 0.2;

/// How much the fits lean to large neighbourhoods: little, so that the shape is kept, ...
const LEANING: f64 = 0.25;

/// ... or, on rough clouds, as much as the error of a slope falls with their size.
const ROUGH_LEANING: f64 = 0.5;

/// What bare points tell.
pub struct Estimated {
    /// Outward unit normals.
    pub normals: Vec<Vec3>,
    /// Standard deviation of the points from the surface.
    pub noise: f64,
    /// Areas that the points stand for, where they were worked out on the way.
    pub areas: Option<Vec<f64>>,
}

/// Outward unit normals of `points`.
///
/// The side comes from the winding field (\[LSL24\]), whose kernels are made as wide as the noise asks
/// for; the noise is what local fits leave, and those give the directions too. Open sheets have no
/// inside: their side comes from a spanning tree (\[H92\]), as where that contradicts itself much less.
pub fn orient(points: &[Vec3], tree: &Tree, neighbours: &Neighbourhoods) -> Estimated {
    if points.len() > MANY {
        return Many::new(points, tree, neighbours).orient();
    }
    let cloud = Cloud::new(points, tree, neighbours);
    let flat = estimate(points, tree, neighbours.count());
    let spanned = spanning::propagated(points, &flat, neighbours);
    let spanned = cloud.fitted(&spanned);
    let wound = cloud.settled();
    let [of_spanned, of_wound] = [&spanned, &wound].map(|jets| cloud.contradiction(&jets.normals));
    let closes = of_spanned.closed < CLEARLY_LESS * of_wound.closed;
    let has_one_side = of_spanned.sheet < LESS * of_wound.sheet && of_wound.closed > NOTHING_CLOSES;
    if closes || has_one_side {
        spanned.into()
    } else {
        wound.into()
    }
}

/// What local fits tell of `points` whose outward unit normals are known.
pub fn refined(
    points: &[Vec3],
    normals: &[Vec3],
    tree: &Tree,
    neighbours: &Neighbourhoods,
) -> Estimated {
    if points.len() > MANY {
        return Many::new(points, tree, neighbours).refined(normals);
    }
    Cloud::new(points, tree, neighbours).fitted(normals).into()
}

impl From<Jets> for Estimated {
    fn from(jets: Jets) -> Self {
        Self {
            noise: jets.noise(),
            normals: jets.normals,
            areas: None,
        }
    }
}

/// Points with what every round needs.
struct Cloud<'a> {
    points: &'a [Vec3],
    neighbours: &'a Neighbourhoods,
    around: Neighbourhoods,
    spacings: Vec<f64>,
    /// Median of `spacings`.
    spacing: f64,
    /// An even subset of `points`, and how much farther apart its points are.
    paired: Vec<Vec3>,
    thinning: f64,
}

impl<'a> Cloud<'a> {
    fn new(points: &'a [Vec3], tree: &Tree, neighbours: &'a Neighbourhoods) -> Self {
        let spacings = neighbours.spacings(points);
        let chosen = even_subset(points, MOST_PAIRED, &mut stream(0, Purpose::Selection));
        Self {
            points,
            neighbours,
            around: Neighbourhoods::new(tree, points, WIDEST * neighbours.count()),
            spacing: median(&mut spacings.clone()),
            spacings,
            thinning: (points.len() as f64 / chosen.len() as f64).sqrt(),
            paired: chosen.into_iter().map(|i| points[i]).collect(),
        }
    }

    /// Fits on the side of the winding field, with the width that the noise asks for.
    fn settled(&self) -> Jets {
        let mut width = LEAST_WIDTH;
        let mut best = self.wound(width);
        for _ in 1..ROUNDS {
            let error = best.error() / self.spacing;
            let wanted = (WIDTH_OF_NOISE * error * error / self.thinning).max(LEAST_WIDTH);
            if wanted <= WORTH * width {
                break;
            }
            width = wanted;
            best = self.wound(width);
        }
        if self.rough(&best) {
            let mut least = self.contradiction(&best.normals).closed;
            while width < WIDE {
                let wider = self.wound(2.0 * width);
                let found = self.contradiction(&wider.normals).closed;
                if found > IMPROVED * least {
                    break;
                }
                (width, best, least) = (2.0 * width, wider, found);
            }
        }
        best
    }

    /// Fits on the side that the winding field with a kernel of `width` gives, in spacings of the paired
    /// points.
    fn wound(&self, width: f64) -> Jets {
        let width = width * self.spacing * self.thinning;
        let consistent = Consistent::new(&self.paired, width);
        if self.paired.len() == self.points.len() {
            self.fitted(&consistent.normals)
        } else {
            self.fitted(&consistent.at(self.points))
        }
    }

    /// Fits from oriented normals on; on rough clouds once more from what comes out.
    fn fitted(&self, normals: &[Vec3]) -> Jets {
        let jets = Jets::new(self.points, normals, &self.around, LEANING);
        if self.rough(&jets) {
            Jets::new(self.points, &jets.normals, &self.around, ROUGH_LEANING)
        } else {
            jets
        }
    }

    fn rough(&self, jets: &Jets) -> bool {
        jets.error() > ROUGH * self.spacing
    }

    fn contradiction(&self, normals: &[Vec3]) -> Contradiction {
        contradiction(Oriented {
            points: self.points,
            normals,
            areas: &self.neighbours.areas(self.points, normals, &self.spacings),
            spacings: &self.spacings,
        })
    }
}
