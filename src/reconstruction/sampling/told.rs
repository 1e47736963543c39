//! What neighbourhoods of one size tell of points, and of which size they have to be.

use super::neighbours::{Neighbourhoods, Tree};
use super::normals::{NormalSource, Normals, normals};
use super::orientation::{MANY, least_contradiction};
use super::winding::Oriented;
use crate::reconstruction::observer::Warning;
use crate::reconstruction::vector::Vec3;

/// Contradiction at the distance where it is least, as of a closed surface and as of a sheet, up to which the sides of
/// points are borne out.
const BORNE_OUT: f64 = 0.1;

/// Neighbours that are tried where they are not, over the chosen number. Noise of twice the spacing leaves no sheet in
/// 16 neighbours of a long bone of 8000 points, and one in 40.
const MORE: f64 = 2.5;

/// The wider neighbourhoods are believed if their contradiction is below this share. Of 8000 points with noise of 1 % of
/// the diagonal, those of the bone leave 0.28 of it and of a figure 0.37; those of a brain, whose grooves they close,
/// 0.86. Not chosen on: gear 0.67, capsule 0.52.
const CLEARLY_LESS: f64 = 0.5;

/// Normals of points with the neighbourhoods that they come from.
pub(super) struct Told {
    pub(super) near: Neighbourhoods,
    pub(super) normals: Normals,
    /// Local spacings.
    pub(super) spacings: Vec<f64>,
    /// Areas that the points stand for.
    pub(super) areas: Vec<f64>,
}

impl Told {
    /// From these neighbours, or from more where bare points contradict themselves with these and clearly less
    /// with those.
    pub(super) fn new(
        points: &[Vec3],
        given: Option<&[Vec3]>,
        (tree, near): (&Tree, Neighbourhoods),
        warnings: &mut Vec<Warning>,
    ) -> Self {
        let neighbours = near.count();
        let told = Self::by(points, given, (tree, near), warnings);
        if told.normals.source == NormalSource::Given || points.len() > MANY {
            return told;
        }
        let contradiction = least_contradiction(told.oriented(points), BORNE_OUT);
        if contradiction.closed.min(contradiction.sheet) < BORNE_OUT {
            return told;
        }
        let more = (MORE * neighbours as f64) as usize;
        let more = Neighbourhoods::new(tree, points, more);
        let by_more = Self::by(points, None, (tree, more), &mut Vec::new());
        let less = CLEARLY_LESS * contradiction.closed;
        if least_contradiction(by_more.oriented(points), less).closed < less {
            by_more
        } else {
            told
        }
    }

    fn by(
        points: &[Vec3],
        given: Option<&[Vec3]>,
        (tree, near): (&Tree, Neighbourhoods),
        warnings: &mut Vec<Warning>,
    ) -> Self {
        let mut normals = normals(points, given, tree, &near, warnings);
        let spacings = near.spacings(points);
        Self {
            areas: normals
                .areas
                .take()
                .unwrap_or_else(|| near.areas(points, &normals.directions, &spacings)),
            near,
            normals,
            spacings,
        }
    }

    /// The points with what is told of them.
    pub(super) fn oriented<'a>(&'a self, points: &'a [Vec3]) -> Oriented<'a> {
        Oriented {
            points,
            normals: &self.normals.directions,
            areas: &self.areas,
            spacings: &self.spacings,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rand::RngExt;
    use rand_distr::StandardNormal;

    use super::*;
    use crate::reconstruction::random::{Purpose, stream};
    use crate::reconstruction::vector::{along, dot, norm};

    /// A rod of radius 4 with round ends: points with such noise, and the outward normals where they were.
    fn rod(count: usize, noise: f64) -> (Vec<Vec3>, Vec<Vec3>) {
        let (radius, half) = (4.0, 14.0);
        let mut random = stream(7, Purpose::Selection);
        (0..count)
            .map(|_| {
                // By Archimedes, the area of a ball goes with the height, as that of a rod does.
                let height: f64 = random.random_range(-half - radius..half + radius);
                let beyond = (height.abs() - half).max(0.0).copysign(height) / radius;
                let (sin, cos) = random.random_range(0.0..TAU).sin_cos();
                let around = (1.0 - beyond * beyond).sqrt();
                let normal = [around * cos, around * sin, beyond];
                let axis = [0.0, 0.0, height.clamp(-half, half)];
                let moved: f64 = random.sample(StandardNormal);
                (along(axis, radius + noise * moved, normal), normal)
            })
            .unzip()
    }

    #[test]
    fn noise_of_twice_the_spacing_asks_for_more_neighbours() {
        for (noise, expected) in [(0.0, 16), (1.0, 40)] {
            let (points, outward) = rod(2600, noise);
            let tree = Tree::new(&points);
            let near = Neighbourhoods::new(&tree, &points, 16);
            let told = Told::new(&points, None, (&tree, near), &mut Vec::new());
            assert_eq!(told.near.count(), expected);
            let found = &told.normals.directions;
            let right = found
                .iter()
                .zip(&outward)
                .filter(|(a, b)| dot(**a, **b) > 0.5);
            assert!(right.count() as f64 > 0.95 * points.len() as f64);
            assert!(
                found
                    .iter()
                    .all(|normal| (norm(*normal) - 1.0).abs() < 1e-9)
            );
        }
    }
}
