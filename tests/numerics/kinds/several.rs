//! Several surfaces in one cloud; points spread unevenly, given twice, or by two scans that do not quite meet.

use std::f64::consts::PI;

use meshway::reconstruction::vector::Vec3;
use rand::RngExt;

use super::{RING, Truth, bare, deviate, random, right, right_by_default, ring, spiral};

const BALL: f64 = 4.0 / 3.0 * PI;

fn ball(count: usize, radius: f64, middle: Vec3) -> impl Iterator<Item = Vec3> {
    spiral(count)
        .into_iter()
        .map(move |p| std::array::from_fn(|axis| middle[axis] + radius * p[axis]))
}

#[test]
fn bodies_beside_each_other_stay_apart() {
    let points = ball(900, 1.0, [0.0; 3])
        .chain(ball(900, 1.0, [2.4, 0.0, 0.0]))
        .chain(ball(900, 1.0, [0.0, 3.0, 0.5]));
    let truth = Truth {
        components: 3,
        ..Truth::body(3.0 * BALL)
    };
    right(&bare(points.collect()), &truth);
}

#[test]
fn a_shell_has_two_sides() {
    let points = ball(3_000, 1.0, [0.0; 3]).chain(ball(1_500, 0.7, [0.0; 3]));
    let truth = Truth {
        components: 2,
        ..Truth::body(BALL * (1.0 - 0.7_f64.powi(3)))
    };
    right(&bare(points.collect()), &truth);
}

#[test]
fn uneven_points_make_an_even_body() {
    let mut random = random(15);
    let points: Vec<Vec3> = spiral(20_000)
        .into_iter()
        .filter(|p| {
            let keep = if p[0] > 0.0 { 1.0 } else { 0.02 };
            random.random::<f64>() < keep
        })
        .collect();
    right(&bare(points), &Truth::body(BALL));
}

#[test]
fn repeated_points_count_once() {
    let (points, _) = ring(2_500, 16);
    let thrice = points.iter().chain(&points).chain(&points).copied();
    right(&bare(thrice.collect()), &Truth::ring());
}

#[test]
fn two_scans_that_do_not_quite_meet_make_one_surface() {
    let (mut points, _) = ring(2_400, 17);
    let shift = 0.003 * 2.0 * (RING.0 + RING.1) * 2.0_f64.sqrt();
    for p in points.iter_mut().step_by(2) {
        *p = [p[0] + 0.6 * shift, p[1], p[2] + 0.8 * shift];
    }
    right_by_default(&bare(points), &Truth::ring());
}

#[test]
fn moderate_noise_makes_no_handles() {
    let mut random = random(18);
    let (mut points, _) = ring(3_000, 19);
    let spacing = (4.0 * PI * PI * RING.0 * RING.1 / 3_000.0).sqrt();
    for p in &mut points {
        let shift = deviate(&mut random);
        *p = std::array::from_fn(|axis| p[axis] + 0.05 * spacing * shift[axis]);
    }
    right_by_default(&bare(points), &Truth::ring());
}
