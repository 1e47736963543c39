//! Which clouds are refused before any work, and how clouds are put together.

use meshway::reconstruction::Error as ReconstructionError;
use meshway::reconstruction::cloud::{Label, PointCloud};
use meshway::reconstruction::vector::Vec3;

fn of(points: Vec<Vec3>) -> PointCloud {
    PointCloud {
        points,
        ..PointCloud::default()
    }
}

/// Points on a spiral over the unit sphere.
fn sphere(n: usize) -> Vec<Vec3> {
    let point = |i: usize| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
        let (sin, cos) = (2.4 * i as f64).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        [radius * cos, radius * sin, z]
    };
    (0..n).map(point).collect()
}

fn mapped(map: impl Fn(Vec3) -> Vec3) -> PointCloud {
    of(sphere(100).into_iter().map(map).collect())
}

fn code(cloud: &PointCloud) -> &'static str {
    cloud
        .validate()
        .map_or_else(|error| ReconstructionError::from(error).code(), |()| "fine")
}

#[test]
fn spheres_of_any_sensible_size_and_place_are_fine() {
    assert_eq!(code(&of(sphere(16))), "fine");
    for size in [1e-90, 1e-6, 1.0, 1e6, 1e14] {
        assert_eq!(code(&mapped(|p| p.map(|v| v * size))), "fine", "{size:e}");
    }
    assert_eq!(code(&mapped(|p| p.map(|v| v + 1e6))), "fine");
    assert_eq!(code(&mapped(|p| p.map(|v| v * 1e-3 + 6e6))), "fine");
    // A thousandth as thick as it is wide, a sheet is still a body.
    assert_eq!(code(&mapped(|[x, y, z]| [x, y, z * 1e-3])), "fine");
}

#[test]
fn too_few_points_are_refused() {
    assert_eq!(code(&PointCloud::default()), "cloud_empty");
    assert_eq!(code(&of(sphere(15))), "cloud_too_few_points");
    assert_eq!(
        code(&of([sphere(15), sphere(15)].concat())),
        "cloud_too_few_points"
    );
    let mut inside = of(sphere(100)).with_label(Label::Interior);
    assert_eq!(code(&inside), "cloud_too_few_points");
    inside.append(of(sphere(16)));
    assert_eq!(code(&inside), "fine");
}

#[test]
fn points_without_volume_are_refused() {
    assert_eq!(code(&mapped(|_| [1.0, 2.0, 3.0])), "cloud_degenerate");
    let turned = |a: f64, b: f64| [a + 2.0 * b, 3.0 * a - b, 0.7 * a + 0.1 * b];
    assert_eq!(code(&mapped(|[x, ..]| turned(x, 0.0))), "cloud_degenerate");
    assert_eq!(code(&mapped(|[x, y, _]| turned(x, y))), "cloud_degenerate");
    // A plane whose coordinates went through f32.
    let rounded = |[x, y, _]: Vec3| turned(x, y).map(|v| f64::from(v as f32));
    assert_eq!(code(&mapped(rounded)), "cloud_degenerate");
    assert_eq!(code(&mapped(|p| p.map(|v| v * 1e-300))), "cloud_degenerate");
    assert_eq!(
        code(&mapped(|p| p.map(|v| v * 1e-6 + 1e12))),
        "cloud_degenerate"
    );
    assert_eq!(
        code(&mapped(|p| p.map(|v| v * 0.1 + 1e12))),
        "cloud_degenerate"
    );
}

#[test]
fn numbers_that_cannot_be_worked_with_are_refused() {
    assert_eq!(code(&mapped(|p| p.map(|v| v * 1e30))), "cloud_too_large");
    let mut far = of(sphere(100));
    far.points[7][1] = -1.1e15;
    assert_eq!(code(&far), "cloud_too_large");
    far.points[7][1] = f64::NAN;
    assert_eq!(code(&far), "cloud_not_finite");
    let mut few = of(sphere(100));
    few.normals = Some(sphere(99));
    assert_eq!(code(&few), "normals_invalid");
}

#[test]
fn appended_clouds_keep_what_either_has() {
    let surface = || PointCloud {
        normals: Some(sphere(3)),
        ..of(sphere(3))
    };
    let mut cloud = PointCloud::default();
    cloud.append(surface());
    cloud.append(PointCloud::default());
    assert_eq!(cloud, surface());
    cloud.append(surface());
    assert_eq!(cloud.normals.as_ref().unwrap().len(), 6);
    assert_eq!(cloud.labels, None);
    cloud.append(of(sphere(1)).with_label(Label::Interior));
    cloud.append(of(sphere(1)));
    assert_eq!(
        cloud.normals.as_ref().unwrap()[5..],
        [sphere(3)[2], [0.0; 3], [0.0; 3]]
    );
    assert_eq!(cloud.points.len(), 8);
    assert_eq!(cloud.indices(Label::Interior).collect::<Vec<_>>(), [6]);
    assert_eq!(cloud.labels.unwrap().len(), 8);
}
