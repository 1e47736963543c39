//! What given normals are worth: their sides by the winding number, their directions by how they scatter.

use super::neighbours::{Neighbourhoods, Tree, median};
use super::normals::{NormalSource, Normals};
use super::orientation::{Estimated, orient, refined};
use super::sides::Sides;
use super::winding::Oriented;
use crate::reconstruction::observer::Warning;
use crate::reconstruction::vector::{Vec3, dot, scale};

/// Share of the points at which the winding number contradicts the side of given normals from which on sides are
/// found anew, to be compared: right normals of clean points stay below.
const REVERSED: f64 = 0.002;

/// The same for the share of points at which it bears them out.
const SURE: f64 = 0.97;

/// One minus the cosine between normals of neighbours from which on directions are found anew, to be compared:
/// 25 degrees.
const SCATTERED: f64 = 0.09;

/// Given directions are left for estimated ones that scatter less than so many times as much: fits follow curved
/// surfaces as normals do, so that only errors of the directions make more of it.
const WORSE: f64 = 3.0;

/// Normals scatter at least by so much: one minus the cosine of 8 degrees.
const LEAST_SCATTER: f64 = 0.01;

/// The best of given unit normals, which point outwards as a whole, and of those that the points tell.
///
/// Sides are found anew where the winding number contradicts the given ones, and taken if it then contradicts
/// less; directions are kept unless they scatter from point to point where the points themselves do not.
pub(super) fn judged(
    points: &[Vec3],
    given: Vec<Vec3>,
    (tree, neighbours): (&Tree, &Neighbourhoods),
    warnings: &mut Vec<Warning>,
) -> Normals {
    let spacings = neighbours.spacings(points);
    let sides = |normals: &[Vec3]| {
        let areas = neighbours.areas(points, normals, &spacings);
        let oriented = Oriented {
            points,
            normals,
            areas: &areas,
            spacings: &spacings,
        };
        Sides::new(oriented, neighbours)
    };
    let of_given = sides(&given);
    let scattered = scatter(&given, neighbours);
    let doubtful =
        of_given.reversed() > REVERSED || of_given.confidence() < SURE || scattered > SCATTERED;
    let told = if doubtful {
        orient(points, tree, neighbours)
    } else {
        refined(points, &given, tree, neighbours)
    };
    let better = doubtful && sides(&told.normals).confidence() > of_given.confidence();
    let Estimated {
        normals: told,
        noise,
        areas: _,
    } = told;
    let mut turned = 0;
    let signed: Vec<Vec3> = given
        .into_iter()
        .zip(&told)
        .map(|(normal, told)| {
            if better && dot(normal, *told) < 0.0 {
                turned += 1;
                scale(normal, -1.0)
            } else {
                normal
            }
        })
        .collect();
    let directions_fail = scattered > WORSE * scatter(&told, neighbours).max(LEAST_SCATTER);
    let (directions, source) = if directions_fail {
        // Where the sides were not found anew, they are those of the given normals.
        (on_the_sides_of(&signed, told), NormalSource::Estimated)
    } else {
        (signed, NormalSource::Given)
    };
    warnings.extend(warning(turned, points.len(), directions_fail && better));
    Normals {
        directions,
        source,
        noise,
        areas: None,
    }
}

/// Median over the points of one minus the cosine, sides aside, between their normal and that of their nearest
/// neighbour.
fn scatter(normals: &[Vec3], neighbours: &Neighbourhoods) -> f64 {
    let mut angles: Vec<f64> = (0..normals.len())
        .filter_map(|i| {
            let j = neighbours.of(i).next()?;
            Some(1.0 - dot(normals[i], normals[j]).abs())
        })
        .collect();
    median(&mut angles)
}

fn on_the_sides_of(sides: &[Vec3], directions: Vec<Vec3>) -> Vec<Vec3> {
    directions
        .into_iter()
        .zip(sides)
        .map(|(direction, side)| scale(direction, 1.0_f64.copysign(dot(direction, *side))))
        .collect()
}

fn warning(turned: usize, of: usize, estimated: bool) -> Option<Warning> {
    if estimated {
        return Some(Warning::new(
            "normals_contradictory",
            "the given normals contradict each other and the points; they are estimated from the points instead; \
             see that the file's normals are those of its points",
        ));
    }
    (turned > 0).then(|| {
        Warning::new(
            "normals_turned",
            format!(
                "{turned} of {of} given normals contradict the side that all points tell and are turned; their \
                 directions are kept"
            ),
        )
    })
}
