//! A block: a box in which a network of its own rules, and where it hands over to its neighbours.

use serde::{Deserialize, Serialize};

use crate::reconstruction::sampling::Frame;
use crate::reconstruction::vector::{Bounds, Vec3};

/// Where a block is; all in the frame of the run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Block {
    /// Where the weight of its network is 1.
    pub core: Bounds,
    /// Where it falls to 0; the samples in it are what the network is fitted to.
    pub reach: Bounds,
    /// Distance from the surface at which the network's targets reach ±1.
    pub band: f64,
    /// From the frame of the run to that of the network.
    pub frame: Frame,
}

impl Block {
    /// Weight of the network at `q`: 1 in the core, 0 from the end of the reach on, with a continuous slope.
    pub fn weight(&self, q: Vec3) -> f64 {
        (0..3).map(|axis| self.along(axis, q).0).product()
    }

    /// The weight and its gradient.
    pub fn weight_and_gradient(&self, q: Vec3) -> (f64, Vec3) {
        let parts = [0, 1, 2].map(|axis| self.along(axis, q));
        let [a, b, c] = parts.map(|part| part.0);
        let [da, db, dc] = parts.map(|part| part.1);
        (a * b * c, [da * b * c, a * db * c, a * b * dc])
    }

    /// The factor of one axis, and its slope.
    fn along(&self, axis: usize, q: Vec3) -> (f64, f64) {
        let (from, to, sign) = if q[axis] > self.core.max[axis] {
            (self.core.max[axis], self.reach.max[axis], 1.0)
        } else if q[axis] < self.core.min[axis] {
            (self.core.min[axis], self.reach.min[axis], -1.0)
        } else {
            return (1.0, 0.0);
        };
        let width = (to - from).abs();
        let beyond = (q[axis] - from).abs();
        if beyond >= width {
            return (0.0, 0.0);
        }
        let t = beyond / width;
        let fall = 1.0 - t * t * (3.0 - 2.0 * t);
        (fall, -sign * 6.0 * t * (1.0 - t) / width)
    }
}

/// How much of the coarse field is left where the weights of the blocks sum to `sum`, and the slope of that: 1
/// without any, 0 from 1 on, with a continuous slope.
pub(super) fn rest(sum: f64) -> (f64, f64) {
    let missing = (1.0 - sum).max(0.0);
    (missing * missing, -2.0 * missing)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block() -> Block {
        let core = Bounds {
            min: [0.0, -1.0, 2.0],
            max: [1.0, 0.5, 2.5],
        };
        Block {
            core,
            reach: core.padded(0.25),
            band: 0.1,
            frame: Frame::IDENTITY,
        }
    }

    #[test]
    fn the_weight_is_one_in_the_core_and_falls_to_zero() {
        let block = block();
        for (q, weight) in [
            ([0.5, 0.0, 2.2], 1.0),
            ([1.0, 0.5, 2.5], 1.0),
            ([1.125, 0.0, 2.2], 0.5),
            ([1.25, 0.0, 2.2], 0.0),
            ([0.5, 0.0, 9.0], 0.0),
        ] {
            assert!((block.weight(q) - weight).abs() < 1e-12, "{q:?}");
        }
    }

    #[test]
    fn the_gradients_are_those_of_the_weights() {
        let block = block();
        let step = 1e-6;
        for q in [
            [1.1, 0.6, 2.55],
            [-0.2, -1.1, 2.2],
            [0.5, 0.0, 1.8],
            [0.5, 0.0, 2.2],
        ] {
            let (weight, gradient) = block.weight_and_gradient(q);
            assert!((weight - block.weight(q)).abs() < 1e-15);
            for axis in 0..3 {
                let [low, high] = [-step, step].map(|h| {
                    let mut p = q;
                    p[axis] += h;
                    block.weight(p)
                });
                let slope = (high - low) / (2.0 * step);
                assert!(
                    (slope - gradient[axis]).abs() < 1e-6,
                    "{q:?} {axis}: {slope}"
                );
            }
        }
        for sum in [0.0, 0.3, 0.9, 1.0, 2.0] {
            let slope = (rest(sum + step).0 - rest(sum - step).0) / (2.0 * step);
            assert!((slope - rest(sum).1).abs() < 1e-5, "{sum}: {slope}");
        }
    }
}
