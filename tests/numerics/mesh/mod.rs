//! Meshes: what they are, how large, how far apart, and that every format gives them back.

mod colors;
pub(crate) mod formats;
mod glb;
mod hostile;
mod mask;
mod measures;
mod packages;
mod quality;
mod space;
mod topology;

use std::f64::consts::{PI, TAU};

use meshway::reconstruction::mesh::TriangleMesh;
use meshway::reconstruction::vector::{Vec3, add, cross, dot, normalized, sub};

/// Corner (i, j, k) of the unit cube is vertex i + 2 j + 4 k.
fn cube() -> TriangleMesh {
    let vertices = (0..8)
        .map(|i| [i & 1, i >> 1 & 1, i >> 2].map(f64::from))
        .collect();
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    TriangleMesh {
        vertices,
        triangles: quads.into_iter().flat_map(halves).collect(),
        ..TriangleMesh::default()
    }
}

/// The unit tetrahedron at the origin.
fn tetrahedron() -> TriangleMesh {
    TriangleMesh {
        vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        ..TriangleMesh::default()
    }
}

/// Sphere around the origin with vertices on it and their exact normals: an octahedron, halved
/// `halvings` times.
fn sphere(radius: f64, halvings: usize) -> TriangleMesh {
    let mut normals: Vec<Vec3> = vec![
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [-1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, -1.0],
    ];
    let mut triangles = vec![
        [0, 1, 2],
        [1, 3, 2],
        [3, 4, 2],
        [4, 0, 2],
        [1, 0, 5],
        [3, 1, 5],
        [4, 3, 5],
        [0, 4, 5],
    ];
    for _ in 0..halvings {
        let mut middles = std::collections::HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let sum = add(normals[a as usize], normals[b as usize]);
                normals.push(normalized(sum).unwrap());
                normals.len() as u32 - 1
            })
        };
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    TriangleMesh {
        vertices: normals.iter().map(|n| n.map(|v| v * radius)).collect(),
        normals,
        triangles,
        ..TriangleMesh::default()
    }
}

/// Torus around the z axis with `2 n` segments along and `n` around the tube, vertices on it.
fn torus(radius: f64, tube: f64, n: u32) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for i in 0..2 * n {
        for j in 0..n {
            let u = PI * f64::from(i) / f64::from(n);
            let v = TAU * f64::from(j) / f64::from(n);
            let normal = [v.cos() * u.cos(), v.cos() * u.sin(), v.sin()];
            let ring = [radius * u.cos(), radius * u.sin(), 0.0];
            mesh.vertices.push(add(ring, normal.map(|x| x * tube)));
            mesh.normals.push(normal);
            let at = |i: u32, j: u32| i % (2 * n) * n + j % n;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

/// Both meshes as one, without any common vertex.
fn together(mut a: TriangleMesh, b: &TriangleMesh) -> TriangleMesh {
    let first = a.vertices.len() as u32;
    a.vertices.extend(&b.vertices);
    a.triangles
        .extend(b.triangles.iter().map(|t| t.map(|v| v + first)));
    a
}

fn moved(mut mesh: TriangleMesh, by: Vec3) -> TriangleMesh {
    for v in &mut mesh.vertices {
        *v = add(*v, by);
    }
    mesh
}

/// Whether every triangle faces away from `inside`, which sees the whole surface.
fn faces_away_from(mesh: &TriangleMesh, inside: Vec3) -> bool {
    mesh.triangles.iter().all(|t| {
        let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
        dot(cross(sub(b, a), sub(c, a)), sub(a, inside)) > 0.0
    })
}

#[test]
fn the_shapes_of_these_tests_face_outwards() {
    assert!(faces_away_from(&cube(), [0.5; 3]));
    assert!(faces_away_from(&tetrahedron(), [0.1; 3]));
    assert!(faces_away_from(&sphere(2.0, 2), [0.0; 3]));
    assert!(torus(1.0, 0.3, 16).volume() > 0.0);
}
