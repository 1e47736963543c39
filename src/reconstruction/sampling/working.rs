//! Which surface points are worked with: each place once, no strays, no more than memory is for.

use std::collections::HashSet;

use super::neighbours::Neighbourhoods;
use super::selection::{distinct, even_subset, pick};
use super::strays::strays;
use crate::reconstruction::cloud::{Label, PointCloud, enough_points};
use crate::reconstruction::error::Error;
use crate::reconstruction::observer::Warning;
use crate::reconstruction::random::Generator;
use crate::reconstruction::settings::{self, OffSurface, Settings};
use crate::reconstruction::vector::bits;

/// Most surface points that are looked at; larger clouds are thinned evenly first.
pub(crate) const MAX_WORKING_POINTS: usize = 5_000_000;

/// The surface points that are worked with: all in the paper's way, otherwise different ones that are no strays,
/// thinned where they are very many.
pub(super) struct Working {
    /// Their indices into the cloud. Many are in an order in which neighbours follow each other.
    pub(super) indices: Vec<usize>,
    /// Those of what was left out, ascending.
    pub(super) strays: Vec<usize>,
    /// Neighbours of each by their positions, at least as many as were wanted, where these were found on the way.
    pub(super) near: Option<Neighbourhoods>,
}

impl Working {
    /// Those of `cloud`, of which so many `neighbours` are wanted.
    ///
    /// # Errors
    /// [`crate::reconstruction::cloud::Error::TooFewPoints`]; a conflict at `/sampling/off_surface`.
    pub(super) fn new(
        cloud: &PointCloud,
        (settings, neighbours): (&Settings, usize),
        choice: &mut Generator,
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, Error> {
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
            return Ok(Self {
                indices: labelled,
                strays: Vec::new(),
                near: None,
            });
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
        let mut working = Self::without_strays(cloud, different, neighbours, warnings)?;
        let found = working.indices.len();
        if found > MAX_WORKING_POINTS {
            warnings.push(Warning::new(
                "points_thinned",
                format!(
                    "{MAX_WORKING_POINTS} of {found} surface points, evenly chosen, are worked with"
                ),
            ));
            let points = pick(&cloud.points, &working.indices);
            let kept = even_subset(&points, MAX_WORKING_POINTS, choice);
            working.indices = pick(&working.indices, &kept);
            working.near = None;
        }
        Ok(working)
    }

    /// The points at `indices` but for strays.
    fn without_strays(
        cloud: &PointCloud,
        mut indices: Vec<usize>,
        neighbours: usize,
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, Error> {
        let (found, near) = strays(&pick(&cloud.points, &indices), neighbours);
        if found.is_empty() {
            return Ok(Self {
                indices,
                strays: found,
                near,
            });
        }
        let places: HashSet<[u64; 3]> = found
            .into_iter()
            .map(|position| bits(cloud.points[indices[position]]))
            .collect();
        // With those that repeat them.
        let strays: Vec<usize> = cloud
            .indices(Label::Surface)
            .filter(|&i| places.contains(&bits(cloud.points[i])))
            .collect();
        warnings.push(Warning::new(
            "strays_left_out",
            format!(
                "{} of {} surface points are strays, far from the surface of the others, and are left out; the \
                 first lies at {:?}",
                strays.len(),
                cloud.indices(Label::Surface).count(),
                cloud.points[strays[0]]
            ),
        ));
        indices.retain(|i| strays.binary_search(i).is_err());
        enough_points(indices.len())?;
        Ok(Self {
            indices,
            strays,
            near: None,
        })
    }
}
