//! Reading a million points from memory.

use std::fmt::Write;

use criterion::{Criterion, Throughput};
use meshway::reconstruction::cloud::{Limits, PointCloud, read, write_ply};
use meshway::reconstruction::shapes::{Recipe, Shape, sample};

const POINTS: usize = 1_000_000;

pub(super) fn ply(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("PLY of a million points");
    group.sample_size(10);
    for (name, write) in [
        ("binary", binary as fn(&PointCloud) -> Vec<u8>),
        ("ASCII", ascii),
    ] {
        group.throughput(Throughput::Elements(POINTS as u64));
        group.bench_function(name, |bencher| {
            let file = write(&cloud());
            bencher.iter(|| read(&file, None, &Limits::default()).expect("the file is sound"));
        });
    }
    group.finish();
}

fn cloud() -> PointCloud {
    let recipe = Recipe {
        points: POINTS,
        ..Recipe::default()
    };
    sample(&Shape::Sphere { radius: 1.0 }, &recipe)
}

fn binary(cloud: &PointCloud) -> Vec<u8> {
    let mut file = Vec::new();
    write_ply(cloud, &mut file).expect("memory takes everything");
    file
}

/// Nine digits, as f32 has them.
fn ascii(cloud: &PointCloud) -> Vec<u8> {
    let mut file = format!(
        "ply\nformat ascii 1.0\nelement vertex {POINTS}\nproperty float x\nproperty float y\n\
         property float z\nend_header\n"
    );
    for [x, y, z] in &cloud.points {
        writeln!(file, "{x:.9} {y:.9} {z:.9}").expect("memory takes everything");
    }
    file.into_bytes()
}
