//! Thin and long bodies, and bodies of few points.

use std::f64::consts::{PI, TAU};

use meshway::reconstruction::vector::Vec3;
use rand::RngExt;

use super::{Truth, bare, codes, random, right, run, spiral};

#[test]
fn a_long_tube_keeps_its_volume() {
    let (length, radius) = (120.0, 0.6);
    let mut random = random(13);
    let caps = PI * radius * radius;
    let side = TAU * radius * length;
    let points: Vec<Vec3> = (0..6_000)
        .map(|_| {
            let (sin, cos) = (TAU * random.random::<f64>()).sin_cos();
            let place = random.random::<f64>() * (side + 2.0 * caps);
            if place < side {
                return [radius * cos, radius * sin, length * random.random::<f64>()];
            }
            let r = radius * random.random::<f64>().sqrt();
            let z = if place < side + caps { 0.0 } else { length };
            [r * cos, r * sin, z]
        })
        .collect();
    right(&bare(points), &Truth::body(caps * length));
}

#[test]
fn a_thin_plate_keeps_its_volume_and_is_no_open_sheet() {
    let [a, b, c] = [40.0, 30.0, 1.0];
    let mut random = random(14);
    let sides = [b * c, a * c, a * b];
    let points: Vec<Vec3> = (0..9_000)
        .map(|_| {
            let mut p = [a, b, c].map(|edge| edge * random.random::<f64>());
            let mut place = 2.0 * sides.iter().sum::<f64>() * random.random::<f64>();
            for axis in 0..3 {
                for end in [0.0, [a, b, c][axis]] {
                    if place >= 0.0 && place < sides[axis] {
                        p[axis] = end;
                    }
                    place -= sides[axis];
                }
            }
            p
        })
        .collect();
    let made = right(&bare(points), &Truth::body(a * b * c));
    assert!(!codes(&made).contains(&"surface_unsupported"));
}

#[test]
fn few_points_make_a_body_or_a_clear_refusal() {
    for count in [16, 24, 40, 60] {
        let made = match run(&bare(spiral(count))) {
            Ok(made) => made,
            Err(error) => {
                assert!(error.to_string().len() > 20, "{error}");
                continue;
            }
        };
        let mesh = &made.report.mesh;
        let summary = made.report.summary();
        assert_eq!(
            (mesh.topology.components, mesh.topology.genus),
            (1, Some(0)),
            "{summary}"
        );
        let share = mesh.volume.unwrap() / (4.0 / 3.0 * PI);
        assert!(share > 0.8 && share < 1.1, "{count}: {share}: {summary}");
    }
}

#[test]
fn a_ball_far_from_the_origin_is_still_one() {
    let points = spiral(3_000)
        .into_iter()
        .map(|p| p.map(|x| 5_000_000.0 + x));
    right(&bare(points.collect()), &Truth::body(4.0 / 3.0 * PI));
}
