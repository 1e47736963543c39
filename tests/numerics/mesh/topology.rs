//! Meshes with known answers.

use meshway::reconstruction::mesh::{Topology, TriangleMesh, components};

use super::{cube, moved, sphere, tetrahedron, together, torus};

/// Every number that describes a good surface; the others are zero there.
fn is_good(topology: &Topology) -> bool {
    topology.closed
        && topology.manifold
        && topology.oriented
        && topology.boundary_edges == 0
        && topology.non_manifold_edges == 0
        && topology.non_manifold_vertices == 0
        && topology.degenerate_triangles == 0
}

#[test]
fn closed_surfaces_have_the_euler_number_of_their_genus() {
    for (mesh, components, euler, genus) in [
        (cube(), 1, 2, 0),
        (tetrahedron(), 1, 2, 0),
        (sphere(1.0, 3), 1, 2, 0),
        (torus(1.0, 0.3, 8), 1, 0, 1),
        (together(cube(), &torus(9.0, 0.3, 8)), 2, 2, 1),
        (together(torus(1.0, 0.3, 8), &torus(9.0, 0.3, 8)), 2, 0, 2),
    ] {
        let topology = Topology::of(&mesh);
        assert!(is_good(&topology), "{topology:?}");
        assert_eq!(topology.components, components);
        assert_eq!(topology.euler_characteristic, euler);
        assert_eq!(topology.genus, Some(genus));
    }
}

#[test]
fn a_missing_triangle_opens_the_surface() {
    let mut mesh = cube();
    mesh.triangles.pop();
    let topology = Topology::of(&mesh);
    assert!(!topology.closed && topology.manifold && topology.oriented);
    assert_eq!(topology.boundary_edges, 3);
    assert_eq!(topology.euler_characteristic, 1);
    assert_eq!(topology.genus, None);
}

#[test]
fn a_flipped_triangle_breaks_the_orientation_only() {
    let mut mesh = cube();
    mesh.triangles[3].swap(0, 1);
    let topology = Topology::of(&mesh);
    assert!(topology.closed && topology.manifold && !topology.oriented);
    assert_eq!(topology.genus, None);
}

#[test]
fn a_fin_on_an_edge_is_not_manifold() {
    let mut mesh = tetrahedron();
    mesh.vertices.push([-1.0; 3]);
    mesh.triangles.push([0, 1, 4]);
    let topology = Topology::of(&mesh);
    assert!(!topology.closed && !topology.manifold && !topology.oriented);
    assert_eq!(topology.non_manifold_edges, 1);
    assert_eq!(topology.boundary_edges, 2);
    // Around each vertex the fin hangs on the others by its edge.
    assert_eq!(topology.non_manifold_vertices, 0);
}

#[test]
fn two_tetrahedra_at_one_vertex_are_a_bow_tie() {
    let mut mesh = together(tetrahedron(), &moved(tetrahedron(), [5.0; 3]));
    for v in mesh.triangles.iter_mut().flatten() {
        if *v == 4 {
            *v = 0;
        }
    }
    let topology = Topology::of(&mesh);
    assert!(topology.closed && topology.oriented && !topology.manifold);
    assert_eq!(topology.non_manifold_vertices, 1);
    assert_eq!(topology.non_manifold_edges, 0);
    assert_eq!(topology.components, 1);
    // Vertex 4 is left unused and does not count: 7 - 12 + 8.
    assert_eq!(topology.euler_characteristic, 3);
    assert_eq!(topology.genus, None);
}

#[test]
fn two_cubes_along_one_edge_share_an_edge_of_four_triangles() {
    let mut mesh = together(cube(), &moved(cube(), [1.0, 1.0, 0.0]));
    // The edge from (1, 1, 0) to (1, 1, 1).
    for v in mesh.triangles.iter_mut().flatten() {
        *v = match *v {
            8 => 3,
            12 => 7,
            other => other,
        };
    }
    let topology = Topology::of(&mesh);
    assert_eq!(topology.non_manifold_edges, 1);
    assert_eq!(topology.boundary_edges, 0);
    assert!(!topology.closed && !topology.manifold && !topology.oriented);
}

#[test]
fn a_moebius_strip_cannot_be_oriented() {
    // Five vertices, each triangle of three consecutive ones.
    let mesh = TriangleMesh {
        vertices: (0..5)
            .map(|i| [f64::from(i), f64::from(i * i), 1.0])
            .collect(),
        triangles: (0..5).map(|i| [i, (i + 1) % 5, (i + 2) % 5]).collect(),
        ..TriangleMesh::default()
    };
    let topology = Topology::of(&mesh);
    assert!(topology.manifold && !topology.oriented && !topology.closed);
    assert_eq!(topology.boundary_edges, 5);
    assert_eq!(topology.euler_characteristic, 0);
}

#[test]
fn triangles_without_area_are_counted_and_do_no_harm() {
    let mut mesh = cube();
    mesh.triangles.push([0, 0, 1]);
    let topology = Topology::of(&mesh);
    assert_eq!(topology.degenerate_triangles, 1);
    assert!(topology.closed && topology.manifold && topology.oriented);
    assert_eq!(topology.genus, Some(0));

    let mut flat = tetrahedron();
    flat.vertices[3] = [0.5, 0.0, 0.0];
    assert_eq!(Topology::of(&flat).degenerate_triangles, 1);
    assert!(Topology::of(&flat).closed);
}

#[test]
fn an_empty_mesh_has_nothing() {
    let topology = Topology::of(&TriangleMesh::default());
    assert!(!topology.closed);
    assert_eq!((topology.components, topology.euler_characteristic), (0, 0));
}

#[test]
fn components_are_numbered_by_their_first_triangle() {
    let mut mesh = together(tetrahedron(), &moved(cube(), [9.0; 3]));
    mesh.triangles.rotate_left(4);
    let (ids, count) = components(&mesh);
    assert_eq!(count, 2);
    assert_eq!(ids, [[0; 12].as_slice(), &[1; 4]].concat());
}
