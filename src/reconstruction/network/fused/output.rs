//! The sums of which the normal equations of the output layer are made.

use std::ops::Range;

use pulp::Simd;

use super::batch::Batch;
use super::dispatch::Blockwise;
use super::pass::{Network, Pass, Scratch};
use crate::reconstruction::network::OutputEquations;

/// Over some blocks of points, with a the outputs of the last hidden layer:
/// Σ w a aᵀ (its lower half), Σ w a, Σ w y a and Σ w y, one after the other, are added to `sums`. The hidden layers
/// stay in the scratch, each block in a slot of its own.
pub(super) struct OutputSums<'a> {
    pub(super) network: &'a Network<'a>,
    pub(super) batch: &'a Batch,
    pub(super) blocks: Range<usize>,
    pub(super) scratch: &'a mut Scratch,
    pub(super) sums: &'a mut [f32],
}

impl OutputSums<'_> {
    /// How many sums there are.
    pub(super) fn length(width: usize) -> usize {
        width * width + 2 * width + 1
    }

    /// The equations that the sums over a whole batch make.
    pub(super) fn equations(sums: &[f64], batch: &Batch) -> OutputEquations {
        // (width + 1)² sums.
        let width = sums.len().isqrt() - 1;
        let (products, rest) = sums.split_at(width * width);
        let (weighted, targets) = rest.split_at(width);
        let count = batch.count as f64;
        let mut matrix = Vec::with_capacity((width + 1) * (width + 1));
        for (row, last) in weighted.iter().enumerate() {
            let product = |column: usize| products[row.max(column) * width + row.min(column)];
            matrix.extend((0..width).map(|column| product(column) / count));
            matrix.push(last / count);
        }
        matrix.extend(weighted.iter().map(|sum| sum / count));
        matrix.push(batch.total_weight / count);
        OutputEquations {
            matrix,
            right: targets.iter().map(|sum| sum / count).collect(),
        }
    }
}

impl Blockwise for OutputSums<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, const N: usize>(self, simd: S) {
        let mut pass = Pass {
            simd,
            network: self.network,
            scratch: self.scratch,
        };
        let count = self.blocks.len();
        for (slot, block) in self.blocks.enumerate() {
            pass.hidden::<N>(slot, self.batch.points(block));
            let [targets, _, weights] = self.batch.targets(block);
            pass.weigh_output::<N>(slot, targets, weights);
        }
        pass.output_sums::<N>(count, self.sums);
    }
}
