//! What a cloud must be like before any work is spent on it.

use rayon::slice::ParallelSliceMut;

use super::{Error, Label, PointCloud};
use crate::reconstruction::symmetric;
use crate::reconstruction::vector::{Bounds, Vec3, bits, scale, sub};

/// Fewest distinct surface points. Below that every estimate from neighbours fails.
pub const MIN_POINTS: usize = 16;

/// Largest magnitude of a coordinate: there f64 still tells eighths apart, and cubes of distances
/// are far from overflow.
pub(in crate::reconstruction) const MAX_COORDINATE: f64 = 1e15;

/// Smallest extent: the volume of its cube is still a normal number.
const MIN_EXTENT: f64 = 1e-100;

/// Smallest extent relative to the largest coordinate: some 5000 steps of f64 along the extent.
const MIN_RELATIVE_EXTENT: f64 = 1e-12;

/// Spread along an axis, relative to that along the longest, from which on it counts as spread.
/// Above what rounding of coordinates to f32 or to six digits makes of a tilted plane (1e-7 to
/// 3e-7), below any sheet that could be reconstructed.
const MIN_SPREAD: f64 = 1e-6;

impl PointCloud {
    /// Refuses what no surface can be reconstructed from.
    ///
    /// # Errors
    /// No or too few distinct surface points, coordinates that are not finite or too large, normals
    /// that do not match the points, surface points in one place, on a line or in a plane, or with a
    /// shape that is lost in the rounding of large coordinates.
    pub fn validate(&self) -> Result<(), Error> {
        if self.points.is_empty() {
            return Err(Error::Empty);
        }
        self.check_coordinates()?;
        if self
            .normals
            .as_ref()
            .is_some_and(|normals| normals.len() != self.points.len())
        {
            let detail = "the cloud has another number of normals than of points";
            return Err(Error::NormalsInvalid(detail.to_owned()));
        }
        let surface: Vec<Vec3> = self
            .indices(Label::Surface)
            .map(|i| self.points[i])
            .collect();
        enough_points(surface.len())?;
        check_spread(&surface)?;
        enough_points(distinct(&surface))
    }

    /// Number of different points.
    pub(super) fn distinct(&self) -> usize {
        distinct(&self.points)
    }

    fn check_coordinates(&self) -> Result<(), Error> {
        let total = self.points.len();
        let finite = |p: &&Vec3| p.iter().all(|v| v.is_finite());
        let dropped = total - self.points.iter().filter(finite).count();
        if dropped > 0 {
            return Err(Error::NotFinite { dropped, total });
        }
        let largest = |a: f64, &b: &f64| if b.abs() > a.abs() { b } else { a };
        let value = self.points.iter().flatten().fold(0.0, largest);
        if value.abs() > MAX_COORDINATE {
            let limit = MAX_COORDINATE;
            return Err(Error::TooLarge { value, limit });
        }
        Ok(())
    }
}

/// Refuses fewer surface points than an estimate from neighbours needs.
pub(in crate::reconstruction) fn enough_points(found: usize) -> Result<(), Error> {
    let needed = MIN_POINTS;
    let error = Error::TooFewPoints { found, needed };
    if found < needed { Err(error) } else { Ok(()) }
}

fn check_spread(points: &[Vec3]) -> Result<(), Error> {
    let Some(bounds) = Bounds::of(points) else {
        return Err(Error::Empty);
    };
    let extent = bounds.longest_edge();
    if extent < MIN_EXTENT {
        return Err(Error::Degenerate("all lie in one place"));
    }
    let largest = bounds
        .min
        .iter()
        .chain(&bounds.max)
        .fold(0.0, |a: f64, b| a.max(b.abs()));
    if extent < MIN_RELATIVE_EXTENT * largest {
        let reason = "lie so far from the origin that their shape is lost in rounding";
        return Err(Error::Degenerate(reason));
    }
    let [short, middle, long] = spreads(points, &bounds);
    if middle < MIN_SPREAD * long {
        return Err(Error::Degenerate("all lie on a line"));
    }
    if short < MIN_SPREAD * long {
        return Err(Error::Degenerate("all lie in a plane"));
    }
    Ok(())
}

/// Standard deviations along the principal axes, ascending, in units of the longest edge.
fn spreads(points: &[Vec3], bounds: &Bounds) -> [f64; 3] {
    let to_unit = 1.0 / bounds.longest_edge();
    let centre = bounds.centre();
    let unit = |p: &Vec3| scale(sub(*p, centre), to_unit);
    let count = points.len() as f64;
    let mut mean = [0.0; 3];
    for p in points {
        let u = unit(p);
        for i in 0..3 {
            mean[i] += u[i] / count;
        }
    }
    let mut covariance = [[0.0; 3]; 3];
    for p in points {
        let d = sub(unit(p), mean);
        for (i, row) in covariance.iter_mut().enumerate() {
            for (j, entry) in row.iter_mut().enumerate() {
                *entry += d[i] * d[j] / count;
            }
        }
    }
    symmetric::eigen(covariance).0.map(|v| v.max(0.0).sqrt())
}

fn distinct(points: &[Vec3]) -> usize {
    let mut keys: Vec<[u64; 3]> = points.iter().map(|p| bits(*p)).collect();
    keys.par_sort_unstable();
    keys.dedup();
    keys.len()
}
