//! Distances between points and surfaces, exact: to the closest point of a triangle, not to the
//! closest vertex or sample.

use std::iter;
use std::ops::Range;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQueryWithLocation;
use parry3d_f64::shape::TriMesh;
use rand::RngExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::TriangleMesh;
use crate::reconstruction::nearby::{map_nearby, morton_order};
use crate::reconstruction::random::Generator;
use crate::reconstruction::vector::{Vec3, along, distance, norm, sub};

/// The point of a mesh that is closest to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closest {
    /// Its distance; infinite from a point that is not finite.
    pub distance: f64,
    /// The triangle that it lies on.
    pub triangle: usize,
}

/// Finds the closest point of a mesh.
pub struct SurfaceTree {
    shape: TriMesh,
    /// Middle of the mesh: the tree holds coordinates relative to it, so that a far origin costs
    /// no digits.
    origin: Vec3,
    /// Number in the mesh of each triangle of the tree, which holds none without area.
    triangles: Vec<u32>,
}

impl SurfaceTree {
    /// Indexes `mesh`; `None` where no triangle has an area.
    ///
    /// # Cost
    /// O(n log n) for n triangles, and some 250 bytes for each.
    pub fn new(mesh: &TriangleMesh) -> Option<Self> {
        let origin = mesh.bounds()?.centre();
        Self::of_part(mesh, origin, 0..mesh.triangles.len())
    }

    /// Indexes some triangles of `mesh`, which is around `origin`, and only the vertices that they use.
    fn of_part(mesh: &TriangleMesh, origin: Vec3, part: Range<usize>) -> Option<Self> {
        let triangles: Vec<u32> = part
            .filter(|&t| mesh.triangle_area(t) > 0.0)
            .map(|t| t as u32)
            .collect();
        // Vertices of neighbouring triangles have near numbers.
        let used = || triangles.iter().flat_map(|&t| mesh.triangles[t as usize]);
        let (first, last) = (used().min()?, used().max()?);
        let mut places = vec![None; (last - first) as usize + 1];
        let mut positions = Vec::new();
        let mut place = |v: u32| {
            *places[(v - first) as usize].get_or_insert_with(|| {
                positions.push(Vector::from(sub(mesh.vertices[v as usize], origin)));
                positions.len() as u32 - 1
            })
        };
        let indices = triangles
            .iter()
            .map(|&t| mesh.triangles[t as usize].map(&mut place))
            .collect();
        let shape = TriMesh::new(positions, indices).ok()?;
        Some(Self {
            shape,
            origin,
            triangles,
        })
    }

    /// The point of the mesh that is closest to `point`.
    pub fn closest(&self, point: Vec3) -> Closest {
        self.closer(point, f64::MAX).unwrap_or(Closest {
            distance: f64::INFINITY,
            triangle: self.triangles[0] as usize,
        })
    }

    /// The point of the mesh that is closest to `point`, where it is nearer than `reach`.
    fn closer(&self, point: Vec3, reach: f64) -> Option<Closest> {
        let point = Vector::from(sub(point, self.origin));
        let (projection, (triangle, _)) = self
            .shape
            .project_local_point_and_get_location_with_max_dist(point, false, reach)?;
        Some(Closest {
            distance: (projection.point - point).length(),
            triangle: self.triangles[triangle as usize] as usize,
        })
    }

    /// [`closest`](Self::closest) for each of `points`, in their order, on all threads.
    pub fn closest_to_each(&self, points: &[Vec3]) -> Vec<Closest> {
        map_nearby(points, |i| Some(self.closest(points[i])))
            .into_iter()
            .flatten()
            .collect()
    }

    /// Triangles whose boxes meet that of `corners`, itself among them, in the order of the tree.
    pub(super) fn near(&self, corners: &[Vec3]) -> Vec<usize> {
        let corners = corners.iter().map(|&c| Vector::from(sub(c, self.origin)));
        let around = Aabb::from_points(corners);
        let leaves = self.shape.bvh().intersect_aabb(&around);
        leaves
            .map(|t| self.triangles[t as usize] as usize)
            .collect()
    }

    /// Distance of each of `points` from the mesh, in their order.
    pub fn distances(&self, points: &[Vec3]) -> Vec<f64> {
        map_nearby(points, |i| self.closest(points[i]).distance)
    }
}

/// Most triangles that are indexed at a time where only the closest points are asked for: 130 MB of tree.
pub const INDEXED_TRIANGLES: usize = 1 << 19;

/// The closest point of `mesh` to each of `points`, in their order, on all threads; `None` where no triangle has an
/// area.
///
/// A large mesh is indexed part by part, so that the memory beside the answer is bounded.
pub fn closest_to_each(mesh: &TriangleMesh, points: &[Vec3]) -> Option<Vec<Closest>> {
    closest_by_parts(mesh, points, INDEXED_TRIANGLES)
}

fn closest_by_parts(mesh: &TriangleMesh, points: &[Vec3], part: usize) -> Option<Vec<Closest>> {
    let count = mesh.triangles.len();
    if count <= part {
        return Some(SurfaceTree::new(mesh)?.closest_to_each(points));
    }
    let order = morton_order(points);
    let sorted: Vec<Vec3> = order.iter().map(|&(_, i)| points[i as usize]).collect();
    let mut found = within_reach(mesh, &sorted, part)?;
    let origin = mesh.bounds()?.centre();
    let tree_from = |first: usize| {
        let part = first..(first + part).min(count);
        SurfaceTree::of_part(mesh, origin, part)
    };
    let mut tree = tree_from(0);
    for first in (0..count).step_by(part) {
        // The next tree is made on one thread while the others ask this one.
        let ask = || {
            let Some(tree) = tree else { return };
            let asked = found.par_iter_mut().zip(&sorted);
            asked.for_each(|(closest, &point)| {
                let closer = tree.closer(point, closest.distance.min(f64::MAX));
                if let Some(closer) = closer.filter(|c| c.distance < closest.distance) {
                    *closest = closer;
                }
            });
        };
        ((), tree) = rayon::join(ask, || tree_from(first + part));
    }
    drop(sorted);
    let mut all = found.clone();
    for (&(_, i), found) in order.iter().zip(found) {
        all[i as usize] = found;
    }
    Some(all)
}

/// What is surely farther than the closest point of the mesh, for each of `points`: a corner of one of so many of its
/// triangles. A part of the mesh that is not near a point is left after one look then.
fn within_reach(mesh: &TriangleMesh, points: &[Vec3], most: usize) -> Option<Vec<Closest>> {
    let with_area = |&t: &usize| mesh.triangle_area(t) > 0.0;
    let first = (0..mesh.triangles.len()).find(with_area)?;
    let chosen = (0..mesh.triangles.len()).step_by(mesh.triangles.len().div_ceil(most));
    let corners: Vec<Vec3> = iter::once(first)
        .chain(chosen.filter(with_area))
        .map(|t| mesh.corners(t)[0])
        .collect();
    let nearest = PointTree::new(&corners)?;
    let reach = |point: Vec3| {
        if point.iter().all(|c| c.is_finite()) {
            // Beyond what rounding adds to either distance: their digits are those of coordinates.
            let digits = 64.0 * f64::EPSILON * (norm(point) + norm(corners[0]));
            nearest.distance(point) * (1.0 + 1e-6) + digits + f64::MIN_POSITIVE
        } else {
            f64::INFINITY
        }
    };
    let farther = |&point: &Vec3| Closest {
        distance: reach(point),
        triangle: first,
    };
    Some(points.par_iter().map(farther).collect())
}

/// Finds the nearest of some points.
pub struct PointTree<'a> {
    tree: ImmutableKdTree<f64, 3>,
    points: &'a [Vec3],
}

impl<'a> PointTree<'a> {
    /// Indexes `points`, which are finite; `None` without points.
    pub fn new(points: &'a [Vec3]) -> Option<Self> {
        if points.is_empty() {
            return None;
        }
        let tree = ImmutableKdTree::new_from_slice(points).ok()?;
        Some(Self { tree, points })
    }

    /// Distance of each of `points` from the nearest indexed point, in their order, on all threads.
    pub fn distances(&self, points: &[Vec3]) -> Vec<f64> {
        map_nearby(points, |i| self.distance(points[i]))
    }

    /// Distance of a point from the nearest indexed one.
    fn distance(&self, point: Vec3) -> f64 {
        let nearest = self.tree.query(&point);
        let found = nearest.nearest_one::<SquaredEuclidean<f64>>().execute();
        distance(point, self.points[found.item as usize])
    }
}

/// A point drawn from a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Where it is.
    pub position: Vec3,
    /// The triangle that it lies on.
    pub triangle: usize,
}

/// `count` points, uniform by area; none where the mesh has no area.
///
/// One point from each of `count` equal shares of the area, in the order of the triangles: the same
/// distribution as independent draws, and means over it scatter less.
pub fn sample_surface(
    mesh: &TriangleMesh,
    count: usize,
    generator: &mut Generator,
) -> Vec<SurfacePoint> {
    let cumulative: Vec<f64> = (0..mesh.triangles.len())
        .scan(0.0, |sum, t| {
            *sum += mesh.triangle_area(t);
            Some(*sum)
        })
        .collect();
    let Some(&total) = cumulative.last().filter(|&&total| total > 0.0) else {
        return Vec::new();
    };
    (0..count)
        .map(|share| {
            let area = (share as f64 + generator.random::<f64>()) / count as f64 * total;
            // The last triangle with an area takes what rounding lifts to the total itself.
            let triangle = cumulative
                .partition_point(|&sum| sum <= area)
                .min(cumulative.partition_point(|&sum| sum < total));
            let [a, b, c] = mesh.corners(triangle);
            let from_a = generator.random::<f64>().sqrt();
            let towards_c = generator.random::<f64>();
            let on_edge = along(b, towards_c, sub(c, b));
            SurfacePoint {
                position: along(a, from_a, sub(on_edge, a)),
                triangle,
            }
        })
        .collect()
}

/// Distances of many points, summed up; absolute and in percent of a reference length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Distances {
    /// Mean.
    pub mean: f64,
    /// Root of the mean square.
    pub rms: f64,
    /// 95th percentile, linear between the two nearest ranks.
    pub p95: f64,
    /// Largest.
    pub max: f64,
    /// Mean, in percent of the reference length.
    pub mean_percent: f64,
    /// Root of the mean square, in percent of the reference length.
    pub rms_percent: f64,
    /// 95th percentile, in percent of the reference length.
    pub p95_percent: f64,
    /// Largest, in percent of the reference length.
    pub max_percent: f64,
}

impl Distances {
    /// Sums up `distances` against the length `reference`; `None` without distances, or without a
    /// length to relate them to.
    pub fn of(distances: &[f64], reference: f64) -> Option<Self> {
        if distances.is_empty() || !reference.is_normal() {
            return None;
        }
        let n = distances.len() as f64;
        let mut sorted = distances.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let rank = 0.95 * (n - 1.0);
        let below = sorted[rank.floor() as usize];
        let above = sorted[rank.ceil() as usize];

        let mean = distances.iter().sum::<f64>() / n;
        let rms = (distances.iter().map(|d| d * d).sum::<f64>() / n).sqrt();
        let p95 = below + rank.fract() * (above - below);
        let max = sorted[sorted.len() - 1];
        let percent = 100.0 / reference;
        Some(Self {
            mean,
            rms,
            p95,
            max,
            mean_percent: mean * percent,
            rms_percent: rms * percent,
            p95_percent: p95 * percent,
            max_percent: max * percent,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of a bent strip, with one in between that has no area.
    fn strip() -> TriangleMesh {
        let at = |i: u32| [f64::from(i), f64::from(i % 2), f64::from(i * i) / 40.0];
        TriangleMesh {
            vertices: (0..40).map(at).collect(),
            triangles: (0..38)
                .map(|i| [i, i + 1, if i == 20 { i } else { i + 2 }])
                .collect(),
            ..TriangleMesh::default()
        }
    }

    #[test]
    fn a_mesh_in_parts_has_the_same_closest_points_as_the_whole() {
        let mesh = strip();
        let mut points: Vec<Vec3> = (0..50)
            .map(|i| [f64::from(i % 47), f64::from(i % 3) - 1.0, f64::from(i % 11)])
            .collect();
        points.push([f64::NAN, 0.0, 0.0]);
        let whole = SurfaceTree::new(&mesh).unwrap().closest_to_each(&points);
        for part in [1, 7, 38, 100] {
            let found = closest_by_parts(&mesh, &points, part).unwrap();
            for ((found, expected), point) in found.iter().zip(&whole).zip(&points) {
                let infinite = [found, expected].map(|c| c.distance.is_infinite());
                assert!(
                    (found.distance - expected.distance).abs() < 1e-12 || infinite == [true; 2],
                    "{point:?} in parts of {part}: {found:?}, not {expected:?}"
                );
            }
        }
        assert!(closest_to_each(&TriangleMesh::default(), &points).is_none());
    }
}
