//! Area, volume, bounds, and dropping components.

use std::f64::consts::PI;

use meshway::reconstruction::mesh::{TriangleMesh, components};

use super::{cube, moved, sphere, tetrahedron, together, torus};

fn relative(value: f64, expected: f64) -> f64 {
    (value / expected - 1.0).abs()
}

#[test]
fn a_cube_has_its_volume_and_area() {
    assert_eq!(cube().volume().to_bits(), 1f64.to_bits());
    assert_eq!(cube().area().to_bits(), 6f64.to_bits());
    // 1/6 takes a rounding or two.
    assert!(relative(tetrahedron().volume(), 1.0 / 6.0) < 1e-15);
}

#[test]
fn turned_inside_out_the_volume_is_negative() {
    let mut mesh = cube();
    for triangle in &mut mesh.triangles {
        triangle.reverse();
    }
    assert_eq!(mesh.volume().to_bits(), (-1f64).to_bits());
}

#[test]
fn a_far_origin_costs_the_volume_no_digits() {
    let offset = [1e6, -2e6, 3e6];
    // Coordinates near 3e6 are rounded by 2e-10 of the cube's edge, here not at all.
    assert!(relative(moved(cube(), offset).volume(), 1.0) < 1e-15);
    // The sphere's vertices are moved by rounding, each by at most 3e-10 and in all directions.
    let volume = sphere(1.0, 4).volume();
    assert!(relative(moved(sphere(1.0, 4), offset).volume(), volume) < 1e-10);
}

#[test]
fn sphere_and_torus_converge_with_the_square_of_the_edge() {
    // Error of (area, volume) for one mesh and for one with half the edge length.
    let errors = |mesh: &TriangleMesh, area, volume| {
        [relative(mesh.area(), area), relative(mesh.volume(), volume)]
    };
    let ball = |halvings| errors(&sphere(2.0, halvings), 16.0 * PI, 32.0 / 3.0 * PI);
    let ring = |n| {
        let (area, volume) = (4.0 * PI * PI * 0.4, 2.0 * PI * PI * 0.16);
        errors(&torus(1.0, 0.4, n), area, volume)
    };
    for (coarse, fine) in [(ball(3), ball(4)), (ring(24), ring(48))] {
        for (coarse, fine) in coarse.into_iter().zip(fine) {
            // Second order: a quarter; the next order in h² is some percent of it here.
            assert!((coarse / fine - 4.0).abs() < 0.1, "{coarse} {fine}");
            assert!(fine < 0.01);
        }
    }
}

#[test]
#[expect(clippy::float_cmp, reason = "bounds are coordinates, not results")]
fn unused_vertices_widen_the_bounds_only_without_triangles() {
    let mut mesh = cube();
    mesh.vertices.push([100.0; 3]);
    assert_eq!(mesh.bounds().unwrap().max, [1.0; 3]);
    mesh.triangles.clear();
    assert_eq!(mesh.bounds().unwrap().max, [100.0; 3]);
    assert!(TriangleMesh::default().bounds().is_none());
}

#[test]
fn a_dropped_component_takes_its_vertices_along() {
    let far = moved(tetrahedron(), [9.0; 3]);
    let mut mesh = together(together(cube(), &far), &moved(cube(), [-9.0; 3]));
    mesh.normals = mesh.vertices.iter().map(|v| v.map(|x| x * 2.0)).collect();
    let (ids, count) = components(&mesh);
    let areas = mesh.component_areas(&ids, count);
    assert_eq!(areas[0].to_bits(), 6f64.to_bits());
    // Three right triangles of 1/2 and one with edges √2, of √3/2.
    assert!(relative(areas[1], 1.5 + 0.75f64.sqrt()) < 1e-15);

    mesh.retain_components(&[true, false, true], &ids);
    let expected = together(cube(), &moved(cube(), [-9.0; 3]));
    assert_eq!(mesh.vertices, expected.vertices);
    assert_eq!(mesh.triangles, expected.triangles);
    let doubled: Vec<_> = mesh.vertices.iter().map(|v| v.map(|x| x * 2.0)).collect();
    assert_eq!(mesh.normals, doubled);
}
