//! An extraction that begins before all of a field is known.
//!
//! What is asked of the field in a block of the first level depends on the field there alone. So such a part of the grid
//! can be sampled, and its vertices can be moved onto the zero set, as soon as the field is known in and around it.
//! Whichever parts come first, and whether any do, the mesh is the same.

use super::bits::Bits;
use super::grid::{Grid, Lattice};
use super::marching_cubes::{Contour, contour, vertex_at};
use super::projection::{LONGEST_STEP, Moved, Mover};
use super::samples::{BATCH, Samples, Seen, Source};
use super::sparse::{self, Block, PROGRESS};
use super::{Extraction, Field, Request, dense, refinement};
use crate::reconstruction::error::Error;
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::settings::Evaluation;
use crate::reconstruction::vector::{Bounds, Vec3};

/// How far an extraction has come.
pub struct Begun {
    lattice: Lattice,
    parts: Vec<Part>,
    samples: Samples,
    seen: Seen,
    moved: Vec<Moved<Edge>>,
}

/// A part of the grid: a block of the first level.
struct Part {
    block: Block,
    is_sampled: bool,
}

/// An edge of the lattice: three times its lower point, and its axis.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Edge(usize);

impl Edge {
    fn new(lower: usize, axis: usize) -> Self {
        Self(3 * lower + axis)
    }

    fn lower(self) -> usize {
        self.0 / 3
    }

    fn axis(self) -> usize {
        self.0 % 3
    }
}

impl Begun {
    /// Nothing is asked yet.
    ///
    /// # Errors
    /// [`Error::NoSurface`] where the box is none for a grid.
    pub fn new(request: &Request<'_>) -> Result<Self, Error> {
        let lattice = Lattice::new(Grid::new(&request.bounds, request.resolution)?);
        let blocks = match request.evaluation {
            Evaluation::Sparse => sparse::first_blocks(&lattice),
            Evaluation::Dense => Vec::new(),
        };
        let parts = blocks.into_iter().map(|block| Part {
            block,
            is_sampled: false,
        });
        Ok(Self {
            lattice,
            parts: parts.collect(),
            samples: Samples::none(&lattice),
            seen: Seen::default(),
            moved: Vec::new(),
        })
    }

    /// Where the field is asked for each part.
    pub fn parts(&self, request: &Request<'_>) -> Vec<Bounds> {
        // A vertex may be on an edge that is beside the part and has an end in it, and a step takes it up to half of an
        // edge further.
        let margin = 1.0 + LONGEST_STEP * request.projection_steps as f64;
        let parts = self.parts.iter().map(|part| {
            let [min, max] = sparse::corners_of_first(&self.lattice, &part.block);
            Bounds { min, max }.padded(margin * self.lattice.grid.spacing)
        });
        parts.collect()
    }

    /// Whether a part was sampled.
    pub fn is_sampled(&self, part: usize) -> bool {
        self.parts[part].is_sampled
    }

    /// Samples these parts, and moves the vertices that they have. `field` may be any beyond [what these ask](Self::parts).
    ///
    /// # Errors
    /// As for [`extract`](super::extract).
    pub fn go_on(
        &mut self,
        parts: &[usize],
        field: &dyn Field,
        request: &Request<'_>,
    ) -> Result<(), Error> {
        for &part in parts {
            self.parts[part].is_sampled = true;
        }
        let blocks = parts.iter().map(|&part| self.parts[part].block).collect();
        let mut fresh = Bits::new(self.lattice.len());
        let mut source = self.source(field, request);
        sparse::sample(&mut self.samples, blocks, &mut source, Some(&mut fresh))?;
        self.seen = source.seen;
        let edges = self.crossed(&fresh);
        drop(fresh);
        let mover = self.mover(field, request);
        for edges in edges.chunks(BATCH) {
            let from = edges.iter().map(|&edge| self.vertex(edge)).collect();
            let moved = mover.moved(edges.to_vec(), from, &[])?;
            self.moved.push(moved);
            (request.progress)(PROGRESS);
        }
        Ok(())
    }

    fn source<'a>(&self, field: &'a dyn Field, request: &'a Request<'a>) -> Source<'a> {
        Source {
            field,
            request,
            lattice: self.lattice,
            seen: self.seen,
        }
    }

    fn mover<'a>(&self, field: &'a dyn Field, request: &'a Request<'a>) -> Mover<'a> {
        Mover {
            field,
            request,
            spacing: self.lattice.grid.spacing,
        }
    }

    /// The edges between known points that the surface crosses, with an end among the `fresh` ones.
    fn crossed(&self, fresh: &Bits) -> Vec<Edge> {
        let axes = || (0..3).map(|axis| (axis, self.lattice.strides[axis]));
        let edges = fresh.members().flat_map(|index| {
            let up = axes().map(move |(axis, _)| Edge::new(index, axis));
            let below = axes().map(move |(axis, stride)| (index - stride, axis));
            // Between two fresh points, it is found from the lower one.
            let down = below.filter(|(below, _)| !fresh.contains(*below));
            up.chain(down.map(|(below, axis)| Edge::new(below, axis)))
        });
        let is_crossed = |edge: &Edge| {
            let ends = self.ends(*edge);
            ends.is_some_and(|[low, high]| (low > 0.0) != (high > 0.0))
        };
        let mut edges: Vec<Edge> = edges.filter(is_crossed).collect();
        edges.sort_unstable();
        edges
    }

    /// The field at the ends of an edge; none where it is not known at both.
    fn ends(&self, edge: Edge) -> Option<[f64; 2]> {
        let upper = edge.lower() + self.lattice.strides[edge.axis()];
        Some([self.samples.get(edge.lower())?, self.samples.get(upper)?])
    }

    /// Where marching cubes have the vertex of an edge that is crossed.
    fn vertex(&self, edge: Edge) -> Vec3 {
        let ends = self.ends(edge).expect("both ends are known");
        let at = self.lattice.coordinates(edge.lower());
        vertex_at(&self.lattice, (at, edge.axis()), ends)
    }

    /// Does what is left of the extraction, now that all of the field is known.
    ///
    /// # Errors
    /// As for [`extract`](super::extract).
    pub fn finish(mut self, field: &dyn Field, request: &Request<'_>) -> Result<Extraction, Error> {
        let mut source = self.source(field, request);
        match request.evaluation {
            Evaluation::Sparse => {
                let open = self.parts.iter().filter(|part| !part.is_sampled);
                let open = open.map(|part| part.block).collect();
                sparse::sample(&mut self.samples, open, &mut source, None)?;
                sparse::follow(&mut self.samples, &mut source)?;
            }
            Evaluation::Dense => self.samples = dense::sample(&mut source)?,
        }
        let (seen, grid) = (source.seen, self.lattice.grid);
        check_signs(&seen)?;
        let mover = self.mover(field, request);
        let (mut contour, moved) = self.contour(request)?;
        if request.refined {
            refinement::refine(field, request, &mut contour)?;
        }
        let projected = mover.project(&contour, moved)?;
        Ok(Extraction {
            mesh: TriangleMesh {
                vertices: projected.vertices,
                normals: projected.normals,
                triangles: contour.triangles,
                ..TriangleMesh::default()
            },
            grid,
            evaluations: seen.evaluations,
            gradient_evaluations: projected.evaluations,
            closing_vertices: contour.caps.len(),
            unprojected_vertices: projected.undone,
        })
    }

    /// Triangulates the samples; those of its vertices that were moved have their numbers then. The memory of the samples
    /// is free again when the others are moved.
    fn contour(self, request: &Request<'_>) -> Result<(Contour, Vec<Moved<u32>>), Error> {
        let samples = self.samples;
        let (contour, numbering) = contour(&samples, &self.lattice, request.max_triangles)?;
        let number = |edge: &Edge| {
            let rank = samples.rank(edge.lower());
            numbering.vertex(rank.expect("both ends are known"), edge.axis())
        };
        let moved = self.moved.into_iter().map(|moved| {
            let numbers = moved.names.iter().map(number).collect();
            moved.named(numbers)
        });
        Ok((contour, moved.collect()))
    }
}

fn check_signs(seen: &Seen) -> Result<(), Error> {
    let sign = if seen.positive == 0 {
        "nowhere positive (inside)"
    } else if seen.positive == seen.evaluations {
        "everywhere positive (inside)"
    } else {
        return Ok(());
    };
    Err(Error::NoSurface(format!(
        "it is {sign} on the grid, at {} points; see that normals point outwards, or try more \
         training.max_evaluations or another training.seed",
        seen.evaluations
    )))
}
