//! Segmentations as slices, all the way to a mesh.

use meshway::reconstruction::cloud::{Format, Source};
use meshway::reconstruction::reconstruct;
use meshway::reconstruction::settings::{Preset, Settings};
use meshway::reconstruction::slices::{Builder, Content, Geometry, Mask, Plane};
use serde_json::json;

use crate::uncertainty::Silent;

const SIZE: usize = 70;

/// A ball with a lobe; negative inside.
fn organ([x, y, z]: [f64; 3]) -> f64 {
    let ball = |centre: [f64; 3], radius: f64| {
        let [dx, dy, dz] = [x - centre[0], y - centre[1], z - centre[2]];
        (dx * dx + dy * dy + dz * dz).sqrt() - radius
    };
    let (a, b) = (
        ball([24.0, 23.0, 24.0], 15.0),
        ball([34.0, 30.0, 31.0], 8.0),
    );
    let share = (0.5 + 0.5 * (b - a) / 4.0).clamp(0.0, 1.0);
    b * (1.0 - share) + a * share - 4.0 * share * (1.0 - share)
}

fn slice(geometry: &Geometry, slice: usize) -> Plane {
    let [x, y, z] = geometry.origins[slice];
    let place = |i: usize| [x + 0.7 * (i % SIZE) as f64, y + 0.7 * (i / SIZE) as f64, z];
    let filled = (0..SIZE * SIZE)
        .map(|i| u8::from(organ(place(i)) < 0.0))
        .collect();
    let content = Content::Mask(Mask {
        left: 0,
        top: 0,
        width: SIZE,
        filled,
        fractional: false,
        slice_size: [SIZE; 2],
    });
    Plane { slice, content }
}

#[test]
fn thick_slices_become_a_smooth_surface_of_the_right_volume() {
    let geometry = Geometry {
        column: [0.7, 0.0, 0.0],
        row: [0.0, 0.7, 0.0],
        origins: (0..17).map(|k| [0.0, 0.0, 3.0 * f64::from(k)]).collect(),
    };
    let mut builder = Builder::new(&geometry).unwrap();
    for k in 0..geometry.origins.len() {
        builder.push(slice(&geometry, k)).unwrap();
    }
    let (cloud, record, warnings) = builder.finish().unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    assert!(record.summary.voxels.unwrap() > 5_000.0);
    let settings =
        Settings::resolve(Preset::Fast, &json!({"surface": {"resolution": 80}})).unwrap();
    tch::set_num_threads(1);
    let mut made = reconstruct(&cloud, &settings, &Silent).unwrap();
    let source = Source {
        format: Format::Npy,
        gzipped: false,
        dropped_non_finite: 0,
        warnings,
        slices: Some(record),
        grid: None,
        identifiers: None,
    };
    made.report.read_from(Vec::new(), source, &made.mesh);
    let slices = made.report.slices.as_ref().unwrap();
    assert!(slices.volume_change_percent.unwrap().abs() < 1.5);
    assert!(slices.dice.unwrap() > 0.98, "{:?}", slices.dice);
    assert_eq!(made.report.mesh.topology.components, 1);
    let vertices = &made.mesh.vertices;
    let mean = vertices.iter().map(|&p| organ(p).abs()).sum::<f64>() / vertices.len() as f64;
    assert!(mean < 0.1, "{mean} mm");
    let summary = made.report.summary();
    assert!(summary.contains("slices 3.00 mm apart"), "{summary}");
}
