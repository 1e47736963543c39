//! Work at many places, in an order in which neighbours follow each other.
//!
//! Searches at neighbouring places go the same way through a tree, which stays in the cache of the processor: those
//! of five million places in any order take twice as long. Each result is that of its place, whatever the order.

use rayon::prelude::*;

use super::vector::{Bounds, Vec3};

/// Bits of each axis along the curve.
const MORTON_BITS: u32 = 21;

/// Places below which a tree over as many stays in the cache anyway.
const FEW: usize = 1 << 15;

/// Places that are worked at before their results are put in their places.
const AT_A_TIME: usize = 1 << 16;

/// Numbers of the places along the Z-shaped curve of Morton, with their places on it; those at the same place of it by
/// their numbers.
pub(super) fn morton_order(places: &[Vec3]) -> Vec<(u64, u32)> {
    let Some(bounds) = Bounds::of(places) else {
        return Vec::new();
    };
    let numbered = places.par_iter().enumerate();
    let mut order: Vec<(u64, u32)> = numbered
        .map(|(i, p)| (morton(&bounds, *p), i as u32))
        .collect();
    order.par_sort_unstable();
    order
}

/// Cells of the points along the Z-shaped curve of Morton: bits of the three axes interleaved.
fn morton(bounds: &Bounds, p: Vec3) -> u64 {
    let edge = bounds.longest_edge().max(f64::MIN_POSITIVE);
    let cells = f64::from((1_u32 << MORTON_BITS) - 1);
    (0..3).fold(0, |code, axis| {
        let cell = ((p[axis] - bounds.min[axis]) / edge * cells) as u64;
        (0..MORTON_BITS).fold(code, |code, bit| {
            code | ((cell >> bit) & 1) << (3 * bit + axis as u32)
        })
    })
}

/// What `work` gives for the number of each of `places`, put where `put` wants it, on all threads.
pub(super) fn for_each_nearby<R: Send>(
    places: &[Vec3],
    work: impl Fn(usize) -> R + Sync,
    mut put: impl FnMut(usize, R),
) {
    let order: Vec<(u64, u32)> = if places.len() < FEW {
        (0..places.len() as u32).map(|i| (0, i)).collect()
    } else {
        morton_order(places)
    };
    for some in order.chunks(AT_A_TIME) {
        let found: Vec<R> = some.par_iter().map(|&(_, i)| work(i as usize)).collect();
        for (&(_, i), found) in some.iter().zip(found) {
            put(i as usize, found);
        }
    }
}

/// What `work` gives for the number of each of `places`, in their order, on all threads.
pub(super) fn map_nearby<R: Send + Clone + Default>(
    places: &[Vec3],
    work: impl Fn(usize) -> R + Sync,
) -> Vec<R> {
    let mut all = vec![R::default(); places.len()];
    for_each_nearby(places, work, |i, found| all[i] = found);
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_result_is_that_of_its_place() {
        for count in [0, 1, 100, FEW + 3, AT_A_TIME + 5] {
            let places: Vec<Vec3> = (0..count)
                .map(|i| [0.7, 0.3, 0.1].map(|step| (i as f64 * step).fract()))
                .collect();
            let found = map_nearby(&places, |i| places[i][0] + i as f64);
            let expected = places.iter().enumerate().map(|(i, p)| p[0] + i as f64);
            assert!(found.into_iter().eq(expected), "{count}");
        }
    }

    #[test]
    fn neighbours_follow_each_other() {
        let place = |i: usize| [(7 * i % FEW) as f64, 0.0, 0.0];
        let places: Vec<Vec3> = (0..FEW).map(place).collect();
        let order = morton_order(&places);
        let along: Vec<f64> = order.iter().map(|&(_, i)| places[i as usize][0]).collect();
        assert!(along.is_sorted());
    }
}
