//! Points on a lattice along the axes: voxels of a label map, or the faces between them.

use rayon::prelude::*;

use crate::reconstruction::vector::{Bounds, Vec3};

/// How far a coordinate may be from its place on the lattice, in steps: rounding to four digits.
const OFF: f64 = 0.02;

/// Places of the lattice over the number of points to the power of 1.5, above which it says nothing: a shell of
/// voxels has about one.
const SPARSEST: f64 = 8.0;

/// Points on a regular lattice.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    /// The place of the cell 0, 0, 0.
    pub(super) origin: Vec3,
    /// Distance between neighbouring places along each axis.
    pub(super) steps: Vec3,
    /// Places along each axis.
    pub(super) size: [usize; 3],
    /// The cell of each point.
    pub(super) cells: Vec<[usize; 3]>,
}

impl Lattice {
    /// The lattice on which all of `points` lie; none where there is no such.
    pub(super) fn of(points: &[Vec3]) -> Option<Self> {
        let bounds = Bounds::of(points)?;
        let mut steps = [0.0; 3];
        let mut size = [0; 3];
        for axis in 0..3 {
            steps[axis] = step(points.iter().map(|p| p[axis]).collect())?;
            size[axis] = (bounds.extent()[axis] / steps[axis]).round() as usize + 1;
        }
        let places = size.iter().map(|n| *n as f64).product::<f64>();
        if places > SPARSEST * (points.len() as f64).powf(1.5) {
            return None;
        }
        let origin = bounds.min;
        let cell = |p: &Vec3| -> [usize; 3] {
            std::array::from_fn(|axis| ((p[axis] - origin[axis]) / steps[axis]).round() as usize)
        };
        Some(Self {
            origin,
            steps,
            size,
            cells: points.iter().map(cell).collect(),
        })
    }

    /// The position of a place given in steps from the origin.
    pub(super) fn position(&self, place: Vec3) -> Vec3 {
        std::array::from_fn(|axis| self.origin[axis] + place[axis] * self.steps[axis])
    }

    /// Where the points lie on the middles of the faces of cells of twice the steps: the parity of the places of
    /// their centres. Each face is an odd number of steps away from them along one axis.
    pub(super) fn parity_of_faces(&self) -> Option<[usize; 3]> {
        let mut counts = [0_usize; 8];
        for cell in &self.cells {
            counts[(cell[0] & 1) | (cell[1] & 1) << 1 | (cell[2] & 1) << 2] += 1;
        }
        let centres = (0..8_usize).find(|&centres| {
            let kinds = [1, 2, 4].map(|axis| counts[centres ^ axis]);
            kinds.iter().sum::<usize>() == self.cells.len() && !kinds.contains(&0)
        })?;
        Some([centres & 1, centres >> 1 & 1, centres >> 2 & 1])
    }
}

/// The step of which all differences between the coordinates are multiples; none where there is no such.
fn step(mut coordinates: Vec<f64>) -> Option<f64> {
    coordinates.par_sort_unstable_by(f64::total_cmp);
    let extent = coordinates.last()? - coordinates.first()?;
    let rounding = OFF * extent / coordinates.len() as f64;
    let gaps: Vec<f64> = coordinates
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .filter(|gap| *gap > rounding)
        .collect();
    // The mean of the smallest ones, which rounding changes by a little.
    let least = gaps.iter().copied().fold(f64::INFINITY, f64::min);
    let smallest = gaps.iter().filter(|gap| **gap < 1.5 * least);
    let (sum, count) = smallest.fold((0.0, 0.0), |(sum, count), gap| (sum + gap, count + 1.0));
    let step = sum / count;
    let first = *coordinates.first()?;
    let on_lattice = coordinates.iter().all(|c| {
        let place = (c - first) / step;
        (place - place.round()).abs() <= OFF * place.max(1.0).sqrt()
    });
    (count > 0.0 && on_lattice).then_some(step)
}
