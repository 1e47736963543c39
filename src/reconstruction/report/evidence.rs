//! What the points tell about a mesh: the measures that its verdict rests on.

use crate::reconstruction::mesh::{Closest, TriangleMesh, components};
use crate::reconstruction::quality::MeshReport;
use crate::reconstruction::vector::{Bounds, Vec3, dot, normalized, sub};

use super::{CloudReport, SurfaceReport};

/// Points that a piece needs to be more than a bubble around some of them.
const LEAST_POINTS_OF_A_PIECE: usize = 10;

/// Distance, in spacings beyond three times the noise, from which on a point has lost its surface.
const LOST_SPACINGS: f64 = 2.0;

/// Share of the points on either side of each axis that may be strays.
const STRAY_SHARE: f64 = 0.005;

/// What a verdict rests on; lengths in units of the input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Evidence<'a> {
    /// Surface points trained on.
    pub(super) trained: usize,
    /// Median distance between neighbouring trained points.
    pub(super) spacing: f64,
    /// Standard deviation of the points from their surface; 0 where it is not known.
    pub(super) noise: f64,
    /// Area that the points stand for, where it is known.
    pub(super) stood_for: Option<f64>,
    /// Share of the points whose side the winding number bears out.
    pub(super) confidence: Option<f64>,
    /// How the mesh runs through the points; none without points or area.
    pub(super) fit: Option<Fit>,
    /// How much of the area was filled in.
    pub(super) surface: &'a SurfaceReport,
    /// Area of the mesh.
    pub(super) area: f64,
    /// Its volume, where it is closed.
    pub(super) volume: Option<f64>,
    /// Its handles, where they can be counted.
    pub(super) handles: Option<i64>,
    /// Length of the box of all points over that of the box of the central 99 %.
    pub(super) stretch: f64,
}

/// How a mesh runs through its points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// 95 % of the points are at most this far from the mesh.
    pub(super) p95: f64,
    /// Share of the points that are far from it, see [`Fit::reach`].
    pub(super) lost: f64,
    /// Distance from which on a point is lost.
    pub(super) reach: f64,
    /// Median of the signed distances, positive where the points are outside.
    pub(super) offset: f64,
    /// Pieces of the mesh.
    pub(super) pieces: usize,
    /// Pieces to which hardly a point is closest.
    pub(super) bare_pieces: usize,
}

/// Surface points of a cloud, trained on or held out, and what of the mesh is closest to each: nothing where the mesh
/// has no area.
#[derive(Clone, Copy)]
pub(super) struct Measured<'a> {
    pub(super) points: &'a [Vec3],
    pub(super) closest: &'a [Closest],
    /// How many of them were trained on.
    pub(super) trained: usize,
}

impl<'a> Evidence<'a> {
    /// Measures `mesh` against the surface points of its cloud, trained on or held out.
    pub(super) fn new(
        (mesh, described): (&TriangleMesh, &MeshReport),
        measured: Measured<'_>,
        cloud: &CloudReport,
        surface: &'a SurfaceReport,
    ) -> Self {
        let noise = cloud.noise.unwrap_or(0.0);
        Self {
            trained: measured.trained,
            spacing: cloud.spacing,
            noise,
            stood_for: cloud.area,
            confidence: cloud.orientation_confidence,
            fit: Fit::new(mesh, measured, LOST_SPACINGS * cloud.spacing + 3.0 * noise),
            surface,
            area: described.area,
            volume: described.volume,
            handles: described.topology.genus,
            stretch: stretch(measured.points),
        }
    }

    /// Mean thickness of the body, as that of a plate with its volume and area.
    pub(super) fn thickness(&self) -> Option<f64> {
        let volume = self.volume.filter(|_| self.area > 0.0)?;
        Some(2.0 * volume.abs() / self.area)
    }

    /// Measured area over the area that the points stand for.
    pub(super) fn area_share(&self) -> Option<f64> {
        let stood_for = self.stood_for.filter(|&area| area > 0.0)?;
        let filled_in = if self.surface.trimmed_area_percent > 0.0 {
            0.0
        } else {
            self.surface.unsupported_area_percent
        };
        Some(self.area * (1.0 - filled_in / 100.0) / stood_for)
    }
}

impl Fit {
    fn new(mesh: &TriangleMesh, measured: Measured<'_>, reach: f64) -> Option<Self> {
        let Measured {
            points, closest, ..
        } = measured;
        let (ids, pieces) = components(mesh);
        let mut points_of = vec![0; pieces];
        for closest in closest {
            points_of[ids[closest.triangle] as usize] += 1;
        }
        let distances: Vec<f64> = closest.iter().map(|closest| closest.distance).collect();
        let signed: Vec<f64> = points
            .iter()
            .zip(closest)
            .map(|(&point, closest)| {
                let [corner, ..] = mesh.corners(closest.triangle);
                let outward = normalized(mesh.area_vector(closest.triangle)).unwrap_or([0.0; 3]);
                closest.distance.copysign(dot(sub(point, corner), outward))
            })
            .collect();
        let lost = distances.iter().filter(|&&d| d > reach).count();
        Some(Self {
            p95: quantile(distances, 0.95)?,
            lost: lost as f64 / points.len() as f64,
            reach,
            offset: quantile(signed, 0.5)?,
            pieces,
            bare_pieces: points_of
                .iter()
                .filter(|&&count| count < LEAST_POINTS_OF_A_PIECE)
                .count(),
        })
    }
}

/// How much longer the box of all `points` is than that of the central ones; 1 where there is no box.
fn stretch(points: &[Vec3]) -> f64 {
    let Some(whole) = Bounds::of(points) else {
        return 1.0;
    };
    let extent = |axis: usize| {
        let along = |share| quantile(points.iter().map(|point| point[axis]).collect(), share);
        Some(along(1.0 - STRAY_SHARE)? - along(STRAY_SHARE)?)
    };
    let central = [0, 1, 2].map(|axis| extent(axis).unwrap_or(0.0));
    let central = central.iter().map(|e| e * e).sum::<f64>().sqrt();
    if central > 0.0 {
        whole.diagonal() / central
    } else {
        1.0
    }
}

/// The value below which this share of the values lies; none without values.
fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let place = (share * last as f64).round() as usize;
    Some(*values.select_nth_unstable_by(place, f64::total_cmp).1)
}
