//! Places that are known to lie inside or outside.

use super::layers::Layer;

/// Pixels from the contours below which the side of a place is not sure.
const LEAST_PIXELS: f64 = 1.0;

/// What lies beside a layer in the stack.
#[derive(Debug, Clone, Copy)]
pub(super) enum Beside<'a> {
    /// Another layer.
    Layer(&'a Layer),
    /// A slice without the label, or the end of the stack.
    Nothing,
    /// Slices are missing.
    Unknown,
}

/// Distances from the contours, in millimetres, between which places tell a side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Band {
    least: f32,
    most: f32,
}

impl Band {
    /// From one pixel on, up to `reach`.
    pub(super) fn new(pixel: [f64; 2], reach: f64) -> Self {
        let least = LEAST_PIXELS * pixel[0].max(pixel[1]);
        Self {
            least: least as f32,
            most: reach.max(2.0 * least) as f32,
        }
    }

    /// Whether a place so far from the contours tells a side.
    fn tells(self, distance: f32) -> bool {
        (self.least..=self.most).contains(&distance)
    }
}

/// Places on a layer, in columns and rows, and whether they are inside: those near its contours, and those on the
/// other side of what lies below and above.
pub(super) fn on_layer(
    layer: &Layer,
    beside: [Beside<'_>; 2],
    band: Band,
    mut take: impl FnMut([f64; 2], bool),
) {
    let lattice = &layer.lattice;
    let changes = |place| {
        beside.iter().any(|beside| match beside {
            Beside::Layer(other) => !other.lattice.contains(place),
            Beside::Nothing => true,
            Beside::Unknown => false,
        })
    };
    for (i, &inside) in lattice.inside.iter().enumerate() {
        let (place, distance) = (lattice.place(i), lattice.distances[i]);
        let deep = inside && distance > band.most && changes(place);
        if deep || band.tells(distance) {
            take(place, inside);
        }
    }
    for beside in beside {
        let Beside::Layer(other) = beside else {
            continue;
        };
        for (i, _) in other
            .lattice
            .inside
            .iter()
            .enumerate()
            .filter(|(_, inside)| **inside)
        {
            let place = other.lattice.place(i);
            let far = |i: usize| !lattice.inside[i] && lattice.distances[i] > band.most;
            if lattice.at(place).is_none_or(far) {
                take(place, false);
            }
        }
    }
}

/// Places over and around a layer, which are outside where nothing lies beside it.
pub(super) fn beyond(layer: &Layer, band: Band, mut take: impl FnMut([f64; 2])) {
    let lattice = &layer.lattice;
    for (i, &inside) in lattice.inside.iter().enumerate() {
        if inside || lattice.distances[i] <= band.most {
            take(lattice.place(i));
        }
    }
}
