//! The report on a mesh: what it is, and how far it is from the points or from a known surface.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::mesh::{
    Closest, Distances, PointTree, SurfacePoint, Topology, TriangleMesh, closest_to_each,
    sample_surface,
};
use super::random::{self, Purpose};
use super::vector::{Bounds, Vec3, dot, normalized};

/// Points drawn from a mesh where a distance is averaged over its surface: the mean is then good
/// to about 0.3 % of the spread of the distances.
const SURFACE_SAMPLES: usize = 100_000;

/// What a mesh is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshReport {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Pieces, borders, orientation, genus.
    #[serde(flatten)]
    pub topology: Topology,
    /// Area, in the unit of the input squared.
    pub area: f64,
    /// Enclosed volume, in the unit of the input cubed; only of a closed, oriented mesh.
    pub volume: Option<f64>,
    /// Smallest box around it; none for an empty mesh.
    pub bounds: Option<Bounds>,
}

/// Describes `mesh`.
pub fn describe(mesh: &TriangleMesh) -> MeshReport {
    let topology = Topology::of(mesh);
    MeshReport {
        vertices: mesh.vertices.len(),
        triangles: mesh.triangles.len(),
        area: mesh.area(),
        volume: (topology.closed && topology.oriented).then(|| mesh.volume()),
        bounds: mesh.bounds(),
        topology,
    }
}

/// How far a mesh and a cloud are from each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Comparison {
    /// From each point to the closest point of the mesh.
    pub cloud_to_mesh: Distances,
    /// From points uniform on the mesh to the nearest point of the cloud: never below the spacing
    /// of the cloud, and large where the mesh bridges a hole.
    pub mesh_to_cloud: Distances,
    /// Diagonal of the whole cloud's bounding box, which the percentages refer to.
    pub diagonal: f64,
}

/// Points measured against a mesh, once for all the questions that a report asks.
pub struct Judge<'a> {
    mesh: &'a TriangleMesh,
    points: &'a [Vec3],
    closest: Vec<Closest>,
    samples: Vec<Vec3>,
}

impl<'a> Judge<'a> {
    /// Finds what is closest to each of `points` and draws points from the mesh; `None` where it has no area.
    ///
    /// # Determinism
    /// The same seed gives the same numbers, for any number of threads.
    pub fn new(mesh: &'a TriangleMesh, points: &'a [Vec3], seed: u64) -> Option<Self> {
        Some(Self {
            mesh,
            points,
            closest: closest_to_each(mesh, points)?,
            samples: surface_samples(mesh, seed)
                .iter()
                .map(|sample| sample.position)
                .collect(),
        })
    }

    /// What is closest to each of the points.
    pub(super) fn closest(&self) -> &[Closest] {
        &self.closest
    }

    /// How far the mesh and those of the points are from each other; `None` without points.
    ///
    /// They may be some of a cloud only, even a single one: percentages refer to the box of the
    /// `whole`, or, where all of that lies in one place, to the box of the mesh.
    pub fn compare(&self, those: Range<usize>, whole: Option<Bounds>) -> Option<Comparison> {
        let diagonal = |bounds: Option<Bounds>| bounds.map(|bounds| bounds.diagonal());
        let of_whole = diagonal(whole).filter(|&length| length > 0.0);
        let diagonal = of_whole.or_else(|| diagonal(self.mesh.bounds()))?;
        let of_these = &self.closest[those.clone()];
        let to_mesh: Vec<f64> = of_these.iter().map(|closest| closest.distance).collect();
        let to_cloud = PointTree::new(&self.points[those])?.distances(&self.samples);
        Some(Comparison {
            cloud_to_mesh: Distances::of(&to_mesh, diagonal)?,
            mesh_to_cloud: Distances::of(&to_cloud, diagonal)?,
            diagonal,
        })
    }

    /// Mean cosine between `normals`, those of the first points, and the normal of the closest triangle: 1 where
    /// they agree, -1 where the mesh is inside out. Normals without a direction are left out;
    /// `None` where none is left.
    pub fn normal_agreement(&self, normals: &[Vec3]) -> Option<f64> {
        mean(
            normals
                .iter()
                .zip(&self.closest)
                .filter_map(|(&normal, closest)| {
                    cosine(normal, self.mesh.area_vector(closest.triangle))
                }),
        )
    }
}

/// How far a mesh and a known surface are from each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeshComparison {
    /// From points uniform on the mesh to the closest point of the reference: accuracy.
    pub mesh_to_reference: Distances,
    /// From points uniform on the reference to the closest point of the mesh: completeness.
    pub reference_to_mesh: Distances,
    /// Mean of the two mean distances, in percent of the diagonal.
    pub chamfer_percent: f64,
    /// Larger of the two 95th percentiles, in percent of the diagonal.
    pub hausdorff_95_percent: f64,
    /// Larger of the two largest distances, in percent of the diagonal.
    pub hausdorff_percent: f64,
    /// Mean cosine between the normals at the two ends of each distance, both directions alike.
    pub normal_agreement: f64,
    /// Diagonal of the reference's bounding box, which the percentages refer to.
    pub diagonal: f64,
}

/// Compares `mesh` with `reference`; `None` where one of them has no area.
///
/// Distances go from samples of one surface to the exact closest point of the other, so that they
/// have no floor from the spacing of the samples.
///
/// # Determinism
/// The same seed gives the same numbers, for any number of threads.
pub fn compare_meshes(
    mesh: &TriangleMesh,
    reference: &TriangleMesh,
    seed: u64,
) -> Option<MeshComparison> {
    let diagonal = reference.bounds()?.diagonal();
    let (accuracy, agreement_there) = directed(mesh, reference, seed)?;
    let (completeness, agreement_back) = directed(reference, mesh, seed)?;
    let mesh_to_reference = Distances::of(&accuracy, diagonal)?;
    let reference_to_mesh = Distances::of(&completeness, diagonal)?;
    let larger =
        |pick: fn(&Distances) -> f64| pick(&mesh_to_reference).max(pick(&reference_to_mesh));
    Some(MeshComparison {
        chamfer_percent: 0.5 * (mesh_to_reference.mean_percent + reference_to_mesh.mean_percent),
        hausdorff_95_percent: larger(|d| d.p95_percent),
        hausdorff_percent: larger(|d| d.max_percent),
        normal_agreement: 0.5 * (agreement_there + agreement_back),
        mesh_to_reference,
        reference_to_mesh,
        diagonal,
    })
}

/// Distances from samples of `from` to `to`, and the mean cosine of the normals.
fn directed(from: &TriangleMesh, to: &TriangleMesh, seed: u64) -> Option<(Vec<f64>, f64)> {
    let samples = surface_samples(from, seed);
    let positions: Vec<Vec3> = samples.iter().map(|sample| sample.position).collect();
    let closest = closest_to_each(to, &positions)?;
    let distances = closest.iter().map(|closest| closest.distance).collect();
    let cosines = samples
        .iter()
        .zip(&closest)
        .filter_map(|(sample, closest)| {
            cosine(
                from.area_vector(sample.triangle),
                to.area_vector(closest.triangle),
            )
        });
    Some((distances, mean(cosines)?))
}

fn surface_samples(mesh: &TriangleMesh, seed: u64) -> Vec<SurfacePoint> {
    let mut generator = random::stream(seed, Purpose::Shape);
    sample_surface(mesh, SURFACE_SAMPLES, &mut generator)
}

fn cosine(a: Vec3, b: Vec3) -> Option<f64> {
    Some(dot(normalized(a)?, normalized(b)?))
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0usize), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / count as f64)
}
