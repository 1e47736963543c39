//! The pixels that a label fills, kept to hold a mesh against them: the ends of their rows, which grow with the
//! surface of a label and not with its volume.

use super::lattice::Lattice;
use super::{Content, Geometry, Inside};
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::vector::along;

/// Pixels in a row, from the first to the one behind the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Run {
    slice: u32,
    row: i32,
    columns: [i32; 2],
}

/// The pixels that a label fills by half at least.
#[derive(Debug, Clone, PartialEq)]
pub struct Occupancy {
    geometry: Geometry,
    runs: Vec<Run>,
}

/// How well a mesh and the pixels of a label agree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overlap {
    /// Pixels of the label.
    pub label: u64,
    /// Pixels whose centres are inside the mesh.
    pub mesh: u64,
    /// Pixels of both.
    pub both: u64,
}

impl Overlap {
    /// Dice: 1 where they are the same pixels; none where there are no pixels at all.
    pub fn dice(self) -> Option<f64> {
        let all = self.label + self.mesh;
        (all > 0).then(|| 2.0 * self.both as f64 / all as f64)
    }
}

impl Occupancy {
    /// Nothing yet.
    pub(super) fn new(geometry: &Geometry) -> Self {
        Self {
            geometry: geometry.clone(),
            runs: Vec::new(),
        }
    }

    /// Notes what a slice shows.
    pub(super) fn add(&mut self, slice: usize, content: &Content, lattice: &Lattice) {
        match content {
            Content::Mask(mask) => {
                let least = if mask.fractional { 128 } else { 1 };
                let filled = |v: &u8| *v >= least;
                let first = [mask.left as i32, mask.top as i32];
                for (y, row) in (0..).zip(mask.filled.chunks(mask.width.max(1))) {
                    self.add_row(slice, [first[0], first[1] + y], row.iter().map(filled));
                }
            }
            // Contours that are so large that their lattice is coarser are not kept.
            Content::Polygons(_) if lattice.step > 1.0 => {}
            Content::Polygons(_) => {
                let first = lattice.first.map(|v| v as i32);
                for (y, row) in (0..).zip(lattice.inside.chunks(lattice.width.max(1))) {
                    self.add_row(slice, [first[0], first[1] + y], row.iter().copied());
                }
            }
        }
    }

    fn add_row(&mut self, slice: usize, first: [i32; 2], filled: impl Iterator<Item = bool>) {
        let mut start = None;
        for (x, filled) in (first[0]..).zip(filled.chain([false])) {
            match (start, filled) {
                (None, true) => start = Some(x),
                (Some(from), false) => {
                    self.runs.push(Run {
                        slice: slice as u32,
                        row: first[1],
                        columns: [from, x],
                    });
                    start = None;
                }
                _ => {}
            }
        }
    }

    /// Counts pixels in the slices that show the label and in their neighbourhood; those of the mesh elsewhere in
    /// the plane of a slice count as well.
    pub fn overlap(&self, mesh: &TriangleMesh) -> Overlap {
        let least = |pick: fn(&Run) -> i32| self.runs.iter().map(pick).min().unwrap_or(0);
        let most = |pick: fn(&Run) -> i32| self.runs.iter().map(pick).max().unwrap_or(0);
        // A fitted surface leaves the pixels of its label by a few at most.
        let margin = 16;
        let first = [
            least(|run| run.columns[0]) - margin,
            least(|run| run.row) - margin,
        ];
        let size = [
            (most(|run| run.columns[1]) + margin - first[0]) as usize,
            (most(|run| run.row) + 1 + margin - first[1]) as usize,
        ];
        let moved = |&origin: &_| {
            let in_row = along(origin, f64::from(first[0]), self.geometry.column);
            along(in_row, f64::from(first[1]), self.geometry.row)
        };
        let geometry = Geometry {
            origins: self.geometry.origins.iter().map(moved).collect(),
            ..self.geometry.clone()
        };
        let inside = Inside::new(mesh, &geometry, size);
        let mut overlap = Overlap {
            label: 0,
            mesh: 0,
            both: 0,
        };
        let mut runs = self.runs.as_slice();
        for slice in 0..geometry.origins.len() {
            let (these, others) =
                runs.split_at(runs.partition_point(|run| run.slice as usize <= slice));
            runs = others;
            let filled = inside.slice(slice);
            overlap.mesh += filled.iter().filter(|&&inside| inside).count() as u64;
            for run in these {
                let start = (run.row - first[1]) as usize * size[0];
                let [from, to] = run.columns.map(|x| start + (x - first[0]) as usize);
                overlap.label += (to - from) as u64;
                overlap.both += filled[from..to].iter().filter(|&&inside| inside).count() as u64;
            }
        }
        overlap
    }
}
