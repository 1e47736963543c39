//! Distances and the report, against closed forms.

use meshway::reconstruction::mesh::{
    Distances, PointTree, SurfaceTree, TriangleMesh, components, sample_surface,
};
use meshway::reconstruction::quality::{Judge, compare_meshes, describe};
use meshway::reconstruction::random::{Generator, Purpose, stream};
use meshway::reconstruction::vector::{Bounds, Vec3, distance, dot, norm, normalized};
use rand::RngExt;

use super::{cube, moved, sphere, tetrahedron, together, torus};

fn random_points(count: usize, size: f64) -> Vec<Vec3> {
    let mut generator: Generator = stream(7, Purpose::Sampling);
    (0..count)
        .map(|_| std::array::from_fn(|_| size * (2.0 * generator.random::<f64>() - 1.0)))
        .collect()
}

/// Distance from the unit cube [0, 1]³'s surface.
fn distance_from_cube(p: Vec3) -> f64 {
    let outside = norm(p.map(|x| (x - 1.0).max(-x).max(0.0)));
    if outside > 0.0 {
        outside
    } else {
        p.into_iter().fold(1.0, |d, x| d.min(x).min(1.0 - x))
    }
}

#[test]
fn distances_from_a_cube_are_exact() {
    let points = random_points(2_000, 3.0);
    for offset in [0.0, 1e6] {
        let mesh = moved(cube(), [offset; 3]);
        let tree = SurfaceTree::new(&mesh).unwrap();
        // At 1e6 the query points themselves are rounded by 1e-10.
        let tolerance = if offset > 0.0 { 1e-9 } else { 1e-14 };
        for p in &points {
            let found = tree.closest(p.map(|x| x + offset)).distance;
            assert!((found - distance_from_cube(*p)).abs() < tolerance, "{p:?}");
        }
    }
}

/// How far the facets of a mesh with its vertices on a sphere around the origin lie below it.
fn depth_of_facets(mesh: &TriangleMesh) -> f64 {
    let planes = (0..mesh.triangles.len()).map(|t| {
        let normal = normalized(mesh.area_vector(t)).unwrap();
        dot(normal, mesh.corners(t)[0])
    });
    norm(mesh.vertices[0]) - planes.fold(f64::MAX, f64::min)
}

#[test]
fn distances_from_a_fine_sphere_approach_those_from_the_sphere() {
    let mesh = sphere(1.0, 5);
    let tree = SurfaceTree::new(&mesh).unwrap();
    let depth = depth_of_facets(&mesh);
    assert!(depth < 1e-3, "{depth}");
    for p in random_points(1_000, 2.0) {
        let error = tree.closest(p).distance - (norm(p) - 1.0).abs();
        // Rounding comes on top.
        assert!(error.abs() < depth + 1e-14, "{error}");
    }
}

#[test]
fn triangles_without_area_do_not_disturb_the_search() {
    let mut mesh = cube();
    mesh.triangles.insert(0, [0, 0, 7]);
    mesh.triangles.insert(5, [1, 1, 1]);
    let closest = SurfaceTree::new(&mesh).unwrap().closest([0.25, 0.5, 1.5]);
    assert_eq!(closest.distance.to_bits(), 0.5f64.to_bits());
    assert!(mesh.corners(closest.triangle).iter().all(|v| v[2] > 0.5));
    mesh.triangles = vec![[0, 0, 7]];
    assert!(SurfaceTree::new(&mesh).is_none());
    assert!(SurfaceTree::new(&TriangleMesh::default()).is_none());
}

#[test]
fn a_point_that_is_not_finite_is_infinitely_far() {
    let tree = SurfaceTree::new(&cube()).unwrap();
    assert!(tree.closest([f64::NAN, 0.0, 0.0]).distance.is_infinite());
}

#[test]
fn the_nearest_point_is_that_of_a_search_through_all() {
    let mut cloud = random_points(3_000, 1.0);
    // Many points at one place, and many in one plane, are hard for a k-d tree.
    cloud.extend([[0.5; 3]; 100]);
    cloud.extend(random_points(500, 1.0).iter().map(|p| [p[0], p[1], 0.25]));
    let queries = random_points(300, 1.5);
    let found = PointTree::new(&cloud).unwrap().distances(&queries);
    for (q, found) in queries.iter().zip(found) {
        let nearest = cloud
            .iter()
            .map(|p| distance(*p, *q))
            .fold(f64::MAX, f64::min);
        assert_eq!(found.to_bits(), nearest.to_bits());
    }
    assert!(PointTree::new(&[]).is_none());
}

#[test]
fn samples_lie_on_the_surface_and_follow_the_area() {
    // Triangles of very different sizes: a square of 100 parts of the area and one of 1.
    let mesh = TriangleMesh {
        vertices: vec![
            [0.0, 0.0, 0.0],
            [10.0, 0.0, 0.0],
            [0.0, 10.0, 0.0],
            [0.0, 0.0, 5.0],
            [1.0, 0.0, 5.0],
            [0.0, 1.0, 5.0],
        ],
        triangles: vec![[0, 1, 2], [3, 3, 4], [3, 4, 5]],
        ..TriangleMesh::default()
    };
    let samples = sample_surface(&mesh, 10_100, &mut stream(1, Purpose::Shape));
    let small = samples.iter().filter(|s| s.triangle == 2).count();
    // One sample a share, so at most the one share on the border is uncertain.
    assert!((99..=101).contains(&small), "{small}");
    let tree = SurfaceTree::new(&mesh).unwrap();
    // Rounding of coordinates up to 10.
    assert!(
        samples
            .iter()
            .all(|s| tree.closest(s.position).distance < 1e-14)
    );
    // The mean of uniform points is the centroid; its standard error is 10 √(1/18) / √10000 = 0.024.
    let mean = samples
        .iter()
        .filter(|s| s.triangle == 0)
        .map(|s| s.position[0])
        .sum::<f64>()
        / 10_000.0;
    assert!((mean - 10.0 / 3.0).abs() < 0.1, "{mean}");
    assert!(sample_surface(&TriangleMesh::default(), 5, &mut stream(1, Purpose::Shape)).is_empty());
}

#[test]
fn distances_are_summed_up_as_numpy_does() {
    let distances = Distances::of(&[4.0, 1.0, 3.0, 2.0], 50.0).unwrap();
    // numpy.percentile([1, 2, 3, 4], 95) = 3.85.
    let expected = [2.5, 7.5f64.sqrt(), 3.85, 4.0];
    let found = [distances.mean, distances.rms, distances.p95, distances.max];
    let percent = [
        distances.mean_percent,
        distances.rms_percent,
        distances.p95_percent,
        distances.max_percent,
    ];
    for ((found, percent), expected) in found.into_iter().zip(percent).zip(expected) {
        // A rounding or two.
        assert!((found - expected).abs() < 1e-14);
        assert!((percent - 2.0 * expected).abs() < 1e-14);
    }
    assert!(Distances::of(&[], 1.0).is_none());
    assert!(Distances::of(&[1.0], 0.0).is_none());
}

#[test]
fn concentric_spheres_are_as_far_apart_as_their_radii() {
    let (inner, outer) = (sphere(1.0, 5), sphere(1.1, 5));
    let comparison = compare_meshes(&inner, &outer, 1).unwrap();
    let percent = 100.0 / comparison.diagonal;
    // The diagonal is that of the outer one.
    assert!((comparison.diagonal - 2.2 * 3f64.sqrt()).abs() < 1e-12);
    // Each end of a distance lies on a facet, which is at most that deep; in the mean they cancel.
    let tolerance = depth_of_facets(&outer) * percent;
    assert!((comparison.chamfer_percent - 0.1 * percent).abs() < tolerance);
    assert!((comparison.hausdorff_95_percent - 0.1 * percent).abs() < tolerance);
    assert!((comparison.hausdorff_percent - 0.1 * percent).abs() < tolerance);
    // Neighbouring facets differ by some 3°; the cosine of that is 0.9986.
    assert!(comparison.normal_agreement > 0.998);
}

#[test]
fn a_mesh_is_no_distance_from_itself() {
    let mesh = torus(1.0, 0.4, 24);
    let comparison = compare_meshes(&mesh, &mesh, 3).unwrap();
    // Rounding only.
    assert!(comparison.hausdorff_percent < 1e-12);
    // A sample within rounding of an edge may count for the neighbour.
    assert!(comparison.normal_agreement > 1.0 - 1e-6);
}

#[test]
fn a_missing_half_shows_in_one_direction_only() {
    let whole = sphere(1.0, 4);
    let mut half = whole.clone();
    half.triangles
        .retain(|t| t.iter().all(|&v| whole.vertices[v as usize][2] > -1e-12));
    let comparison = compare_meshes(&half, &whole, 1).unwrap();
    assert!(comparison.mesh_to_reference.max < 1e-12);
    // The south pole is √2 from the equator; a sample lies within one facet of it.
    let farthest = comparison.reference_to_mesh.max;
    assert!((farthest - 2f64.sqrt()).abs() < 0.05, "{farthest}");
}

#[test]
fn a_cloud_on_the_surface_is_near_it_both_ways() {
    let mesh = sphere(1.0, 5);
    let judge = Judge::new(&mesh, &mesh.vertices, 1).unwrap();
    let all = 0..mesh.vertices.len();
    let comparison = judge.compare(all, Bounds::of(&mesh.vertices)).unwrap();
    assert!(comparison.cloud_to_mesh.max < 1e-14);
    // No point of a facet is farther from a corner than half of the longest edge / cos 30°.
    assert!(comparison.mesh_to_cloud.max < 0.05);
    assert!(comparison.mesh_to_cloud.mean > 0.005);
    assert!(judge.compare(0..0, Bounds::of(&mesh.vertices)).is_none());
    // A single point, and even a cloud in one place, have percentages of something.
    let point = &[[0.0, 0.0, 2.0]];
    for whole in [&mesh.vertices[..], point] {
        let judge = Judge::new(&mesh, point, 1).unwrap();
        let comparison = judge.compare(0..1, Bounds::of(whole)).unwrap();
        let percent = comparison.cloud_to_mesh.mean_percent;
        assert!(
            (percent - 100.0 / comparison.diagonal).abs() < 0.1,
            "{percent}"
        );
        assert!((comparison.diagonal - 12f64.sqrt()).abs() < 0.01);
    }
    assert!(Judge::new(&TriangleMesh::default(), point, 1).is_none());
}

#[test]
fn the_same_seed_gives_the_same_report_on_any_number_of_threads() {
    let (a, b) = (sphere(1.0, 3), torus(1.0, 0.3, 16));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| compare_meshes(&a, &b, 5))
    };
    assert_eq!(on(1), on(3));
    assert_ne!(on(1), compare_meshes(&a, &b, 6));
}

#[test]
fn normals_agree_with_the_mesh_they_belong_to() {
    let mesh = sphere(1.0, 5);
    let points: Vec<Vec3> = random_points(500, 1.0)
        .into_iter()
        .map(|p| normalized(p).unwrap())
        .collect();
    let inward: Vec<Vec3> = points.iter().map(|p| p.map(|x| -3.0 * x)).collect();
    // A facet with edges of 0.08 is tilted by at most 0.04 from the sphere: cosine 0.9992.
    let judge = Judge::new(&mesh, &points, 1).unwrap();
    assert!(judge.normal_agreement(&points).unwrap() > 0.999);
    assert!(judge.normal_agreement(&inward).unwrap() < -0.999);
    assert!(judge.normal_agreement(&vec![[0.0; 3]; 500]).is_none());
}

#[test]
fn each_corner_of_a_triangle_has_a_third_of_its_area() {
    let mut mesh = together(cube(), &tetrahedron());
    assert!(
        mesh.share_beyond(0.0).abs() < f64::EPSILON,
        "nothing is known"
    );
    // Only the corner 1 of the tetrahedron is far; three triangles meet there.
    mesh.distance_to_points = vec![1.0; 12];
    mesh.distance_to_points[9] = 1.5;
    let area = 1.0 + 0.5 * 3f64.sqrt();
    let share = area / 3.0 / mesh.area();
    assert!((mesh.share_beyond(1.2) - share).abs() < 1e-14);
    assert!((mesh.share_beyond(0.9) - 1.0).abs() < 1e-14);
    assert!(mesh.share_beyond(1.5).abs() < f64::EPSILON);
    // The distances stay with their vertices.
    let (ids, _) = components(&mesh);
    mesh.retain_components(&[false, true], &ids);
    assert_eq!(mesh.vertices.len(), 4);
    assert_eq!(mesh.distance_to_points, [1.0, 1.5, 1.0, 1.0]);
}

#[test]
fn the_description_is_flat_json() {
    let report = serde_json::to_value(describe(&cube())).unwrap();
    assert_eq!(report["triangles"], 12);
    assert_eq!(report["components"], 1);
    assert_eq!(report["volume"], 1.0);
    assert_eq!(report["bounds"]["max"][2], 1.0);
    let mut open = cube();
    open.triangles.pop();
    let report = serde_json::to_value(describe(&open)).unwrap();
    assert!(report["volume"].is_null() && report["genus"].is_null());
    assert_eq!(report["boundary_edges"], 3);
}
