//! Sampling only where the surface can be: from coarse cells to fine ones, then along the surface.
//!
//! The levels are grids of stride S, S/2, ..., 1 over the same points, so that the last one is the
//! dense grid and every point is evaluated once. A cell goes on to the next level when its corners
//! differ in sign or when the field is so small in it that a thin part may lie between them. What
//! is missed by that and touches what is found is followed from point to point until the surface
//! is closed; so a component is either found whole or, if no cell of any level saw it, not at all.

use rayon::prelude::*;

use super::bits::Bits;
use super::grid::Lattice;
use super::samples::{Samples, Source};
use crate::reconstruction::error::Error;

/// Least number of coarse cells along the longest edge. The stride is a power of two, so there are
/// up to twice as many; at this number the coarse grid costs less than a surface at 256³.
const COARSE_CELLS: usize = 32;

/// How far, in edges of its cell, a zero may lie from the corners of a cell on the average.
///
/// With |f(x) - f(c)| ≤ L|x - c|, a zero x in a cell of edge h gives mean |f(c)| ≤ L mean |x - c|
/// over its corners c, which is at most (3 + 3√2 + √3)/8 h = 1.122 h, at a corner. The rest is
/// safety, for L is only seen at the points of the grid.
const REACH: f64 = 1.2;

/// Share of the whole progress that sampling takes.
pub(super) const PROGRESS: f64 = 0.7;

/// Samples all points around the surface that the levels see.
pub(super) fn sample(source: &mut Source<'_>) -> Result<Samples, Error> {
    let lattice = source.lattice;
    let longest = lattice.grid.points.into_iter().fold(2, usize::max);
    let levels = ((longest - 1) / COARSE_CELLS).max(1).ilog2();
    let mut samples = Samples::none(&lattice);
    let mut blocks = all_blocks(&lattice, 1 << levels);
    let mut wanted = Bits::new(lattice.len());
    for level in (0..=levels).rev() {
        let stride = 1 << level;
        wanted.clear();
        for block in &blocks {
            for at in block_points(&lattice, *block, stride)
                .into_iter()
                .flatten()
                .flatten()
            {
                wanted.insert(at);
            }
        }
        // The points of a level are about four times those of the level before.
        let end = PROGRESS / f64::from(1 << (2 * level));
        samples.require(&mut wanted, source, end / 4.0..end)?;
        if level > 0 {
            blocks = refine(&samples, &lattice, &blocks, stride);
        }
    }
    wanted.clone_from(samples.known());
    follow(&mut samples, wanted, source)?;
    Ok(samples)
}

/// A block of two cells of a level along each axis: what one cell of the level before becomes.
type Block = [u16; 3];

fn all_blocks(lattice: &Lattice, stride: usize) -> Vec<Block> {
    let [x, y, z] = lattice
        .grid
        .points
        .map(|points| (points - 1).div_ceil(2 * stride) as u16);
    (0..z)
        .flat_map(|k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k])))
        .collect()
}

/// Coordinates of the plane `number` of a level; the last one is the border of the grid, whether
/// the stride divides its length or not.
fn plane(lattice: &Lattice, axis: usize, number: usize, stride: usize) -> usize {
    (number * stride + 1).min(lattice.grid.points[axis])
}

/// The 3 x 3 x 3 points of a block, as `[z][y][x]`.
fn block_points(lattice: &Lattice, block: Block, stride: usize) -> [[[usize; 3]; 3]; 3] {
    let planes: [[usize; 3]; 3] = std::array::from_fn(|axis| {
        std::array::from_fn(|i| plane(lattice, axis, 2 * usize::from(block[axis]) + i, stride))
    });
    std::array::from_fn(|k| {
        std::array::from_fn(|j| {
            std::array::from_fn(|i| lattice.index([planes[0][i], planes[1][j], planes[2][k]]))
        })
    })
}

/// The cells of the blocks that may hold a zero, as blocks of the next level.
fn refine(samples: &Samples, lattice: &Lattice, blocks: &[Block], stride: usize) -> Vec<Block> {
    let mut finer = Vec::new();
    for block in blocks {
        let values = block_points(lattice, *block, stride).map(|layer| {
            layer.map(|row| row.map(|at| samples.get(at).expect("blocks are sampled whole")))
        });
        let change = change_along_edges(&values);
        for child in 0..8 {
            let offset: [usize; 3] = std::array::from_fn(|axis| child >> axis & 1);
            let cell: Block = std::array::from_fn(|axis| 2 * block[axis] + offset[axis] as u16);
            let low: [usize; 3] =
                std::array::from_fn(|a| plane(lattice, a, usize::from(cell[a]), stride));
            if (0..3).any(|axis| low[axis] == lattice.grid.points[axis]) {
                continue; // the block is cut short by the border, and this cell is beyond it
            }
            let corners: [f64; 8] = std::array::from_fn(|corner| {
                let [i, j, k] = std::array::from_fn(|axis| offset[axis] + (corner >> axis & 1));
                values[k][j][i]
            });
            let at_border = (0..3).any(|a| {
                low[a] == 1
                    || plane(lattice, a, usize::from(cell[a]) + 1, stride) == lattice.grid.points[a]
            });
            if may_hold_zero(&corners, change, at_border) {
                finer.push(cell);
            }
        }
    }
    finer
}

/// How much the field is seen to change along an edge in the direction of its gradient.
///
/// It is taken over the block, for a thin part in the middle of one cell leaves no difference
/// between the corners of that cell, only between those of its neighbour.
fn change_along_edges(values: &[[[f64; 3]; 3]; 3]) -> f64 {
    let at = |i: usize, j: usize, k: usize| values[k][j][i];
    let mut largest = [0.0_f64; 3];
    for k in 0..3 {
        for j in 0..3 {
            for i in 0..2 {
                let along = [
                    at(i + 1, j, k) - at(i, j, k),
                    at(j, i + 1, k) - at(j, i, k),
                    at(j, k, i + 1) - at(j, k, i),
                ];
                for (largest, change) in largest.iter_mut().zip(along) {
                    *largest = largest.max(change.abs());
                }
            }
        }
    }
    crate::reconstruction::vector::norm(largest)
}

fn may_hold_zero(corners: &[f64; 8], change: f64, at_border: bool) -> bool {
    let inside = corners.iter().filter(|value| **value > 0.0).count();
    let mean = corners.iter().map(|value| value.abs()).sum::<f64>() / 8.0;
    // At the border the frame is outside, so that the field need not change its sign there.
    (1..8).contains(&inside) || (at_border && inside > 0) || mean < REACH * change
}

/// Completes the cells around every edge at a `fresh` point that the surface crosses, until no new
/// crossing appears.
fn follow(samples: &mut Samples, mut fresh: Bits, source: &mut Source<'_>) -> Result<(), Error> {
    let lattice = source.lattice;
    let mut wanted = Bits::new(lattice.len());
    loop {
        wanted.clear();
        for at in unknown_at_crossings(samples, &lattice, &fresh) {
            wanted.insert(at);
        }
        samples.require(&mut wanted, source, PROGRESS..PROGRESS)?;
        if wanted.count() == 0 {
            return Ok(());
        }
        std::mem::swap(&mut fresh, &mut wanted);
    }
}

/// The points, some of them several times, that are not known around the edges at `fresh` ones that the surface crosses.
fn unknown_at_crossings(samples: &Samples, lattice: &Lattice, fresh: &Bits) -> Vec<usize> {
    let parts = fresh.parts().into_par_iter();
    let unknown = parts.flat_map_iter(|part| {
        let mut unknown = Vec::new();
        for index in fresh.members_of(part) {
            for (axis, lower) in crossed_edges(samples, lattice, index) {
                let around = around_edge(lattice, lower, axis);
                unknown.extend(around.filter(|&at| !samples.known().contains(at)));
            }
        }
        unknown
    });
    unknown.collect()
}

/// The axes and lower ends of the edges at the point `index` that the surface crosses.
fn crossed_edges(
    samples: &Samples,
    lattice: &Lattice,
    index: usize,
) -> impl Iterator<Item = (usize, usize)> {
    let inside = samples.get(index).is_some_and(|value| value > 0.0);
    let at = lattice.coordinates(index);
    let edges = (0..3).flat_map(|axis| [(axis, false), (axis, true)]);
    edges.filter_map(move |(axis, up)| {
        let (place, stride) = (at[axis], lattice.strides[axis]);
        if place == if up { lattice.size[axis] - 1 } else { 0 } {
            return None;
        }
        let (other, other_place, lower) = if up {
            (index + stride, place + 1, index)
        } else {
            (index - stride, place - 1, index - stride)
        };
        let crossed = match samples.get(other) {
            Some(value) => (value > 0.0) != inside,
            None => inside && lattice.is_frame(axis, other_place),
        };
        crossed.then_some((axis, lower))
    })
}

/// The corners of the four cells around the edge that runs from `lower` along `axis`.
pub(super) fn around_edge(
    lattice: &Lattice,
    lower: usize,
    axis: usize,
) -> impl Iterator<Item = usize> {
    let along = lattice.strides[axis];
    let [u, v] = [1, 2].map(|step| lattice.strides[(axis + step) % 3]);
    // An edge with an end inside the grid has neighbours on all sides.
    let first = lower - u - v;
    (0..9).flat_map(move |k| {
        let at = first + k / 3 * u + k % 3 * v;
        [at, at + along]
    })
}
