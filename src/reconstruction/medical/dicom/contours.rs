//! Closed contours, and the area that several of one plane enclose.

use super::element::DataSet;
use super::structures::Left;
use super::tags;
use crate::reconstruction::vector::{Vec3, add, cross, scale, sub};

/// Farthest coordinate in millimetres.
const FARTHEST: f64 = 1e5;

/// A closed contour in the patient.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Contour {
    /// Its points; the first does not come again at the end.
    pub(super) points: Vec<Vec3>,
    /// Twice its area along its normal.
    pub(super) normal: Vec3,
}

/// Contours in the columns and rows of their plane.
pub(super) type Polygons = Vec<Vec<[f64; 2]>>;

impl Contour {
    /// The contour of an item, if it is one that encloses something.
    pub(super) fn of(item: &DataSet<'_>, left: &mut Left) -> Option<Self> {
        let kind = item.text(tags::CONTOUR_TYPE);
        if !matches!(kind.as_str(), "CLOSED_PLANAR" | "CLOSEDPLANAR_XOR") {
            left.open += 1;
            return None;
        }
        let numbers = item.numbers(tags::CONTOUR_DATA);
        if !numbers.len().is_multiple_of(3) || !numbers.iter().all(|v| v.abs() <= FARTHEST) {
            left.damaged += 1;
            return None;
        }
        let points = numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]);
        let mut points: Vec<Vec3> = points.collect();
        points.dedup();
        if points.len() > 1 && points.first() == points.last() {
            points.pop();
        }
        if points.len() < 3 {
            left.short += 1;
            return None;
        }
        let first = points[0];
        let corners = points.iter().map(|&p| sub(p, first));
        let next = corners.clone().skip(1);
        let normal = corners
            .zip(next)
            .fold([0.0; 3], |sum, (a, b)| add(sum, cross(a, b)));
        Some(Self { points, normal })
    }

    /// Mean of its points.
    pub(super) fn middle(&self) -> Vec3 {
        let sum = self.points.iter().fold([0.0; 3], |sum, &p| add(sum, p));
        scale(sum, 1.0 / self.points.len() as f64)
    }
}
