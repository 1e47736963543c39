//! Normals of a cloud: the given ones, checked, or estimated ones, oriented.

use serde::{Deserialize, Serialize};

use super::given::judged;
use super::neighbours::{Neighbourhoods, Tree};
use super::orientation::{orient, points_inwards};
use crate::reconstruction::nearby::map_nearby;
use crate::reconstruction::observer::Warning;
use crate::reconstruction::symmetric::{covariance, eigen};
use crate::reconstruction::vector::{Vec3, add, dot, normalized, scale, sub};

/// Fewest neighbours of which a plane is fitted.
const FEWEST: usize = 6;

/// Most neighbours of which a plane is fitted, as a multiple of the chosen number.
const MOST_WIDENING: usize = 8;

/// Nearest points whose normals a point takes the mean of.
const SHARED: usize = 8;

/// Where the normals come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NormalSource {
    /// From the cloud.
    Given,
    /// From the neighbours of each point.
    Estimated,
}

/// Outward unit normals.
pub struct Normals {
    /// One for each point.
    pub directions: Vec<Vec3>,
    /// Where they come from.
    pub source: NormalSource,
    /// Standard deviation of the points from the surface.
    pub noise: f64,
    /// Areas that the points stand for, where they were worked out on the way.
    pub(super) areas: Option<Vec<f64>>,
}

/// Outward unit normals of `points`: the `given` ones where they can be used.
///
/// Given normals are scaled to unit length. Those that are zero or not finite are replaced by
/// estimated ones on the side of the nearest usable ones; if none is usable, all are estimated and
/// oriented. If all point inwards, all are turned. What they are worth then is judged point by point.
pub fn normals(
    points: &[Vec3],
    given: Option<&[Vec3]>,
    tree: &Tree,
    neighbours: &Neighbourhoods,
    warnings: &mut Vec<Warning>,
) -> Normals {
    let mut checked: Vec<Option<Vec3>> = given.map_or_else(
        || vec![None; points.len()],
        |given| given.iter().copied().map(normalized).collect(),
    );
    let missing = checked.iter().filter(|n| n.is_none()).count();
    if missing == points.len() {
        if given.is_some() {
            warnings.push(Warning::new(
                "normals_unusable",
                "all given normals are zero or not finite; they are estimated instead",
            ));
        }
        let estimated = orient(points, tree, neighbours);
        return Normals {
            directions: estimated.normals,
            source: NormalSource::Estimated,
            noise: estimated.noise,
            areas: estimated.areas,
        };
    }
    if missing > 0 {
        warnings.push(Warning::new(
            "normals_replaced",
            format!("{missing} given normals are zero or not finite; they are estimated instead"),
        ));
        replace_missing(points, &mut checked, tree, neighbours);
    }
    let mut normals: Vec<Vec3> = checked.into_iter().flatten().collect();
    let all: Vec<usize> = (0..points.len()).collect();
    if points_inwards(points, &normals, &all, neighbours) {
        warnings.push(Warning::new(
            "normals_inward",
            "the given normals point inwards; they are turned around",
        ));
        for normal in &mut normals {
            *normal = scale(*normal, -1.0);
        }
    }
    judged(points, normals, (tree, neighbours), warnings)
}

/// Undirected unit normals: the direction of least extent of each point and its neighbours
/// \[H92, tangent plane estimation\].
///
/// # Deviations
/// \[H92\] takes a fixed number of neighbours. Here several numbers are tried, from half of those
/// in `neighbours` on, and the one whose points lie flattest is taken: thin parts ask for few,
/// noise above the spacing for many.
pub(super) fn estimate(points: &[Vec3], tree: &Tree, neighbours: usize) -> Vec<Vec3> {
    map_nearby(points, |i| plane(points, tree, points[i], neighbours))
}

/// Unit normals at `places`: each the mean of those of the nearest points of `tree` on the same sheet, whose unit
/// normals are `normals`.
pub(super) fn shared(places: &[Vec3], tree: &Tree, normals: &[Vec3]) -> Vec<Vec3> {
    map_nearby(places, |i| {
        let near = tree.nearest_n(places[i], SHARED);
        let first = normals[near[0].0];
        let same = near
            .iter()
            .map(|&(i, _)| normals[i])
            .filter(|normal| dot(*normal, first) > 0.0);
        normalized(same.fold([0.0; 3], add)).unwrap_or(first)
    })
}

/// The direction of [`estimate`] at one place.
pub(super) fn plane(points: &[Vec3], tree: &Tree, p: Vec3, neighbours: usize) -> Vec3 {
    let most = MOST_WIDENING * neighbours;
    // Relative to the point, so that no digits are lost far from the origin.
    let arms: Vec<Vec3> = tree
        .nearest_n(p, most + 1)
        .into_iter()
        .map(|(j, _)| sub(points[j], p))
        .collect();
    let mut best = (f64::INFINITY, [0.0, 0.0, 1.0]);
    let mut count = (neighbours / 2).max(FEWEST);
    loop {
        let taken = (count + 1).min(arms.len());
        let (values, vectors) = eigen(covariance(&arms[..taken]));
        // A plane has three degrees of freedom, so that few points lie flat by chance.
        let freedom = taken as f64 / (taken as f64 - 3.0).max(0.5);
        let roughness = freedom * values[0].max(0.0) / values[1].max(f64::MIN_POSITIVE);
        if roughness < best.0 {
            best = (roughness, vectors[0]);
        }
        if taken == arms.len() || count >= most {
            return best.1;
        }
        count *= 2;
    }
}

/// Fills the gaps of `normals`, spreading the side from the usable ones outwards.
fn replace_missing(
    points: &[Vec3],
    normals: &mut [Option<Vec3>],
    tree: &Tree,
    neighbours: &Neighbourhoods,
) {
    let mut missing: Vec<usize> = (0..points.len())
        .filter(|&i| normals[i].is_none())
        .collect();
    while !missing.is_empty() {
        let filled: Vec<(usize, Vec3)> = missing
            .iter()
            .filter_map(|&i| {
                let known = neighbours.of(i).find_map(|j| normals[j])?;
                let normal = plane(points, tree, points[i], neighbours.count());
                Some((i, scale(normal, 1.0_f64.copysign(dot(normal, known)))))
            })
            .collect();
        if filled.is_empty() {
            // A group with no usable normal around it: its own best orientation.
            let estimated = orient(points, tree, neighbours).normals;
            for &i in &missing {
                normals[i] = Some(estimated[i]);
            }
            return;
        }
        for (i, normal) in filled {
            normals[i] = Some(normal);
        }
        missing.retain(|&i| normals[i].is_none());
    }
}
