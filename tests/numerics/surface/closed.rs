//! What a mesh must be, whatever the field: closed, manifold, oriented.

use std::collections::{HashMap, HashSet};

use meshway::reconstruction::mesh::TriangleMesh;
use meshway::reconstruction::vector::{Vec3, cross, dot, sub};

/// Fails unless every directed edge occurs once and with its opposite, the triangles around each
/// vertex form one ring, and there is a unit normal and a triangle for each vertex.
pub(super) fn check_closed_manifold(mesh: &TriangleMesh) {
    assert!(!mesh.triangles.is_empty());
    assert_eq!(mesh.normals.len(), mesh.vertices.len());
    let mut directed = HashSet::new();
    // For a vertex: from each neighbour to the next one around it.
    let mut rings: Vec<HashMap<u32, u32>> = vec![HashMap::new(); mesh.vertices.len()];
    for [a, b, c] in &mesh.triangles {
        for (from, to, across) in [(*a, *b, *c), (*b, *c, *a), (*c, *a, *b)] {
            assert_ne!(from, to);
            assert!(directed.insert((from, to)), "edge {from}-{to} occurs twice");
            rings[from as usize].insert(to, across);
        }
    }
    for (from, to) in &directed {
        assert!(directed.contains(&(*to, *from)), "edge {from}-{to} is open");
    }
    for ring in rings {
        let start = *ring.keys().next().expect("every vertex has a triangle");
        let mut at = start;
        let mut length = 0;
        while length == 0 || at != start {
            at = ring[&at];
            length += 1;
        }
        assert_eq!(length, ring.len(), "a vertex joins several sheets");
    }
}

/// V - E + F of a closed mesh.
pub(super) fn euler_number(mesh: &TriangleMesh) -> i64 {
    mesh.vertices.len() as i64 - (mesh.triangles.len() / 2) as i64
}

/// Signed volume, positive where the triangles face outwards.
pub(super) fn volume(mesh: &TriangleMesh) -> f64 {
    let sixfold = mesh.triangles.iter().map(|triangle| {
        let [a, b, c] = triangle.map(|v| mesh.vertices[v as usize]);
        dot(a, cross(b, c))
    });
    sixfold.sum::<f64>() / 6.0
}

/// Twice the area of each triangle, along its normal.
pub(super) fn areas(mesh: &TriangleMesh) -> Vec<Vec3> {
    let area = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|v| mesh.vertices[v as usize]);
        cross(sub(b, a), sub(c, a))
    };
    mesh.triangles.iter().map(area).collect()
}
