//! Normals that are given and wrong.

use meshway::reconstruction::cloud::PointCloud;
use meshway::reconstruction::vector::{Vec3, dot, scale, sub};
use rand::RngExt;

use super::{Truth, bare, codes, deviate, message, random, right, ring};

/// The ring with normals made of the right ones.
fn with_normals(mut change: impl FnMut(usize, Vec3, Vec3) -> Vec3) -> PointCloud {
    let (points, normals) = ring(3_000, 8);
    let changed = (0..points.len()).map(|i| change(i, points[i], normals[i]));
    PointCloud {
        normals: Some(changed.collect()),
        ..bare(points)
    }
}

#[test]
fn flipped_normals_are_turned_and_counted() {
    for share in [0.05, 0.3, 0.5] {
        let mut random = random(9);
        let mut flipped = 0_usize;
        let cloud = with_normals(|_, _, normal| {
            if random.random::<f64>() < share {
                flipped += 1;
                scale(normal, -1.0)
            } else {
                normal
            }
        });
        let made = right(&cloud, &Truth::ring());
        let told = message(&made, "normals_turned");
        let turned = told
            .split(' ')
            .find_map(|word| word.parse::<usize>().ok())
            .unwrap();
        // Turning all of them is no contradiction: of half, either part is that which is turned.
        let either = turned
            .min(3_000 - turned)
            .abs_diff(flipped.min(3_000 - flipped));
        assert!(either <= 30, "{flipped} flipped: {told}");
    }
}

#[test]
fn normals_towards_one_viewpoint_are_turned() {
    let cloud = with_normals(|_, point, normal| {
        let towards = dot(normal, sub([60.0, 20.0, 40.0], point));
        scale(normal, towards.signum())
    });
    message(&right(&cloud, &Truth::ring()), "normals_turned");
}

#[test]
fn normals_at_random_are_replaced() {
    let mut random = random(10);
    let cloud = with_normals(|_, _, _| deviate(&mut random));
    message(&right(&cloud, &Truth::ring()), "normals_contradictory");
}

#[test]
fn noisy_normals_of_any_length_serve() {
    let mut random = random(11);
    let cloud = with_normals(|i, _, normal| {
        let length = 0.01 * (1 + i % 500) as f64;
        let shift = deviate(&mut random);
        std::array::from_fn(|axis| length * (normal[axis] + 0.2 * shift[axis]))
    });
    let made = right(&cloud, &Truth::ring());
    assert!(!codes(&made).contains(&"normals_contradictory"));
}
