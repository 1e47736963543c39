//! Vector operations of the optimisers.

use crate::reconstruction::network::Scalar;

/// Independent sums, so that additions overlap and the compiler can use SIMD.
const LANES: usize = 16;
/// Components that are summed in T before they go to an f64: in f32 the error of the sum then
/// does not grow with the number of parameters.
const BLOCK: usize = 1024;

/// a · b, in a fixed order.
pub(super) fn dot<T: Scalar>(a: &[T], b: &[T]) -> f64 {
    let blocks = a.chunks(BLOCK).zip(b.chunks(BLOCK));
    blocks.map(|(a, b)| dot_block(a, b)).sum()
}

fn dot_block<T: Scalar>(a: &[T], b: &[T]) -> f64 {
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
}

/// y += factor x.
pub(super) fn add_scaled<T: Scalar>(y: &mut [T], factor: f64, x: &[T]) {
    let factor = T::from_f64(factor);
    for (y, x) in y.iter_mut().zip(x) {
        *y += factor * *x;
    }
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
