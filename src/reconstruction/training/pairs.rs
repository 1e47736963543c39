//! The limited memory of L-BFGS.

use serde::{Deserialize, Serialize};

use super::linear_algebra::{Products, add_rows, dot, products};
use crate::reconstruction::network::Scalar;

/// Curvature below which a pair is not kept: it would make the inverse Hessian indefinite or huge.
const SMALLEST_CURVATURE: f64 = 1e-10;

/// The latest steps s and changes of the gradient y, and the inverse Hessian that they imply.
///
/// The two-loop recursion (\[NW06\] algorithm 7.4) reads and writes a vector for each scalar that it
/// computes. Here it runs on the coefficients of its vectors in the basis of all s, all y and ∇L;
/// the products that it needs then come from one pass over the pairs and those kept from earlier
/// steps, and the direction from a second pass. Both passes are shared among threads.
///
/// # Cost
/// A direction reads each pair twice, and takes 3/2 `len`² multiplications besides.
///
/// # References
/// Chen, Wang, Zhou, "Large-scale L-BFGS using `MapReduce`", NIPS 2014, for the coefficients.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub(super) struct Pairs<T> {
    /// Length of each vector.
    dimension: usize,
    /// Most pairs that are kept.
    capacity: usize,
    /// Slot of the oldest pair, once all are in use.
    oldest: usize,
    /// s of each slot.
    steps: Vec<T>,
    /// y of each slot.
    changes: Vec<T>,
    /// 1 / (y · s) of each slot.
    inverse_curvatures: Vec<f64>,
    /// H₀ = (y · s) / (y · y) of the newest pair.
    scale: f64,
    /// By slots (j, i), `capacity` apart: sᵢ · yⱼ where i is not newer than j. Those of the newest
    /// pair are filled in with the next direction.
    step_change: Vec<f64>,
    /// By slots (j, i): yᵢ · yⱼ.
    change_change: Vec<f64>,
}

impl<T: Scalar> Pairs<T> {
    pub(super) fn new(dimension: usize, capacity: usize) -> Self {
        Self {
            dimension,
            capacity,
            oldest: 0,
            steps: Vec::new(),
            changes: Vec::new(),
            inverse_curvatures: Vec::new(),
            scale: 1.0,
            step_change: Vec::new(),
            change_change: Vec::new(),
        }
    }

    /// Keeps the pair (s, y) in place of the oldest one, unless its curvature is too small.
    pub(super) fn push(&mut self, step: &[T], change: &[T]) {
        let curvature = dot(change, step);
        if curvature <= SMALLEST_CURVATURE || self.capacity == 0 {
            return;
        }
        self.scale = curvature / dot(change, change);
        if self.inverse_curvatures.len() < self.capacity {
            self.steps.extend_from_slice(step);
            self.changes.extend_from_slice(change);
            self.inverse_curvatures.push(1.0 / curvature);
            let products = self.inverse_curvatures.len() * self.capacity;
            self.step_change.resize(products, 0.0);
            self.change_change.resize(products, 0.0);
        } else {
            let slot = self.slot(self.oldest);
            self.steps[slot.clone()].copy_from_slice(step);
            self.changes[slot].copy_from_slice(change);
            self.inverse_curvatures[self.oldest] = 1.0 / curvature;
            self.oldest = (self.oldest + 1) % self.capacity;
        }
    }

    fn slot(&self, i: usize) -> std::ops::Range<usize> {
        i * self.dimension..(i + 1) * self.dimension
    }

    /// -H ∇L.
    pub(super) fn direction(&mut self, gradient: &[T]) -> Vec<T> {
        let mut direction = vec![T::ZERO; self.dimension];
        let (steps, changes) = self.coefficients(gradient);
        add_rows(
            &mut direction,
            &[
                (&[-self.scale], gradient),
                (&changes, &self.changes),
                (&steps, &self.steps),
            ],
        );
        direction
    }

    /// Of each s and each y in -H ∇L; that of ∇L is -`scale`.
    fn coefficients(&mut self, gradient: &[T]) -> (Vec<f64>, Vec<f64>) {
        let len = self.inverse_curvatures.len();
        let Some(last) = len.checked_sub(1) else {
            return (Vec::new(), Vec::new());
        };
        let by_age: Vec<usize> = (0..len).map(|k| (self.oldest + k) % len).collect();
        let newest = by_age[last];
        let change = &self.changes[self.slot(newest)];
        let right = [gradient, change];
        let of_steps = products(&self.steps, right);
        let of_changes = products(&self.changes, right);
        self.keep(newest, &of_steps, &of_changes);
        let capacity = self.capacity;
        let step_change = |i: usize, j: usize| self.step_change[j * capacity + i];
        let change_change = |i: usize, j: usize| self.change_change[j * capacity + i];

        let mut alphas = vec![0.0; len];
        for (age, &i) in by_age.iter().enumerate().rev() {
            let newer = by_age[age + 1..].iter();
            let sum: f64 = newer.map(|&j| alphas[j] * step_change(i, j)).sum();
            alphas[i] = -self.inverse_curvatures[i] * (of_steps[i][0] + sum);
        }
        let mut steps = vec![0.0; len];
        for (age, &i) in by_age.iter().enumerate() {
            let all = alphas.iter().enumerate();
            let sum: f64 = all.map(|(j, alpha)| alpha * change_change(j, i)).sum();
            let older = by_age[..age].iter();
            let carried: f64 = older.map(|&j| steps[j] * step_change(j, i)).sum();
            let product = carried - self.scale * (of_changes[i][0] + sum);
            steps[i] = alphas[i] - self.inverse_curvatures[i] * product;
        }
        let changes = alphas.iter().map(|alpha| -self.scale * alpha).collect();
        (steps, changes)
    }

    /// Keeps the products of all vectors with the newest y.
    fn keep(&mut self, newest: usize, of_steps: &[Products], of_changes: &[Products]) {
        for (i, ([_, step], [_, change])) in of_steps.iter().zip(of_changes).enumerate() {
            self.step_change[newest * self.capacity + i] = *step;
            self.change_change[newest * self.capacity + i] = *change;
            self.change_change[i * self.capacity + newest] = *change;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::linear_algebra::{add_scaled, scaled};
    use super::*;

    /// The recursion as it stands in \[NW06\], oldest pair first.
    fn two_loops(pairs: &[(Vec<f64>, Vec<f64>)], scale: f64, gradient: &[f64]) -> Vec<f64> {
        let mut q = scaled(-1.0, gradient);
        let mut alphas = vec![0.0; pairs.len()];
        for (i, (s, y)) in pairs.iter().enumerate().rev() {
            alphas[i] = dot(s, &q) / dot(s, y);
            add_scaled(&mut q, -alphas[i], y);
        }
        let mut r = scaled(scale, &q);
        for ((s, y), alpha) in pairs.iter().zip(alphas) {
            let beta = dot(y, &r) / dot(s, y);
            add_scaled(&mut r, alpha - beta, s);
        }
        r
    }

    #[test]
    fn a_direction_is_that_of_the_two_loop_recursion() {
        // More pairs than are kept, no multiple of the rows that are read together, and vectors that
        // fill no block.
        let (dimension, capacity) = (1_234, 7);
        let wave = |k: usize, step: f64| -> Vec<f64> {
            (0..dimension)
                .map(|i| (step * i as f64 + k as f64).sin())
                .collect()
        };
        let mut pairs = Pairs::new(dimension, capacity);
        let mut kept: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
        for k in 0..20 {
            let gradient = wave(k, 0.37);
            let scale = kept.last().map_or(1.0, |(s, y)| dot(s, y) / dot(y, y));
            let expected = two_loops(&kept, scale, &gradient);
            let direction = pairs.direction(&gradient);
            let size = dot(&expected, &expected).sqrt();
            for (a, b) in direction.iter().zip(&expected) {
                // Both in f64, sums of a thousand terms in another order.
                assert!((a - b).abs() < 1e-11 * size, "{k}: {a} {b}");
            }
            // y = A s with a positive diagonal A: the curvature is positive.
            let step = wave(k, 0.11 * (k + 1) as f64);
            let change = step.iter().enumerate();
            let change: Vec<f64> = change.map(|(i, s)| s * (1.0 + (i % 5) as f64)).collect();
            pairs.push(&step, &change);
            kept.push((step, change));
            if kept.len() > capacity {
                kept.remove(0);
            }
        }
    }
}
