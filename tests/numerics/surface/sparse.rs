//! What the sparse grid must find: all that the dense one does, at the cost of the surface.

use meshway::reconstruction::random::{Purpose, stream};
use meshway::reconstruction::surface::{Field, extract};
use meshway::reconstruction::vector::{Vec3, distance, dot, norm};
use rand::RngExt;

use super::closed::check_closed_manifold;
use super::fields::{analytic, binary, graded, sphere, torus};
use super::{dense, request};

#[test]
fn sparse_equals_dense() {
    let two = analytic(|p: Vec3| {
        (0.4 - distance(p, [-0.4, 0.1, 0.0])).max(0.06 - distance(p, [0.7, 0.7, 0.7]))
    });
    let blobs = analytic(|p: Vec3| {
        let centres = [
            [0.3, 0.2, 0.1],
            [-0.3, 0.0, 0.4],
            [0.0, -0.5, -0.2],
            [0.5, 0.5, -0.6],
        ];
        let bumps = centres.map(|c| (-30.0 * distance(p, c).powi(2)).exp());
        bumps.iter().sum::<f64>() - 0.4
    });
    let gyroid = analytic(|p: Vec3| {
        let [x, y, z] = p.map(|v| 7.0 * v);
        let gyroid = x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos();
        gyroid.min(4.0 * (0.85 - p.into_iter().fold(0.0, |m: f64, v| m.max(v.abs()))))
    });
    // Thinner than a cell of the coarsest level, in the middle of such cells, and tilted.
    let plate = analytic(|p: Vec3| {
        let across = (p[2] + 0.2 * p[0] - 0.0155).abs() - 0.012;
        let along = p[0].hypot(p[1]) - 0.7;
        -across.max(along)
    });
    let needle = analytic(|p: Vec3| {
        let t = ((p[0] + p[1] + p[2]) / 3.0).clamp(-0.55, 0.55);
        0.02 - distance(p, [t, t, t])
    });
    let graded_sphere = graded(sphere(0.5), 0.1);
    let binary_torus = binary(torus(0.6, 0.2));
    let fields: [(&str, &dyn Field); 7] = [
        ("two spheres", &two),
        ("blobs", &blobs),
        ("gyroid", &gyroid),
        ("plate", &plate),
        ("needle", &needle),
        ("graded", &graded_sphere),
        ("binary", &binary_torus),
    ];
    // One level, two and three, and lengths that no stride divides.
    for resolution in [40, 71, 135] {
        for (name, field) in fields {
            let request = request(resolution, 0);
            let sparse = extract(field, &request).unwrap();
            let dense = extract(field, &dense(request)).unwrap();
            check_closed_manifold(&sparse.mesh);
            assert_eq!(sparse.mesh, dense.mesh, "{name} at {resolution}");
            assert_eq!(dense.evaluations, dense.grid.len() as u64);
        }
    }
}

#[test]
fn parts_between_the_coarse_points_are_found() {
    // At 129 points the coarsest stride is 4, and these contain grid points of odd number only.
    let at = |number: i32| f64::from(number) / 64.0 - 1.0;
    let plate = analytic(move |p: Vec3| {
        let across = (p[2] - at(67)).abs() - 0.01;
        -across.max(p[0].hypot(p[1]) - 0.7)
    });
    let rod = analytic(move |p: Vec3| {
        let axis = (p[0] - at(65)).hypot(p[1] - at(67)) - 0.01;
        -axis.max(p[2].abs() - 0.5)
    });
    let ball = analytic(move |p: Vec3| 0.012 - distance(p, [at(65), at(67), at(63)]));
    let fields: [(&str, &dyn Field); 3] = [("plate", &plate), ("rod", &rod), ("ball", &ball)];
    for (name, field) in fields {
        let dense = extract(field, &dense(request(129, 0))).unwrap();
        let sparse = extract(field, &request(129, 0));
        assert!(
            sparse.is_ok_and(|sparse| sparse.mesh == dense.mesh),
            "{name}"
        );
    }
}

#[test]
fn thin_parts_are_found_however_they_lie() {
    let mut random = stream(3, Purpose::Shape);
    let mut within =
        |limit: f64| -> Vec3 { std::array::from_fn(|_| random.random_range(-limit..limit)) };
    for round in 0..60 {
        let (centre, direction) = (within(0.3), within(1.0));
        let length = norm(direction);
        let along = move |p: Vec3| {
            let arm: Vec3 = std::array::from_fn(|a| p[a] - centre[a]);
            (dot(arm, direction) / length, norm(arm))
        };
        // Between 0.4 and 2.2 cells thick.
        let half = (0.2 + f64::from(round % 7) * 0.15) / 64.0;
        let plate = analytic(move |p: Vec3| {
            let (across, away) = along(p);
            half - across.abs().max(away - 0.5)
        });
        let rod = analytic(move |p: Vec3| {
            let (across, away) = along(p);
            half - (away * away - across * across)
                .max(0.0)
                .sqrt()
                .max(across.abs() - 0.4)
        });
        for (name, field) in [("plate", &plate as &dyn Field), ("rod", &rod)] {
            let dense = extract(field, &dense(request(129, 0)));
            let sparse = extract(field, &request(129, 0));
            match (sparse, dense) {
                (Ok(sparse), Ok(dense)) => assert_eq!(sparse.mesh, dense.mesh, "{name} {round}"),
                (sparse, dense) => assert!(sparse.is_err() && dense.is_err(), "{name} {round}"),
            }
        }
    }
}

#[test]
fn evaluations_grow_with_the_surface() {
    let field = graded(torus(0.6, 0.25), 0.08);
    let [coarse, fine] = [128, 256].map(|n| extract(&field, &request(n, 0)).unwrap().evaluations);
    // Four times the points around the surface, and the same coarse grid.
    assert!(fine as f64 <= 4.3 * coarse as f64, "{coarse} and {fine}");
    assert!(fine < 256_u64.pow(3) / 12, "{fine} of {}", 256_u64.pow(3));
}
