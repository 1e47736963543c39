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

/// What lies in an odd number of the contours, which do not cross: each is a hole of those around
/// it if their number is odd.
pub(super) fn area(polygons: &[Vec<[f64; 2]>]) -> f64 {
    let one = |(i, polygon): (usize, &Vec<[f64; 2]>)| {
        let others = polygons.iter().enumerate().filter(|&(j, _)| j != i);
        let around = others
            .filter(|(_, other)| inside(polygon[0], other))
            .count();
        let sign = if around.is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * signed_area(polygon).abs()
    };
    polygons.iter().enumerate().map(one).sum()
}

fn edges(polygon: &[[f64; 2]]) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().zip(next).map(|(&a, &b)| (a, b))
}

fn signed_area(polygon: &[[f64; 2]]) -> f64 {
    edges(polygon)
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
        .sum::<f64>()
        / 2.0
}

fn inside(p: [f64; 2], polygon: &[[f64; 2]]) -> bool {
    let crosses = |&(a, b): &([f64; 2], [f64; 2])| {
        (a[1] > p[1]) != (b[1] > p[1])
            && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
    };
    edges(polygon).filter(crosses).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_taken_off_and_islands_in_them_added() {
        let square = |r: f64| vec![[-r, -r], [r, -r], [r, r], [-r, r]];
        let polygons = vec![square(1.0), square(3.0), square(2.0)];
        assert!((area(&polygons) - (36.0 - 16.0 + 4.0)).abs() < 1e-12);
    }
}
