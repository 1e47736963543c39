//! Analytic shapes: their fields, their surfaces, and the clouds drawn from them.

use meshway::reconstruction::cloud::{Label, write_ply, write_xyz};
use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use meshway::reconstruction::vector::{Bounds, Vec3, along, dot, norm};

fn all() -> Vec<Shape> {
    Shape::names().map(|name| name.parse().unwrap()).to_vec()
}

#[test]
fn names_and_lengths_are_read_and_written() {
    assert_eq!(
        "torus:0.8:0.3".parse(),
        Ok(Shape::Torus {
            major: 0.8,
            minor: 0.3
        })
    );
    for shape in all() {
        assert_eq!(shape.to_string().parse(), Ok(shape));
    }
    for bad in [
        "",
        "cube",
        "sphere:0",
        "sphere:x",
        "sphere:1:2",
        "torus:1:2",
        "hand:1",
        "torus:nan:1",
    ] {
        let message = bad.parse::<Shape>().unwrap_err().to_string();
        assert!(message.contains("known are sphere"), "{message}");
    }
}

#[test]
fn gradients_are_those_of_central_differences() {
    for shape in all() {
        let recipe = Recipe {
            points: 200,
            interior: 100,
            exterior: 100,
            ..Recipe::default()
        };
        for p in sample(&shape, &recipe).points {
            let gradient = shape.gradient(p);
            let step = 1e-6;
            let difference: Vec3 = std::array::from_fn(|a| {
                let mut axis = [0.0; 3];
                axis[a] = step;
                (shape.signed(along(p, 1.0, axis)) - shape.signed(along(p, -1.0, axis)))
                    / (2.0 * step)
            });
            // Kinks of the second derivative at joints leave an error of the order of the step
            // times a curvature of a few tens.
            assert!(
                norm(along(gradient, -1.0, difference)) < 1e-4,
                "{shape} at {p:?}: {gradient:?} and {difference:?}"
            );
        }
    }
}

#[test]
fn drawn_points_lie_where_their_labels_say() {
    for shape in all() {
        let cloud = sample(
            &shape,
            &Recipe {
                points: 300,
                interior: 100,
                exterior: 100,
                normals: true,
                ..Recipe::default()
            },
        );
        let diagonal = shape.bounds().diagonal();
        let normals = cloud.normals.as_ref().unwrap();
        assert_eq!(cloud.points.len(), 500);
        for (i, p) in cloud.points.iter().enumerate() {
            let value = shape.signed(*p);
            match cloud.label(i) {
                Label::Surface => {
                    // The projection ends at 1e-13.
                    assert!(value.abs() < 1e-12 * diagonal, "{shape}");
                    assert!(shape.bounds().padded(1e-9).contains(*p), "{shape}");
                    let outward = along(*p, 0.01 * diagonal, normals[i]);
                    assert!(shape.signed(outward) < 0.0, "{shape}");
                }
                Label::Interior => assert!(value > 0.01 * diagonal, "{shape}"),
                Label::Exterior => assert!(value < -0.01 * diagonal, "{shape}"),
            }
        }
    }
}

#[test]
fn the_far_field_of_every_shape_is_negative() {
    for shape in all() {
        let corner = shape.bounds().padded(1.0).max;
        assert!(shape.signed(corner) < 0.0);
        assert!(shape.signed([1e6, -1e6, 1e6]) < -1e5);
    }
}

#[test]
fn surface_points_are_uniform_by_area() {
    let points = 20_000;
    let recipe = Recipe {
        points,
        ..Recipe::default()
    };
    let sphere = sample(&Shape::Sphere { radius: 2.0 }, &recipe);
    // A zone of a sphere has an area in proportion to its height (Archimedes).
    for zone in 0..10 {
        let low = -2.0 + 0.4 * f64::from(zone);
        let inside = sphere
            .points
            .iter()
            .filter(|p| p[2] >= low && p[2] < low + 0.4)
            .count();
        // 2000 expected with a standard deviation of 42; five of them.
        assert!(inside.abs_diff(2000) < 210, "zone {zone}: {inside}");
    }
    let torus = sample(
        &Shape::Torus {
            major: 1.0,
            minor: 0.4,
        },
        &recipe,
    );
    let outer = torus
        .points
        .iter()
        .filter(|p| p[0].hypot(p[1]) > 1.0)
        .count() as f64;
    // Outer half over all: 1/2 + (minor / major) / π; standard deviation 0.0034, five of them.
    let expected = 0.5 + 0.4 / std::f64::consts::PI;
    assert!((outer / points as f64 - expected).abs() < 0.017, "{outer}");
}

#[test]
fn a_hole_takes_the_asked_share_from_one_place() {
    let whole = Recipe {
        points: 300,
        ..Recipe::default()
    };
    let holed = Recipe {
        missing_percent: 40.0,
        ..whole.clone()
    };
    let (all, left) = (
        sample(&Shape::Uterus, &whole),
        sample(&Shape::Uterus, &holed),
    );
    assert_eq!(left.points.len(), 180);
    let missing: Vec<Vec3> = all
        .points
        .iter()
        .copied()
        .filter(|p| !left.points.contains(p))
        .collect();
    assert_eq!(missing.len(), 120);
    let hole = Bounds::of(&missing).unwrap().diagonal();
    assert!(hole < 0.9 * Bounds::of(&all.points).unwrap().diagonal());
}

#[test]
fn noise_has_its_size_and_the_seed_decides() {
    let recipe = Recipe {
        points: 2_000,
        noise_percent: 1.0,
        seed: 7,
        ..Recipe::default()
    };
    let shape = Shape::Sphere { radius: 1.0 };
    let cloud = sample(&shape, &recipe);
    let square = cloud
        .points
        .iter()
        .map(|p| shape.signed(*p).powi(2))
        .sum::<f64>()
        / 2_000.0;
    // 1 % of the diagonal 2 √3; the standard error of a deviation from 2000 values is 1.6 %.
    assert!((square.sqrt() / (0.02 * 3.0_f64.sqrt()) - 1.0).abs() < 0.08);
    assert_eq!(cloud, sample(&shape, &recipe));
    assert_ne!(cloud, sample(&shape, &Recipe { seed: 8, ..recipe }));
}

#[test]
fn written_clouds_hold_every_value() {
    let cloud = sample(
        &Shape::Hand,
        &Recipe {
            points: 20,
            interior: 5,
            exterior: 5,
            normals: true,
            ..Recipe::default()
        },
    );
    let mut text = Vec::new();
    write_xyz(&cloud, &mut text).unwrap();
    let text = String::from_utf8(text).unwrap();
    let mut lines = text.lines();
    // Labels are read by the name of their column only.
    assert!(lines.next().unwrap().ends_with(" label"));
    for (i, line) in lines.enumerate() {
        let row: Vec<f64> = line.split(' ').map(|x| x.parse().unwrap()).collect();
        assert_eq!(row[..3], cloud.points[i]);
        assert_eq!(row[3..6], cloud.normals.as_ref().unwrap()[i]);
        assert_eq!(row[6..], [cloud.label(i).target()]);
    }
    let mut ply = Vec::new();
    write_ply(&cloud, &mut ply).unwrap();
    let end = b"end_header\n";
    let body = ply.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    assert!(String::from_utf8_lossy(&ply[..body]).contains("element vertex 30\n"));
    assert_eq!(ply.len() - body, 30 * (6 * 8 + 1));
    let last = &ply[ply.len() - 49..];
    assert_eq!(last[..8], cloud.points[29][0].to_le_bytes());
    assert_eq!(last[48], 0xff, "-1 marks an exterior point");
}

#[test]
fn projection_ends_on_the_surface_nearby() {
    let shape = Shape::Torus {
        major: 1.0,
        minor: 0.4,
    };
    for p in sample(
        &shape,
        &Recipe {
            points: 50,
            ..Recipe::default()
        },
    )
    .points
    {
        let normal = shape.gradient(p);
        let back = shape.project(along(p, 0.1, normal)).unwrap();
        // The field is an exact distance, so the way back is the way there.
        assert!(dot(normal, normal) > 0.999 && norm(along(back, -1.0, p)) < 1e-9);
    }
    assert_eq!(Shape::Sphere { radius: 1.0 }.project([0.0; 3]), None);
}
