//! Which surface points are worked with: each place once, no strays, no more than memory is for.

use std::collections::HashSet;

use super::selection::{distinct, even_subset, pick};
use super::strays::strays;
use crate::reconstruction::cloud::{Label, PointCloud, enough_points};
use crate::reconstruction::error::Error;
use crate::reconstruction::nearby::Walk;
use crate::reconstruction::observer::Warning;
use crate::reconstruction::random::Generator;
use crate::reconstruction::settings::{self, OffSurface, Settings};
use crate::reconstruction::vector::bits;

/// Most surface points that are looked at; larger clouds are thinned evenly first.
pub(crate) const MAX_WORKING_POINTS: usize = 5_000_000;

/// Indices of the surface points that are worked with, and of strays: all and none in the paper's way, otherwise
/// different ones that are no strays, thinned where they are very many. Many are in an order in which neighbours follow
/// each other: what is worked out of neighbours finds them in the cache of the processor then.
pub(super) fn working_points(
    cloud: &PointCloud,
    settings: &Settings,
    choice: &mut Generator,
    warnings: &mut Vec<Warning>,
) -> Result<(Vec<usize>, Vec<usize>), Error> {
    let labelled: Vec<usize> = cloud.indices(Label::Surface).collect();
    enough_points(labelled.len())?;
    if settings.sampling.off_surface == OffSurface::Labels {
        if labelled.len() == cloud.points.len() {
            return Err(settings::Error::conflict(
                "/sampling/off_surface",
                "is labels, but no point of the cloud is labelled interior or exterior; give \
                 such points, or choose generated",
            )
            .into());
        }
        return Ok((labelled, Vec::new()));
    }
    let different = distinct(&cloud.points, &labelled);
    if different.len() < labelled.len() {
        warnings.push(Warning::new(
            "duplicate_points",
            format!(
                "{} surface points repeat earlier ones and are left out",
                labelled.len() - different.len()
            ),
        ));
    }
    enough_points(different.len())?;
    let walk = Walk::along(&pick(&cloud.points, &different));
    let mut different: Vec<usize> = walk.order().map(|position| different[position]).collect();
    let strays = without_strays(cloud, &mut different, warnings)?;
    if different.len() <= MAX_WORKING_POINTS {
        return Ok((different, strays));
    }
    warnings.push(Warning::new(
        "points_thinned",
        format!(
            "{MAX_WORKING_POINTS} of {} surface points, evenly chosen, are worked with",
            different.len()
        ),
    ));
    let kept = even_subset(&pick(&cloud.points, &different), MAX_WORKING_POINTS, choice);
    Ok((pick(&different, &kept), strays))
}

/// Takes strays out of the points at `indices` and gives theirs.
fn without_strays(
    cloud: &PointCloud,
    indices: &mut Vec<usize>,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<usize>, Error> {
    let places: HashSet<[u64; 3]> = strays(&pick(&cloud.points, indices))
        .into_iter()
        .map(|position| bits(cloud.points[indices[position]]))
        .collect();
    // With those that repeat them.
    let strays: Vec<usize> = cloud
        .indices(Label::Surface)
        .filter(|&i| places.contains(&bits(cloud.points[i])))
        .collect();
    if let Some(first) = strays.first() {
        warnings.push(Warning::new(
            "strays_left_out",
            format!(
                "{} of {} surface points are strays, far from the surface of the others, and are left out; the \
                 first lies at {:?}",
                strays.len(),
                cloud.indices(Label::Surface).count(),
                cloud.points[*first]
            ),
        ));
        indices.retain(|i| strays.binary_search(i).is_err());
        enough_points(indices.len())?;
    }
    Ok(strays)
}
