//! How far a field misses the shape of a cloud, told apart from the noise of its points.
//!
//! Noise of neighbouring points is independent; what a field misses of the shape is the same for both. So the mean
//! product of the residuals of neighbours is the mean square of what is missed, and no estimate of the noise is needed.
//! Details as small as the distance of neighbours are not seen so: where points are all but exact, the size of the
//! residuals tells of them.

use crate::reconstruction::error::Error;
use crate::reconstruction::sampling::neighbours::{Neighbourhoods, Tree};
use crate::reconstruction::surface::Field;
use crate::reconstruction::vector::{Vec3, along, distance, norm};

/// Least slope of a field whose value is divided by it for a distance, over that of a distance in units of the band.
/// Between parts that a field has not told apart yet it is flat: a larger bound would call them near.
const LEAST_SLOPE: f64 = 0.1;

/// No slope: a place where the gradient is less stays where it is.
const TINY: f64 = 1e-12;

/// Newton's steps to the zero set: more change no residual of the clouds of the bench by a percent.
const STEPS: usize = 2;

/// The mean product has to be so many standard errors above 0. Residuals of pure noise are above two once in 40 clouds.
const STANDARD_ERRORS: f64 = 2.0;

/// How far a field passes points by that it was not fitted to, in their unit.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Misfit {
    /// Root mean square of what it misses of the shape that neighbours share, 0 where noise alone may have made the
    /// residuals.
    pub(super) shared: f64,
    /// Root mean square of the residuals, noise and all.
    pub(super) size: f64,
}

/// The misfit of the field of one network at `points`. Targets of the field reach ±1 at `band`.
///
/// # Errors
/// What the field reports.
pub(super) fn misfit(field: &dyn Field, points: &[Vec3], band: f64) -> Result<Misfit, Error> {
    if points.len() < 2 {
        return Ok(Misfit::default());
    }
    let (residuals, feet) = residuals(field, points, band)?;
    // Of the points themselves, those at the same height above the surface are the nearer ones.
    let nearest = Neighbourhoods::new(&Tree::new(&feet), &feet, 1);
    let products = (0..points.len()).flat_map(|i| nearest.of(i).map(move |j| (i, j)));
    let products: Vec<f64> = products.map(|(i, j)| residuals[i] * residuals[j]).collect();
    let squares = residuals.iter().map(|r| r * r).sum::<f64>();
    Ok(Misfit {
        shared: significant_mean(&products).sqrt(),
        size: (squares / points.len() as f64).sqrt(),
    })
}

/// Signed distances of the points to the zero set, at most a band, and their feet there: Newton's steps along the
/// gradient. The first alone is off by the square of the distance, to the same side everywhere.
fn residuals(
    field: &dyn Field,
    points: &[Vec3],
    band: f64,
) -> Result<(Vec<f64>, Vec<Vec3>), Error> {
    let mut reached = points.to_vec();
    let mut inside = vec![1.0; points.len()];
    let mut values = vec![0.0; points.len()];
    let mut gradients = vec![[0.0; 3]; points.len()];
    for step in 0..STEPS {
        field.values_and_gradients(&reached, &mut values, &mut gradients)?;
        if step == 0 {
            inside.copy_from_slice(&values);
        }
        for ((place, value), gradient) in reached.iter_mut().zip(&values).zip(&gradients) {
            let slope = norm(*gradient);
            let length = (value / slope.max(LEAST_SLOPE / band)).clamp(-band, band);
            *place = along(*place, -length / slope.max(TINY), *gradient);
        }
    }
    let ways = points.iter().zip(&reached).zip(&inside);
    let distances = ways.map(|((from, to), side)| distance(*from, *to).min(band).copysign(*side));
    Ok((distances.collect(), reached))
}

/// Their mean less some standard errors, or 0. Most products stand twice among them, once for each of two neighbours.
fn significant_mean(products: &[f64]) -> f64 {
    let count = products.len() as f64;
    let mean = products.iter().sum::<f64>() / count;
    let variance = products.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / count;
    (mean - STANDARD_ERRORS * (2.0 * variance / count).sqrt()).max(0.0)
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::reconstruction::random::{Purpose, stream};

    /// Distance to the plane z = 0.
    struct Plane;

    impl Field for Plane {
        fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
            for (value, p) in values.iter_mut().zip(points) {
                *value = -p[2];
            }
            Ok(())
        }

        fn values_and_gradients(
            &self,
            points: &[Vec3],
            values: &mut [f64],
            gradients: &mut [Vec3],
        ) -> Result<(), Error> {
            gradients.fill([0.0, 0.0, -1.0]);
            self.values(points, values)
        }
    }

    /// What it misses of a surface with waves, so many to a length, and noise.
    fn misfit_of(noise: f64, wave: f64, waves: f64) -> Misfit {
        let mut random = stream(1, Purpose::Sampling);
        let points: Vec<Vec3> = (0..4_000)
            .map(|_| {
                let [x, y]: [f64; 2] = [random.random(), random.random()];
                let height = wave * (waves * x).sin();
                [x, y, height + noise * (random.random::<f64>() - 0.5)]
            })
            .collect();
        misfit(&Plane, &points, 1.0).unwrap()
    }

    fn missed(noise: f64, wave: f64) -> f64 {
        misfit_of(noise, wave, 20.0).shared
    }

    #[test]
    fn waves_shorter_than_the_way_to_a_neighbour_are_told_by_their_size() {
        let found = misfit_of(0.0, 0.02, 2_000.0);
        assert!(found.shared < 0.006, "{found:?}");
        assert!((0.013..0.0155).contains(&found.size), "{found:?}");
    }

    #[test]
    fn noise_is_no_misfit_and_a_wave_is_one_under_any_noise() {
        assert!(missed(0.1, 0.0).abs() < 1e-12);
        // The root mean square of a wave; what is taken off is 2 standard errors of its square.
        let clean = missed(0.0, 0.02);
        assert!((0.012..0.0142).contains(&clean), "{clean}");
        let noisy = missed(0.1, 0.02);
        assert!((0.009..0.0155).contains(&noisy), "{noisy}");
    }
}
