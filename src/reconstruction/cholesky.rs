//! Small systems of linear equations.

/// A pivot below this share of its diagonal element is rounding.
const SINGULAR: f64 = 1e-12;

/// Solves symmetric positive definite equations by Cholesky's decomposition: the solution takes the place of
/// `right`. Of `matrix`, whose rows are `stride` apart, the lower triangle is read, and overwritten. `None`
/// where the equations are singular or not finite.
pub(super) fn solve(matrix: &mut [f64], stride: usize, right: &mut [f64]) -> Option<()> {
    let at = |i: usize, j: usize| i * stride + j;
    let n = right.len();
    for i in 0..n {
        let diagonal = matrix[at(i, i)];
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| matrix[at(i, k)] * matrix[at(j, k)]).sum();
            let rest = matrix[at(i, j)] - sum;
            matrix[at(i, j)] = if j < i {
                rest / matrix[at(j, j)]
            } else if rest > SINGULAR * diagonal {
                rest.sqrt()
            } else {
                return None;
            };
        }
    }
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| matrix[at(i, k)] * right[k]).sum();
        right[i] = (right[i] - sum) / matrix[at(i, i)];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| matrix[at(k, i)] * right[k]).sum();
        right[i] = (right[i] - sum) / matrix[at(i, i)];
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_solution_comes_out() {
        // Rows are longer than the equations, and the upper triangle is not read.
        let mut matrix = [4.0, 9.0, 9.0, 2.0, 5.0, 9.0];
        let mut right = [8.0, 12.0];
        solve(&mut matrix, 3, &mut right).unwrap();
        assert!((right[0] - 1.0).abs() < 1e-14 && (right[1] - 2.0).abs() < 1e-14);
    }

    #[test]
    fn singular_and_not_finite_equations_are_refused() {
        assert_eq!(solve(&mut [1.0, 0.0, 1.0, 1.0], 2, &mut [1.0, 1.0]), None);
        assert_eq!(solve(&mut [f64::NAN], 1, &mut [1.0]), None);
    }
}
