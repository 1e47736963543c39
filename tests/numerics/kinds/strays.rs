//! Points that belong to no surface.

use meshway::reconstruction::vector::Vec3;
use rand::RngExt;

use super::{RING, Truth, bare, codes, deviate, from_ring, message, random, right, ring};

/// The ring with these points besides: they are left out, told and counted, and the ring is as it was.
#[track_caller]
fn left_out(strays: &[Vec3], at_least: usize) {
    let (mut points, _) = ring(3_000, 5);
    points.extend_from_slice(strays);
    let made = right(&bare(points), &Truth::ring());
    let told = message(&made, "strays_left_out");
    let count: usize = told.split(' ').next().unwrap().parse().unwrap();
    assert!(count >= at_least && count <= strays.len(), "{told}");
    let furthest = made
        .mesh
        .vertices
        .iter()
        .map(|v| from_ring(*v))
        .fold(0.0, f64::max);
    assert!(furthest < 0.1 * RING.1, "{furthest}: {told}");
}

#[test]
fn strays_all_around_are_left_out() {
    let mut random = random(6);
    let strays: Vec<Vec3> = (0..150)
        .map(|_| std::array::from_fn(|_| 40.0 * random.random::<f64>() - 20.0))
        .filter(|p| from_ring(*p) > 2.0)
        .collect();
    left_out(&strays, strays.len() * 9 / 10);
}

#[test]
fn a_clump_of_strays_is_left_out() {
    let mut random = random(7);
    let strays: Vec<Vec3> = (0..40)
        .map(|_| {
            let [x, y, z] = deviate(&mut random);
            [30.0 + x, y, 12.0 + z]
        })
        .collect();
    left_out(&strays, strays.len());
}

#[test]
fn far_strays_decide_no_box() {
    left_out(&[[420.0, 0.0, 0.0]], 1);
    left_out(
        &[[60.0, 50.0, 0.0], [-70.0, 0.0, 20.0], [0.0, 0.0, 90.0]],
        3,
    );
    // The same place twice is no surface either.
    left_out(&[[420.0, 0.0, 0.0], [420.0, 0.0, 0.0]], 1);
}

#[test]
fn a_clean_ring_has_none() {
    let made = right(&bare(ring(3_000, 5).0), &Truth::ring());
    assert!(!codes(&made).contains(&"strays_left_out"));
}
