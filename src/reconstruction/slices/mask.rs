//! From the pixels of a slice to the contours that they are the inside of.

use super::lattice::Lattice;
use super::{Mask, blur};

/// Half full: where contours run.
const LEVEL: f32 = 0.5;

/// Pixels below which an island is left as it is: smoothing would wipe it out.
const ISLAND: usize = 9;

/// The contours of a mask, as points in columns and rows, and the lattice around them with a margin of so many pixels.
pub(super) fn contours(mask: &Mask, margin: usize, pixel: [f64; 2]) -> (Vec<[f64; 2]>, Lattice) {
    let margin = margin.max(blur::REACH + 1);
    let (raw, width) = padded(mask, margin);
    let smooth = if mask.fractional {
        raw
    } else {
        smoothed(&raw, width)
    };
    let first = [mask.left, mask.top].map(|start| start as f64 - margin as f64);
    let points = crossings(&smooth, width)
        .into_iter()
        .map(|p| [first[0] + p[0], first[1] + p[1]])
        .collect();
    let inside = smooth.iter().map(|&v| v >= LEVEL).collect();
    (points, Lattice::new(first, 1.0, width, inside, pixel))
}

/// Shares from 0 to 1 with a margin of empty pixels, and the number of columns.
fn padded(mask: &Mask, margin: usize) -> (Vec<f32>, usize) {
    let width = mask.width + 2 * margin;
    let height = mask.filled.len() / mask.width.max(1) + 2 * margin;
    let mut values = vec![0.0; width * height];
    for (y, row) in mask.filled.chunks(mask.width.max(1)).enumerate() {
        let start = (y + margin) * width + margin;
        for (value, &filled) in values[start..].iter_mut().zip(row) {
            *value = if mask.fractional {
                f32::from(filled) / 255.0
            } else {
                f32::from(u8::from(filled > 0))
            };
        }
    }
    (values, width)
}

/// The smoothed mask; what smoothing would wipe out stays as it is.
fn smoothed(raw: &[f32], width: usize) -> Vec<f32> {
    let mut smooth = blur::gaussian(raw, width);
    for island in islands(raw, width) {
        let left = island.iter().filter(|&&i| smooth[i] >= LEVEL).count();
        if island.len() < ISLAND || 2 * left < island.len() {
            for &i in &island {
                smooth[i] = 1.0;
            }
        }
    }
    smooth
}

/// Pixels that hang together over edges or corners.
fn islands(raw: &[f32], width: usize) -> Vec<Vec<usize>> {
    let mut seen = vec![false; raw.len()];
    let mut found = Vec::new();
    for start in 0..raw.len() {
        if seen[start] || raw[start] < LEVEL {
            continue;
        }
        seen[start] = true;
        let mut island = vec![start];
        let mut next = 0;
        while next < island.len() {
            let i = island[next];
            next += 1;
            // The margin is empty, so that no pixel of an island lies at the border.
            for near in [i - width - 1, i - width, i - width + 1, i - 1]
                .into_iter()
                .chain([i + 1, i + width - 1, i + width, i + width + 1])
            {
                if !seen[near] && raw[near] >= LEVEL {
                    seen[near] = true;
                    island.push(near);
                }
            }
        }
        found.push(island);
    }
    found
}

/// Where the values cross the level between neighbours in rows and columns.
fn crossings(values: &[f32], width: usize) -> Vec<[f64; 2]> {
    let mut points = Vec::new();
    for i in 0..values.len() {
        let (x, y) = (i % width, i / width);
        let across = (x + 1 < width).then(|| (i + 1, [1.0, 0.0]));
        let down = (i + width < values.len()).then(|| (i + width, [0.0, 1.0]));
        for (j, way) in across.into_iter().chain(down) {
            let (a, b) = (values[i], values[j]);
            if (a >= LEVEL) != (b >= LEVEL) {
                let share = f64::from((LEVEL - a) / (b - a));
                points.push([x as f64 + share * way[0], y as f64 + share * way[1]]);
            }
        }
    }
    points
}
