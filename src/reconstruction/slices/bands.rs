//! Edges of contours, sorted by rows: a point has to be held against those of its row only.

/// From one point of a contour to the next.
pub(super) type Edge = ([f64; 2], [f64; 2]);

/// Most bands.
const MOST: f64 = 1024.0;

/// Edges of contours, in bands of rows.
#[derive(Debug)]
pub(super) struct Bands {
    first: f64,
    height: f64,
    crossing: Vec<Vec<Edge>>,
}

impl Bands {
    /// Sorts edges. However long they are, three times their number is kept at most: bands are as high as the
    /// edges are on average.
    pub(super) fn new(edges: impl Iterator<Item = Edge> + Clone) -> Self {
        let (mut first, mut last, mut total, mut count) =
            (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0_u32);
        for (a, b) in edges.clone() {
            first = first.min(a[1]).min(b[1]);
            last = last.max(a[1]).max(b[1]);
            total += (a[1] - b[1]).abs();
            count += 1;
        }
        let extent = last - first;
        // Without an extent no edge crosses a row.
        if count == 0 || extent <= 0.0 {
            return Self {
                first: 0.0,
                height: 1.0,
                crossing: Vec::new(),
            };
        }
        let height = (total / f64::from(count)).max(extent / MOST);
        let mut crossing = vec![Vec::new(); (extent / height) as usize + 1];
        for (a, b) in edges {
            let [from, to] = [a[1].min(b[1]), a[1].max(b[1])];
            if from < to {
                let [from, to] = [from, to].map(|y| ((y - first) / height) as usize);
                for band in &mut crossing[from..=to] {
                    band.push((a, b));
                }
            }
        }
        Self {
            first,
            height,
            crossing,
        }
    }

    /// The edges that may cross a row.
    pub(super) fn at(&self, row: f64) -> &[Edge] {
        let band = ((row - self.first) / self.height).floor();
        let band = (band >= 0.0).then(|| self.crossing.get(band as usize));
        band.flatten().map_or(&[], Vec::as_slice)
    }

    /// Whether a point lies in an odd number of the contours.
    pub(super) fn contain(&self, p: [f64; 2]) -> bool {
        let edges = self.at(p[1]).iter();
        let crossed = edges.filter(|(a, b)| {
            (a[1] > p[1]) != (b[1] > p[1])
                && p[0] < a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        });
        crossed.count() % 2 == 1
    }
}
