//! Normals of a cloud: the given ones, checked, or estimated ones, oriented.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::neighbours::Neighbourhoods;
use super::orientation::{orient, points_inwards};
use crate::reconstruction::observer::Warning;
use crate::reconstruction::symmetric::eigen;
use crate::reconstruction::vector::{Vec3, dot, normalized, scale, sub};

/// Where the normals come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NormalSource {
    /// From the cloud.
    Given,
    /// From the neighbours of each point.
    Estimated,
}

/// Outward unit normals of `points`: the `given` ones where they can be used.
///
/// Given normals are scaled to unit length. Those that are zero or not finite are replaced by
/// estimated ones on the side of the nearest usable ones; if none is usable, all are estimated and
/// oriented. If all point inwards, all are turned.
pub fn normals(
    points: &[Vec3],
    given: Option<&[Vec3]>,
    neighbours: &Neighbourhoods,
    warnings: &mut Vec<Warning>,
) -> (Vec<Vec3>, NormalSource) {
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
        let estimated = estimate(points, neighbours);
        return (
            orient(points, &estimated, neighbours),
            NormalSource::Estimated,
        );
    }
    if missing > 0 {
        warnings.push(Warning::new(
            "normals_replaced",
            format!("{missing} given normals are zero or not finite; they are estimated instead"),
        ));
        replace_missing(points, &mut checked, neighbours);
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
    (normals, NormalSource::Given)
}

/// Undirected unit normals: the direction of least extent of each point and its neighbours
/// [H92, section 3.2].
pub fn estimate(points: &[Vec3], neighbours: &Neighbourhoods) -> Vec<Vec3> {
    (0..points.len())
        .into_par_iter()
        .map(|i| plane(points, i, neighbours))
        .collect()
}

fn plane(points: &[Vec3], i: usize, neighbours: &Neighbourhoods) -> Vec3 {
    // Relative to point i, so that no digits are lost far from the origin.
    let arms: Vec<Vec3> = neighbours
        .of(i)
        .map(|j| sub(points[j], points[i]))
        .collect();
    let count = (arms.len() + 1) as f64;
    let mean: Vec3 = std::array::from_fn(|a| arms.iter().map(|d| d[a]).sum::<f64>() / count);
    let covariance = std::array::from_fn(|a| {
        std::array::from_fn(|b| {
            arms.iter().map(|d| d[a] * d[b]).sum::<f64>() / count - mean[a] * mean[b]
        })
    });
    let (_, vectors) = eigen(covariance);
    vectors[0]
}

/// Fills the gaps of `normals`, spreading the side from the usable ones outwards.
fn replace_missing(points: &[Vec3], normals: &mut [Option<Vec3>], neighbours: &Neighbourhoods) {
    let mut missing: Vec<usize> = (0..points.len())
        .filter(|&i| normals[i].is_none())
        .collect();
    while !missing.is_empty() {
        let filled: Vec<(usize, Vec3)> = missing
            .iter()
            .filter_map(|&i| {
                let known = neighbours.of(i).find_map(|j| normals[j])?;
                let normal = plane(points, i, neighbours);
                Some((i, scale(normal, 1.0_f64.copysign(dot(normal, known)))))
            })
            .collect();
        if filled.is_empty() {
            // A group with no usable normal around it: its own best orientation.
            let estimated = orient(points, &estimate(points, neighbours), neighbours);
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
