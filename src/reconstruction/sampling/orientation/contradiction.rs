//! How far oriented points contradict themselves.

use crate::reconstruction::sampling::winding::{Oriented, Winding};
use crate::reconstruction::vector::{Vec3, along};

/// Most points around which a result is judged.
const MOST_PROBES: usize = 4_000;

/// Distances from the points, in spacings, of which one is beyond the noise and still within the body, if there is any.
const DISTANCES: [f64; 5] = [1.0, 2.0, 3.0, 4.0, 6.0];

/// Departures of the winding number beside the points from what it should be there.
#[derive(Debug, Clone, Copy)]
pub(in crate::reconstruction::sampling) struct Contradiction {
    /// Mean squared departure from 1 inside and from 0 outside, added: 0 where a closed surface is oriented.
    pub(in crate::reconstruction::sampling) closed: f64,
    /// Mean squared departure from 1 of inside less outside: 0 where a sheet has one side, open or closed.
    pub(in crate::reconstruction::sampling) sheet: f64,
}

/// How far `oriented` points contradict themselves one spacing beside them, over some of the points where they are many.
pub(super) fn contradiction(oriented: Oriented<'_>) -> Contradiction {
    at_distance(&Winding::new(oriented), oriented, 1.0)
}

/// The least of both kinds at any of some distances, the nearest first, until that of a closed surface is below
/// `enough`: points that noise moves by more than their spacing are borne out beyond it alone.
pub(in crate::reconstruction::sampling) fn least_contradiction(
    oriented: Oriented<'_>,
    enough: f64,
) -> Contradiction {
    let winding = Winding::new(oriented);
    let mut least = Contradiction {
        closed: f64::INFINITY,
        sheet: f64::INFINITY,
    };
    for spacings in DISTANCES {
        let found = at_distance(&winding, oriented, spacings);
        least.closed = least.closed.min(found.closed);
        least.sheet = least.sheet.min(found.sheet);
        if least.closed < enough {
            break;
        }
    }
    least
}

/// The same so many `spacings` beside the points.
fn at_distance(winding: &Winding, oriented: Oriented<'_>, spacings: f64) -> Contradiction {
    let every = oriented.points.len().div_ceil(MOST_PROBES);
    let beside = |side: f64| {
        let probes: Vec<Vec3> = (0..oriented.points.len())
            .step_by(every)
            .map(|i| {
                let step = side * spacings * oriented.spacings[i];
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
