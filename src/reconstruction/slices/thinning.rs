//! Points of which no two are nearer than a radius.

use std::collections::HashMap;

use super::super::vector::{Vec3, distance};

/// Points that keep their distance, in the order in which they came.
#[derive(Debug, Clone)]
pub(super) struct Thinned {
    radius: f64,
    cells: HashMap<[i64; 3], Vec<usize>>,
    points: Vec<Vec3>,
}

impl Thinned {
    /// None yet.
    pub(super) fn new(radius: f64) -> Self {
        Self {
            radius,
            cells: HashMap::new(),
            points: Vec::new(),
        }
    }

    /// Takes a point unless it is too near to one that is there; whether it was taken.
    pub(super) fn offer(&mut self, point: Vec3) -> bool {
        let cell = point.map(|v| (v / self.radius).floor() as i64);
        let near = |k: i64| {
            [
                cell[0] + k % 3 - 1,
                cell[1] + k / 3 % 3 - 1,
                cell[2] + k / 9 - 1,
            ]
        };
        let taken = (0..27).filter_map(|k| self.cells.get(&near(k))).flatten();
        if taken
            .into_iter()
            .any(|&i| distance(self.points[i], point) < self.radius)
        {
            return false;
        }
        self.cells.entry(cell).or_default().push(self.points.len());
        self.points.push(point);
        true
    }

    /// Drops points until those left are farther apart.
    pub(super) fn coarsen(&mut self) {
        let mut fewer = Self::new(self.radius * std::f64::consts::SQRT_2);
        for &point in &self.points {
            fewer.offer(point);
        }
        *self = fewer;
    }

    /// The distance that the points keep.
    pub(super) fn radius(&self) -> f64 {
        self.radius
    }

    /// Number of points.
    pub(super) fn len(&self) -> usize {
        self.points.len()
    }

    /// The points.
    pub(super) fn points(self) -> Vec<Vec3> {
        self.points
    }
}
