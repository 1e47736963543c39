//! The traps of contours.

use super::*;
use crate::reconstruction::vector::{norm, sub};

/// A circle of `count` points in columns and rows.
fn circle(centre: [f64; 2], radius: f64, count: usize) -> Vec<[f64; 2]> {
    let angle = |i: usize| std::f64::consts::TAU * i as f64 / count as f64;
    let point = |i| {
        [
            centre[0] + radius * angle(i).cos(),
            centre[1] + radius * angle(i).sin(),
        ]
    };
    (0..count).map(point).collect()
}

/// Stacked contours in slices 3 mm apart, at 1 mm a column and a row.
fn contours(slices: &[Vec<Vec<[f64; 2]>>]) -> Built {
    let geometry = stack(
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 3.0],
        slices.len(),
    );
    let planes = slices.iter().enumerate().map(|(slice, polygons)| Plane {
        slice,
        content: Content::Polygons(polygons.clone()),
    });
    build(&geometry, planes).unwrap()
}

#[test]
fn contours_with_holes_bridges_and_stubs_are_read_by_even_and_odd() {
    let centre = [20.0, 20.0];
    let outer = circle(centre, 15.0, 90);
    let hole = circle(centre, 8.0, 60);
    // A bridge from the outer contour to the hole and back makes one contour of both.
    let mut keyhole = outer.clone();
    keyhole.push(outer[0]);
    keyhole.extend(hole.iter().rev().chain(hole.last()));
    let stub = vec![[1.0, 1.0], [2.0, 2.0]];
    for (polygons, ignored) in [(vec![outer, hole, stub], 6), (vec![keyhole], 0)] {
        let built = contours(&vec![polygons; 6]);
        assert_eq!(built.1.summary.contours_ignored, ignored);
        let told = codes(&built);
        assert_eq!(told.contains(&"contours_ignored"), ignored > 0, "{told:?}");
        let from_axis = |p: Vec3| (p[0] - centre[0]).hypot(p[1] - centre[1]);
        for p in of(&built.0, Label::Surface) {
            let r = from_axis(p);
            assert!((r - 15.0).abs() < 0.1 || (r - 8.0).abs() < 0.1, "{p:?}");
        }
        for p in of(&built.0, Label::Interior) {
            assert!((8.0..15.0).contains(&from_axis(p)), "{p:?}");
        }
        let exterior = of(&built.0, Label::Exterior);
        assert!(
            exterior
                .iter()
                .any(|&p| from_axis(p) < 7.0 && p[2] > 0.0 && p[2] < 15.0)
        );
        assert!(exterior.iter().any(|p| p[2] < -2.9) && exterior.iter().any(|p| p[2] > 17.9));
        assert_eq!(built.1.summary.voxels, None);
        let area = std::f64::consts::PI * (225.0 - 64.0);
        assert!((built.1.summary.volume / (18.0 * area) - 1.0).abs() < 0.02);
    }
}

#[test]
fn contours_on_every_second_slice_are_as_far_apart_as_they_are() {
    let circle = circle([20.0, 20.0], 12.0, 80);
    let slices: Vec<Vec<Vec<[f64; 2]>>> = (0..9)
        .map(|slice| {
            if slice % 2 == 0 {
                vec![circle.clone()]
            } else {
                Vec::new()
            }
        })
        .collect();
    let built = contours(&slices);
    assert!((built.1.summary.slice_distance - 6.0).abs() < 1e-12);
    assert_eq!(built.1.summary.gaps, 0);
    let inside = |p: &Vec3| norm(sub(*p, [20.0, 20.0, p[2]])) < 12.0;
    let between = of(&built.0, Label::Exterior);
    assert!(
        !between
            .iter()
            .any(|p| inside(p) && (0.0..24.0).contains(&p[2]))
    );
}
