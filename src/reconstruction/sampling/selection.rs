//! Which points are trained on and which are held out: even over the surface, and by the seed.

use std::collections::HashSet;

use rand::RngExt;

use crate::reconstruction::nearby::{is_many, morton_order};
use crate::reconstruction::random::Generator;
use crate::reconstruction::vector::{Vec3, bits};

/// Fewest points that stay in training when a small cloud gives some to validation.
const MIN_TRAINED: usize = 64;

/// Positions in a list of points that are trained on and those that are not; both ascending.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Split {
    /// Trained on.
    pub trained: Vec<usize>,
    /// Held out.
    pub held_out: Vec<usize>,
}

impl Split {
    /// At most `budget` of `points` are trained on; where all are within it, `fraction` of them is
    /// held out all the same, except from tiny clouds.
    pub fn new(points: &[Vec3], budget: usize, fraction: f64, random: &mut Generator) -> Self {
        let trained = trained_points(points.len(), budget, fraction);
        let trained = even_subset(points, trained, random);
        let held_out = others(points.len(), &trained);
        Self { trained, held_out }
    }

    /// `count` of `points` are held out, as evenly as they are spread.
    pub(in crate::reconstruction) fn holding_out(
        points: &[Vec3],
        count: usize,
        random: &mut Generator,
    ) -> Self {
        let held_out = even_subset(points, count, random);
        let trained = others(points.len(), &held_out);
        Self { trained, held_out }
    }
}

/// How many of so many points are trained on, see [`Split::new`].
pub(in crate::reconstruction) fn trained_points(
    points: usize,
    budget: usize,
    fraction: f64,
) -> usize {
    if points > budget {
        budget
    } else {
        let held_out = (fraction * points as f64) as usize;
        (points - held_out).max(points.min(MIN_TRAINED))
    }
}

/// The positions in a list that are not among these, which ascend.
fn others(len: usize, positions: &[usize]) -> Vec<usize> {
    let mut others: Vec<usize> = (0..len).collect();
    others.retain(|i| positions.binary_search(i).is_err());
    others
}

/// Positions of `count` of `points`, ascending, spread as evenly as the points are.
///
/// The points are put in Morton order and one is drawn from each of `count` equal runs
/// (stratified sampling), O(n log n). All of them if there are no more than `count`.
pub fn even_subset(points: &[Vec3], count: usize, random: &mut Generator) -> Vec<usize> {
    let len = points.len();
    if count >= len {
        return (0..len).collect();
    }
    let order = morton_order(points);
    let mut chosen: Vec<usize> = (0..count)
        .map(|run| {
            let (start, end) = (run * len / count, (run + 1) * len / count);
            order[random.random_range(start as u64..end as u64) as usize].1 as usize
        })
        .collect();
    chosen.sort_unstable();
    chosen
}

/// Those of `indices` whose point has not come before in the list. Many are in an order in which neighbours follow each
/// other: what is worked out of neighbours finds them in the cache of the processor then.
pub fn distinct(points: &[Vec3], indices: &[usize]) -> Vec<usize> {
    let points = pick(points, indices);
    let order = morton_order(&points);
    let mut repeats = vec![false; points.len()];
    let mut seen = HashSet::new();
    // The same points are in the same cell, one after the other as in the list.
    for cell in order.chunk_by(|a, b| a.0 == b.0).filter(|c| c.len() > 1) {
        seen.clear();
        for &(_, i) in cell {
            repeats[i as usize] = !seen.insert(bits(points[i as usize]));
        }
    }
    let is_kept = |i: &usize| !repeats[*i];
    let kept: Vec<usize> = if is_many(points.len()) {
        order
            .iter()
            .map(|&(_, i)| i as usize)
            .filter(is_kept)
            .collect()
    } else {
        (0..points.len()).filter(is_kept).collect()
    };
    pick(indices, &kept)
}

/// Those of `items` at `positions`.
pub(in crate::reconstruction) fn pick<T: Copy>(items: &[T], positions: &[usize]) -> Vec<T> {
    positions.iter().map(|&i| items[i]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::vector::distance;

    #[test]
    fn many_different_points_follow_their_neighbours_and_few_keep_their_order() {
        for (side, is_kept) in [(20, true), (200, false)] {
            let place = |i: usize| [(i % side) as f64, (i / side) as f64, 0.0];
            let count = side * side;
            // 7 has no factor in common with the number: every place once, far from the one before; and one twice.
            let points: Vec<Vec3> = (0..=count).map(|i| place(7 * i % count)).collect();
            let all: Vec<usize> = (0..points.len()).collect();
            let found = distinct(&points, &all);
            let mut each = found.clone();
            each.sort_unstable();
            assert!(each.iter().copied().eq(0..count));
            assert_eq!(found == each, is_kept);
            let steps = found
                .windows(2)
                .map(|pair| distance(points[pair[0]], points[pair[1]]));
            let mean = steps.sum::<f64>() / count as f64;
            assert_eq!(mean > 5.0, is_kept, "{mean}");
        }
    }
}
