//! The planes that the contours of a region lie in, which need not be axial.

use std::collections::HashSet;

use super::contours::{Contour, Polygons};
use super::structures::Left;
use crate::reconstruction::vector::{Vec3, add, along, cross, dot, norm, normalized, scale, sub};

/// Contours closer than this, in millimetres along the normal, lie in one plane.
const SAME_PLANE: f64 = 0.05;

/// How far a point may be from the plane of its contour, in millimetres.
const FLAT: f64 = 0.5;

/// Normals this close to an axis of the patient are that axis: contours are drawn on such slices, and
/// their numbers are rounded.
const ALMOST: f64 = 1e-3;

/// The planes of a region, in order along their normal.
#[derive(Debug, Default)]
pub(super) struct Planes {
    /// A millimetre along the columns.
    pub(super) column: Vec3,
    /// A millimetre along the rows.
    pub(super) row: Vec3,
    /// Where the columns and rows of each plane begin.
    pub(super) origins: Vec<Vec3>,
    /// The contours of each plane.
    pub(super) polygons: Vec<Polygons>,
}

impl Planes {
    /// Sorts the contours of a region into planes.
    pub(super) fn of(contours: Vec<Contour>, left: &mut Left) -> Self {
        let Some(normal) = common_normal(&contours) else {
            left.skew += contours.len();
            return Self::default();
        };
        let (column, row) = across(normal);
        let count = contours.len();
        let flat = |contour: &Contour| {
            let middle = contour.middle();
            contour
                .points
                .iter()
                .all(|&p| dot(sub(p, middle), normal).abs() <= FLAT)
        };
        let mut flat: Vec<(f64, Contour)> = contours
            .into_iter()
            .filter(flat)
            .map(|contour| (dot(contour.middle(), normal), contour))
            .collect();
        left.skew += count - flat.len();
        flat.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut planes = Self {
            column,
            row,
            ..Self::default()
        };
        let mut first = f64::NEG_INFINITY;
        // The contours of the plane, to the last bit: thousands of them are not compared one with another.
        let mut seen: HashSet<Vec<[u64; 2]>> = HashSet::new();
        for (height, contour) in flat {
            if height - first > SAME_PLANE {
                first = height;
                planes.origins.push(scale(normal, height));
                planes.polygons.push(Vec::new());
                seen.clear();
            }
            let polygon: Vec<[f64; 2]> = contour
                .points
                .iter()
                .map(|&p| [dot(p, column), dot(p, row)])
                .collect();
            let Some(plane) = planes.polygons.last_mut() else {
                continue;
            };
            if seen.insert(polygon.iter().map(|p| p.map(f64::to_bits)).collect()) {
                plane.push(polygon);
            } else {
                left.repeated += 1;
            }
        }
        planes
    }

    /// Distance of neighbouring planes, the median; of a single one a millimetre.
    pub(super) fn distance(&self) -> f64 {
        let gaps = self
            .origins
            .windows(2)
            .map(|pair| norm(sub(pair[1], pair[0])));
        let mut gaps: Vec<f64> = gaps.collect();
        gaps.sort_by(f64::total_cmp);
        gaps.get(gaps.len() / 2).copied().unwrap_or(1.0)
    }
}

/// The normal that the largest contours have in common; `None` without one.
fn common_normal(contours: &[Contour]) -> Option<Vec3> {
    let size = |contour: &&Contour| norm(contour.normal);
    let largest = contours
        .iter()
        .max_by(|a, b| size(a).total_cmp(&size(b)))?
        .normal;
    let sum = contours.iter().fold([0.0; 3], |sum: Vec3, contour| {
        // Contours run either way around.
        let sign = if dot(contour.normal, largest) < 0.0 {
            -1.0
        } else {
            1.0
        };
        add(sum, scale(contour.normal, sign))
    });
    let normal = normalized(sum)?;
    let axis = (0..3).max_by(|&a, &b| normal[a].abs().total_cmp(&normal[b].abs()))?;
    let unit: Vec3 = std::array::from_fn(|i| f64::from(i == axis));
    // Upwards along the axis that it is nearest to, whatever way the contours run.
    let upwards = if normal[axis] < 0.0 {
        scale(normal, -1.0)
    } else {
        normal
    };
    let off = norm(along(upwards, -1.0, unit));
    Some(if off < ALMOST { unit } else { upwards })
}

/// Two unit vectors that make a right-handed frame with the normal; those of an axial plane lead to
/// the left and the back.
fn across(normal: Vec3) -> (Vec3, Vec3) {
    let start = if normal[0].abs() < 0.9 {
        [1.0, 0.0, 0.0]
    } else {
        [0.0, 1.0, 0.0]
    };
    let flat = along(start, -dot(start, normal), normal);
    let column = normalized(flat).unwrap_or(start);
    (column, cross(normal, column))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_right_handed() {
        for normal in [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8]] {
            let (column, row) = across(normal);
            let third = cross(column, row);
            assert!(norm(sub(third, normal)) < 1e-12, "{third:?}");
        }
        assert_eq!(across([0.0, 0.0, 1.0]), ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]));
    }
}
