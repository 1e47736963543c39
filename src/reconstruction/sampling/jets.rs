//! Directions of normals by local fits of height fields, with neighbourhoods chosen by
//! cross-validation; and the noise, which is what the fits leave.

use std::iter;

use rayon::prelude::*;

use super::neighbours::{Neighbourhoods, quantile, tangents};
use crate::reconstruction::cholesky;
use crate::reconstruction::vector::{Vec3, along, dot, norm, normalized, sub};

/// Sizes of neighbourhoods that are tried, in multiples of the chosen number of neighbours.
const SIZES: [f64; 12] = [
    0.375, 0.5, 0.625, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0,
];

/// Largest of the sizes that are tried, in multiples of the neighbours asked for.
pub const WIDEST: usize = 8;

/// Coefficients of a plane and of a quadric as heights over the tangent plane.
const DEGREES: [usize; 2] = [3, 6];

/// A fit needs so many points more than it has coefficients.
const SPARE: usize = 2;

/// Least cosine between the normals of points on the same sheet.
const SAME_SHEET: f64 = 0.2;

/// Points over which the error of a size is averaged, besides the point itself.
const POOLED: usize = 16;

/// Weight against slopes and curvatures, as a share of what the points weigh: it settles fits that few
/// points leave open.
const RIDGE: f64 = 0.0025;

/// The quantile of the errors of the fits that tells the noise, ...
const NOISE_QUANTILE: f64 = 0.25;

/// ... and what it is times that: the error of points left out, averaged, varies little.
const NOISE_FACTOR: f64 = 1.1;

/// Normals from fits.
pub struct Jets {
    /// Unit normals, on the side of those that they started from.
    pub normals: Vec<Vec3>,
    /// Root mean square error of the fits around each point that has any.
    errors: Vec<f64>,
}

/// What one fit tells.
#[derive(Clone, Copy)]
struct Fit {
    /// Distance of the point from the surface that its neighbours make without it.
    error: f64,
    normal: Vec3,
}

impl Jets {
    /// Normals of `points` near the oriented unit `normals`.
    ///
    /// Around each point, planes and quadrics are fitted to neighbourhoods of several sizes, on the sheet
    /// of the point only. That one is taken which predicts points best that were left out of it
    /// (cross-validation, averaged over the points around); of equally good ones the larger, whose slope
    /// is the surer: its error is divided by its size to the power of `leaning`.
    pub fn new(
        points: &[Vec3],
        normals: &[Vec3],
        neighbours: &Neighbourhoods,
        leaning: f64,
    ) -> Self {
        let sizes: Vec<usize> = SIZES
            .iter()
            .map(|size| (size * neighbours.count() as f64 / WIDEST as f64).round() as usize)
            .collect();
        let fits: Vec<Vec<Option<Fit>>> = (0..points.len())
            .into_par_iter()
            .map(|i| {
                let arms = same_sheet(points, normals, neighbours, i);
                DEGREES
                    .iter()
                    .flat_map(|degree| sizes.iter().map(move |size| (*degree, *size)))
                    .map(|(degree, size)| fit(arms.get(..size)?, normals[i], degree))
                    .collect()
            })
            .collect();
        let chosen: Vec<(Vec3, Option<f64>)> = (0..points.len())
            .into_par_iter()
            .map(|i| {
                let pool: Vec<usize> = iter::once(i).chain(neighbours.of(i).take(POOLED)).collect();
                best(&fits, &pool, |k| {
                    (sizes[k % sizes.len()] as f64).powf(-leaning)
                })
                .map_or((normals[i], None), |(normal, error)| (normal, Some(error)))
            })
            .collect();
        let errors: Vec<f64> = chosen.iter().filter_map(|(_, error)| *error).collect();
        Self {
            normals: chosen.into_iter().map(|(normal, _)| normal).collect(),
            errors,
        }
    }

    /// Median error of the fits: noise, and what they miss of the shape.
    pub fn error(&self) -> f64 {
        self.quantile(0.5)
    }

    /// Standard deviation of the points from the surface. It is the same everywhere, where features
    /// that the fits miss are not, so the places of the least errors tell it.
    pub fn noise(&self) -> f64 {
        NOISE_FACTOR * self.quantile(NOISE_QUANTILE)
    }

    fn quantile(&self, share: f64) -> f64 {
        quantile(&mut self.errors.clone(), share)
    }
}

/// One quadric through the nearest points of each: where points are many, slopes need no more.
pub(super) struct Quadrics(Vec<Option<Fit>>);

impl Quadrics {
    /// Quadrics around `points` near the oriented unit `normals`.
    pub(super) fn new(points: &[Vec3], normals: &[Vec3], neighbours: &Neighbourhoods) -> Self {
        Self(neighbours.map(|i| quadric(points, normals, neighbours, i)))
    }

    /// The same, made again only around the points `at`.
    pub(super) fn again(
        &self,
        points: &[Vec3],
        normals: &[Vec3],
        (neighbours, at): (&Neighbourhoods, &[bool]),
    ) -> Self {
        Self(neighbours.map(|i| {
            if at[i] {
                quadric(points, normals, neighbours, i)
            } else {
                self.0[i]
            }
        }))
    }

    /// Their normals, and the given ones where there is no quadric.
    pub(super) fn normals(&self, mut normals: Vec<Vec3>) -> Vec<Vec3> {
        for (normal, fit) in normals.iter_mut().zip(&self.0) {
            *normal = fit.map_or(*normal, |fit| fit.normal);
        }
        normals
    }

    /// Standard deviation of the points from the surface, as [`Jets::noise`] tells it.
    pub(super) fn noise(&self, neighbours: &Neighbourhoods) -> f64 {
        let errors = neighbours.map(|i| {
            let pool = iter::once(i).chain(neighbours.of(i).take(POOLED));
            root_mean_square(pool.filter_map(|j| self.0[j].map(|fit| fit.error)))
        });
        let mut errors: Vec<f64> = errors.into_iter().flatten().collect();
        NOISE_FACTOR * quantile(&mut errors, NOISE_QUANTILE)
    }
}

fn quadric(
    points: &[Vec3],
    normals: &[Vec3],
    neighbours: &Neighbourhoods,
    i: usize,
) -> Option<Fit> {
    fit(
        &same_sheet(points, normals, neighbours, i),
        normals[i],
        DEGREES[1],
    )
}

/// `point` moved onto the quadric through the ends of `arms` from it, nearest first, seen along `normal`; and the
/// normal of the quadric there. Both stay where the arms do not determine it.
pub(super) fn moved(point: Vec3, normal: Vec3, arms: &[Vec3]) -> (Vec3, Vec3) {
    fit(arms, normal, 6).map_or((point, normal), |fit| {
        (along(point, fit.error, fit.normal), fit.normal)
    })
}

/// From point `i` to its neighbours on the same sheet, nearest first.
fn same_sheet(
    points: &[Vec3],
    normals: &[Vec3],
    neighbours: &Neighbourhoods,
    i: usize,
) -> Vec<Vec3> {
    neighbours
        .of(i)
        .filter(|&j| dot(normals[i], normals[j]) > SAME_SHEET)
        .map(|j| sub(points[j], points[i]))
        .collect()
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0_u32, 0.0), |(count, sum), v| (count + 1, sum + v * v));
    (count > 0).then(|| (sum / f64::from(count)).sqrt())
}

/// Normal of the first point of `pool`, and error, of that kind of fit whose error over the pool, times
/// its `factor`, is least.
fn best(
    fits: &[Vec<Option<Fit>>],
    pool: &[usize],
    factor: impl Fn(usize) -> f64,
) -> Option<(Vec3, f64)> {
    let own = fits[*pool.first()?].iter().enumerate();
    own.filter_map(|(k, fit)| {
        let fit = (*fit)?;
        let errors = pool.iter().filter_map(|&j| fits[j][k]);
        let error = root_mean_square(errors.map(|fit| fit.error))?;
        Some((fit.normal, error, error * factor(k)))
    })
    .min_by(|a, b| a.2.total_cmp(&b.2))
    .map(|(normal, error, _)| (normal, error))
}

/// The plane or quadric through a point and `arms` around it, nearest first, as heights along `normal`;
/// `None` where they do not determine it.
fn fit(arms: &[Vec3], normal: Vec3, coefficients: usize) -> Option<Fit> {
    if arms.len() < coefficients + SPARE {
        return None;
    }
    let (u, v) = tangents(normal);
    // A little beyond the farthest one, which would have no weight otherwise.
    let reach = 1.05 * norm(*arms.last()?);
    let mut matrix = [[0.0; 6]; 6];
    let mut right = [0.0; 6];
    let mut total = 0.0;
    for arm in arms {
        let [x, y, z] = [dot(*arm, u), dot(*arm, v), dot(*arm, normal)].map(|c| c / reach);
        let weight = (1.0 - x * x - y * y - z * z).max(0.0).powi(2);
        let row = [1.0, x, y, x * x, x * y, y * y];
        for i in 0..coefficients {
            for j in 0..=i {
                matrix[i][j] += weight * row[i] * row[j];
            }
            right[i] += weight * row[i] * z;
        }
        total += weight;
    }
    for (i, row) in matrix.iter_mut().enumerate().skip(1) {
        row[i] += RIDGE * total;
    }
    let without = solved(matrix, right, coefficients)?;
    let slope = (1.0 + without[1] * without[1] + without[2] * without[2]).sqrt();
    matrix[0][0] += 1.0;
    let with = solved(matrix, right, coefficients)?;
    Some(Fit {
        error: reach * without[0] / slope,
        normal: normalized(along(along(normal, -with[1], u), -with[2], v))?,
    })
}

/// The solution of the first `n` of symmetric equations, of which the lower triangle is read.
fn solved(mut matrix: [[f64; 6]; 6], mut right: [f64; 6], n: usize) -> Option<[f64; 6]> {
    cholesky::solve(matrix.as_flattened_mut(), 6, &mut right[..n])?;
    Some(right)
}
