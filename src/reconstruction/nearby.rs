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

/// Whether the order of so many places matters to the cache.
pub(super) fn is_many(places: usize) -> bool {
    places >= FEW
}

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
        code | spread(cell) << axis
    })
}

/// A number of [`MORTON_BITS`] with two zeros below each of its bits.
fn spread(bits: u64) -> u64 {
    let steps = [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ];
    steps
        .into_iter()
        .fold(bits, |bits, (shift, mask)| (bits | bits << shift) & mask)
}

/// Which threads work at the places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Threads {
    /// All of the pool.
    All,
    /// The calling one, for those who work side by side already: a thread that waits for others may begin what they
    /// wait for.
    Caller,
}

/// An order of places in which neighbours follow each other, or that in which they were given, where they are few.
pub(super) struct Walk {
    order: Vec<u32>,
    threads: Threads,
}

impl Walk {
    pub(super) fn along(places: &[Vec3]) -> Self {
        Self::on(Threads::All, places)
    }

    /// A walk on these threads: for the calling one alone, places are few.
    pub(super) fn on(threads: Threads, places: &[Vec3]) -> Self {
        let order = if threads == Threads::Caller || !is_many(places.len()) {
            (0..places.len() as u32).collect()
        } else {
            morton_order(places).into_iter().map(|(_, i)| i).collect()
        };
        Self { order, threads }
    }

    /// The numbers of the places in this order.
    pub(super) fn order(&self) -> impl Iterator<Item = usize> + '_ {
        self.order.iter().map(|&i| i as usize)
    }

    /// What `work` gives for the number of each place, put where `put` wants it.
    pub(super) fn for_each<R: Send>(
        &self,
        work: impl Fn(usize) -> R + Sync,
        mut put: impl FnMut(usize, R),
    ) {
        for some in self.order.chunks(AT_A_TIME) {
            let work = |&i: &u32| work(i as usize);
            let found: Vec<R> = match self.threads {
                Threads::All => some.par_iter().map(work).collect(),
                Threads::Caller => some.iter().map(work).collect(),
            };
            for (&i, found) in some.iter().zip(found) {
                put(i as usize, found);
            }
        }
    }

    /// What `work` gives for the number of each place, in the order of the places.
    pub(super) fn map<R: Send + Clone + Default>(
        &self,
        work: impl Fn(usize) -> R + Sync,
    ) -> Vec<R> {
        let mut all = vec![R::default(); self.order.len()];
        self.for_each(work, |i, found| all[i] = found);
        all
    }

    /// The same where `work` is at several places at a time; what it gives for more than there are is dropped.
    pub(super) fn map_together<const TOGETHER: usize, R: Send + Clone + Default>(
        &self,
        work: impl Fn([usize; TOGETHER]) -> [R; TOGETHER] + Sync,
    ) -> Vec<R> {
        let mut all = vec![R::default(); self.order.len()];
        for some in self.order.chunks(AT_A_TIME - AT_A_TIME % TOGETHER) {
            let work = |of: &[u32]| work(std::array::from_fn(|k| of[k.min(of.len() - 1)] as usize));
            let found: Vec<[R; TOGETHER]> = match self.threads {
                Threads::All => some.par_chunks(TOGETHER).map(work).collect(),
                Threads::Caller => some.chunks(TOGETHER).map(work).collect(),
            };
            for (of, found) in some.chunks(TOGETHER).zip(found) {
                for (&i, found) in of.iter().zip(found) {
                    all[i as usize] = found;
                }
            }
        }
        all
    }
}

/// What `work` gives for the number of each of `places`, in their order, on all threads.
pub(super) fn map_nearby<R: Send + Clone + Default>(
    places: &[Vec3],
    work: impl Fn(usize) -> R + Sync,
) -> Vec<R> {
    Walk::along(places).map(work)
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
            let expected = places.iter().enumerate().map(|(i, p)| p[0] + i as f64);
            for threads in [Threads::All, Threads::Caller] {
                let walk = Walk::on(threads, &places);
                let found = walk.map(|i| places[i][0] + i as f64);
                assert!(found.into_iter().eq(expected.clone()), "{count}");
                let work = |at: [usize; 3]| at.map(|i| places[i][0] + i as f64);
                let found = walk.map_together(work);
                assert!(found.into_iter().eq(expected.clone()), "{count}");
            }
        }
    }

    #[test]
    fn the_bits_of_three_axes_are_interleaved() {
        let code = [0b101, 0b010, 0b111].into_iter().enumerate();
        let code = code.fold(0, |code, (axis, cell)| code | spread(cell) << axis);
        assert_eq!(code, 0b101_110_101);
        assert_eq!(spread((1 << MORTON_BITS) - 1), 0x1249_2492_4924_9249);
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
