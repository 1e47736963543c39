//! From the pixels of a slice to the contours that they are the inside of.

use super::lattice::Lattice;
use super::slope::Slope;
use super::{Mask, blur};

/// Half full: where contours run.
const LEVEL: f32 = 0.5;

/// Pixels below which an island is left as it is: smoothing would wipe it out.
const ISLAND: usize = 9;

/// Empty pixels on either side into which the smoothed mask fades.
const LEAST_MARGIN: usize = 5;

/// Standard deviation of the smoothing, in pixels: the least that leaves contours right to a tenth of a pixel.
const SIGMA: f64 = 1.0;

/// The same for the smoother mask that tells how contours bend.
const WIDE: f64 = 2.0;

/// By how much of what smoothing moves a bent contour inwards, half the square of its standard deviation times the
/// curvature, it is moved out again. All of it is a little too much, for contours are bent by their noise as well.
const UNDONE: f64 = 0.8;

/// Largest curvature that is believed, one over pixels.
const MOST_BENT: f64 = 0.5;

/// The contours of a mask, as places in columns and rows, and the lattice around them with a margin of so many
/// pixels.
pub(super) fn contours(mask: &Mask, margin: usize, pixel: [f64; 2]) -> (Vec<[f64; 2]>, Lattice) {
    let margin = margin.max(LEAST_MARGIN);
    let (raw, width) = padded(mask, margin);
    let wide = blur::gaussian(&raw, width, WIDE);
    let (level, moved) = if mask.fractional {
        (raw, vec![false; wide.len()])
    } else {
        smoothed(&raw, width)
    };
    let first = [mask.left, mask.top].map(|start| start as f64 - margin as f64);
    let points = crossings(&level, width)
        .into_iter()
        .map(|([from, _], place)| {
            let slope = Slope::at(&wide, width, place);
            let bend = slope.curvature().clamp(-MOST_BENT, MOST_BENT);
            let back = match slope.outward() {
                Some(outward) if moved[from] => {
                    outward.map(|v| v * UNDONE * 0.5 * SIGMA * SIGMA * bend)
                }
                _ => [0.0; 2],
            };
            [0, 1].map(|i| first[i] + place[i] + back[i])
        })
        .collect();
    let inside = level.iter().map(|&v| v >= LEVEL).collect();
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

/// The smoothed mask, and where it is smoothed: what smoothing would wipe out stays as it is.
fn smoothed(raw: &[f32], width: usize) -> (Vec<f32>, Vec<bool>) {
    let mut smooth = blur::gaussian(raw, width, SIGMA);
    let mut moved = vec![true; raw.len()];
    for island in islands(raw, width) {
        let left = island.iter().filter(|&&i| smooth[i] >= LEVEL).count();
        if island.len() < ISLAND || 2 * left < island.len() {
            for &i in &island {
                smooth[i] = 1.0;
                for near in [i, i - 1, i + 1, i - width, i + width] {
                    moved[near] = false;
                }
            }
        }
    }
    (smooth, moved)
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

/// The pixels next to each other in rows and columns between which the values cross the level, and where.
fn crossings(values: &[f32], width: usize) -> Vec<([usize; 2], [f64; 2])> {
    let mut points = Vec::new();
    for i in 0..values.len() {
        let (x, y) = (i % width, i / width);
        let across = (x + 1 < width).then(|| (i + 1, [1.0, 0.0]));
        let down = (i + width < values.len()).then(|| (i + width, [0.0, 1.0]));
        for (j, way) in across.into_iter().chain(down) {
            let (a, b) = (values[i], values[j]);
            if (a >= LEVEL) != (b >= LEVEL) {
                let share = f64::from((LEVEL - a) / (b - a));
                points.push((
                    [i, j],
                    [x as f64 + share * way[0], y as f64 + share * way[1]],
                ));
            }
        }
    }
    points
}
