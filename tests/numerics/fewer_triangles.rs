//! Runs that ask for fewer triangles: `surface.target_triangles`.

use meshway::reconstruction::cloud::PointCloud;
use meshway::reconstruction::quality::compare_meshes;
use meshway::reconstruction::settings::{Preset, Settings};
use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use meshway::reconstruction::{Reconstruction, reconstruct};
use serde_json::json;

use crate::uncertainty::Silent;

const TORUS: Shape = Shape::Torus {
    major: 1.0,
    minor: 0.4,
};

fn cloud(noise_percent: f64) -> PointCloud {
    let recipe = Recipe {
        points: 1_500,
        noise_percent,
        ..Recipe::default()
    };
    sample(&TORUS, &recipe)
}

fn made(cloud: &PointCloud, target_triangles: usize) -> Reconstruction {
    let given = json!({
        "training": {"max_evaluations": 150},
        "surface": {"resolution": 96, "target_triangles": target_triangles},
    });
    let settings = Settings::resolve(Preset::Fast, &given).unwrap();
    tch::set_num_threads(1);
    reconstruct(cloud, &settings, &Silent).unwrap()
}

fn warned(made: &Reconstruction) -> bool {
    let mut warnings = made.report.warnings.iter();
    warnings.any(|warning| warning.code == "triangles_above_target")
}

#[test]
fn a_mesh_has_the_triangles_that_were_asked_for() {
    let cloud = cloud(0.0);
    let all = made(&cloud, 0);
    assert_eq!(all.report.surface.simplification, None);
    let fewer = made(&cloud, 5_000);
    let done = fewer.report.surface.simplification.unwrap();
    assert_eq!(done.triangles_before, all.mesh.triangles.len());
    assert_eq!(done.triangles, fewer.mesh.triangles.len());
    assert!((4_900..=5_000).contains(&done.triangles), "{done:?}");
    assert_eq!(done.target_triangles, 5_000);
    assert!(done.error <= done.error_bound, "{done:?}");
    let compared = compare_meshes(&fewer.mesh, &all.mesh, 1).unwrap();
    let furthest = compared.hausdorff_percent / 100.0 * compared.diagonal;
    assert!(furthest <= 1.05 * done.error_bound, "{furthest}, {done:?}");
    let topology = &fewer.report.mesh.topology;
    assert!(topology.closed && topology.manifold && topology.oriented);
    assert_eq!(topology.genus, Some(1));
    assert_eq!(fewer.mesh.normals.len(), fewer.mesh.vertices.len());
    assert_eq!(
        fewer.mesh.distance_to_points.len(),
        fewer.mesh.vertices.len()
    );
    assert!(!warned(&fewer));
    assert!(fewer.report.summary().contains("simplified from"));

    // No number above that of the mesh changes a bit of it.
    let as_many = made(&cloud, all.mesh.triangles.len());
    assert_eq!(as_many.mesh, all.mesh);
    assert_eq!(as_many.report.surface, all.report.surface);
}

#[test]
fn the_points_say_how_far_the_surface_may_move() {
    let mut errors = Vec::new();
    for noise in [0.0, 1.0] {
        let made = made(&cloud(noise), 20);
        let done = made.report.surface.simplification.unwrap();
        assert!(warned(&made), "{done:?}");
        assert!(done.triangles > 20 && done.triangles < done.triangles_before / 4);
        assert!(done.error <= done.error_bound, "{done:?}");
        assert_eq!(made.report.mesh.topology.genus, Some(1));
        let cloud = made.report.cloud;
        let bound = f64::max(0.05 * cloud.spacing, 0.25 * cloud.noise.unwrap());
        assert!((done.error_bound / bound - 1.0).abs() < 1e-9);
        errors.push(done.error_bound);
    }
    assert!(errors[1] > 1.5 * errors[0], "{errors:?}");
}
