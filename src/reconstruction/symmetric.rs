//! Eigenvalues of symmetric 3 × 3 matrices: the shape of a small neighbourhood of points.

use super::vector::Vec3;

/// Sweeps of the cyclic Jacobi method; it converges quadratically, five are enough in practice.
const MAX_SWEEPS: usize = 30;

/// Eigenvalues in ascending order and their orthonormal eigenvectors, by cyclic Jacobi rotations
/// (Golub, Van Loan: Matrix Computations, section 8.5).
///
/// Only the symmetric part that the upper triangle gives is read.
pub(crate) fn eigen(m: [[f64; 3]; 3]) -> ([f64; 3], [Vec3; 3]) {
    let mut a = [
        [m[0][0], m[0][1], m[0][2]],
        [m[0][1], m[1][1], m[1][2]],
        [m[0][2], m[1][2], m[2][2]],
    ];
    let mut vectors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..MAX_SWEEPS {
        let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        let diagonal = a[0][0].abs() + a[1][1].abs() + a[2][2].abs();
        if off <= f64::EPSILON * f64::EPSILON * diagonal || off <= f64::MIN_POSITIVE {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut a, &mut vectors, p, q);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    (order.map(|i| a[i][i]), order.map(|i| vectors[i]))
}

/// One rotation that makes `a[p][q]` zero; row `i` of `vectors` is the i-th eigenvector so far.
fn rotate(a: &mut [[f64; 3]; 3], vectors: &mut [Vec3; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let tau = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = tau.signum() / (tau.abs() + tau.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for row in a.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
    for k in 0..3 {
        (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
        (vectors[p][k], vectors[q][k]) = (
            c * vectors[p][k] - s * vectors[q][k],
            s * vectors[p][k] + c * vectors[q][k],
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::vector::dot;

    #[test]
    fn the_decomposition_gives_the_matrix_back() {
        for m in [
            [[2.0, 1.0, 0.5], [1.0, 3.0, -0.7], [0.5, -0.7, 1.0]],
            [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]],
            [[5.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 2.0]],
            [[0.0; 3]; 3],
        ] {
            let (values, vectors) = eigen(m);
            assert!(values[0] <= values[1] && values[1] <= values[2]);
            for i in 0..3 {
                for j in 0..3 {
                    let rebuilt: f64 = (0..3)
                        .map(|k| values[k] * vectors[k][i] * vectors[k][j])
                        .sum();
                    // A few rotations of rounding on entries of order one.
                    assert!((rebuilt - m[i][j]).abs() < 1e-13);
                    let unit = f64::from(u8::from(i == j));
                    assert!((dot(vectors[i], vectors[j]) - unit).abs() < 1e-13);
                }
            }
        }
    }
}
