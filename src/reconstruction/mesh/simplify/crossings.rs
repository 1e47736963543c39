//! Triangles of a mesh that run through each other.

use rayon::prelude::*;

use crate::reconstruction::mesh::{SurfaceTree, TriangleMesh};
use crate::reconstruction::vector::{Vec3, cross, dot, sub};

/// The triangles that an edge of another runs through, and those of these edges; sorted, without repetition.
///
/// Of two triangles that run through each other, an edge of one does so through the other. Edges that only touch
/// a triangle, or have a corner in common with it, do not count.
pub(super) fn crossing_triangles(mesh: &TriangleMesh, tree: &SurfaceTree) -> Vec<usize> {
    let of = |t: usize| -> Vec<usize> {
        let others = tree.near(&mesh.corners(t));
        let crossed = others
            .into_iter()
            .filter(|&other| pierces(mesh, t, other))
            .flat_map(|other| [t, other]);
        crossed.collect()
    };
    let mut found: Vec<usize> = (0..mesh.triangles.len())
        .into_par_iter()
        .flat_map_iter(of)
        .collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// Whether an edge of triangle `t` runs through the inside of triangle `other`.
fn pierces(mesh: &TriangleMesh, t: usize, other: usize) -> bool {
    let triangle = mesh.corners(other);
    let corners = mesh.triangles[other];
    let ends = mesh.triangles[t];
    (0..3).any(|k| {
        let edge = [ends[k], ends[(k + 1) % 3]];
        let apart = edge.iter().all(|v| !corners.contains(v));
        apart && runs_through(edge.map(|v| mesh.vertices[v as usize]), triangle)
    })
}

/// Whether the segment from `p` to `q` runs through the inside of the triangle.
fn runs_through([p, q]: [Vec3; 2], [a, b, c]: [Vec3; 3]) -> bool {
    // All from p, so that a far origin costs no digits.
    let [q, a, b, c] = [q, a, b, c].map(|v| sub(v, p));
    let normal = cross(sub(b, a), sub(c, a));
    let [from, to] = [-dot(a, normal), dot(sub(q, a), normal)];
    if from * to >= 0.0 {
        return false;
    }
    let around = [(a, b), (b, c), (c, a)].map(|(u, v)| dot(q, cross(u, v)));
    around.iter().all(|s| *s > 0.0) || around.iter().all(|s| *s < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two triangles: one in the plane z = 0, and one upright that reaches down to `depth`.
    fn two(depth: f64) -> TriangleMesh {
        TriangleMesh {
            vertices: vec![
                [0.0, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [0.2, 0.2, 1.0],
                [0.3, 0.2, 1.0],
                [0.2, 0.3, -depth],
            ],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            ..TriangleMesh::default()
        }
    }

    fn crossing(mesh: &TriangleMesh) -> Vec<usize> {
        crossing_triangles(mesh, &SurfaceTree::new(mesh).unwrap())
    }

    #[test]
    fn triangles_that_run_through_each_other_are_found() {
        assert_eq!(crossing(&two(0.5)), [0, 1]);
        let mut far = two(0.5);
        for vertex in &mut far.vertices {
            *vertex = vertex.map(|x| x + 1e9);
        }
        assert_eq!(crossing(&far), [0, 1]);
    }

    #[test]
    fn those_that_touch_or_share_a_corner_are_not() {
        assert!(crossing(&two(-0.1)).is_empty());
        assert!(crossing(&two(0.0)).is_empty());
        let mut shared = two(0.5);
        shared.triangles[1] = [0, 4, 5];
        assert_eq!(crossing(&shared), [0, 1], "its side from 4 to 5 does");
        shared.triangles[1] = [3, 4, 0];
        assert!(crossing(&shared).is_empty());
    }
}
