//! Fewer triangles for extracted surfaces, also where collapses would pinch, fold or close something.

use std::cell::Cell;
use std::collections::BTreeMap;

use meshway::reconstruction::Error;
use meshway::reconstruction::mesh::{
    Limits, PointTree, Simplified, Topology, TriangleMesh, simplify, trim,
};
use meshway::reconstruction::quality::compare_meshes;
use meshway::reconstruction::shapes::Shape;
use meshway::reconstruction::surface::{Field, Request, extract};
use meshway::reconstruction::vector::{Vec3, add, cross, distance, dot, norm, sub};

use super::closed::{areas, check_closed_manifold};
use super::fields::{analytic, sphere, torus};
use super::request;
use super::trim::check_open_sheet;

fn simplified(mesh: &TriangleMesh, triangles: usize, error: f64) -> Simplified {
    let mut mesh = mesh.clone();
    // A channel that tells where a vertex came from.
    mesh.distance_to_points = (0..mesh.vertices.len()).map(|v| v as f64).collect();
    simplify(mesh, Limits { triangles, error }, &|| false).unwrap()
}

fn extracted(field: &dyn Field, resolution: usize) -> TriangleMesh {
    extract(field, &request(resolution, 2)).unwrap().mesh
}

fn shape(shape: &Shape, resolution: usize) -> TriangleMesh {
    let bounds = shape.bounds();
    let bounds = bounds.padded(0.1 * bounds.longest_edge());
    extract(shape, &Request::new(bounds, resolution))
        .unwrap()
        .mesh
}

/// Fails unless `simplified` is some vertices of `original` and as sound as that, within `error`.
fn check(original: &TriangleMesh, simplified: &Simplified, error: f64) {
    let mesh = &simplified.mesh;
    check_closed_manifold(mesh);
    let [before, after] = [original, mesh].map(Topology::of);
    assert_eq!(after.genus, before.genus);
    assert_eq!(after.components, before.components);
    assert_eq!(after.degenerate_triangles, 0);
    assert_eq!(mesh.distance_to_points.len(), mesh.vertices.len());
    for (v, origin) in mesh.distance_to_points.iter().enumerate() {
        let origin = *origin as usize;
        let bits = |of: &TriangleMesh, v: usize| {
            [of.vertices[v], of.normals[v]].map(|vector| vector.map(f64::to_bits))
        };
        assert_eq!(bits(mesh, v), bits(original, origin));
        assert!((norm(mesh.normals[v]) - 1.0).abs() < 1e-12);
    }
    for (triangle, area) in mesh.triangles.iter().zip(areas(mesh)) {
        let [a, b, c] = triangle.map(|v| mesh.normals[v as usize]);
        assert!(dot(area, add(a, add(b, c))) > 0.0, "a triangle is turned");
    }
    assert!(!runs_through_itself(mesh), "triangles cross");
    assert!(simplified.error <= error);
    let compared = compare_meshes(mesh, original, 1).unwrap();
    let furthest = compared.hausdorff_percent / 100.0 * compared.diagonal;
    // Measured in other places than those that the bound was kept at.
    assert!(furthest <= 1.05 * error, "{furthest} above {error}");
}

/// Whether an edge runs through a triangle that it has no corner of; of small meshes only.
fn runs_through_itself(mesh: &TriangleMesh) -> bool {
    if mesh.triangles.len() > 3_000 {
        return false;
    }
    let at = |v: u32| mesh.vertices[v as usize];
    let volume = |[a, b, c, d]: [Vec3; 4]| dot(sub(a, d), cross(sub(b, d), sub(c, d)));
    let crosses = |[p, q]: [u32; 2], corners: [u32; 3]| {
        let [a, b, c] = corners.map(at);
        let (p, q) = (at(p), at(q));
        let ends = volume([a, b, c, p]) * volume([a, b, c, q]);
        let sides = [[a, b], [b, c], [c, a]].map(|[u, v]| volume([u, v, p, q]) > 0.0);
        ends < 0.0 && (sides == [true; 3] || sides == [false; 3])
    };
    mesh.triangles.iter().any(|[a, b, c]| {
        let edges = [[*a, *b], [*b, *c], [*c, *a]];
        edges
            .into_iter()
            .filter(|[from, to]| from < to)
            .any(|edge| {
                let mut apart = mesh.triangles.iter();
                apart.any(|other| edge.iter().all(|v| !other.contains(v)) && crosses(edge, *other))
            })
    })
}

#[test]
fn shapes_come_down_to_the_number_asked_for() {
    let ring = Shape::Torus {
        major: 1.0,
        minor: 0.4,
    };
    for (name, shape_of, genus) in [("torus", ring, 1), ("hand", Shape::Hand, 0)] {
        let mesh = shape(&shape_of, 120);
        let error = 0.01 * mesh.bounds().unwrap().longest_edge();
        for triangles in [10_000, 2_000] {
            let result = simplified(&mesh, triangles, error);
            check(&mesh, &result, error);
            let left = result.mesh.triangles.len();
            assert!(left <= triangles, "{name}: {left} of {triangles}");
            assert!(left * 100 > triangles * 98, "{name}: {left}");
            assert_eq!(Topology::of(&result.mesh).genus, Some(genus), "{name}");
        }
    }
}

#[test]
fn the_error_goes_before_the_number() {
    let mesh = extracted(&torus(0.6, 0.25), 100);
    let mut last = 4;
    for error in [0.01, 0.003, 0.001] {
        let result = simplified(&mesh, 4, error);
        check(&mesh, &result, error);
        let left = result.mesh.triangles.len();
        assert!(left > last && left < mesh.triangles.len() / 2, "{left}");
        // Not far below what is allowed: more was possible otherwise.
        assert!(result.error > 0.5 * error, "{} of {error}", result.error);
        last = left;
    }
}

#[test]
fn what_is_thinner_than_the_error_is_neither_pinched_nor_closed() {
    let thin_ring = torus(0.6, 0.03);
    let plate = analytic(|p: Vec3| {
        let across = (p[2] + 0.2 * p[0]).abs() - 0.02;
        -across.max(p[0].hypot(p[1]) - 0.7)
    });
    let gap = analytic(|p: Vec3| {
        (0.3 - distance(p, [-0.31, 0.0, 0.0])).max(0.3 - distance(p, [0.31, 0.0, 0.0]))
    });
    let neck = analytic(|p: Vec3| {
        let balls = (0.3 - distance(p, [-0.4, 0.0, 0.0])).max(0.3 - distance(p, [0.4, 0.0, 0.0]));
        balls.max((0.03 - p[1].hypot(p[2])).min(0.4 - p[0].abs()))
    });
    // Facets of one sheet would run through the other.
    let shell = analytic(|p: Vec3| 0.02 - (norm(p) - 0.7).abs());
    let fields: [(&str, &dyn Field); 5] = [
        ("ring", &thin_ring),
        ("plate", &plate),
        ("shell", &shell),
        ("gap", &gap),
        ("neck", &neck),
    ];
    for (name, field) in fields {
        // Newton steps run over the edge of the plate.
        let mesh = extract(field, &request(80, 0)).unwrap().mesh;
        let result = simplified(&mesh, 10, 0.06);
        check(&mesh, &result, 0.06);
        let left = result.mesh.triangles.len();
        assert!(left < mesh.triangles.len() / 2, "{name}: {left}");
    }
}

#[test]
fn small_components_stay() {
    let dust = analytic(|p: Vec3| {
        let ball = 0.5 - norm(p);
        let grains = (0..8).map(|i| {
            let at = |bit: i32| if i >> bit & 1 == 1 { 0.7 } else { -0.7 };
            0.03 - distance(p, [at(0), at(1), at(2)])
        });
        grains.fold(ball, f64::max)
    });
    let mesh = extracted(&dust, 70);
    assert_eq!(Topology::of(&mesh).components, 9);
    check(&mesh, &simplified(&mesh, 10, 0.1), 0.1);
}

#[test]
fn open_sheets_keep_their_boundary() {
    let mut mesh = extracted(&sphere(0.8), 80);
    let points: Vec<Vec3> = mesh
        .vertices
        .iter()
        .copied()
        .filter(|v| v[2] > 0.3)
        .collect();
    let tree = PointTree::new(&points).unwrap();
    mesh.distance_to_points = tree.distances(&mesh.vertices);
    let cap = trim(&mesh, 0.05, &|places| tree.distances(places));
    let result = simplified(&cap, 500, 0.02);
    assert!(result.mesh.triangles.len() <= 500);
    check_open_sheet(&result.mesh);
    let compared = compare_meshes(&result.mesh, &cap, 1).unwrap();
    assert!(compared.hausdorff_percent / 100.0 * compared.diagonal <= 0.021);
}

#[test]
fn nothing_changes_where_nothing_is_to_be_done() {
    let mesh = extracted(&sphere(0.5), 40);
    let all = mesh.triangles.len();
    for (triangles, error) in [(all, 0.1), (2 * all, 0.1), (4, 0.0)] {
        let limits = Limits { triangles, error };
        let same = simplify(mesh.clone(), limits, &|| false).unwrap();
        assert_eq!(same.mesh, mesh);
        assert!(same.error.abs() < f64::MIN_POSITIVE);
    }
    let empty = simplify(
        TriangleMesh::default(),
        Limits {
            triangles: 0,
            error: 1.0,
        },
        &|| false,
    );
    assert_eq!(empty.unwrap().mesh, TriangleMesh::default());
}

#[test]
fn a_far_origin_changes_nothing() {
    let mesh = extracted(&torus(0.6, 0.25), 60);
    let far = [3e6, -5e6, 1e5];
    let mut moved = mesh.clone();
    for vertex in &mut moved.vertices {
        *vertex = add(*vertex, far);
    }
    let near = simplified(&mesh, 1_000, 0.02).mesh.triangles.len();
    let result = simplified(&moved, 1_000, 0.02);
    check_closed_manifold(&result.mesh);
    assert_eq!(result.mesh.triangles.len(), near);
}

#[test]
fn the_same_mesh_gives_the_same_result() {
    let mesh = extracted(&torus(0.6, 0.25), 70);
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let run = || simplified(&mesh, 4, 0.004);
        pool.build().unwrap().install(run)
    };
    let first = run(1);
    assert_eq!(first, run(3));
    assert_eq!(first, run(3));
}

#[test]
fn it_stops_when_asked() {
    let mesh = extracted(&torus(0.6, 0.25), 50);
    let asked = Cell::new(0);
    let stopped = || {
        asked.set(asked.get() + 1);
        asked.get() > 1
    };
    let limits = Limits {
        triangles: 4,
        error: 0.002,
    };
    let result = simplify(mesh, limits, &stopped);
    assert!(matches!(result, Err(Error::Cancelled)));
    assert_eq!(asked.get(), 2);
}

#[test]
fn a_rough_surface_stays_a_manifold() {
    // Ripples as fine as the cells.
    let rough = analytic(|p: Vec3| {
        let ripple = (40.0 * p[0]).sin() * (37.0 * p[1]).sin() * (43.0 * p[2]).cos();
        0.6 - norm(p) + 0.08 * ripple
    });
    let mesh = extracted(&rough, 50);
    let genus = Topology::of(&mesh).genus;
    for error in [0.02, 0.1] {
        let result = simplified(&mesh, 100, error);
        check_closed_manifold(&result.mesh);
        assert_eq!(Topology::of(&result.mesh).genus, genus);
        assert!(!runs_through_itself(&result.mesh));
        assert!(result.error <= error);
        let mut uses: BTreeMap<[u32; 3], usize> = BTreeMap::new();
        for triangle in &result.mesh.triangles {
            let mut corners = *triangle;
            corners.sort_unstable();
            *uses.entry(corners).or_default() += 1;
        }
        assert!(
            uses.values().all(|uses| *uses == 1),
            "two triangles in one place"
        );
    }
}
