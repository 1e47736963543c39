//! Marching cubes \[LC87\] over sampled points: vertices on crossed edges, triangles from the table.
//!
//! Deviations from \[LC87\]: the table of [`super::table`], which leaves no holes; and vertices keep
//! a small distance from the grid points, so that no triangle has equal corners.

use rayon::prelude::*;

use super::grid::Lattice;
use super::samples::Samples;
use super::table;
use crate::reconstruction::error::Error;
use crate::reconstruction::vector::Vec3;

/// Least distance of a vertex from the ends of its edge, as a share of the edge: large enough to
/// stay apart in single precision on a grid of 1024 points, small beside the error of linear
/// interpolation.
const MARGIN: f64 = 1e-4;

/// The triangulated level set before anything is moved.
pub(super) struct Contour {
    pub(super) vertices: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// Vertices between a border point and the frame, increasing: the field has no zero there.
    pub(super) caps: Vec<u32>,
}

/// The crossed edges of a part of the lattice.
#[derive(Default)]
struct Crossings {
    /// For each known point, bit a: the edge upwards along axis a is crossed.
    axes: Vec<u8>,
    vertices: Vec<Vec3>,
    /// Places in `vertices` of those at the frame.
    caps: Vec<u32>,
}

/// Triangulates the zero set of the samples, and tells which vertex is on which edge.
///
/// Vertices are in the order of their edges (lower point, then axis), triangles in that of their
/// cells, whatever else is known of the field.
pub(super) fn contour(
    samples: &Samples,
    lattice: &Lattice,
    max_triangles: usize,
) -> Result<(Contour, Numbering), Error> {
    let parts = samples.known().parts();
    let crossings: Vec<Crossings> = parts
        .par_iter()
        .map(|part| {
            let mut crossings = Crossings::default();
            for (index, value) in samples.part(part.clone()) {
                crossings.add(samples, lattice, index, value);
            }
            crossings
        })
        .collect();
    let too_large = || Error::MeshTooLarge {
        limit: max_triangles,
    };
    // A closed mesh has at least 4/3 triangles a vertex, so this spares making them.
    let count = crossings.iter().map(|c| c.vertices.len()).sum::<usize>();
    if count > max_triangles {
        return Err(too_large());
    }
    let mut numbering = Numbering::with_capacity(samples.len());
    let mut vertices = Vec::with_capacity(count);
    let mut caps = Vec::new();
    for part in crossings {
        numbering.extend(part.axes);
        let first = vertices.len() as u32;
        caps.extend(part.caps.into_iter().map(|place| first + place));
        vertices.extend(part.vertices);
    }
    let triangles: Vec<Vec<[u32; 3]>> = parts
        .into_par_iter()
        .map(|part| {
            samples
                .part(part)
                .filter_map(|(index, value)| Cell::at(samples, lattice, index, value))
                .flat_map(|cell| cell.triangles(samples, lattice, &numbering))
                .collect()
        })
        .collect();
    let count = triangles.iter().map(Vec::len).sum::<usize>();
    if count > max_triangles {
        return Err(too_large());
    }
    // Each part is freed once it is copied.
    let mut all = Vec::with_capacity(count);
    for part in triangles {
        all.extend(part);
    }
    let contour = Contour {
        vertices,
        triangles: all,
        caps,
    };
    Ok((contour, numbering))
}

impl Crossings {
    fn add(&mut self, samples: &Samples, lattice: &Lattice, index: usize, value: f64) {
        let mut axes = 0;
        for axis in 0..3 {
            let Some(other) = samples.get(index + lattice.strides[axis]) else {
                continue;
            };
            if (value > 0.0) == (other > 0.0) {
                continue;
            }
            axes |= 1 << axis;
            let at = lattice.coordinates(index);
            if lattice.is_frame(axis, at[axis]) || lattice.is_frame(axis, at[axis] + 1) {
                self.caps.push(self.vertices.len() as u32);
            }
            let vertex = vertex_at(lattice, (at, axis), [value, other]);
            self.vertices.push(vertex);
        }
        self.axes.push(axes);
    }
}

/// The vertex on the edge from a point upwards along an axis, given the field at its ends.
pub(super) fn vertex_at(
    lattice: &Lattice,
    (at, axis): ([usize; 3], usize),
    [value, other]: [f64; 2],
) -> Vec3 {
    let share = (value / (value - other)).clamp(MARGIN, 1.0 - MARGIN);
    let mut vertex = lattice.position(at);
    vertex[axis] += share * lattice.grid.spacing;
    vertex
}

/// From an edge to its vertex.
pub(super) struct Numbering {
    axes: Vec<u8>,
    /// First vertex of each known point.
    first: Vec<u32>,
    vertices: u32,
}

impl Numbering {
    /// No vertices yet, and room for so many known points.
    fn with_capacity(points: usize) -> Self {
        Self {
            axes: Vec::with_capacity(points),
            first: Vec::with_capacity(points),
            vertices: 0,
        }
    }

    fn extend(&mut self, axes: Vec<u8>) {
        for axes in &axes {
            self.first.push(self.vertices);
            self.vertices += axes.count_ones();
        }
        self.axes.extend(axes);
    }

    /// Number of the vertex on the edge from the known point of this rank upwards along `axis`, which the surface crosses.
    pub(super) fn vertex(&self, rank: usize, axis: usize) -> u32 {
        self.first[rank] + (self.axes[rank] & ((1 << axis) - 1)).count_ones()
    }
}

/// A cell that the surface crosses: the index of its lowest corner, and its sign pattern.
struct Cell {
    index: usize,
    case: u8,
}

impl Cell {
    fn at(samples: &Samples, lattice: &Lattice, index: usize, value: f64) -> Option<Self> {
        let mut case = u8::from(value > 0.0);
        for corner in 1..8 {
            let offset = [corner & 1, corner >> 1 & 1, corner >> 2];
            let value = samples.get(index + lattice.index(offset))?;
            case |= u8::from(value > 0.0) << corner;
        }
        (case != 0 && case != u8::MAX).then_some(Self { index, case })
    }

    fn triangles(
        self,
        samples: &Samples,
        lattice: &Lattice,
        numbering: &Numbering,
    ) -> impl Iterator<Item = [u32; 3]> {
        table::triangles(self.case).iter().map(move |triangle| {
            triangle.map(|number| {
                let (axis, corner) = table::edge(usize::from(number));
                let rank = samples.rank(self.index + lattice.index(corner));
                numbering.vertex(rank.expect("the corners of a cell are known"), axis)
            })
        })
    }
}
