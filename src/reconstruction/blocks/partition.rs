//! Cutting a cloud into blocks of about as many points each.

use super::block::Block;
use crate::reconstruction::sampling::Frame;
use crate::reconstruction::sampling::neighbours::median;
use crate::reconstruction::vector::{Bounds, Vec3};

/// Width of the targets' band, in local spacings.
const BAND: f64 = 5.0;

/// A core reaches so many bands beyond its points, as far as its cell goes.
const CORE_MARGIN: f64 = 0.5;

/// The reach goes beyond the core by this share of the longest edge of the core ...
const OVERLAP: f64 = 0.06;

/// ... and by so many local spacings at least.
const LEAST_OVERLAP: f64 = 3.0;

/// Half the longest edge of a reach in the frame of its network.
const HALF_EXTENT: f64 = 2.0;

/// `count` blocks of about as many of `points` each, whose local spacings are given: the cells of a k-d tree, cut along
/// the longest edge of the box around their points. Fewer where some are a single place.
pub(super) fn partition(points: &[Vec3], spacings: &[f64], count: usize) -> Vec<Block> {
    let everywhere = Bounds {
        min: [f64::NEG_INFINITY; 3],
        max: [f64::INFINITY; 3],
    };
    let mut blocks = Vec::new();
    let all: Vec<u32> = (0..points.len() as u32).collect();
    let mut open = vec![(all, everywhere, count)];
    while let Some((mut indices, cell, parts)) = open.pop() {
        let bounds = Bounds::of(indices.iter().map(|&i| &points[i as usize]));
        let Some(bounds) = bounds else { continue };
        if parts == 1 {
            let mut theirs: Vec<f64> = indices.iter().map(|&i| spacings[i as usize]).collect();
            blocks.extend(block(&bounds, &cell, median(&mut theirs)));
            continue;
        }
        let extent = bounds.extent();
        let axis = (0..3).fold(0, |a, b| if extent[b] > extent[a] { b } else { a });
        let low_parts = parts / 2;
        let middle = indices.len() * low_parts / parts;
        let by_axis = |i: &u32| points[*i as usize][axis];
        let (_, at, _) = indices.select_nth_unstable_by(middle, |a, b| {
            by_axis(a).total_cmp(&by_axis(b)).then(a.cmp(b))
        });
        let cut = by_axis(at);
        let high = indices.split_off(middle);
        let (mut below, mut above) = (cell, cell);
        below.max[axis] = cut;
        above.min[axis] = cut;
        open.extend([
            (high, above, parts - low_parts),
            (indices, below, low_parts),
        ]);
    }
    blocks
}

impl Block {
    /// Median local spacing of its points.
    pub(super) fn spacing(&self) -> f64 {
        self.band / BAND
    }
}

/// The block of a cell whose points have this box and spacing; none where that is a single place.
fn block(points: &Bounds, cell: &Bounds, spacing: f64) -> Option<Block> {
    let band = BAND * spacing;
    let grown = points.padded(CORE_MARGIN * band);
    let core = Bounds {
        min: std::array::from_fn(|a| grown.min[a].max(cell.min[a])),
        max: std::array::from_fn(|a| grown.max[a].min(cell.max[a])),
    };
    let overlap = (OVERLAP * core.longest_edge()).max(LEAST_OVERLAP * spacing);
    let reach = core.padded(overlap);
    Some(Block {
        core,
        reach,
        band,
        frame: Frame::normalized(&reach, HALF_EXTENT)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_cover_the_points_and_do_not_overlap() {
        let points: Vec<Vec3> = (0..3000)
            .map(|i| {
                let t = f64::from(i) * 0.01;
                [t.cos() * 3.0, t.sin(), 0.1 * t]
            })
            .collect();
        let spacings = vec![0.02; points.len()];
        let blocks = partition(&points, &spacings, 15);
        assert_eq!(blocks.len(), 15);
        for p in &points {
            let cores: Vec<&Block> = blocks.iter().filter(|b| b.core.contains(*p)).collect();
            assert!(!cores.is_empty());
            // On a cut, both sides have it.
            for core in cores.iter().skip(1) {
                assert!(!core.core.padded(-1e-12).contains(*p));
            }
        }
        for block in &blocks {
            assert!((0..3).all(|a| block.reach.min[a] < block.core.min[a]));
        }
    }
}
