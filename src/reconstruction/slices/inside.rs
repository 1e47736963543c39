//! Which pixels of slices lie inside a mesh.

use super::Geometry;
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::vector::{Vec3, cross, dot, sub};

/// A mesh and slices through it.
///
/// A pixel is inside if the way from its centre along its row to the end crosses the surface an odd number of times.
/// An edge that two triangles share is cut once for both, in the same place to the last bit, and what begins in a
/// plane or a row counts to one side of it: so a closed surface is crossed an even number of times by every row.
#[derive(Debug)]
pub struct Inside<'a> {
    mesh: &'a TriangleMesh,
    geometry: &'a Geometry,
    columns: usize,
    rows: usize,
    normal: Vec3,
    /// Of each vertex along the normal.
    heights: Vec<f64>,
    /// The triangles that each slice cuts.
    cut: Vec<Vec<u32>>,
}

impl<'a> Inside<'a> {
    /// Of slices with so many columns and rows.
    pub fn new(
        mesh: &'a TriangleMesh,
        geometry: &'a Geometry,
        [columns, rows]: [usize; 2],
    ) -> Self {
        let normal = cross(geometry.column, geometry.row);
        let heights: Vec<f64> = mesh.vertices.iter().map(|&v| dot(normal, v)).collect();
        let mut planes: Vec<(f64, usize)> = geometry
            .origins
            .iter()
            .enumerate()
            .map(|(slice, &origin)| (dot(normal, origin), slice))
            .collect();
        planes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut cut = vec![Vec::new(); planes.len()];
        for (t, triangle) in (0u32..).zip(&mesh.triangles) {
            let corners = triangle.map(|v| heights[v as usize]);
            let [low, high] = [f64::min, f64::max].map(|pick| corners.into_iter().reduce(pick));
            let (low, high) = (low.unwrap_or_default(), high.unwrap_or_default());
            let first = planes.partition_point(|&(plane, _)| plane <= low);
            for &(_, slice) in planes[first..]
                .iter()
                .take_while(|(plane, _)| *plane <= high)
            {
                cut[slice].push(t);
            }
        }
        Self {
            mesh,
            geometry,
            columns,
            rows,
            normal,
            heights,
            cut,
        }
    }

    /// Whether each pixel of a slice is inside, row by row.
    pub fn slice(&self, slice: usize) -> Vec<bool> {
        let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); self.rows];
        for &t in &self.cut[slice] {
            if let Some([a, b]) = self.segment(slice, self.mesh.triangles[t as usize]) {
                self.cross_rows(a, b, &mut crossings);
            }
        }
        let mut inside = vec![false; self.columns * self.rows];
        for (row, crossings) in inside.chunks_mut(self.columns.max(1)).zip(&mut crossings) {
            crossings.sort_by(f64::total_cmp);
            for ends in crossings.as_chunks::<2>().0 {
                let [from, to] = ends.map(|end| end.ceil().clamp(0.0, self.columns as f64));
                row[from as usize..(to as usize).max(from as usize)].fill(true);
            }
        }
        inside
    }

    /// Where the plane of a slice cuts a triangle, in columns and rows; none where it only touches it.
    fn segment(&self, slice: usize, [a, b, c]: [u32; 3]) -> Option<[[f64; 2]; 2]> {
        let origin = self.geometry.origins[slice];
        let plane = dot(self.normal, origin);
        let below = |v: u32| self.heights[v as usize] < plane;
        let mut ends = [(a, b), (b, c), (c, a)]
            .into_iter()
            .filter(|&(v, w)| below(v) != below(w))
            .map(|(v, w)| self.pixel(origin, self.crossing(plane, v.min(w), v.max(w))));
        Some([ends.next()?, ends.next()?])
    }

    /// Where an edge passes a height.
    fn crossing(&self, plane: f64, v: u32, w: u32) -> Vec3 {
        let [v, w] = [v, w].map(|v| v as usize);
        let share = (plane - self.heights[v]) / (self.heights[w] - self.heights[v]);
        let [from, to] = [self.mesh.vertices[v], self.mesh.vertices[w]];
        std::array::from_fn(|i| from[i] + share * (to[i] - from[i]))
    }

    /// A point of a slice in columns and rows.
    fn pixel(&self, origin: Vec3, point: Vec3) -> [f64; 2] {
        let Geometry { column, row, .. } = *self.geometry;
        let offset = sub(point, origin);
        let area = dot(self.normal, self.normal);
        [
            dot(self.normal, cross(offset, row)) / area,
            dot(self.normal, cross(column, offset)) / area,
        ]
    }

    /// Notes at which columns a segment crosses rows.
    fn cross_rows(&self, a: [f64; 2], b: [f64; 2], crossings: &mut [Vec<f64>]) {
        let ([x, y], [far_x, far_y]) = if a[1] <= b[1] { (a, b) } else { (b, a) };
        let row = |y: f64| y.ceil().clamp(0.0, self.rows as f64) as usize;
        let crossed = row(y)..row(far_y);
        for (at, crossings) in crossed.clone().zip(&mut crossings[crossed]) {
            crossings.push(x + (at as f64 - y) / (far_y - y) * (far_x - x));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::slices::Grid;

    /// A tetrahedron with corners at the origin and at 8 along each axis.
    fn corner() -> TriangleMesh {
        TriangleMesh {
            vertices: vec![[0.0; 3], [8.0, 0.0, 0.0], [0.0, 8.0, 0.0], [0.0, 0.0, 8.0]],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            ..TriangleMesh::default()
        }
    }

    fn compare(grid: &Grid) -> usize {
        let (mesh, geometry) = (corner(), grid.geometry());
        let [columns, rows, slices] = grid.size;
        let inside = Inside::new(&mesh, &geometry, [columns, rows]);
        let mut count = 0;
        for k in 0..slices {
            for (pixel, found) in inside.slice(k).into_iter().enumerate() {
                let place = [pixel % columns, pixel / columns, k].map(|index| index as f64);
                let [x, y, z] = grid.centre(place);
                let expected = x > 0.0 && y > 0.0 && z > 0.0 && x + y + z < 8.0;
                assert_eq!(found, expected, "{place:?}");
                count += usize::from(found);
            }
        }
        count
    }

    #[test]
    fn pixels_are_inside_as_the_inequalities_of_a_tetrahedron_say() {
        // Oblique, sheared and left-handed: no centre lies on a face.
        let oblique = Grid {
            size: [23, 19, 17],
            affine: [
                [-0.71, 0.13, 0.05, 9.03],
                [0.09, 0.64, -0.21, -1.57],
                [0.03, -0.11, 0.83, -1.83],
            ],
        };
        assert!(compare(&oblique) > 100);
        // Slices downwards, and the mesh larger than the grid.
        let small = Grid {
            size: [4, 5, 3],
            affine: [
                [0.51, 0.0, 0.0, 0.3],
                [0.0, 0.47, 0.0, 0.2],
                [0.0, 0.0, -0.59, 3.1],
            ],
        };
        assert_eq!(compare(&small), 60);
    }

    #[test]
    fn corners_and_edges_in_rows_and_planes_leave_no_streaks() {
        // Centres lie on corners, edges and faces.
        let grid = Grid {
            size: [13, 13, 13],
            affine: [
                [1.0, 0.0, 0.0, -2.0],
                [0.0, 1.0, 0.0, -2.0],
                [0.0, 0.0, 1.0, -2.0],
            ],
        };
        let (mesh, geometry) = (corner(), grid.geometry());
        let inside = Inside::new(&mesh, &geometry, [13, 13]);
        for k in 0..13 {
            for (pixel, found) in inside.slice(k).into_iter().enumerate() {
                let [x, y, z] = [pixel % 13, pixel / 13, k].map(|index| index as f64 - 2.0);
                let sum = x + y + z;
                if x > 0.0 && y > 0.0 && z > 0.0 && sum < 8.0 {
                    assert!(found, "{x} {y} {z}");
                }
                if x < 0.0 || y < 0.0 || z < 0.0 || sum > 8.0 {
                    assert!(!found, "{x} {y} {z}");
                }
            }
        }
    }
}
