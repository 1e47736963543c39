//! The area of contours.

use super::bands::Edge;

/// Most edges that the rows of one plane are held against.
const MOST_CROSSINGS: usize = 200_000_000;

/// What lies in an odd number of the contours: holes count as such whether they are contours of their own or hang on
/// the one around them by a bridge, and whatever way they run.
///
/// Between two heights of corners the width is linear, so that the middle tells it exactly. Of more corners than
/// rows can be looked at, rows are taken at even distances.
pub fn area(polygons: &[Vec<[f64; 2]>]) -> f64 {
    let mut edges: Vec<_> = polygons
        .iter()
        .flat_map(|polygon| edges(polygon))
        .map(|(a, b)| if a[1] <= b[1] { (a, b) } else { (b, a) })
        .filter(|(a, b)| a[1] < b[1])
        .collect();
    edges.sort_by(|(a, _), (b, _)| a[1].total_cmp(&b[1]));
    let mut open: Vec<Edge> = Vec::new();
    let mut next = edges.iter().peekable();
    let mut crossed = Vec::new();
    let mut area = 0.0;
    for [low, high] in rows(&edges) {
        let y = 0.5 * (low + high);
        open.extend(std::iter::from_fn(|| next.next_if(|(a, _)| a[1] <= y)).copied());
        open.retain(|(_, b)| b[1] > y);
        crossed.clear();
        let at = |(a, b): &Edge| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
        crossed.extend(open.iter().map(at));
        crossed.sort_by(f64::total_cmp);
        let width: f64 = crossed.as_chunks::<2>().0.iter().map(|[a, b]| b - a).sum();
        area += width * (high - low);
    }
    area
}

/// Lower and upper ends of the rows into which edges are cut.
fn rows(edges: &[Edge]) -> Vec<[f64; 2]> {
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

/// From each point to the next, and from the last one back.
pub(super) fn edges(polygon: &[[f64; 2]]) -> impl Iterator<Item = Edge> + Clone + '_ {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().zip(next).map(|(a, b)| (*a, *b))
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

    #[test]
    fn contours_one_beside_the_other_are_added_up() {
        let square = |i: usize| {
            let x = 4.0 * i as f64;
            vec![[x, 0.0], [x + 2.5, 0.0], [x + 2.5, 2.5], [x, 2.5]]
        };
        let polygons: Vec<_> = (0..20_000).map(square).collect();
        assert!((area(&polygons) / (20_000.0 * 6.25) - 1.0).abs() < 1e-9);
    }
}
