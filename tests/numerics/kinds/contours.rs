//! Contours: points dense in planes and sparse between, as outlines drawn on slices.

use std::f64::consts::TAU;

use meshway::reconstruction::vector::Vec3;
use rand::RngExt;

use super::{Truth, bare, deviate, ellipsoid_volume, random, right};

const AXES: Vec3 = [30.0, 24.0, 36.0];

/// Outlines of the ellipsoid on planes `apart` from each other, of points a `ratio`th of that apart.
fn outlines(apart: f64, ratio: f64) -> Vec<Vec3> {
    let [a, b, c] = AXES;
    let mut points = Vec::new();
    let mut z = -c + 0.37 * apart;
    while z < c {
        let share = (1.0 - (z / c).powi(2)).sqrt();
        let around = TAU * share * 0.5 * (a + b);
        let count = (around * ratio / apart).round().max(3.0);
        for k in 0..count as usize {
            let (sin, cos) = (TAU * k as f64 / count + z).sin_cos();
            points.push([a * share * cos, b * share * sin, z]);
        }
        z += apart;
    }
    points
}

#[test]
fn outlines_make_one_smooth_body() {
    for (apart, ratio) in [(3.0, 6.0), (4.0, 12.0)] {
        let made = right(
            &bare(outlines(apart, ratio)),
            &Truth::body(ellipsoid_volume(AXES)),
        );
        let anisotropy = made.report.cloud.anisotropy;
        assert!(
            anisotropy > 0.4 * ratio && anisotropy < 2.0 * ratio,
            "{ratio}: {anisotropy}"
        );
    }
}

#[test]
fn outlines_that_are_tilted_shaken_and_one_short_still_do() {
    let mut random = random(3);
    let (sin, cos) = 0.4_f64.sin_cos();
    let mut points = outlines(3.0, 6.0);
    let missing = points[points.len() / 2][2];
    points.retain(|p| (p[2] - missing).abs() > 1e-6);
    for p in &mut points {
        let shift = deviate(&mut random);
        let [x, y, z] = [p[0] + 0.1 * shift[0], p[1] + 0.1 * shift[1], p[2]];
        *p = [x, cos * y - sin * z, sin * y + cos * z];
    }
    right(&bare(points), &Truth::body(ellipsoid_volume(AXES)));
}

#[test]
fn outlines_on_pixels_do_too() {
    let snapped = |x: f64| (2.0 * x).round() / 2.0;
    let mut points: Vec<Vec3> = outlines(3.0, 5.0)
        .into_iter()
        .map(|[x, y, z]| [snapped(x), snapped(y), z])
        .collect();
    points.dedup();
    right(&bare(points), &Truth::body(ellipsoid_volume(AXES)));
}

#[test]
fn scan_lines_that_run_one_way_do_too() {
    let mut random = random(4);
    let [a, b, c] = AXES;
    let points = (0..36).flat_map(|line| {
        let turn = TAU * (f64::from(line) + 0.2 * random.random::<f64>()) / 36.0;
        let (sin, cos) = turn.sin_cos();
        (1..160).map(move |k| {
            let (ring, z) = (std::f64::consts::PI * f64::from(k) / 160.0).sin_cos();
            [a * ring * cos, b * ring * sin, c * z]
        })
    });
    right(
        &bare(points.collect()),
        &Truth::body(ellipsoid_volume(AXES)),
    );
}
