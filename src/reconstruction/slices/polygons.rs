//! From closed contours of a slice to points along them and the lattice around them.

use super::area::edges;
use super::bands::{Bands, Edge};
use super::lattice::Lattice;

/// Most pixels of a lattice.
const MAX_PIXELS: f64 = 1_048_576.0;

/// Most points along the contours of a slice, beside one for each of their own.
const MAX_POINTS: f64 = 200_000.0;

/// Largest column and row.
const MAX_PLACE: f64 = 1e7;

/// Side tests of a slice beyond which its points are all taken to separate inside from outside.
const MAX_TESTS: usize = 200_000_000;

/// How far beside a contour its sides are looked at, in columns and rows.
const BESIDE: f64 = 1e-4;

/// The contours of a slice.
pub(super) struct Contours<'a> {
    polygons: Vec<&'a [[f64; 2]]>,
    /// Contours of fewer than three points, or beyond all bounds.
    pub(super) ignored: usize,
}

impl<'a> Contours<'a> {
    /// Those that have an inside.
    pub(super) fn new(polygons: &'a [Vec<[f64; 2]>]) -> Self {
        let whole: Vec<&[[f64; 2]]> = polygons
            .iter()
            .map(Vec::as_slice)
            .filter(|polygon| {
                let bounded = |v: &f64| v.abs() <= MAX_PLACE;
                polygon.len() >= 3 && polygon.iter().flatten().all(bounded)
            })
            .collect();
        Self {
            ignored: polygons.len() - whole.len(),
            polygons: whole,
        }
    }

    /// Whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.polygons.is_empty()
    }

    /// Points at most `spacing` apart along the contours, where these have the inside on one side only: the bridges
    /// of keyholes do not. `pixel` is the size of a column and a row.
    pub(super) fn points(&self, spacing: f64, pixel: [f64; 2]) -> Vec<[f64; 2]> {
        let length = |way: [f64; 2]| (way[0] * pixel[0]).hypot(way[1] * pixel[1]);
        let way = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
        let total: f64 = self.edges().map(|(a, b)| length(way(a, b))).sum();
        let spacing = spacing.max(total / MAX_POINTS);
        let mut points = Vec::new();
        for (a, b) in self.edges() {
            let way = way(a, b);
            let count = (length(way) / spacing).ceil();
            let across = (way[0].hypot(way[1]) > 0.0).then(|| {
                let scale = BESIDE / way[0].hypot(way[1]);
                [-way[1] * scale, way[0] * scale]
            });
            let Some(across) = across else { continue };
            for i in 0..count as usize {
                let share = (i as f64 + 0.5) / count;
                points.push(([a[0] + share * way[0], a[1] + share * way[1]], across));
            }
        }
        let bands = Bands::new(self.edges());
        let tests = points.iter().map(|(p, _)| bands.at(p[1]).len());
        let test = tests.sum::<usize>() <= MAX_TESTS;
        let separates = |p: [f64; 2], across: [f64; 2]| {
            let beside = |side: f64| [p[0] + side * across[0], p[1] + side * across[1]];
            bands.contain(beside(1.0)) != bands.contain(beside(-1.0))
        };
        points
            .into_iter()
            .filter(|&(p, across)| !test || separates(p, across))
            .map(|(p, _)| p)
            .collect()
    }

    /// The pixels around the contours, with a margin of so many on either side.
    pub(super) fn lattice(&self, margin: usize, pixel: [f64; 2]) -> Lattice {
        let all = || self.polygons.iter().flat_map(|polygon| polygon.iter());
        let least = |axis: usize| all().map(|p| p[axis]).fold(f64::INFINITY, f64::min).floor();
        let most = |axis: usize| {
            all()
                .map(|p| p[axis])
                .fold(f64::NEG_INFINITY, f64::max)
                .ceil()
        };
        let extent = [0, 1].map(|axis| most(axis) - least(axis) + 1.0);
        let step = (extent[0] / MAX_PIXELS.sqrt())
            .max(extent[1] / MAX_PIXELS.sqrt())
            .ceil()
            .max(1.0);
        let first = [0, 1].map(|axis| least(axis) - step * margin as f64);
        let [width, height] = extent.map(|extent| (extent / step).ceil() as usize + 2 * margin);
        let inside = self.filled(first, step, [width, height]);
        Lattice::new(first, step, width, inside, pixel)
    }

    /// Which pixel centres lie in an odd number of contours: each edge turns all pixels to its right over.
    fn filled(&self, first: [f64; 2], step: f64, size: [usize; 2]) -> Vec<bool> {
        let [width, height] = size;
        let mut inside = vec![false; width * height];
        for (a, b) in self.edges() {
            let [a, b] = [a, b].map(|p| [0, 1].map(|axis| (p[axis] - first[axis]) / step));
            let rows =
                a[1].min(b[1]).ceil().max(0.0) as usize..a[1].max(b[1]).ceil().max(0.0) as usize;
            for y in rows.start..rows.end.min(height) {
                let x = a[0] + (y as f64 - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                let x = x.ceil().max(0.0) as usize;
                if x < width {
                    inside[y * width + x] ^= true;
                }
            }
        }
        for row in inside.chunks_mut(width.max(1)) {
            for x in 1..row.len() {
                row[x] ^= row[x - 1];
            }
        }
        inside
    }

    fn edges(&self) -> impl Iterator<Item = Edge> + Clone + '_ {
        self.polygons.iter().flat_map(|polygon| edges(polygon))
    }
}
