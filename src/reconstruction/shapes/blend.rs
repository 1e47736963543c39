//! Organic solids: tapered capsules, smoothly united, in a space stretched along the axes.

use crate::reconstruction::vector::{Bounds, Vec3, along, dot, norm, scale, sub};

/// A segment thickened from one radius to another.
pub(super) struct Capsule {
    from: Vec3,
    to: Vec3,
    radii: [f64; 2],
}

/// A smooth union of capsules.
pub(super) struct Blend {
    capsules: &'static [Capsule],
    /// Distance over which two capsules flow into each other.
    smoothness: f64,
    /// Factors along the axes from the space of the capsules to that of the shape.
    stretch: Vec3,
}

const fn capsule(from: Vec3, to: Vec3, radii: [f64; 2]) -> Capsule {
    Capsule { from, to, radii }
}

/// Fingers along y, palm in the plane z = 0.
pub(super) const HAND: Blend = Blend {
    capsules: &[
        capsule([0.0, -1.0, 0.0], [0.0, -0.5, 0.0], [0.25, 0.25]),
        capsule([-0.08, -0.45, 0.0], [-0.28, 0.1, 0.0], [0.2, 0.17]),
        capsule([0.0, -0.45, 0.0], [0.0, 0.12, 0.0], [0.22, 0.19]),
        capsule([0.08, -0.45, 0.0], [0.27, 0.06, 0.0], [0.2, 0.16]),
        capsule([-0.34, 0.1, 0.0], [-0.47, 0.75, 0.02], [0.1, 0.07]),
        capsule([-0.12, 0.15, 0.0], [-0.15, 0.92, 0.02], [0.1, 0.075]),
        capsule([0.1, 0.15, 0.0], [0.16, 0.85, 0.02], [0.1, 0.07]),
        capsule([0.3, 0.05, 0.0], [0.46, 0.58, 0.02], [0.09, 0.06]),
        capsule([-0.2, -0.4, 0.03], [-0.72, 0.1, 0.15], [0.14, 0.08]),
    ],
    smoothness: 0.1,
    stretch: [1.0; 3],
};

/// Fundus up (y), tubes left and right (x), flattened from front to back (z).
pub(super) const UTERUS: Blend = Blend {
    capsules: &[
        capsule([0.0, 0.35, 0.0], [0.0, -0.35, 0.02], [0.48, 0.24]),
        capsule([0.0, -0.3, 0.02], [0.0, -0.95, -0.05], [0.21, 0.23]),
        capsule([0.2, 0.55, 0.0], [0.85, 0.72, -0.05], [0.2, 0.09]),
        capsule([-0.2, 0.55, 0.0], [-0.85, 0.72, -0.05], [0.2, 0.09]),
    ],
    smoothness: 0.2,
    stretch: [1.0, 1.0, 0.75],
};

/// Chest up (z), a waist between it and the pelvis, deeper in x than in y.
pub(super) const ABDOMEN: Blend = Blend {
    capsules: &[
        capsule([0.0, 0.0, 0.5], [0.0, 0.0, 0.3], [0.62, 0.6]),
        capsule([0.0, 0.0, 0.2], [0.0, 0.0, -0.2], [0.52, 0.54]),
        capsule([0.0, 0.02, -0.35], [0.0, 0.0, -0.5], [0.6, 0.64]),
    ],
    smoothness: 0.25,
    stretch: [1.0, 0.68, 1.0],
};

impl Capsule {
    /// Distance to the surface, positive inside, and its gradient.
    ///
    /// The radius follows a smooth step along the segment, so that the gradient is continuous at its ends.
    fn signed_and_gradient(&self, p: Vec3) -> (f64, Vec3) {
        let axis = sub(self.to, self.from);
        let t = (dot(sub(p, self.from), axis) / dot(axis, axis)).clamp(0.0, 1.0);
        let away = sub(p, along(self.from, t, axis));
        let length = norm(away);
        let growth = self.radii[1] - self.radii[0];
        let radius = self.radii[0] + growth * t * t * (3.0 - 2.0 * t);
        let slope = growth * 6.0 * t * (1.0 - t) / dot(axis, axis);
        let inward = if length > 0.0 {
            scale(away, -1.0 / length)
        } else {
            [0.0; 3]
        };
        (radius - length, along(inward, slope, axis))
    }
}

impl Blend {
    /// f and ∇f at `p`: a distance in the space of the capsules, scaled back by the smallest stretch,
    /// so that it is never more than the true one near the surface.
    pub(super) fn signed_and_gradient(&self, p: Vec3) -> (f64, Vec3) {
        let inner: Vec3 = std::array::from_fn(|a| p[a] / self.stretch[a]);
        let (value, gradient) = self
            .capsules
            .iter()
            .map(|capsule| capsule.signed_and_gradient(inner))
            .reduce(|a, b| unite(a, b, self.smoothness))
            .expect("a blend has capsules");
        let least = self.stretch.into_iter().fold(f64::INFINITY, f64::min);
        (
            value * least,
            std::array::from_fn(|a| gradient[a] * least / self.stretch[a]),
        )
    }

    /// A box that surely holds the surface: a smooth union swells by a quarter of the smoothness at
    /// each joint, and few joints meet.
    pub(super) fn bounds(&self) -> Bounds {
        let ends = self.capsules.iter().flat_map(|c| {
            [(c.from, c.radii[0]), (c.to, c.radii[1])].map(|(end, radius)| {
                let reach = radius + 0.5 * self.smoothness;
                Bounds { min: end, max: end }.padded(reach)
            })
        });
        let corners: Vec<Vec3> = ends.flat_map(|b| [b.min, b.max]).collect();
        let tight = Bounds::of(&corners).expect("a blend has capsules");
        Bounds {
            min: std::array::from_fn(|a| tight.min[a] * self.stretch[a]),
            max: std::array::from_fn(|a| tight.max[a] * self.stretch[a]),
        }
    }
}

/// The larger of two fields, blended by a quadratic where they differ by less than `smoothness`.
fn unite(a: (f64, Vec3), b: (f64, Vec3), smoothness: f64) -> (f64, Vec3) {
    let (larger, smaller) = if a.0 >= b.0 { (a, b) } else { (b, a) };
    let h = (1.0 - (larger.0 - smaller.0) / smoothness).max(0.0);
    (
        larger.0 + 0.25 * h * h * smoothness,
        std::array::from_fn(|i| larger.1[i] * (1.0 - 0.5 * h) + smaller.1[i] * 0.5 * h),
    )
}
