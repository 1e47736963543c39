//! How far oriented points contradict themselves.

use crate::reconstruction::sampling::winding::{Oriented, Winding};
use crate::reconstruction::vector::{Vec3, along};

/// Most points around which a result is judged.
const MOST_PROBES: usize = 4_000;

/// Departures of the winding number one spacing beside the points from what it should be there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Contradiction {
    /// Mean squared departure from 1 inside and from 0 outside, added: 0 where a closed surface is oriented.
    pub(super) closed: f64,
    /// Mean squared departure from 1 of inside less outside: 0 where a sheet has one side, open or closed.
    pub(super) sheet: f64,
}

/// How far `oriented` points contradict themselves, over some of the points where they are many.
pub(super) fn contradiction(oriented: Oriented<'_>) -> Contradiction {
    let winding = Winding::new(oriented);
    let every = oriented.points.len().div_ceil(MOST_PROBES);
    let beside = |side: f64| {
        let probes: Vec<Vec3> = (0..oriented.points.len())
            .step_by(every)
            .map(|i| {
                let step = side * oriented.spacings[i];
                along(oriented.points[i], step, oriented.normals[i])
            })
            .collect();
        winding.at_all(&probes)
    };
    let (inner, outer) = (beside(-1.0), beside(1.0));
    let mean = |departure: fn(f64, f64) -> f64| {
        let squares = inner.iter().zip(&outer).map(|(&inner, &outer)| {
            let departure = departure(inner, outer);
            departure * departure
        });
        squares.sum::<f64>() / inner.len() as f64
    };
    Contradiction {
        closed: mean(|inner, _| inner - 1.0) + mean(|_, outer| outer),
        sheet: mean(|inner, outer| inner - outer - 1.0),
    }
}
