//! Eigenvalues and eigenvectors of symmetric 3×3 matrices: principal axes of point sets.
//!
//! Cyclic Jacobi rotations (Golub, Van Loan: Matrix Computations, 4th edition, algorithm 8.5.2).
//! Slower than a closed formula by a few times, but accurate to rounding where eigenvalues nearly
//! coincide, which is the common case for flat and for round neighbourhoods.

use super::vector::{Vec3, along, scale};

/// Sweeps over the three off-diagonal entries. Convergence is quadratic: five suffice for double
/// precision, the rest is reserve.
const SWEEPS: usize = 12;

/// Covariance of `arms` around their mean.
pub(crate) fn covariance(arms: &[Vec3]) -> [[f64; 3]; 3] {
    let count = arms.len() as f64;
    let mean: Vec3 = std::array::from_fn(|a| arms.iter().map(|d| d[a]).sum::<f64>() / count);
    std::array::from_fn(|a| {
        std::array::from_fn(|b| {
            arms.iter().map(|d| d[a] * d[b]).sum::<f64>() / count - mean[a] * mean[b]
        })
    })
}

/// Eigenvalues of the symmetric matrix `m`, ascending, and their orthonormal eigenvectors.
///
/// Only the upper triangle is read. Entries are expected to be finite; if they are not, the result
/// is not finite either.
pub(crate) fn eigen(m: [[f64; 3]; 3]) -> ([f64; 3], [Vec3; 3]) {
    let mut a = [
        m[0],
        [m[0][1], m[1][1], m[1][2]],
        [m[0][2], m[1][2], m[2][2]],
    ];
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..SWEEPS {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            if a[p][q] != 0.0 {
                rotate(&mut a, &mut axes, p, q);
            }
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    (order.map(|i| a[i][i]), order.map(|i| axes[i]))
}

/// One rotation in the plane (p, q) that makes `a[p][q]` zero; rows of `axes` turn with it.
fn rotate(a: &mut [[f64; 3]; 3], axes: &mut [Vec3; 3], p: usize, q: usize) {
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    // The smaller root of t² + 2 θ t - 1 = 0: the rotation by at most 45°.
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    a[p][p] -= t * a[p][q];
    a[q][q] += t * a[p][q];
    a[p][q] = 0.0;
    a[q][p] = 0.0;
    let r = 3 - p - q;
    let (rp, rq) = (a[r][p], a[r][q]);
    a[r][p] = c * rp - s * rq;
    a[r][q] = s * rp + c * rq;
    a[p][r] = a[r][p];
    a[q][r] = a[r][q];
    let (vp, vq) = (axes[p], axes[q]);
    axes[p] = along(scale(vp, c), -s, vq);
    axes[q] = along(scale(vq, c), s, vp);
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::reconstruction::random::{Purpose, stream};
    use crate::reconstruction::vector::{cross, dot, norm, sub};

    fn product(m: [[f64; 3]; 3], v: Vec3) -> Vec3 {
        m.map(|row| dot(row, v))
    }

    #[test]
    fn random_matrices_are_diagonalised() {
        let mut generator = stream(7, Purpose::Shape);
        for _ in 0..1000 {
            let mut m = [[0.0; 3]; 3];
            for (i, j) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
                m[i][j] = generator.random_range(-1.0..1.0);
                m[j][i] = m[i][j];
            }
            let (values, vectors) = eigen(m);
            assert!(values[0] <= values[1] && values[1] <= values[2]);
            for (value, vector) in values.into_iter().zip(vectors) {
                // Entries are of order 1: a few roundings of 1e-16 each.
                assert!(norm(sub(product(m, vector), scale(vector, value))) < 1e-14);
                assert!((norm(vector) - 1.0).abs() < 1e-14);
            }
            let volume = dot(cross(vectors[0], vectors[1]), vectors[2]);
            assert!((volume.abs() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn diagonal_and_degenerate_matrices_keep_their_values() {
        let (values, _) = eigen([[3.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 2.0]]);
        assert_eq!(
            values.map(f64::to_bits),
            [-1.0f64, 2.0, 3.0].map(f64::to_bits)
        );
        let (values, vectors) = eigen([[0.0; 3]; 3]);
        assert_eq!(values.map(f64::to_bits), [0; 3]);
        assert!(vectors.iter().all(|v| (norm(*v) - 1.0).abs() < 1e-15));
        // Rank one, 1 1ᵀ: eigenvalues 0, 0, 3.
        let (values, vectors) = eigen([[1.0; 3]; 3]);
        assert!(values[0].abs() < 1e-15 && values[1].abs() < 1e-15);
        assert!((values[2] - 3.0).abs() < 1e-14);
        assert!((vectors[2][0].abs() - 3f64.sqrt().recip()).abs() < 1e-15);
    }
}
