//! Sampling only where the surface can be: from coarse cells to fine ones, then along the surface.
//!
//! The levels are grids of stride S, S/2, ..., 1 over the same points, so that the last one is the
//! dense grid and every point is evaluated once. A cell goes on to the next level when its corners
//! differ in sign or when the field is so small in it that a thin part may lie between them. At the
//! last level only those points of it are evaluated between which the surface can be, as far as the
//! field is seen to bend. What is missed by that and touches what is found is followed from point
//! to point until the surface is closed; so a component is either found whole or, if no cell of any
//! level saw it, not at all.

use rayon::prelude::*;

use super::bits::Bits;
use super::grid::Lattice;
use super::samples::{Samples, Source};
use crate::reconstruction::error::Error;
use crate::reconstruction::vector::Vec3;

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

/// How often the stride of the first level is halved.
fn levels(lattice: &Lattice) -> u32 {
    let longest = lattice.grid.points.into_iter().fold(2, usize::max);
    ((longest - 1) / COARSE_CELLS).max(1).ilog2()
}

/// The blocks of the first level, which fill the grid.
pub(super) fn first_blocks(lattice: &Lattice) -> Vec<Block> {
    all_blocks(lattice, 1 << levels(lattice))
}

/// The lowest and the highest point of a block of the first level.
pub(super) fn corners_of_first(lattice: &Lattice, block: &Block) -> [Vec3; 2] {
    let stride = 1 << levels(lattice);
    [0, 2].map(|corner| {
        lattice.position(std::array::from_fn(|axis| {
            let number = 2 * usize::from(block.at[axis]) + corner;
            plane(lattice, axis, number, stride)
        }))
    })
}

/// Samples all points around the surface that the levels see in these blocks of the first level, and adds those that were
/// not known to `fresh`. What is asked in a block depends on the field in it alone.
pub(super) fn sample(
    samples: &mut Samples,
    mut blocks: Vec<Block>,
    source: &mut Source<'_>,
    mut fresh: Option<&mut Bits>,
) -> Result<(), Error> {
    let lattice = source.lattice;
    let levels = levels(&lattice);
    let mut wanted = Bits::new(lattice.len());
    for level in (0..=levels).rev() {
        let stride = 1 << level;
        wanted.clear();
        for block in &blocks {
            let points = block_points(&lattice, block.at, stride);
            let near = block.near_zeros(samples, &points);
            let points = points.into_iter().flatten().flatten().enumerate();
            for (_, at) in points.filter(|(i, _)| near >> i & 1 == 1) {
                wanted.insert(at);
            }
        }
        // The points of a level are about four times those of the level before.
        let end = PROGRESS / f64::from(1 << (2 * level));
        samples.require(&mut wanted, source, end / 4.0..end)?;
        if let Some(fresh) = &mut fresh {
            fresh.insert_all(&wanted);
        }
        if level > 0 {
            blocks = refine(samples, &lattice, &blocks, stride);
        }
    }
    Ok(())
}

/// A block of two cells of a level along each axis: what one cell of the level before becomes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Block {
    /// Its number along each axis.
    at: [u16; 3],
    /// How much the field is seen to bend around it, see [`bend`]; infinite where that does not tell where its zeros are,
    /// and before the last level, for which all points are asked.
    bend: f32,
}

/// In a set of the 3 x 3 x 3 points of a block, x running fastest: all of them.
const ALL_POINTS: u32 = (1 << 27) - 1;

/// In such a set: the corners of the first of its cells.
const FIRST_CELL: u32 = 0b011_011 << 9 | 0b011_011;

fn all_blocks(lattice: &Lattice, stride: usize) -> Vec<Block> {
    let [x, y, z] = lattice
        .grid
        .points
        .map(|points| (points - 1).div_ceil(2 * stride) as u16);
    (0..z)
        .flat_map(|k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k])))
        .map(|at| Block {
            at,
            bend: f32::INFINITY,
        })
        .collect()
}

impl Block {
    /// Which of its `points` are corners of a cell that may hold a zero, given the samples at its own corners.
    ///
    /// Between these the field is taken as linear along each axis, give or take half of its bend.
    fn near_zeros(&self, samples: &Samples, points: &[[[usize; 3]; 3]; 3]) -> u32 {
        if self.bend.is_infinite() {
            return ALL_POINTS;
        }
        let corner = |i: usize, j: usize, k: usize| {
            let value = samples.get(points[k][j][i]);
            value.expect("corners of a block are of the level before")
        };
        let row = |j, k| halved(corner(0, j, k), corner(2, j, k));
        let layer = |k| {
            let (first, last) = (row(0, k), row(2, k));
            let [a, b, c] = std::array::from_fn(|i| halved(first[i], last[i]));
            std::array::from_fn(|j| [a[j], b[j], c[j]])
        };
        let (first, last): ([[f64; 3]; 3], [[f64; 3]; 3]) = (layer(0), layer(2));
        let middle =
            std::array::from_fn(|j| std::array::from_fn(|i| 0.5 * (first[j][i] + last[j][i])));
        let expected = [first, middle, last];
        let doubt = 0.5 * f64::from(self.bend);
        (0..8).fold(0, |near, child| {
            let [i, j, k] = std::array::from_fn(|axis| child >> axis & 1);
            let corners = corners(&expected, [i, j, k]);
            if differ_in_sign(&corners) || corners.iter().any(|value| value.abs() < doubt) {
                near | FIRST_CELL << (i + 3 * j + 9 * k)
            } else {
                near
            }
        })
    }
}

/// Two values and their mean between them.
fn halved(first: f64, last: f64) -> [f64; 3] {
    [first, 0.5 * (first + last), last]
}

/// Coordinates of the plane `number` of a level; the last one is the border of the grid, whether
/// the stride divides its length or not.
fn plane(lattice: &Lattice, axis: usize, number: usize, stride: usize) -> usize {
    (number * stride + 1).min(lattice.grid.points[axis])
}

/// The 3 x 3 x 3 points of the block there, as `[z][y][x]`.
fn block_points(lattice: &Lattice, at: [u16; 3], stride: usize) -> [[[usize; 3]; 3]; 3] {
    let planes: [[usize; 3]; 3] = std::array::from_fn(|axis| {
        std::array::from_fn(|i| plane(lattice, axis, 2 * usize::from(at[axis]) + i, stride))
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
        let values = block_points(lattice, block.at, stride).map(|layer| {
            layer.map(|row| row.map(|at| samples.get(at).expect("blocks are sampled whole")))
        });
        let change = change_along_edges(&values);
        let next_is_last = stride == 2;
        let bend = if next_is_last {
            bend(&values)
        } else {
            f32::INFINITY
        };
        for child in 0..8 {
            let offset: [usize; 3] = std::array::from_fn(|axis| child >> axis & 1);
            let at: [u16; 3] = std::array::from_fn(|a| 2 * block.at[a] + offset[a] as u16);
            let low: [usize; 3] =
                std::array::from_fn(|a| plane(lattice, a, usize::from(at[a]), stride));
            if (0..3).any(|axis| low[axis] == lattice.grid.points[axis]) {
                continue; // the block is cut short by the border, and this cell is beyond it
            }
            let corners = corners(&values, offset);
            let at_border = (0..3).any(|a| {
                low[a] == 1
                    || plane(lattice, a, usize::from(at[a]) + 1, stride) == lattice.grid.points[a]
            });
            if may_hold_zero(&corners, change, at_border) {
                // Cells at the border have other lengths, and the frame beside them.
                let bend = if at_border { f32::INFINITY } else { bend };
                finer.push(Block { at, bend });
            }
        }
    }
    finer
}

/// The values at the corners of the cell of a block that is so far from its first one.
fn corners(values: &[[[f64; 3]; 3]; 3], offset: [usize; 3]) -> [f64; 8] {
    std::array::from_fn(|corner| {
        let [i, j, k] = std::array::from_fn(|axis| offset[axis] + (corner >> axis & 1));
        values[k][j][i]
    })
}

/// The largest second difference along each axis, in sum.
///
/// A field that bends evenly is at most an eighth of that off what the corners of a cell tell. A sheet that is thinner
/// than a cell bends the field where it is: of points along an axis across it, the one before the first beyond the sheet
/// is at most half of their second difference away.
fn bend(values: &[[[f64; 3]; 3]; 3]) -> f32 {
    let at = |i: usize, j: usize, k: usize| values[k][j][i];
    let mut largest = [0.0_f64; 3];
    for k in 0..3 {
        for j in 0..3 {
            let lines = [
                [at(0, j, k), at(1, j, k), at(2, j, k)],
                [at(j, 0, k), at(j, 1, k), at(j, 2, k)],
                [at(j, k, 0), at(j, k, 1), at(j, k, 2)],
            ];
            for (largest, [a, b, c]) in largest.iter_mut().zip(lines) {
                *largest = largest.max((a - 2.0 * b + c).abs());
            }
        }
    }
    largest.iter().sum::<f64>() as f32
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
    let mean = corners.iter().map(|value| value.abs()).sum::<f64>() / 8.0;
    // At the border the frame is outside, so that the field need not change its sign there.
    differ_in_sign(corners) || (at_border && corners[0] > 0.0) || mean < REACH * change
}

fn differ_in_sign(corners: &[f64; 8]) -> bool {
    let inside = corners.iter().filter(|value| **value > 0.0).count();
    (1..8).contains(&inside)
}

/// Completes the cells around every edge that the surface crosses, until no new crossing appears.
pub(super) fn follow(samples: &mut Samples, source: &mut Source<'_>) -> Result<(), Error> {
    let mut fresh = samples.known().clone();
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
