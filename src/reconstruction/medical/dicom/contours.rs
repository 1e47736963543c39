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

/// Most edges that the rows of one plane are held against.
const MOST_CROSSINGS: usize = 200_000_000;

/// What lies in an odd number of the contours: holes count as such whether they are contours of their own or hang on
/// the one around them by a bridge, and whatever way they run.
///
/// Between two heights of corners the width is linear, so that the middle tells it exactly. Of more corners than
/// rows can be looked at, rows are taken at even distances.
pub(super) fn area(polygons: &[Vec<[f64; 2]>]) -> f64 {
    let mut edges: Vec<_> = polygons
        .iter()
        .flat_map(|polygon| edges(polygon))
        .map(|(a, b)| if a[1] <= b[1] { (a, b) } else { (b, a) })
        .filter(|(a, b)| a[1] < b[1])
        .collect();
    edges.sort_by(|(a, _), (b, _)| a[1].total_cmp(&b[1]));
    let mut open: Vec<([f64; 2], [f64; 2])> = Vec::new();
    let mut next = edges.iter().peekable();
    let mut crossed = Vec::new();
    let mut area = 0.0;
    for [low, high] in rows(&edges) {
        let y = 0.5 * (low + high);
        open.extend(std::iter::from_fn(|| next.next_if(|(a, _)| a[1] <= y)).copied());
        open.retain(|(_, b)| b[1] > y);
        crossed.clear();
        let at = |(a, b): &([f64; 2], [f64; 2])| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
        crossed.extend(open.iter().map(at));
        crossed.sort_by(f64::total_cmp);
        let width: f64 = crossed.as_chunks::<2>().0.iter().map(|[a, b]| b - a).sum();
        area += width * (high - low);
    }
    area
}

/// Lower and upper ends of the rows into which edges are cut.
fn rows(edges: &[([f64; 2], [f64; 2])]) -> Vec<[f64; 2]> {
    let mut heights: Vec<f64> = edges.iter().flat_map(|(a, b)| [a[1], b[1]]).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    let most = (MOST_CROSSINGS / edges.len().max(1)).clamp(32, 2048);
    if heights.len() > most
        && let (Some(&low), Some(&high)) = (heights.first(), heights.last())
    {
        let step = (high - low) / most as f64;
        heights = (0..=most).map(|i| low + i as f64 * step).collect();
    }
    heights.windows(2).map(|pair| [pair[0], pair[1]]).collect()
}

fn edges(polygon: &[[f64; 2]]) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().zip(next).map(|(&a, &b)| (a, b))
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

    #[test]
    fn holes_on_bridges_are_taken_off_whatever_way_they_run() {
        let outer = [[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]];
        let hole = [[1.0, 1.0], [1.0, 3.0], [4.0, 3.0], [4.0, 1.0]];
        for turned in [false, true] {
            let mut ring = hole.to_vec();
            if turned {
                ring[1..].reverse();
            }
            let bridged = [&outer[..], &outer[..1], &ring, &ring[..1]].concat();
            assert!((area(&[bridged]) - 30.0).abs() < 1e-12, "{turned}");
        }
    }

    #[test]
    fn tens_of_thousands_of_contours_in_one_plane_have_an_area() {
        // Heights that no two contours share, so that there are more than rows.
        let square = |i: usize| {
            let (x, y) = (
                (i % 200) as f64 * 2.0,
                (i / 200) as f64 * 2.0 + i as f64 * 1e-5,
            );
            vec![[x, y], [x + 1.0, y], [x + 1.0, y + 1.0], [x, y + 1.0]]
        };
        let polygons: Vec<_> = (0..40_000).map(square).collect();
        let share = area(&polygons) / 40_000.0;
        assert!((share - 1.0).abs() < 0.01, "{share}");
        assert_eq!(area(&[]).to_bits(), 0.0_f64.to_bits());
    }
}
