//! The limited memory of L-BFGS.

use serde::{Deserialize, Serialize};

use super::linear_algebra::{add_scaled, dot, scaled};
use crate::reconstruction::network::Scalar;

/// Curvature below which a pair is not kept: it would make the inverse Hessian indefinite or huge.
const SMALLEST_CURVATURE: f64 = 1e-10;

/// The latest steps s and changes of the gradient y, and the inverse Hessian that they imply.
///
/// # Cost
/// A direction reads each pair twice: 4 `len` passes over vectors of the parameters' length. The
/// pairs lie in two contiguous rings so that these passes run at the speed of the memory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub(super) struct Pairs<T> {
    /// Length of each vector.
    dimension: usize,
    /// Most pairs that are kept.
    capacity: usize,
    /// Slot of the oldest pair, once all are in use.
    oldest: usize,
    steps: Vec<T>,
    changes: Vec<T>,
    /// 1 / (y · s) of each slot.
    inverse_curvatures: Vec<f64>,
    /// H₀ = (y · s) / (y · y) of the newest pair.
    scale: f64,
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

    /// -H ∇L by the two-loop recursion (\[NW06\] algorithm 7.4).
    pub(super) fn direction(&self, gradient: &[T]) -> Vec<T> {
        let len = self.inverse_curvatures.len();
        let oldest_first = (0..len).map(|k| (self.oldest + k) % len);
        let mut alphas = vec![0.0; len];
        let mut q = scaled(-1.0, gradient);
        for i in oldest_first.clone().rev() {
            alphas[i] = self.inverse_curvatures[i] * dot(&self.steps[self.slot(i)], &q);
            add_scaled(&mut q, -alphas[i], &self.changes[self.slot(i)]);
        }
        let mut r = scaled(self.scale, &q);
        for i in oldest_first {
            let beta = self.inverse_curvatures[i] * dot(&self.changes[self.slot(i)], &r);
            add_scaled(&mut r, alphas[i] - beta, &self.steps[self.slot(i)]);
        }
        r
    }
}
