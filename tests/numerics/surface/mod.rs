//! Extraction of the zero set on fields that are known exactly.

mod begun;
mod closed;
mod fields;
mod simplify;
mod sparse;
pub(crate) mod trim;

use std::cell::Cell;
use std::f64::consts::PI;

use meshway::reconstruction::Error;
use meshway::reconstruction::random::{Purpose, stream};
use meshway::reconstruction::settings::{Components, Evaluation};
use meshway::reconstruction::surface::{Extraction, Request, extract, keep_components};
use meshway::reconstruction::vector::{Bounds, Vec3, distance, dot, norm};
use rand::RngExt;

use closed::{check_closed_manifold, euler_number, volume};
use fields::{Analytic, analytic, graded, lattice_field, sphere, torus};

const BOX: Bounds = Bounds {
    min: [-1.0; 3],
    max: [1.0; 3],
};

fn request(resolution: usize, projection_steps: usize) -> Request<'static> {
    Request {
        projection_steps,
        ..Request::new(BOX, resolution)
    }
}

fn dense(request: Request<'_>) -> Request<'_> {
    Request {
        evaluation: Evaluation::Dense,
        ..request
    }
}

/// Root mean square of a distance over the vertices.
fn rms(extraction: &Extraction, distance: impl Fn(Vec3) -> f64) -> f64 {
    let vertices = &extraction.mesh.vertices;
    let squares = vertices.iter().map(|v| distance(*v).powi(2));
    (squares.sum::<f64>() / vertices.len() as f64).sqrt()
}

/// Orders of an error between successive resolutions.
fn orders(resolutions: &[usize], errors: &[f64]) -> Vec<f64> {
    let pairs = errors.windows(2).zip(resolutions.windows(2));
    pairs
        .map(|(e, n)| (e[0] / e[1]).ln() / ((n[1] - 1) as f64 / (n[0] - 1) as f64).ln())
        .collect()
}

/// A field whose values along an edge are not linear, so that interpolation has an error.
fn squared_sphere() -> Analytic<impl Fn(Vec3) -> f64 + Sync> {
    analytic(|p: Vec3| 0.49 - dot(p, p))
}

#[test]
fn sphere_converges_with_second_order() {
    let resolutions = [17, 33, 65];
    let extractions = resolutions.map(|n| extract(&squared_sphere(), &request(n, 0)).unwrap());
    let errors = extractions.each_ref().map(|e| rms(e, |p| norm(p) - 0.7));
    let volumes = extractions
        .each_ref()
        .map(|e| (volume(&e.mesh) - 4.0 / 3.0 * PI * 0.343).abs());
    for errors in [errors, volumes] {
        for order in orders(&resolutions, &errors) {
            // Linear interpolation and flat triangles err by O(h²); where the grid points lie to
            // the sphere differs from grid to grid and moves the mean by some per cent.
            assert!((order - 2.0).abs() < 0.25, "order {order} of {errors:?}");
        }
    }
}

#[test]
fn torus_converges_and_has_genus_one() {
    let to_torus = |p: Vec3| (p[0].hypot(p[1]) - 0.6).hypot(p[2]) - 0.25;
    let field = analytic(move |p| 0.0625 - (p[0].hypot(p[1]) - 0.6).powi(2) - p[2] * p[2]);
    let resolutions = [33, 65, 129];
    let errors = resolutions.map(|n| {
        let extraction = extract(&field, &request(n, 0)).unwrap();
        check_closed_manifold(&extraction.mesh);
        assert_eq!(euler_number(&extraction.mesh), 0);
        rms(&extraction, to_torus)
    });
    for order in orders(&resolutions, &errors) {
        // As for the sphere.
        assert!((order - 2.0).abs() < 0.25, "order {order} of {errors:?}");
    }
}

#[test]
fn projection_reaches_the_zero_set_and_normals_point_outwards() {
    let extraction = extract(&squared_sphere(), &request(48, 4)).unwrap();
    check_closed_manifold(&extraction.mesh);
    assert_eq!(euler_number(&extraction.mesh), 2);
    assert_eq!(extraction.unprojected_vertices, 0);
    for (vertex, normal) in extraction
        .mesh
        .vertices
        .iter()
        .zip(&extraction.mesh.normals)
    {
        // The last step was shorter than 1e-3 of a cell, 4e-5, of which Newton's method leaves the square over the
        // diameter; the normal is that of where it began.
        assert!((norm(*vertex) - 0.7).abs() < 2e-9);
        assert!((norm(*normal) - 1.0).abs() < 1e-12);
        assert!(dot(*normal, *vertex) > 0.7 * (1.0 - 1e-8));
    }
    // Most vertices are there after one step, and the second one is short.
    let asked = extraction.gradient_evaluations as f64 / extraction.mesh.vertices.len() as f64;
    assert!((1.5..2.3).contains(&asked), "{asked} a vertex");
}

#[test]
fn projection_never_turns_a_triangle_over() {
    // Steep, plateaued and with a crease: Newton steps overshoot here.
    let field = analytic(|p: Vec3| {
        let ripple = 0.05 * (40.0 * p[0]).sin() * (37.0 * p[1]).sin();
        ((0.6 - norm(p) + ripple) * 30.0).tanh()
    });
    let before = extract(&field, &request(40, 0)).unwrap().mesh;
    let after = extract(&field, &request(40, 3)).unwrap();
    assert!(
        after.unprojected_vertices > 0,
        "the guard has nothing to do"
    );
    let after = after.mesh;
    assert_eq!(before.triangles, after.triangles);
    let areas = closed::areas(&before)
        .into_iter()
        .zip(closed::areas(&after));
    for (before, after) in areas {
        assert!(dot(before, after) > 0.0);
    }
}

#[test]
fn random_signs_give_a_closed_manifold() {
    let mut random = stream(7, Purpose::Shape);
    for round in 0..200 {
        let size = [2 + round % 4, 5, 3 + round % 3];
        let mut values: Vec<f64> = (0..size.iter().product())
            .map(|_| random.random_range(-1.0..1.0))
            .collect();
        if round % 3 == 0 {
            // Exact zeros and equal values, as of a plateau.
            for value in &mut values {
                *value = value.round();
            }
        }
        let request = Request {
            bounds: Bounds {
                min: [0.0; 3],
                max: size.map(|n| (n - 1) as f64),
            },
            ..request(*size.iter().max().unwrap(), round % 2)
        };
        let field = lattice_field(size, values);
        let sparse = extract(&field, &request).unwrap();
        check_closed_manifold(&sparse.mesh);
        assert_eq!(sparse.mesh, extract(&field, &dense(request)).unwrap().mesh);
        for area in closed::areas(&sparse.mesh) {
            assert!(norm(area) > 0.0, "a triangle without area");
        }
    }
}

#[test]
fn a_surface_that_leaves_the_grid_is_closed_at_its_border() {
    let request = request(80, 2);
    let field = sphere(1.2);
    let sparse = extract(&field, &request).unwrap();
    check_closed_manifold(&sparse.mesh);
    assert!(sparse.closing_vertices > 0);
    assert!(volume(&sparse.mesh) < 8.5, "the box has a volume of 8");
    for vertex in &sparse.mesh.vertices {
        assert!(vertex.iter().all(|v| v.abs() <= 1.0 + sparse.grid.spacing));
    }
    let dense = extract(&field, &dense(request)).unwrap();
    assert_eq!(sparse.mesh, dense.mesh);
}

#[test]
fn a_field_of_one_sign_has_no_surface() {
    for (value, sign) in [(-0.3, "nowhere"), (0.0, "nowhere"), (0.3, "everywhere")] {
        for request in [request(50, 0), dense(request(50, 0)), request(200, 0)] {
            match extract(&analytic(move |_| value), &request) {
                Err(Error::NoSurface(message)) => assert!(message.contains(sign), "{message}"),
                other => panic!("{other:?}"),
            }
        }
    }
}

#[test]
fn values_that_are_not_finite_are_an_error() {
    for bad in [f64::NAN, f64::INFINITY] {
        let field = analytic(move |p: Vec3| if p[0] > 0.4 { bad } else { 0.5 - norm(p) });
        for request in [request(30, 1), dense(request(30, 1))] {
            let result = extract(&field, &request);
            assert!(matches!(result, Err(Error::NoSurface(_))), "{result:?}");
        }
    }
}

#[test]
fn stops_when_asked_and_tells_its_progress() {
    let asked = Cell::new(0);
    for limit in 0.. {
        asked.set(0);
        let cancelled = || {
            asked.set(asked.get() + 1);
            asked.get() > limit
        };
        let result = extract(
            &sphere(0.5),
            &Request {
                cancelled: &cancelled,
                ..request(70, 1)
            },
        );
        if asked.get() <= limit {
            assert!(result.is_ok());
            break;
        }
        assert!(matches!(result, Err(Error::Cancelled)));
        assert_eq!(asked.get(), limit + 1, "nothing is done after the answer");
    }
    let last = Cell::new(0.0);
    let progress = |share: f64| {
        assert!(
            share >= last.get() && share <= 1.0,
            "{share} after {last:?}"
        );
        last.set(share);
    };
    for request in [request(140, 1), dense(request(60, 1))] {
        last.set(0.0);
        extract(
            &sphere(0.5),
            &Request {
                progress: &progress,
                ..request
            },
        )
        .unwrap();
        assert!(
            (last.get() - 1.0).abs() < 1e-12,
            "the shares add up but for rounding"
        );
    }
}

#[test]
fn a_mesh_beyond_the_limit_is_refused() {
    let size = extract(&sphere(0.5), &request(40, 0))
        .unwrap()
        .mesh
        .triangles
        .len();
    for (limit, fits) in [(size, true), (size - 1, false), (0, false)] {
        let result = extract(
            &sphere(0.5),
            &Request {
                max_triangles: limit,
                ..request(40, 0)
            },
        );
        match result {
            Ok(_) => assert!(fits),
            Err(Error::MeshTooLarge { limit: told }) => assert!(!fits && told == limit),
            Err(other) => panic!("{other}"),
        }
    }
}

#[test]
fn the_same_field_gives_the_same_mesh() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let extract = || extract(&graded(torus(0.6, 0.25), 0.1), &request(70, 2)).unwrap();
        pool.build().unwrap().install(extract)
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn components_without_points_are_dropped() {
    let field = analytic(|p: Vec3| {
        (0.4 - distance(p, [-0.4, 0.0, 0.0])).max(0.2 - distance(p, [0.6, 0.0, 0.0]))
    });
    let extraction = extract(&field, &request(64, 2)).unwrap();
    let points: Vec<Vec3> = (0..50)
        .map(|i| {
            let angle = f64::from(i) / 8.0;
            [-0.4 + 0.4 * angle.cos(), 0.4 * angle.sin(), 0.0]
        })
        .collect();
    let reach = 2.0 * extraction.grid.spacing;
    let (kept, dropped) = keep_components(extraction.mesh, Components::Supported, &points, reach);
    check_closed_manifold(&kept);
    assert_eq!(euler_number(&kept), 2);
    assert_eq!(dropped.components, 1);
    // The small sphere; triangles inscribed at 6 cells a radius lack about one per cent of its area.
    assert!((dropped.area / (4.0 * PI * 0.04) - 1.0).abs() < 0.02);
}
