//! Cutting meshes where no points are near: by hand on a plane, and on extracted surfaces.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use meshway::reconstruction::mesh::{PointTree, Topology, TriangleMesh, trim};
use meshway::reconstruction::settings::Components;
use meshway::reconstruction::surface::{Field, extract, keep_components};
use meshway::reconstruction::vector::{Vec3, distance as distance_between};

use super::fields::{analytic, sphere};
use super::request;

/// A plane of `n` × `n` squares of edge 1 in two triangles each, with a distance at each place.
fn plane(n: u32, distance: &dyn Fn(Vec3) -> f64) -> TriangleMesh {
    let at = |x: u32, y: u32| y * (n + 1) + x;
    let mut mesh = TriangleMesh::default();
    for y in 0..=n {
        for x in 0..=n {
            mesh.vertices.push([f64::from(x), f64::from(y), 0.0]);
        }
    }
    for y in 0..n {
        for x in 0..n {
            let [a, b] = [at(x, y), at(x + 1, y)];
            let [c, d] = [at(x + 1, y + 1), at(x, y + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh.normals = vec![[0.0, 0.0, 1.0]; mesh.vertices.len()];
    mesh.distance_to_points = mesh.vertices.iter().map(|v| distance(*v)).collect();
    mesh
}

fn cut(n: u32, level: f64, distance: &dyn Fn(Vec3) -> f64) -> TriangleMesh {
    let trimmed = trim(&plane(n, distance), level, &|places| {
        places.iter().map(|p| distance(*p)).collect()
    });
    assert_eq!(trimmed.normals.len(), trimmed.vertices.len());
    assert_eq!(trimmed.distance_to_points.len(), trimmed.vertices.len());
    for (v, d) in trimmed.vertices.iter().zip(&trimmed.distance_to_points) {
        assert!((distance(*v) - d).abs() < 1e-12, "{v:?}: {d}");
    }
    let topology = Topology::of(&trimmed);
    assert!(topology.manifold && topology.oriented, "{topology:?}");
    assert_eq!(topology.degenerate_triangles, 0);
    for t in 0..trimmed.triangles.len() {
        assert!(trimmed.area_vector(t)[2] > 0.0, "triangle {t} is turned");
    }
    trimmed
}

#[test]
fn a_straight_cut_is_exact() {
    // Across edges, and through vertices.
    for (level, x) in [
        (3.25, 3.25),
        (3.5, 3.5),
        (3.0, 3.0),
        (3.05, 3.0),
        (3.95, 3.9),
    ] {
        let trimmed = cut(8, level, &|p| p[0]);
        let area = trimmed.area();
        assert!((area - 8.0 * x).abs() < 1e-9, "{level}: {area}");
        let furthest = trimmed
            .vertices
            .iter()
            .fold(0.0, |max: f64, v| max.max(v[0]));
        assert!((furthest - x).abs() < 1e-12, "{level}: {furthest}");
    }
}

#[test]
fn a_round_cut_stays_within_the_level() {
    let middle = [10.0, 10.0, 0.0];
    // 5 hits the vertices (3, 4), (4, 3), (5, 0) and so on.
    for level in [5.0, 6.3, 7.77] {
        let distance = |p| distance_between(p, middle);
        let trimmed = cut(20, level, &distance);
        assert!(trimmed.distance_to_points.iter().all(|d| *d <= level));
        let topology = Topology::of(&trimmed);
        assert_eq!((topology.components, topology.euler_characteristic), (1, 1));
        let area = trimmed.area();
        let circle = PI * level * level;
        assert!(area > 0.93 * circle && area <= circle, "{level}: {area}");
    }
}

#[test]
fn pinholes_stay_and_holes_are_cut() {
    let far_within = |radius: f64| {
        move |p: Vec3| {
            let from_middle = distance_between(p, [10.0, 10.0, 0.0]);
            3.0 + radius - from_middle
        }
    };
    let pinhole = cut(20, 3.0, &far_within(1.2));
    assert_eq!(pinhole, plane(20, &far_within(1.2)));
    let hole = cut(20, 3.0, &far_within(4.0));
    assert_eq!(Topology::of(&hole).euler_characteristic, 0);
    let area = 400.0 - PI * 16.0;
    assert!((hole.area() / area - 1.0).abs() < 0.02, "{}", hole.area());
}

#[test]
fn parts_that_touch_in_a_vertex_are_taken_apart() {
    // Near in two opposite quarters, which meet in the vertex (4, 4), where the distance is the level.
    let trimmed = cut(8, 1.0, &|p| 1.0 + (p[0] - 4.0) * (p[1] - 4.0));
    let topology = Topology::of(&trimmed);
    assert_eq!((topology.components, topology.boundary_edges), (2, 32));
    assert!((trimmed.area() - 32.0).abs() < 1e-12);
    let middle = trimmed.vertices.iter();
    let middle = middle.filter(|v| distance_between(**v, [4.0, 4.0, 0.0]) < 1e-12);
    assert_eq!(middle.count(), 2);
}

#[test]
fn nothing_near_leaves_nothing_and_nothing_far_leaves_all() {
    assert_eq!(cut(4, 1.0, &|_| 2.0), TriangleMesh::default());
    assert_eq!(cut(4, 1.0, &|_| 1.0), plane(4, &|_| 1.0));
}

/// Every boundary vertex lies on exactly two boundary edges; triangles agree on their sides, and there is one
/// piece with a boundary.
pub(crate) fn check_open_sheet(mesh: &TriangleMesh) {
    let mut sides: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            *sides.entry((*a.min(b), *a.max(b))).or_default() += 1;
        }
    }
    let mut ends: BTreeMap<u32, usize> = BTreeMap::new();
    for ((a, b), _) in sides.iter().filter(|(_, sides)| **sides == 1) {
        *ends.entry(*a).or_default() += 1;
        *ends.entry(*b).or_default() += 1;
    }
    assert!(!ends.is_empty(), "no boundary");
    for (vertex, edges) in ends {
        assert_eq!(edges, 2, "vertex {vertex}");
    }
    let topology = Topology::of(mesh);
    assert!(topology.manifold && topology.oriented, "{topology:?}");
    assert_eq!((topology.components, topology.closed), (1, false));
    assert_eq!(topology.degenerate_triangles, 0);
}

/// The zero set of `field`, cut `level` from the points, without the pieces that have none.
fn open(field: &dyn Field, points: &[Vec3], level: f64) -> TriangleMesh {
    let tree = PointTree::new(points).unwrap();
    let mut closed = extract(field, &request(80, 2)).unwrap().mesh;
    closed.distance_to_points = tree.distances(&closed.vertices);
    let trimmed = trim(&closed, level, &|places| tree.distances(places));
    let (mesh, _) = keep_components(trimmed, Components::Supported, points, level);
    check_open_sheet(&mesh);
    let measured = tree.distances(&mesh.vertices);
    assert!(measured.iter().all(|d| *d <= level));
    assert_eq!(measured, mesh.distance_to_points);
    mesh
}

/// Points of a sphere between two heights, as shares of its radius, evenly.
fn zone(radius: f64, heights: [f64; 2], count: usize) -> Vec<Vec3> {
    let golden_angle = PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|i| {
            let share = (i as f64 + 0.5) / count as f64;
            let z = heights[0] + share * (heights[1] - heights[0]);
            let (sin, cos) = (golden_angle * i as f64).sin_cos();
            let around = (1.0 - z * z).sqrt();
            [radius * around * cos, radius * around * sin, radius * z]
        })
        .collect()
}

#[test]
fn a_sphere_is_cut_to_its_cap_and_at_its_hole() {
    let (radius, level, angle) = (0.8, 0.1, PI / 3.0);
    let beyond = 2.0 * f64::asin(level / (2.0 * radius));
    for (heights, least) in [
        ([angle.cos(), 1.0], (angle + beyond).cos()),
        ([-1.0, angle.cos()], -(angle - beyond).cos()),
    ] {
        let mesh = open(&sphere(radius), &zone(radius, heights, 3_000), level);
        assert_eq!(Topology::of(&mesh).euler_characteristic, 1);
        let area = 2.0 * PI * radius * radius * (1.0 - least);
        let found = mesh.area();
        assert!((found / area - 1.0).abs() < 0.02, "{found} of {area}");
    }
}

#[test]
fn a_terrain_loses_the_bag_under_it() {
    let height = |x: f64, y: f64| 0.15 * (4.0 * x).sin() * (3.0 * y).cos();
    let slab = analytic(|[x, y, z]: Vec3| {
        let top = 0.5 * (height(x, y) - z);
        top.min(z + 0.6).min(0.9 - x.abs()).min(0.9 - y.abs())
    });
    let steps = 61;
    let at = |i: usize| -0.6 + 1.2 * i as f64 / (steps - 1) as f64;
    let points: Vec<Vec3> = (0..steps * steps)
        .map(|i| (at(i % steps), at(i / steps)))
        .map(|(x, y)| [x, y, height(x, y)])
        .collect();
    let level = 0.06;
    let mesh = open(&slab, &points, level);
    assert_eq!(Topology::of(&mesh).euler_characteristic, 1);
    // The area of the graph over small squares whose middle is within the level.
    let tree = PointTree::new(&points).unwrap();
    let side = 1.4 / 400.0;
    let middle = |i: usize| -0.7 + side * (i as f64 + 0.5);
    let places: Vec<Vec3> = (0..400 * 400)
        .map(|i| (middle(i % 400), middle(i / 400)))
        .map(|(x, y)| [x, y, height(x, y)])
        .collect();
    let within = places.iter().zip(tree.distances(&places));
    let area: f64 = within
        .filter(|(_, distance)| *distance <= level)
        .map(|([x, y, _], _)| {
            let slopes = [
                0.6 * (4.0 * x).cos() * (3.0 * y).cos(),
                -0.45 * (4.0 * x).sin() * (3.0 * y).sin(),
            ];
            side * side * (1.0 + slopes[0].powi(2) + slopes[1].powi(2)).sqrt()
        })
        .sum();
    let found = mesh.area();
    assert!((found / area - 1.0).abs() < 0.02, "{found} of {area}");
}
