//! Vector operations of the optimisers.
//!
//! Sums have a fixed order: the bits depend neither on the number of threads nor on the instruction
//! set, of which the compiler uses the widest.

#![expect(
    clippy::inline_always,
    reason = "code compiles for an instruction set only inside the function that enables it"
)]

use pulp::Arch;
use rayon::prelude::*;

use crate::reconstruction::network::Scalar;

/// Independent sums, so that additions overlap and the compiler can use SIMD.
const LANES: usize = 16;
/// Components that are summed in T before they go to an f64: in f32 the error of the sum then
/// does not grow with the number of parameters.
const BLOCK: usize = 1024;
/// Rows that are added together, so that the sum is read and written once for all of them.
const ROWS: usize = 4;
/// Components of a sum of rows that one thread takes at a time; they stay in the level-1 cache.
const COLUMNS: usize = 2048;
/// Rows of which one thread takes the products, at least.
const TASK_ROWS: usize = 8;

/// a · b.
pub(super) fn dot<T: Scalar>(a: &[T], b: &[T]) -> f64 {
    Arch::new().dispatch(|| sum_of_products(a, b))
}

/// The products of a row with two vectors.
pub(super) type Products = [f64; 2];

/// The products of each row of a matrix with two vectors of the rows' length.
pub(super) fn products<T: Scalar>(matrix: &[T], vectors: [&[T]; 2]) -> Vec<Products> {
    let rows = matrix.par_chunks(vectors[0].len());
    rows.with_min_len(TASK_ROWS)
        .map(|row| Arch::new().dispatch(|| vectors.map(|vector| sum_of_products(row, vector))))
        .collect()
}

#[inline(always)]
fn sum_of_products<T: Scalar>(a: &[T], b: &[T]) -> f64 {
    let blocks = a.chunks(BLOCK).zip(b.chunks(BLOCK));
    let blocks = blocks.map(|(a, b)| {
        let mut lanes = [T::ZERO; LANES];
        let (a, a_rest) = a.as_chunks::<LANES>();
        let (b, b_rest) = b.as_chunks::<LANES>();
        for (a, b) in a.iter().zip(b) {
            for i in 0..LANES {
                lanes[i] += a[i] * b[i];
            }
        }
        let rest = a_rest.iter().zip(b_rest);
        let rest = rest.map(|(a, b)| a.to_f64() * b.to_f64()).sum::<f64>();
        lanes.iter().map(|v| v.to_f64()).sum::<f64>() + rest
    });
    blocks.sum()
}

/// y += Σ factorᵢ rowᵢ, over the rows of several matrices in turn.
pub(super) fn add_rows<T: Scalar>(y: &mut [T], terms: &[(&[f64], &[T])]) {
    let length = y.len();
    y.par_chunks_mut(COLUMNS)
        .enumerate()
        .for_each(|(chunk, y)| {
            let columns = chunk * COLUMNS..chunk * COLUMNS + y.len();
            Arch::new().dispatch(|| {
                for (factors, matrix) in terms {
                    let row = |i: usize| &matrix[i * length..(i + 1) * length][columns.clone()];
                    let (fours, rest) = factors.as_chunks::<ROWS>();
                    for (k, factors) in fours.iter().enumerate() {
                        let rows = [0, 1, 2, 3].map(|i| row(ROWS * k + i));
                        add_weighted(y, factors.map(T::from_f64), rows);
                    }
                    for (k, factor) in rest.iter().enumerate() {
                        let row = row(ROWS * fours.len() + k);
                        add_weighted(y, [T::from_f64(*factor)], [row]);
                    }
                }
            });
        });
}

#[inline(always)]
fn add_weighted<T: Scalar, const R: usize>(y: &mut [T], factors: [T; R], rows: [&[T]; R]) {
    let rows = rows.map(|row| &row[..y.len()]);
    for (i, y) in y.iter_mut().enumerate() {
        for r in 0..R {
            *y += factors[r] * rows[r][i];
        }
    }
}

/// y += factor x.
pub(super) fn add_scaled<T: Scalar>(y: &mut [T], factor: f64, x: &[T]) {
    Arch::new().dispatch(|| add_weighted(y, [T::from_f64(factor)], [x]));
}

/// factor x.
pub(super) fn scaled<T: Scalar>(factor: f64, x: &[T]) -> Vec<T> {
    let factor = T::from_f64(factor);
    x.iter().map(|x| factor * *x).collect()
}

/// a - b.
pub(super) fn difference<T: Scalar>(a: &[T], b: &[T]) -> Vec<T> {
    a.iter().zip(b).map(|(a, b)| *a - *b).collect()
}

/// max |xᵢ|; NaN components count for nothing.
pub(super) fn max_norm<T: Scalar>(x: &[T]) -> f64 {
    x.iter().fold(0.0, |max, x| x.to_f64().abs().max(max))
}

/// Σ |xᵢ|.
pub(super) fn sum_norm<T: Scalar>(x: &[T]) -> f64 {
    x.iter().map(|x| x.to_f64().abs()).sum()
}
