//! Fields that are known exactly.

use meshway::reconstruction::Error;
use meshway::reconstruction::surface::Field;
use meshway::reconstruction::vector::{Vec3, norm};

/// A field from a function, with central differences as its gradient.
pub(super) struct Analytic<F>(F);

pub(super) fn analytic<F: Fn(Vec3) -> f64 + Sync>(f: F) -> Analytic<F> {
    Analytic(f)
}

impl<F: Fn(Vec3) -> f64 + Sync> Field for Analytic<F> {
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
        for (value, point) in values.iter_mut().zip(points) {
            *value = (self.0)(*point);
        }
        Ok(())
    }

    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error> {
        const STEP: f64 = 1e-6;
        self.values(points, values)?;
        for (gradient, point) in gradients.iter_mut().zip(points) {
            *gradient = std::array::from_fn(|axis| {
                let at = |step: f64| {
                    let mut moved = *point;
                    moved[axis] += step;
                    (self.0)(moved)
                };
                (at(STEP) - at(-STEP)) / (2.0 * STEP)
            });
        }
        Ok(())
    }
}

/// Signed distance to a sphere about the origin.
pub(super) fn sphere(radius: f64) -> Analytic<impl Fn(Vec3) -> f64 + Sync> {
    analytic(move |p| radius - norm(p))
}

/// Signed distance to a torus about the z axis.
pub(super) fn torus(major: f64, minor: f64) -> Analytic<impl Fn(Vec3) -> f64 + Sync> {
    analytic(move |p| minor - (p[0].hypot(p[1]) - major).hypot(p[2]))
}

/// A distance over a band, clamped to ±1 as the targets of training are.
pub(super) fn graded<F: Fn(Vec3) -> f64 + Sync>(
    field: Analytic<F>,
    band: f64,
) -> Analytic<impl Fn(Vec3) -> f64 + Sync> {
    analytic(move |p| (field.0(p) / band).clamp(-1.0, 1.0))
}

/// A step from -1 to 1.
pub(super) fn binary<F: Fn(Vec3) -> f64 + Sync>(
    field: Analytic<F>,
) -> Analytic<impl Fn(Vec3) -> f64 + Sync> {
    analytic(move |p| if field.0(p) > 0.0 { 1.0 } else { -1.0 })
}

/// Given values at the points with whole coordinates, constant around them.
pub(super) fn lattice_field(
    size: [usize; 3],
    values: Vec<f64>,
) -> Analytic<impl Fn(Vec3) -> f64 + Sync> {
    analytic(move |p| {
        let [x, y, z] =
            std::array::from_fn(|a| p[a].round().clamp(0.0, (size[a] - 1) as f64) as usize);
        values[x + size[0] * (y + size[1] * z)]
    })
}
