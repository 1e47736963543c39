//! The verdict on meshes made by hand, right ones and wrong ones.

use super::super::evidence::Measured;
use super::super::{CloudReport, SurfaceReport};
use super::*;
use crate::reconstruction::mesh::{TriangleMesh, closest_to_each};
use crate::reconstruction::quality::describe;
use crate::reconstruction::vector::{Vec3, add, scale};

const SPACING: f64 = 0.1;

/// Points even on the unit sphere, about [`SPACING`] apart.
fn points() -> Vec<Vec3> {
    let turn = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let place = |i: u32| {
        let z = (2.0 * f64::from(i) + 1.0) / 1_200.0 - 1.0;
        let (sine, cosine) = (turn * f64::from(i)).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        [radius * cosine, radius * sine, z]
    };
    (0..1_200).map(place).collect()
}

/// Adds a ball to `mesh`: a cube whose faces have `steps`² squares each, blown up.
fn ball(mesh: &mut TriangleMesh, centre: Vec3, radius: f64, steps: u32) {
    let place = |axis: usize, side: f64, i: u32, j: u32| {
        let along = |k: u32| 2.0 * f64::from(k) / f64::from(steps) - 1.0;
        let mut on_cube = [side; 3];
        on_cube[(axis + 1) % 3] = side * along(i);
        on_cube[(axis + 2) % 3] = along(j);
        let length = on_cube.iter().map(|c| c * c).sum::<f64>().sqrt();
        add(centre, scale(on_cube, radius / length))
    };
    let first = mesh.vertices.len();
    let mut number = |vertex: Vec3| {
        let same = |v: &Vec3| (0..3).all(|k| (v[k] - vertex[k]).abs() < 1e-9 * radius);
        let known = mesh.vertices[first..].iter().position(same);
        let place = known.map_or(mesh.vertices.len(), |place| first + place);
        if known.is_none() {
            mesh.vertices.push(vertex);
        }
        u32::try_from(place).unwrap()
    };
    for axis in 0..3 {
        for side in [-1.0, 1.0] {
            for (i, j) in (0..steps).flat_map(|i| (0..steps).map(move |j| (i, j))) {
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)];
                let [a, b, c, d] = corners.map(|(i, j)| number(place(axis, side, i, j)));
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
}

fn one_ball(radius: f64) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    ball(&mut mesh, [0.0; 3], radius, 16);
    mesh
}

fn surface(unsupported_area_percent: f64) -> SurfaceReport {
    SurfaceReport {
        grid_points: [64; 3],
        grid_spacing: 0.04,
        field_evaluations: 1,
        closing_vertices: 0,
        dropped_components: 0,
        dropped_triangles: 0,
        dropped_area: 0.0,
        support_distance: 3.0 * SPACING,
        unsupported_area_percent,
        trimmed_area_percent: 0.0,
        simplification: None,
    }
}

/// The verdict on `mesh`, and the codes of the reasons; `change` is made to what was measured.
fn judged(
    mesh: &TriangleMesh,
    points: &[Vec3],
    percent: f64,
    change: impl FnOnce(&mut Evidence<'_>),
) -> (Verdict, Vec<&'static str>) {
    let cloud = CloudReport {
        spacing: SPACING,
        noise: Some(0.0),
        orientation_confidence: Some(1.0),
        anisotropy: 1.0,
        area: Some(SPACING.powi(2) * points.len() as f64),
        weight_decay: 0.0,
    };
    let surface = surface(percent);
    let described = describe(mesh);
    let closest = closest_to_each(mesh, points).unwrap_or_default();
    let measured = Measured {
        points,
        closest: &closest,
        trained: points.len(),
    };
    let mut evidence = Evidence::new((mesh, &described), measured, &cloud, &surface);
    change(&mut evidence);
    let (verdict, reasons) = judge(&evidence);
    for reason in &reasons {
        assert!(!reason.message.contains('\n') && !reason.message.contains("NaN"));
    }
    (verdict, reasons.iter().map(|reason| reason.code).collect())
}

#[test]
fn a_mesh_through_its_points_is_good() {
    let found = judged(&one_ball(1.0), &points(), 0.0, |_| {});
    assert_eq!(found, (Verdict::Good, vec![]));
}

#[test]
fn a_mesh_beside_its_points_is_not() {
    let (verdict, codes) = judged(&one_ball(0.98), &points(), 0.0, |_| {});
    assert_eq!((verdict, codes), (Verdict::Doubtful, vec!["beside_points"]));
    for radius in [0.8, 1.2] {
        let (verdict, codes) = judged(&one_ball(radius), &points(), 0.0, |_| {});
        assert_eq!(verdict, Verdict::Poor);
        assert!(codes.contains(&"points_far") && codes.contains(&"beside_points"));
    }
    // A body that the mesh lost.
    let mut points = points();
    points.extend((0..80).map(|i| [3.0, 0.1 * f64::from(i % 9), 0.1 * f64::from(i / 9)]));
    let (verdict, codes) = judged(&one_ball(1.0), &points, 0.0, |_| {});
    assert_eq!((verdict, codes), (Verdict::Poor, vec!["points_far"]));
}

#[test]
fn bubbles_around_the_points_are_poor() {
    let points = points();
    let mut mesh = TriangleMesh::default();
    for &point in points.iter().step_by(2) {
        ball(&mut mesh, point, 0.02, 2);
    }
    let (verdict, codes) = judged(&mesh, &points, 0.0, |_| {});
    assert_eq!(verdict, Verdict::Poor);
    for code in ["area_short", "pieces_unsupported", "body_thin"] {
        assert!(codes.contains(&code), "{codes:?}");
    }
}

#[test]
fn a_piece_without_points_is_told() {
    let mut mesh = one_ball(1.0);
    ball(&mut mesh, [0.5, 0.0, 0.0], 0.2, 4);
    let found = judged(&mesh, &points(), 0.0, |_| {});
    assert_eq!(found, (Verdict::Doubtful, vec!["pieces_unsupported"]));
}

#[test]
fn a_mesh_inside_out_is_poor() {
    let mut mesh = one_ball(1.0);
    for triangle in &mut mesh.triangles {
        triangle.swap(1, 2);
    }
    let found = judged(&mesh, &points(), 0.0, |_| {});
    assert_eq!(found, (Verdict::Poor, vec!["inside_out"]));
}

#[test]
fn a_shell_around_the_points_is_poor() {
    let mut mesh = one_ball(0.987);
    for triangle in &mut mesh.triangles {
        triangle.swap(1, 2);
    }
    ball(&mut mesh, [0.0; 3], 1.01, 16);
    let (verdict, codes) = judged(&mesh, &points(), 0.0, |_| {});
    assert_eq!(verdict, Verdict::Poor);
    assert!(codes.contains(&"body_thin"), "{codes:?}");
}

#[test]
fn strays_that_set_the_scale_are_told() {
    for (far, verdict) in [(20.0, Verdict::Doubtful), (90.0, Verdict::Poor)] {
        let mut points = points();
        points.push([far, far, far]);
        let found = judged(&one_ball(1.0), &points, 0.0, |_| {});
        assert_eq!(found, (verdict, vec!["strays_stretch"]));
    }
}

#[test]
fn handles_count_against_points() {
    for (handles, expected) in [
        (8, (Verdict::Good, vec![])),
        (20, (Verdict::Doubtful, vec!["handles_unsupported"])),
        (60, (Verdict::Poor, vec!["handles_unsupported"])),
    ] {
        let found = judged(&one_ball(1.0), &points(), 0.0, |evidence| {
            evidence.handles = Some(handles);
        });
        assert_eq!(found, expected);
    }
}

#[test]
fn what_is_filled_in_is_doubtful_unless_it_is_most() {
    for (percent, expected) in [
        (9.0, (Verdict::Good, vec![])),
        (50.0, (Verdict::Doubtful, vec!["surface_unsupported"])),
        (80.0, (Verdict::Poor, vec!["surface_unsupported"])),
    ] {
        // What is left of the area is as much as the points stand for.
        let found = judged(&one_ball(1.0), &points(), percent, |evidence| {
            evidence.area /= 1.0 - percent / 100.0;
        });
        assert_eq!(found, expected);
    }
}

#[test]
fn unsure_sides_weigh_with_other_faults() {
    let unsure = |evidence: &mut Evidence<'_>| evidence.confidence = Some(0.8);
    let found = judged(&one_ball(1.0), &points(), 0.0, unsure);
    assert_eq!(found, (Verdict::Doubtful, vec!["sides_unsure"]));
    let (verdict, _) = judged(&one_ball(0.98), &points(), 0.0, unsure);
    assert_eq!(verdict, Verdict::Poor);
    // The sides of a plate thinner than the spacing cannot be sure.
    let found = judged(&one_ball(1.0), &points(), 0.0, |evidence| {
        unsure(evidence);
        evidence.volume = Some(0.4 * SPACING * evidence.area);
    });
    assert_eq!(found, (Verdict::Good, vec![]));
}

#[test]
fn nothing_measured_is_no_panic() {
    let empty = TriangleMesh::default();
    judged(&empty, &[], 0.0, |_| {});
    judged(&one_ball(1.0), &[], 0.0, |evidence| evidence.spacing = 0.0);
    judged(&one_ball(1.0), &points(), 0.0, |e| e.spacing = 0.0);
}
