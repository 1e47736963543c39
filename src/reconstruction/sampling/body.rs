//! The voxels of a body, from points at their centres or on their faces.

use std::collections::HashSet;

use super::lattice::Lattice;
use crate::reconstruction::vector::Vec3;

/// Least share of the cells of a body that have all six neighbours in it: a body two voxels wide has none.
const LEAST_INNER: f64 = 0.1;

/// The cells of a regular lattice that belong to a body, with a margin of one cell around.
pub(super) struct Body {
    /// Edges of a cell.
    pub(super) edges: Vec3,
    /// Centre of the first cell.
    origin: Vec3,
    size: [usize; 3],
    inside: Vec<bool>,
}

/// The six directions to the neighbours of a cell: axis and sign.
const FACES: [(usize, isize); 6] = [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)];

/// Faces that cannot be crossed: the cell above, and the axis.
type Walls = HashSet<(usize, usize)>;

impl Body {
    /// The body whose cells, or those at its boundary, or the faces of those, are at the points of a lattice; none
    /// if these enclose nothing.
    pub(super) fn of(lattice: &Lattice) -> Option<Self> {
        let body = match lattice.parity_of_faces() {
            Some(parity) => Self::within_faces(lattice, parity),
            None => Self::of_cells(lattice),
        };
        let cells = (0..body.inside.len()).filter(|&at| body.inside[at]);
        let inner = cells
            .clone()
            .filter(|&at| FACES.iter().all(|&face| body.inside[body.beside(at, face)]));
        let enough = LEAST_INNER * cells.clone().count() as f64;
        (cells.count() > 0 && inner.count() as f64 >= enough).then_some(body)
    }

    /// The cells of the points and those that they enclose.
    fn of_cells(lattice: &Lattice) -> Self {
        let mut body = Self::empty(lattice.size.map(|n| n + 2));
        for cell in &lattice.cells {
            let at = body.index(cell.map(|c| c + 1));
            body.inside[at] = true;
        }
        body.fill(&Walls::new());
        body.edges = lattice.steps;
        body.origin = lattice.position([-1.0; 3]);
        body
    }

    /// The cells of twice the steps of `lattice`, with centres at places of this parity, that faces at its points
    /// enclose.
    fn within_faces(lattice: &Lattice, parity: [usize; 3]) -> Self {
        let above = |face: &[usize; 3]| -> ([usize; 3], usize) {
            let across = (0..3).find(|&axis| (face[axis] ^ parity[axis]) & 1 == 1);
            // A face across an axis has an odd distance from the centres; with the margin.
            let cell = std::array::from_fn(|axis| (face[axis] + 1 - parity[axis]) / 2 + 1);
            (cell, across.unwrap_or(0))
        };
        let mut body = Self::empty(lattice.size.map(|n| n / 2 + 4));
        let walls = lattice.cells.iter().map(|face| {
            let (cell, axis) = above(face);
            (body.index(cell), axis)
        });
        let walls: Walls = walls.collect();
        body.fill(&walls);
        body.edges = lattice.steps.map(|step| 2.0 * step);
        body.origin = lattice.position(parity.map(|p| p as f64 - 2.0));
        body
    }

    fn empty(size: [usize; 3]) -> Self {
        Self {
            edges: [0.0; 3],
            origin: [0.0; 3],
            size,
            inside: vec![false; size.iter().product()],
        }
    }

    /// Adds what cannot be reached from outside.
    fn fill(&mut self, walls: &Walls) {
        let mut outside = vec![false; self.inside.len()];
        let mut open = vec![0];
        outside[0] = true;
        while let Some(at) = open.pop() {
            let here = self.cell(at);
            for (axis, sign) in FACES {
                let edge = if sign < 0 { 0 } else { self.size[axis] - 1 };
                if here[axis] == edge {
                    continue;
                }
                let next = self.beside(at, (axis, sign));
                let above = at.max(next);
                if !outside[next] && !self.inside[next] && !walls.contains(&(above, axis)) {
                    outside[next] = true;
                    open.push(next);
                }
            }
        }
        self.inside = outside.into_iter().map(|outside| !outside).collect();
    }

    /// The middles of the faces between the body and the outside, and their outward normals, as long as the faces
    /// are large.
    pub(super) fn faces(&self) -> impl Iterator<Item = (Vec3, Vec3)> + '_ {
        let inside = (0..self.inside.len()).filter(|&at| self.inside[at]);
        let all = inside.flat_map(|at| FACES.map(|face| (at, face)));
        let open = all.filter(|&(at, face)| !self.inside[self.beside(at, face)]);
        open.map(|(at, (axis, sign))| {
            let cell = self.cell(at);
            let mut middle: Vec3 =
                std::array::from_fn(|a| self.origin[a] + cell[a] as f64 * self.edges[a]);
            middle[axis] += 0.5 * sign as f64 * self.edges[axis];
            let mut normal = [0.0; 3];
            normal[axis] = sign as f64 * self.edges.iter().product::<f64>() / self.edges[axis];
            (middle, normal)
        })
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    fn cell(&self, at: usize) -> [usize; 3] {
        let [nx, ny, _] = self.size;
        [at % nx, at / nx % ny, at / (nx * ny)]
    }

    /// The neighbour of a cell that is not at the margin there.
    fn beside(&self, at: usize, (axis, sign): (usize, isize)) -> usize {
        let stride = [1, self.size[0], self.size[0] * self.size[1]][axis];
        at.wrapping_add_signed(sign * stride as isize)
    }
}
