//! Samples laid out for the passes.

use std::ops::Range;

use super::aligned::Aligned;
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::vector::Vec3;

/// Most points of a tile. The weight gradients of a tile are summed over it in registers, so that
/// more points amortise what follows; but what it keeps (8 bytes a neuron and point) should stay in
/// the level-2 cache. 512 was best or next to best at widths 50, 100 and 200.
pub(in crate::reconstruction) const TILE_POINTS: usize = 512;

/// Samples in blocks of points; the last block is filled up with samples of weight 0.
#[derive(Debug)]
pub(super) struct Batch {
    /// Number of samples.
    pub(super) count: usize,
    /// Points of a block.
    block_points: usize,
    /// Three rows a block.
    points: Aligned,
    /// The least and the greatest value that costs nothing.
    lower: Aligned,
    upper: Aligned,
    weights: Aligned,
    /// Sum of the weights.
    pub(super) total_weight: f64,
}

impl Batch {
    pub(super) fn new(samples: &Samples, block_points: usize) -> Self {
        let blocks = samples.points.len().div_ceil(block_points);
        let column = |value: &dyn Fn(usize) -> f64| {
            let mut column = Aligned::zeros(blocks * block_points);
            for (i, to) in column.iter_mut().enumerate().take(samples.len()) {
                *to = value(i) as f32;
            }
            column
        };
        let mut points = Aligned::zeros(3 * blocks * block_points);
        let chunks = samples.points.chunks(block_points);
        for (rows, chunk) in points.chunks_exact_mut(3 * block_points).zip(chunks) {
            fill_rows(rows, chunk);
        }
        Self {
            count: samples.points.len(),
            block_points,
            points,
            lower: column(&|i| samples.free_range(i)[0]),
            upper: column(&|i| samples.free_range(i)[1]),
            weights: column(&|i| samples.weights[i]),
            total_weight: samples.weights.iter().sum(),
        }
    }

    /// Blocks of each tile, whose number is a multiple of `shares` where there are blocks enough, so that as many
    /// threads get equal ones. Tiles do not depend on the number of threads, so that sums over them do not.
    pub(super) fn tiles(&self, shares: usize) -> Vec<Range<usize>> {
        let blocks = self.blocks();
        let fewest = blocks.div_ceil((TILE_POINTS / self.block_points).max(1));
        let tiles = fewest.next_multiple_of(shares).min(blocks);
        let bound = |tile: usize| tile * blocks / tiles;
        (0..tiles)
            .map(|tile| bound(tile)..bound(tile + 1))
            .collect()
    }

    /// Number of blocks.
    pub(super) fn blocks(&self) -> usize {
        self.count.div_ceil(self.block_points)
    }

    /// Three rows of coordinates of a block.
    pub(super) fn points(&self, block: usize) -> &[f32] {
        &self.points[3 * self.block_points * block..][..3 * self.block_points]
    }

    /// Of a block, the least and the greatest values that cost nothing, and the weights.
    pub(super) fn targets(&self, block: usize) -> [&[f32]; 3] {
        let range = block * self.block_points..(block + 1) * self.block_points;
        [&self.lower, &self.upper, &self.weights].map(|column| &column[range.clone()])
    }
}

/// Coordinates of up to as many points as a row is long, into three rows.
pub(super) fn fill_rows(rows: &mut [f32], points: &[Vec3]) {
    let length = rows.len() / 3;
    for (axis, row) in rows.chunks_exact_mut(length).enumerate() {
        for (to, point) in row.iter_mut().zip(points) {
            *to = point[axis] as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_all_blocks_in_equal_shares() {
        for count in [1, 2, 63, 64, 65, 300, 3_500, 11_000, 20_000] {
            let samples = Samples {
                points: vec![[0.5; 3]; count],
                targets: vec![1.0; count],
                weights: vec![1.0; count],
                one_sided: vec![false; count],
            };
            let batch = Batch::new(&samples, 64);
            for shares in [1, 4] {
                let tiles = batch.tiles(shares);
                let mut next = 0;
                for tile in &tiles {
                    assert_eq!(tile.start, next);
                    assert!(!tile.is_empty() && tile.len() * 64 <= TILE_POINTS);
                    next = tile.end;
                }
                assert_eq!(next, count.div_ceil(64));
                assert!(tiles.len().is_multiple_of(shares) || tiles.len() == next);
            }
            let weights = (0..batch.blocks()).map(|block| batch.targets(block)[2]);
            // Whole numbers: the sum is exact.
            let weight: f64 = weights.flatten().map(|w| f64::from(*w)).sum();
            assert!((weight - count as f64).abs() < 0.5);
        }
    }
}
