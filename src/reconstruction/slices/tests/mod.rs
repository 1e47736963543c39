//! The traps of slices, each with a solid whose surface is known.

mod contours;

use super::*;
use crate::reconstruction::cloud::{Error, Label, PointCloud};
use crate::reconstruction::observer::Warning;
use crate::reconstruction::vector::{add, along, distance, scale};

type Built = (PointCloud, Record, Vec<Warning>);

/// A stack of `slices` slices, `step` apart.
fn stack(column: Vec3, row: Vec3, step: Vec3, slices: usize) -> Geometry {
    let origins = (0..slices).map(|k| scale(step, k as f64)).collect();
    Geometry {
        column,
        row,
        origins,
    }
}

/// Pixels of 0.5 mm in slices of 2 mm.
fn plain(slices: usize) -> Geometry {
    stack([0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 2.0], slices)
}

/// The whole of a slice of `size` pixels in a row and in a column, filled where `inside` says.
fn mask(geometry: &Geometry, slice: usize, size: usize, inside: impl Fn(Vec3) -> bool) -> Plane {
    let origin = geometry.origins[slice];
    let filled = (0..size * size)
        .map(|i| {
            let in_row = along(origin, (i % size) as f64, geometry.column);
            u8::from(inside(along(in_row, (i / size) as f64, geometry.row)))
        })
        .collect();
    let content = Content::Mask(Mask {
        left: 0,
        top: 0,
        width: size,
        filled,
        fractional: false,
        slice_size: [size; 2],
    });
    Plane { slice, content }
}

fn build(geometry: &Geometry, planes: impl IntoIterator<Item = Plane>) -> Result<Built, Error> {
    let mut builder = Builder::new(geometry)?;
    for plane in planes {
        builder.push(plane)?;
    }
    builder.finish()
}

/// A label map of `size` pixels in each row and column.
fn rasterised(geometry: &Geometry, size: usize, inside: impl Fn(Vec3) -> bool) -> Built {
    let slices = 0..geometry.origins.len();
    let planes = slices.map(|slice| mask(geometry, slice, size, &inside));
    build(geometry, planes).unwrap()
}

fn codes(built: &Built) -> Vec<&'static str> {
    built.2.iter().map(|warning| warning.code).collect()
}

/// Points of one kind.
fn of(cloud: &PointCloud, label: Label) -> Vec<Vec3> {
    cloud.indices(label).map(|i| cloud.points[i]).collect()
}

/// Surface points are near the ball, those with sides on the right one.
fn assert_ball(built: &Built, centre: Vec3, radius: f64, most: f64) {
    let cloud = &built.0;
    let away = |p: Vec3| distance(p, centre) - radius;
    for p in of(cloud, Label::Surface) {
        assert!(away(p).abs() < most, "{p:?} is {} off", away(p));
    }
    for p in of(cloud, Label::Interior) {
        assert!(away(p) < 0.0, "{p:?} is outside");
    }
    for p in of(cloud, Label::Exterior) {
        assert!(away(p) > 0.0, "{p:?} is inside");
    }
    for label in [Label::Surface, Label::Interior, Label::Exterior] {
        assert!(cloud.indices(label).count() > 50, "{label:?}");
    }
}

fn ball(centre: Vec3, radius: f64) -> impl Fn(Vec3) -> bool {
    move |p| distance(p, centre) < radius
}

#[test]
fn points_lie_on_the_surface_keep_their_distance_and_sides_are_right() {
    let geometry = plain(16);
    let centre = [15.1, 15.2, 15.3];
    let built = rasterised(&geometry, 61, ball(centre, 10.0));
    assert_ball(&built, centre, 10.0, 0.25);
    assert_eq!(codes(&built), [""; 0]);
    let summary = &built.1.summary;
    assert_eq!(summary.slices, 10);
    assert!(
        distance(
            [summary.pixel_size[0], summary.pixel_size[1], 0.0],
            [0.5, 0.5, 0.0]
        ) < 1e-12
    );
    assert!((summary.slice_distance - 2.0).abs() < 1e-12);
    assert!((summary.thinning_radius - 0.7).abs() < 1e-12);
    assert!((summary.volume - summary.voxels.unwrap() * 0.5).abs() < 1e-6);
    let points = of(&built.0, Label::Surface);
    assert_eq!(points.len(), summary.surface_points);
    for (i, &p) in points.iter().enumerate() {
        assert!(points[..i].iter().all(|&q| distance(p, q) >= 0.7 - 1e-12));
    }
    let beyond = of(&built.0, Label::Exterior);
    let ends = [
        beyond.iter().any(|p| p[2] < 5.0),
        beyond.iter().any(|p| p[2] > 25.5),
    ];
    assert_eq!(
        ends,
        [true, true],
        "one slice beyond both ends tells that the body ends"
    );
    assert_eq!(rasterised(&geometry, 61, ball(centre, 10.0)).0, built.0);
}

#[test]
fn sheared_mirrored_and_reversed_stacks_give_points_of_the_same_ball() {
    for (column, row, step) in [
        ([0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.3, 2.0]),
        ([0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 2.0]),
        ([0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, -2.0]),
        ([0.4, 0.3, 0.0], [-0.3, 0.4, 0.0], [0.0, 0.0, 2.0]),
        ([0.5, 0.0, 0.0], [0.1, 0.6, 0.0], [0.2, 0.1, 1.5]),
    ] {
        let geometry = stack(column, row, step, 16);
        let middle = add(scale(column, 30.0), scale(row, 30.0));
        let centre = add(middle, scale(step, 7.6));
        let built = rasterised(&geometry, 61, ball(centre, 9.0));
        assert_ball(&built, centre, 9.0, 0.25);
        assert_eq!(codes(&built), [""; 0], "{column:?} {row:?} {step:?}");
    }
}

#[test]
fn the_side_at_the_border_of_the_volume_is_invented_and_said() {
    let geometry = plain(12);
    let built = rasterised(&geometry, 41, ball([10.0, 1.0, 1.0], 8.0));
    assert_eq!(codes(&built), ["label_touches_border"]);
    assert_eq!(
        built.1.summary.invented_at,
        [Face::FirstRow, Face::FirstSlice]
    );
    let (surface, exterior) = (of(&built.0, Label::Surface), of(&built.0, Label::Exterior));
    assert!(
        surface.iter().any(|p| p[1] < 0.0),
        "the cap is half a pixel beyond the first row"
    );
    assert!(
        exterior.iter().any(|p| p[2] < -1.0),
        "the slice before the first one is outside"
    );
}

#[test]
fn slices_that_are_left_out_are_no_hole() {
    let geometry = plain(16);
    let centre = [15.1, 15.2, 15.3];
    let planes = (0..16)
        .filter(|slice| *slice != 7)
        .map(|slice| mask(&geometry, slice, 61, ball(centre, 10.0)));
    let built = build(&geometry, planes).unwrap();
    assert_eq!(codes(&built), ["slices_missing"]);
    assert_eq!(built.1.summary.gaps, 1);
    assert_ball(&built, centre, 10.0, 0.25);
    assert!(
        of(&built.0, Label::Exterior)
            .iter()
            .all(|&p| distance(p, centre) > 10.0)
    );

    let mut gap = geometry.clone();
    gap.origins.remove(7);
    let planes = (0..15).map(|slice| mask(&gap, slice, 61, ball(centre, 10.0)));
    let built = build(&gap, planes).unwrap();
    assert_eq!(codes(&built), ["slices_missing"]);
    assert_ball(&built, centre, 10.0, 0.25);
}

#[test]
fn two_bodies_above_each_other_are_no_gap() {
    let geometry = plain(30);
    let [low, high] = [[8.0, 8.0, 10.0], [22.0, 22.0, 35.0]];
    let built = rasterised(&geometry, 61, |p| ball(low, 6.0)(p) || ball(high, 6.0)(p));
    assert_eq!(codes(&built), [""; 0]);
    let between = of(&built.0, Label::Exterior);
    assert!(between.iter().any(|p| (15.0..29.0).contains(&p[2])));
    for p in between {
        assert!(distance(p, low) >= 6.0 && distance(p, high) >= 6.0);
    }
}

#[test]
fn of_repeated_slices_the_middle_ones_are_used() {
    let coarse = stack([0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 3.0], 10);
    let fine = stack([0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 1.0], 30);
    let centre = [15.1, 15.2, 13.3];
    // Slices 3 k to 3 k + 2 of the fine stack show slice k, whose centre is at 3 k + 1.
    let at_middle = move |p: Vec3| ball(centre, 10.0)(add(p, [0.0, 0.0, 1.0]));
    let planes = (0..30).map(|slice| Plane {
        slice,
        ..mask(&coarse, slice / 3, 61, at_middle)
    });
    let built = build(&fine, planes).unwrap();
    assert_eq!(codes(&built), ["slices_repeated"]);
    let summary = &built.1.summary;
    assert_eq!(summary.slices_repeated, 3);
    assert!((summary.slice_distance - 3.0).abs() < 1e-12);
    assert_ball(&built, centre, 10.0, 0.25);
}

#[test]
fn a_prism_keeps_its_ends() {
    let geometry = plain(12);
    let inside = |p: Vec3| (5.0..15.0).contains(&p[0]) && (5.0..15.0).contains(&p[1]);
    let built = rasterised(&geometry, 41, |p| inside(p) && (5.0..17.0).contains(&p[2]));
    assert_eq!(codes(&built), [""; 0]);
    assert_eq!(built.1.summary.slices, 6);
    let points = of(&built.0, Label::Surface);
    let heights = [6.0, 16.0].map(|z| points.iter().any(|p| (p[2] - z).abs() < 1e-9));
    assert_eq!(heights, [true, true]);
}

#[test]
fn an_island_of_a_pixel_and_a_thin_wall_are_not_smoothed_away() {
    let geometry = plain(8);
    let centre = [5.0, 5.0, 7.0];
    let island = [14.0, 14.0];
    let near = |p: Vec3| (p[0] - island[0]).hypot(p[1] - island[1]);
    let wall = |p: Vec3| (p[0] - 18.0).abs() < 0.2 && (2.0..8.0).contains(&p[1]);
    let built = rasterised(&geometry, 41, |p| {
        ball(centre, 4.0)(p) || near(p) < 0.2 || wall(p)
    });
    let points = of(&built.0, Label::Surface);
    assert!(points.iter().any(|&p| near(p) < 0.5));
    assert!(
        points
            .iter()
            .any(|p| (p[0] - 18.0).abs() < 0.5 && (4.0..6.0).contains(&p[1]))
    );
}

#[test]
fn equal_edges_of_voxels_give_points_as_near() {
    let geometry = stack([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], 30);
    let centre = [15.1, 15.2, 15.3];
    let built = rasterised(&geometry, 31, ball(centre, 11.0));
    assert_ball(&built, centre, 11.0, 0.5);
    let points = of(&built.0, Label::Surface);
    let mean = points
        .iter()
        .map(|&p| distance(p, centre) - 11.0)
        .sum::<f64>()
        / points.len() as f64;
    assert!(mean.abs() < 0.03, "{mean}");
}

#[test]
fn what_no_surface_can_be_made_of_is_refused() {
    let refused = |result: Result<Built, Error>, said: &str| {
        let error = result.unwrap_err();
        assert_eq!(error.code(), "slices_unusable");
        assert!(error.to_string().contains(said), "{error}");
    };
    let geometry = plain(5);
    let one = |slice| mask(&geometry, slice, 41, ball([10.0, 10.0, 4.0], 5.0));
    refused(build(&geometry, [one(2)]), "1 slice(s) show the label");
    refused(build(&geometry, []), "0 slice(s)");
    refused(build(&geometry, [one(2), one(1)]), "not behind");
    refused(build(&geometry, [one(2), one(2)]), "not behind");
    refused(build(&plain(1), []), "only one slice");
    let flat = stack([1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 1.0], 3);
    refused(build(&flat, []), "run the same way");
    let mut mixed = plain(4);
    mixed.origins.swap(1, 2);
    refused(build(&mixed, []), "not in order");
}

#[test]
fn fractions_are_not_smoothed_again() {
    let geometry = plain(16);
    let centre = [15.1, 15.2, 15.3];
    let fraction = |p: Vec3| ((10.0 - distance(p, centre)) / 0.5 + 0.5).clamp(0.0, 1.0);
    let planes = (0..16).map(|slice| {
        let mut plane = mask(&geometry, slice, 61, |_| false);
        if let Content::Mask(mask) = &mut plane.content {
            mask.fractional = true;
            for (i, value) in mask.filled.iter_mut().enumerate() {
                let p = [
                    0.5 * (i % 61) as f64,
                    0.5 * (i / 61) as f64,
                    2.0 * slice as f64,
                ];
                *value = (255.0 * fraction(p)).round() as u8;
            }
        }
        plane
    });
    let built = build(&geometry, planes).unwrap();
    assert_ball(&built, centre, 10.0, 0.05);
}

#[test]
fn pixels_of_the_label_are_held_against_a_mesh() {
    let geometry = plain(16);
    let built = rasterised(&geometry, 61, |p| {
        (4.0..20.0).contains(&p[0]) && (6.0..16.0).contains(&p[1]) && (5.0..21.0).contains(&p[2])
    });
    let corner = |i: u32| {
        let pick = |bit: u32, ends: [f64; 2]| ends[usize::from(i & bit > 0)];
        [
            pick(1, [3.9, 19.9]),
            pick(2, [5.9, 10.9]),
            pick(4, [5.0, 21.0]),
        ]
    };
    let faces = [
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ];
    let mesh = crate::reconstruction::mesh::TriangleMesh {
        vertices: (0..8).map(corner).collect(),
        triangles: faces.to_vec(),
        ..Default::default()
    };
    let overlap = built.1.occupancy.overlap(&mesh);
    assert_eq!(
        [overlap.label, overlap.mesh, overlap.both],
        [32 * 20 * 8, 32 * 10 * 8, 32 * 10 * 8]
    );
    assert!((overlap.dice().unwrap() - 2.0 / 3.0).abs() < 1e-12);
}
