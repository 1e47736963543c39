//! How far oriented points contradict themselves.

use crate::reconstruction::sampling::winding::{Oriented, Winding};
use crate::reconstruction::vector::{Vec3, along};

/// Most points around which a result is judged.
const MOST_PROBES: usize = 4_000;

/// Mean squared departure of the winding number from 1 one spacing inside each point, and from 0 one
/// spacing outside; over some of the points where they are many.
pub(super) fn contradiction(oriented: Oriented<'_>) -> f64 {
    let winding = Winding::new(oriented);
    let every = oriented.points.len().div_ceil(MOST_PROBES);
    let departure = |sign: f64, expected: f64| -> f64 {
        let probes: Vec<Vec3> = (0..oriented.points.len())
            .step_by(every)
            .map(|i| {
                let step = sign * oriented.spacings[i];
                along(oriented.points[i], step, oriented.normals[i])
            })
            .collect();
        let found = winding.at_all(&probes);
        let sum: f64 = found.iter().map(|w| (w - expected) * (w - expected)).sum();
        sum / probes.len() as f64
    };
    departure(-1.0, 1.0) + departure(1.0, 0.0)
}
