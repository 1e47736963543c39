//! The choice of the instruction set.

use pulp::{Arch, Simd, WithSimd};

use super::pass::block_vectors;

/// Work over blocks of N vectors of points.
pub(super) trait Blockwise {
    /// What it returns.
    type Output;

    /// Does it. Must be `#[inline(always)]`, as all that it calls.
    fn run<S: Simd, const N: usize>(self, simd: S) -> Self::Output;
}

/// Does `work` with the instructions of `arch`, in blocks of as many vectors as suit its registers.
pub(super) fn dispatch<W: Blockwise>(arch: Arch, work: W) -> W::Output {
    arch.dispatch(Blocks(work))
}

struct Blocks<W>(W);

impl<W: Blockwise> WithSimd for Blocks<W> {
    type Output = W::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> W::Output {
        match block_vectors::<S>() {
            4 => self.0.run::<S, 4>(simd),
            _ => self.0.run::<S, 2>(simd),
        }
    }
}
