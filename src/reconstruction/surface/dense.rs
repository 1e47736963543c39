//! Sampling every point of the grid, layer by layer: the reference, and the way of \[N24\].
//!
//! Of each layer only the corners of cells that the surface crosses are kept, so that a grid of
//! 512³ points does not have to lie in memory at once.

use super::bits::Bits;
use super::grid::Lattice;
use super::samples::{BATCH, OUTSIDE, Samples, Source, check_size};
use super::sparse::{PROGRESS, around_edge};
use crate::reconstruction::error::Error;

/// Samples the whole grid and keeps the points around the surface.
pub(super) fn sample(source: &mut Source<'_>) -> Result<Samples, Error> {
    let lattice = source.lattice;
    let [_, _, layer] = lattice.strides;
    let layers = lattice.size[2];
    let mut kept = Bits::new(lattice.len());
    let mut values = Vec::new();
    let keep_around = |lower: usize, axis: usize, kept: &mut Bits| {
        around_edge(&lattice, lower, axis).for_each(|at| kept.insert(at));
    };
    let mut below = vec![OUTSIDE; layer];
    for z in 1..layers {
        let first = z * layer;
        let above = evaluate(source, first)?;
        for (place, value) in above.iter().enumerate() {
            let inside = *value > 0.0;
            // The last point of a row has no neighbour, but lies on the frame, as the next row's
            // first does, and so do the last row and the one that would follow it.
            for (axis, lower) in [
                (0, place.checked_sub(1)),
                (1, place.checked_sub(lattice.size[0])),
            ] {
                if let Some(lower) = lower
                    && (above[lower] > 0.0) != inside
                {
                    keep_around(first + lower, axis, &mut kept);
                }
            }
            if (below[place] > 0.0) != inside {
                keep_around(first - layer + place, 2, &mut kept);
            }
        }
        // An edge marks points one layer away at most: what lies below is decided now.
        keep(&kept, &lattice, z - 1, &below, &mut values);
        check_size(values.len(), source.request.max_triangles)?;
        below = above;
        (source.request.progress)(PROGRESS * z as f64 / layers as f64);
    }
    keep(&kept, &lattice, layers - 1, &below, &mut values);
    Ok(Samples::of(kept, values))
}

fn evaluate(source: &mut Source<'_>, first: usize) -> Result<Vec<f64>, Error> {
    let layer = source.lattice.strides[2];
    let mut values = Vec::with_capacity(layer);
    let indices: Vec<_> = (first..first + layer).collect();
    for batch in indices.chunks(BATCH) {
        source.append(batch, &mut values)?;
    }
    Ok(values)
}

fn keep(kept: &Bits, lattice: &Lattice, z: usize, layer: &[f64], values: &mut Vec<f64>) {
    let first = z * lattice.strides[2];
    let members = (0..layer.len()).filter(|place| kept.contains(first + place));
    values.extend(members.map(|place| layer[place]));
}
