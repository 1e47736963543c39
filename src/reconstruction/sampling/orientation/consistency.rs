//! Normals that agree with the winding field that they make \[LSL24\].

use super::dipoles::Dipoles;
use crate::reconstruction::sampling::frame::Frame;
use crate::reconstruction::vector::{Bounds, Vec3, along, dot, norm, normalized, scale};

/// Iterations. The signs settle within ten where the points are clean; more let the normals follow
/// the noise.
const ITERATIONS: usize = 15;

/// First width over the last one: the first iterations see the shape as a whole.
const WIDENING: f64 = 2.0;

/// Outward normals of points, with the field of which they are the negative gradient.
pub(super) struct Consistent {
    /// Outward unit normals.
    pub(super) normals: Vec<Vec3>,
    frame: Frame,
    dipoles: Dipoles,
    moments: Vec<Vec3>,
}

impl Consistent {
    /// Normals of `points` from nothing, of the field with kernels that end up with `width`.
    ///
    /// Each iteration takes one step of steepest descent for the moments μ towards a winding number
    /// of 1/2 at the points, and turns each μᵢ into the negative gradient of the field at its point;
    /// its length stays, it is the area that the point stands for.
    pub(super) fn new(points: &[Vec3], width: f64) -> Self {
        // Single precision is enough around the origin and near 1 only.
        let frame = Bounds::of(points)
            .and_then(|bounds| Frame::normalized(&bounds, 1.0))
            .unwrap_or(Frame::IDENTITY);
        let points: Vec<Vec3> = points.iter().map(|p| frame.to_unit(*p)).collect();
        let width = frame.length_to_unit(width);
        let mut dipoles = Dipoles::new(&points);
        let mut moments = vec![[0.0; 3]; points.len()];
        for iteration in 0..ITERATIONS {
            let left = 1.0 - iteration as f64 / (ITERATIONS - 1) as f64;
            dipoles.set_width(width * (1.0 + (WIDENING - 1.0) * left));
            descend(&dipoles, &mut moments);
            let downhill = dipoles.downhill(&points, &moments);
            for (moment, downhill) in moments.iter_mut().zip(&downhill) {
                if let Some(normal) = normalized(*downhill) {
                    *moment = scale(normal, norm(*moment));
                }
            }
        }
        Self {
            normals: units(&moments),
            frame,
            dipoles,
            moments,
        }
    }

    /// Outward unit normals at `places` on the same surface.
    pub(super) fn at(&self, places: &[Vec3]) -> Vec<Vec3> {
        let places: Vec<Vec3> = places.iter().map(|p| self.frame.to_unit(*p)).collect();
        units(&self.dipoles.downhill(&places, &self.moments))
    }
}

/// The best step along the negative gradient of |A μ - 1/2|².
fn descend(dipoles: &Dipoles, moments: &mut [Vec3]) {
    let residuals: Vec<f64> = dipoles.potential(moments).iter().map(|w| 0.5 - w).collect();
    let direction = dipoles.transposed(&residuals);
    let square: f64 = direction.iter().map(|d| dot(*d, *d)).sum();
    let curvature: f64 = dipoles.potential(&direction).iter().map(|v| v * v).sum();
    if curvature > 0.0 {
        for (moment, direction) in moments.iter_mut().zip(&direction) {
            *moment = along(*moment, square / curvature, *direction);
        }
    }
}

fn units(vectors: &[Vec3]) -> Vec<Vec3> {
    vectors
        .iter()
        .map(|v| normalized(*v).unwrap_or([0.0, 0.0, 1.0]))
        .collect()
}
