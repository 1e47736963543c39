//! Clouds that are denser one way than the other: contours on slices, scan lines.
//!
//! The nearest neighbours of a point on a slice lie on the same slice. They say nothing of the way across, and
//! any plane through the slice fits them. An even subset, whose points are as far apart along the slices as the
//! slices are, tells the surface; the other points lie on the surface that it tells.

use std::collections::HashMap;

use rand::seq::SliceRandom;
use rayon::prelude::*;

use super::neighbours::{Neighbourhoods, Tree, median};
use crate::reconstruction::random::{Purpose, stream};
use crate::reconstruction::symmetric::{covariance, eigen};
use crate::reconstruction::vector::{Vec3, distance, sub};

/// Neighbours whose extent is measured: two rings around a point of an even sampling.
const RING: usize = 12;

/// Middle over largest extent of a neighbourhood below which it lies on a line. Two rings of an even sampling
/// are above 0.5, of a random one above this in 99 of 100 places.
const NARROW: f64 = 0.3;

/// Most of the neighbourhoods that may be narrow: the ends of thin tubes and the rims of sheets are.
const FEW_NARROW: f64 = 0.05;

/// Places where neighbourhoods are measured.
const MEASURED: usize = 2_000;

/// Growth of the least distance from one subset that is tried to the next.
const GROWTH: f64 = std::f64::consts::SQRT_2;

/// Fewest points of a subset.
const FEWEST: usize = 64;

/// Positions in `points` of an even subset; none where the points are even themselves.
///
/// The least distance between its points grows from their own spacing on, or from `least` where that is larger,
/// until no more than a few neighbourhoods are narrow. Where none is broad, nothing is gained and none is given.
pub(super) fn even_scale(points: &[Vec3], tree: &Tree, least: f64) -> Option<Vec<usize>> {
    let own = narrow(points, tree);
    if own <= FEW_NARROW && least == 0.0 {
        return None;
    }
    let near = Neighbourhoods::new(tree, points, 2);
    let spacing = median(&mut near.spacings(points));
    let mut reach = least.max(GROWTH * spacing);
    loop {
        let chosen = spread_out(points, reach);
        if chosen.len() < FEWEST {
            return None;
        }
        let some: Vec<Vec3> = chosen.iter().map(|&i| points[i]).collect();
        if narrow(&some, &Tree::new(&some)) <= FEW_NARROW {
            return Some(chosen);
        }
        reach *= GROWTH;
    }
}

/// Share of the neighbourhoods that lie on a line.
fn narrow(points: &[Vec3], tree: &Tree) -> f64 {
    let asked: Vec<usize> = (0..points.len())
        .step_by(points.len().div_ceil(MEASURED))
        .collect();
    let narrow = asked.par_iter().filter(|&&i| {
        let near = tree.nearest_n(points[i], RING + 1);
        let arms: Vec<Vec3> = near
            .into_iter()
            .map(|(j, _)| sub(points[j], points[i]))
            .collect();
        let (values, _) = eigen(covariance(&arms));
        values[1].max(0.0).sqrt() < NARROW * values[2].max(0.0).sqrt()
    });
    narrow.count() as f64 / asked.len() as f64
}

/// Positions, ascending, of points no two of which are nearer than `reach`, and to one of which every other
/// point is.
pub(super) fn spread_out(points: &[Vec3], reach: f64) -> Vec<usize> {
    let cell = |p: Vec3| p.map(|v| (v / reach).floor() as i64);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.shuffle(&mut stream(0, Purpose::Selection));
    let mut cells: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    let mut chosen = Vec::new();
    for i in order {
        let [x, y, z] = cell(points[i]);
        let taken = (0..27).any(|k| {
            let at = [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
            cells
                .get(&at)
                .is_some_and(|near| near.iter().any(|&j| distance(points[i], points[j]) < reach))
        });
        if !taken {
            cells.entry([x, y, z]).or_default().push(i);
            chosen.push(i);
        }
    }
    chosen.sort_unstable();
    chosen
}
