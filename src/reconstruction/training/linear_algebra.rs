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
/// Rows of a matrix that are read together, so that what they are multiplied with is read once.
const ROWS: usize = 4;
/// Components of a sum of rows that one thread takes at a time; they stay in the level-1 cache.
const COLUMNS: usize = 2048;
/// Rows of which one thread takes the products.
const TASK_ROWS: usize = 16;

/// a · b.
pub(super) fn dot<T: Scalar>(a: &[T], b: &[T]) -> f64 {
    let [[product]] = Arch::new().dispatch(|| rows_times([a], [b]));
    product
}

/// The products of a row with two vectors.
pub(super) type Products = [f64; 2];

/// The products of each row of a matrix with two vectors of the rows' length.
pub(super) fn products<T: Scalar>(matrix: &[T], vectors: [&[T]; 2]) -> Vec<Products> {
    let length = vectors[0].len();
    let mut all = vec![[0.0; 2]; matrix.len() / length];
    all.par_chunks_mut(TASK_ROWS)
        .zip(matrix.par_chunks(TASK_ROWS * length))
        .for_each(|(all, rows)| {
            Arch::new().dispatch(|| {
                for (all, rows) in all.chunks_mut(ROWS).zip(rows.chunks(ROWS * length)) {
                    let row = |i: usize| &rows[i * length..(i + 1) * length];
                    if all.len() == ROWS {
                        let products = rows_times([row(0), row(1), row(2), row(3)], vectors);
                        all.copy_from_slice(&products);
                    } else {
                        for (i, all) in all.iter_mut().enumerate() {
                            [*all] = rows_times([row(i)], vectors);
                        }
                    }
                }
            });
        });
    all
}

/// rows · vectors; each product has the same bits whatever stands beside it.
#[inline(always)]
fn rows_times<T: Scalar, const R: usize, const V: usize>(
    rows: [&[T]; R],
    vectors: [&[T]; V],
) -> [[f64; V]; R] {
    let length = vectors[0].len();
    let mut sums = [[0.0; V]; R];
    for start in (0..length).step_by(BLOCK) {
        let block = start..(start + BLOCK).min(length);
        let rows = rows.map(|row| &row[block.clone()]);
        let vectors = vectors.map(|vector| &vector[block.clone()]);
        let mut lanes = [[[T::ZERO; LANES]; V]; R];
        let whole = block.len() / LANES;
        let wide_rows = rows.map(|row| &row.as_chunks::<LANES>().0[..whole]);
        let wide_vectors = vectors.map(|vector| &vector.as_chunks::<LANES>().0[..whole]);
        for k in 0..whole {
            for r in 0..R {
                for v in 0..V {
                    for i in 0..LANES {
                        lanes[r][v][i] += wide_rows[r][k][i] * wide_vectors[v][k][i];
                    }
                }
            }
        }
        for r in 0..R {
            for v in 0..V {
                let rest = rows[r][whole * LANES..].iter();
                let rest = rest.zip(&vectors[v][whole * LANES..]);
                let rest: f64 = rest.map(|(a, b)| a.to_f64() * b.to_f64()).sum();
                sums[r][v] += lanes[r][v].iter().map(|v| v.to_f64()).sum::<f64>() + rest;
            }
        }
    }
    sums
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
