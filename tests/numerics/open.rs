//! Open sheets: closed with a bag, or cut where no points are near.

use meshway::reconstruction::cloud::PointCloud;
use meshway::reconstruction::mesh::read::read;
use meshway::reconstruction::quality::compare_meshes;
use meshway::reconstruction::random::{Purpose, stream};
use meshway::reconstruction::settings::{Preset, Settings};
use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use meshway::reconstruction::{Reconstruction, reconstruct};
use rand::RngExt;
use serde_json::json;

use crate::kinds::bare;
use crate::mesh::formats::{READABLE, written};
use crate::surface::trim::check_open_sheet;
use crate::uncertainty::Silent;

fn made(cloud: &PointCloud, open: &str) -> Reconstruction {
    made_of(cloud, open, 0)
}

fn made_of(cloud: &PointCloud, open: &str, target_triangles: usize) -> Reconstruction {
    let given = json!({
        "training": {"max_evaluations": 150},
        "surface": {"resolution": 64, "open": open, "target_triangles": target_triangles},
    });
    let settings = Settings::resolve(Preset::Fast, &given).unwrap();
    tch::set_num_threads(1);
    reconstruct(cloud, &settings, &Silent).unwrap()
}

/// `count` pairs of numbers from 0 to 1.
fn pairs(count: usize) -> Vec<[f64; 2]> {
    let mut random = stream(7, Purpose::Shape);
    (0..count)
        .map(|_| [random.random(), random.random()])
        .collect()
}

fn terrain() -> PointCloud {
    let points = pairs(2_000).into_iter().map(|[x, y]| {
        let [x, y] = [10.0 * x, 8.0 * y];
        [x, y, 0.5 * x.sin() * (0.8 * y).cos()]
    });
    bare(points.collect())
}

/// The part of a sphere of radius 2 above a height, as a share of the radius.
fn cap(height: f64) -> PointCloud {
    let points = pairs(2_000).into_iter().map(|[u, v]| {
        let z = height + u * (1.0 - height);
        let (sin, cos) = (std::f64::consts::TAU * v).sin_cos();
        let around = (1.0 - z * z).sqrt();
        [2.0 * around * cos, 2.0 * around * sin, 2.0 * z]
    });
    bare(points.collect())
}

#[test]
fn open_sheets_are_cut_where_the_points_end() {
    for (name, cloud) in [
        ("terrain", terrain()),
        ("cap", cap(0.3)),
        ("hole", cap(-0.6)),
    ] {
        let made = made(&cloud, "trimmed");
        check_open_sheet(&made.mesh);
        let report = &made.report;
        let surface = &report.surface;
        let level = surface.support_distance;
        let furthest = made
            .mesh
            .distance_to_points
            .iter()
            .fold(0.0, |a: f64, b| a.max(*b));
        assert!(furthest <= level, "{name}: {furthest} above {level}");
        assert!(surface.trimmed_area_percent > 1.0, "{name}: {surface:?}");
        assert!(!report.mesh.topology.closed && report.mesh.topology.boundary_edges > 10);
        assert_eq!(report.mesh.volume, None);
        let warned = report
            .warnings
            .iter()
            .any(|w| w.code == "surface_unsupported");
        assert!(!warned, "{name}");
        assert!(report.summary().contains("cut away"), "{name}");
        for format in READABLE {
            let again = read(&written(&made.mesh, format), None).unwrap();
            assert_eq!(
                again.triangles.len(),
                made.mesh.triangles.len(),
                "{format:?}"
            );
        }
    }
}

#[test]
fn a_sheet_with_fewer_triangles_ends_where_it_ended() {
    let [all, fewer] = [0, 5_000].map(|target| made_of(&terrain(), "trimmed", target));
    check_open_sheet(&fewer.mesh);
    assert!(fewer.mesh.triangles.len() <= 5_000);
    let [before, after] = [&all, &fewer].map(|made| &made.report.surface);
    let change = before.trimmed_area_percent - after.trimmed_area_percent;
    assert!(change.abs() < 1e-9);
    let mut furthest = fewer.mesh.distance_to_points.iter();
    assert!(furthest.all(|distance| *distance <= after.support_distance));
    let compared = compare_meshes(&fewer.mesh, &all.mesh, 1).unwrap();
    let moved = compared.hausdorff_percent / 100.0 * compared.diagonal;
    assert!(moved <= 1.05 * after.simplification.unwrap().error_bound);
}

#[test]
fn auto_cuts_open_sheets_and_leaves_closed_surfaces() {
    let closed = made(&terrain(), "closed");
    let auto = made(&terrain(), "auto");
    assert!(closed.report.mesh.topology.closed);
    assert!(closed.report.surface.trimmed_area_percent.abs() < f64::EPSILON);
    check_open_sheet(&auto.mesh);
    // What was measured is told of the closed surface.
    let unsupported = |made: &Reconstruction| made.report.surface.unsupported_area_percent;
    assert!((unsupported(&closed) - unsupported(&auto)).abs() < 1e-9);
    let lost = 100.0 * (1.0 - auto.mesh.area() / closed.mesh.area());
    assert!((auto.report.surface.trimmed_area_percent - lost).abs() < 1e-9);

    let recipe = Recipe {
        points: 1_000,
        ..Recipe::default()
    };
    let sphere = sample(&Shape::Sphere { radius: 1.0 }, &recipe);
    assert_eq!(made(&sphere, "closed").mesh, made(&sphere, "auto").mesh);
}
