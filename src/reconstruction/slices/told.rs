//! What slices tell: points of contours, and places inside and outside.

use rand::RngExt;
use rand::seq::SliceRandom;

use super::layers::{Layer, Stack};
use super::priority::Chosen;
use super::sides::{self, Band, Beside};
use super::thinning::Thinned;
use crate::reconstruction::random::Generator;
use crate::reconstruction::vector::Vec3;

/// Most places of each side.
const SIDES: usize = 3_000;

/// Points beyond which they are thinned further, so that memory and time have a bound.
const MAX_POINTS: usize = 100_000;

/// A layer in its place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'a> {
    pub(super) layer: &'a Layer,
    /// What lies below and above.
    pub(super) beside: [Beside<'a>; 2],
    /// Where it is: between slices for the middle of an even number of them.
    pub(super) slice: f64,
    /// How far the next layer would be: the number of its slices.
    pub(super) next: f64,
}

/// What one layer tells in its place.
#[derive(Debug)]
pub(super) struct Drawn {
    contour: Vec<Vec3>,
    /// Places, whether they are inside, and their random numbers.
    sides: Vec<(Vec3, bool, u64)>,
}

/// What all layers tell.
#[derive(Debug)]
pub(super) struct Told {
    pub(super) points: Thinned,
    pub(super) interior: Chosen,
    pub(super) exterior: Chosen,
    /// Where the layers are.
    pub(super) slices: Vec<f64>,
}

impl Seen<'_> {
    /// The same layer in one of its slices.
    pub(super) fn at(self, slice: usize) -> Self {
        let ends = [*self.layer.slices.start(), *self.layer.slices.end()];
        let beside = [0, 1].map(|i| {
            if slice == ends[i] {
                self.beside[i]
            } else {
                Beside::Layer(self.layer)
            }
        });
        Self {
            beside,
            slice: slice as f64,
            next: 1.0,
            ..self
        }
    }

    /// What it tells; points in random order.
    pub(super) fn told(self, stack: &Stack, band: Band, random: &mut Generator) -> Drawn {
        let place = |&place: &[f64; 2]| stack.point(place, self.slice);
        let mut contour: Vec<Vec3> = self.layer.contour.iter().map(place).collect();
        contour.shuffle(random);
        let mut sides = Vec::new();
        sides::on_layer(self.layer, self.beside, band, |place, inside| {
            sides.push((stack.point(place, self.slice), inside, random.random()));
        });
        for (beside, way) in self.beside.iter().zip([-self.next, self.next]) {
            if matches!(beside, Beside::Nothing) {
                sides::beyond(self.layer, band, |place| {
                    let place = stack.point(place, self.slice + way);
                    sides.push((place, false, random.random()));
                });
            }
        }
        Drawn { contour, sides }
    }
}

impl Told {
    /// Nothing yet; points keep a radius.
    pub(super) fn new(radius: f64) -> Self {
        Self {
            points: Thinned::new(radius),
            interior: Chosen::new(SIDES),
            exterior: Chosen::new(SIDES),
            slices: Vec::new(),
        }
    }

    /// Takes what a layer tells.
    pub(super) fn add(&mut self, drawn: &Drawn, slice: f64) {
        self.slices.push(slice);
        for &point in &drawn.contour {
            self.points.offer(point);
        }
        if self.points.len() > MAX_POINTS {
            self.points.coarsen();
        }
        for &(place, inside, number) in &drawn.sides {
            let side = if inside {
                &mut self.interior
            } else {
                &mut self.exterior
            };
            side.offer(place, number);
        }
    }
}
