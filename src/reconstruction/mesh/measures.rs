//! Size of a mesh: bounds, area, volume; and the choice of components.

use rayon::prelude::*;

use super::TriangleMesh;
use crate::reconstruction::vector::{Bounds, Vec3, cross, dot, norm, scale, sub};

/// Triangles that a thread adds up at a time. Sums of them are added in their order, so that the result is the same with
/// any number of threads.
const PIECE: usize = 1 << 16;

impl TriangleMesh {
    /// Positions of the three vertices of triangle `t`.
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        self.triangles[t].map(|v| self.vertices[v as usize])
    }

    /// Half the cross product of two edges of triangle `t`: outward, as long as its area.
    pub fn area_vector(&self, t: usize) -> Vec3 {
        let [a, b, c] = self.corners(t);
        scale(cross(sub(b, a), sub(c, a)), 0.5)
    }

    /// Area of triangle `t`.
    pub fn triangle_area(&self, t: usize) -> f64 {
        norm(self.area_vector(t))
    }

    /// Smallest box around the triangles, or around the vertices where there are no triangles.
    pub fn bounds(&self) -> Option<Bounds> {
        if self.triangles.is_empty() {
            return Bounds::of(&self.vertices);
        }
        let around = |triangles: &[[u32; 3]]| {
            let used = triangles.as_flattened().iter();
            Bounds::of(used.map(|&v| &self.vertices[v as usize]))
        };
        let pieces = self.triangles.par_chunks(PIECE).filter_map(around);
        let corners: Vec<[Vec3; 2]> = pieces.map(|piece| [piece.min, piece.max]).collect();
        Bounds::of(corners.as_flattened())
    }

    /// Sum of what each triangle adds, on all threads.
    fn sum<const N: usize>(&self, of: impl Fn(usize) -> [f64; N] + Sync) -> [f64; N] {
        let add = |sum: [f64; N], more: [f64; N]| std::array::from_fn(|k| sum[k] + more[k]);
        let count = self.triangles.len();
        let pieces: Vec<[f64; N]> = (0..count.div_ceil(PIECE))
            .into_par_iter()
            .map(|piece| {
                let triangles = piece * PIECE..count.min((piece + 1) * PIECE);
                triangles.map(&of).fold([0.0; N], add)
            })
            .collect();
        pieces.into_iter().fold([0.0; N], add)
    }

    /// Sum of the areas of all triangles.
    pub fn area(&self) -> f64 {
        let [area] = self.sum(|t| [self.triangle_area(t)]);
        area
    }

    /// Share of the area further than `reach` from the points that the mesh was made of, by
    /// [`distance_to_points`](Self::distance_to_points): each vertex stands for a third of its triangles. 0
    /// for a mesh without area or without these distances.
    pub fn share_beyond(&self, reach: f64) -> f64 {
        let beyond = |v: u32| {
            let distance = self.distance_to_points.get(v as usize);
            distance.is_some_and(|distance| *distance > reach)
        };
        let [all, far] = self.sum(|t| {
            let area = self.triangle_area(t);
            let corners = self.triangles[t].iter().filter(|v| beyond(**v)).count();
            [area, area * corners as f64 / 3.0]
        });
        if all > 0.0 { far / all } else { 0.0 }
    }

    /// Enclosed volume, positive where the triangles face outwards; of a closed mesh only.
    ///
    /// V = Σ a·(b × c) / 6 over the triangles (divergence theorem), with the origin in the middle
    /// of the mesh: far from it the terms would be much larger than their sum.
    pub fn volume(&self) -> f64 {
        let Some(centre) = self.bounds().map(|bounds| bounds.centre()) else {
            return 0.0;
        };
        let [six_volumes] = self.sum(|t| {
            let [a, b, c] = self.corners(t).map(|v| sub(v, centre));
            [dot(a, cross(b, c))]
        });
        six_volumes / 6.0
    }

    /// Area of each of `count` components; `ids` as [`components`](super::components) gives them.
    pub fn component_areas(&self, ids: &[u32], count: usize) -> Vec<f64> {
        let mut areas = vec![0.0; count];
        for (t, &id) in ids.iter().enumerate() {
            areas[id as usize] += self.triangle_area(t);
        }
        areas
    }

    /// Keeps the triangles whose component `keep` approves and the vertices that they use, in
    /// their order; `ids` as [`components`](super::components) gives them.
    pub fn retain_components(&mut self, keep: &[bool], ids: &[u32]) {
        let mut kept = ids.iter().map(|&id| keep[id as usize]);
        self.triangles.retain(|_| kept.next().unwrap_or(true));
        self.drop_unused_vertices();
    }

    /// The mesh of `triangles`, which name vertices of this one, with the vertices that they use in their order; and
    /// which vertices these are.
    pub(super) fn part(&self, mut triangles: Vec<[u32; 3]>) -> (Self, Vec<u32>) {
        let mut origins: Vec<u32> = triangles.as_flattened().to_vec();
        origins.sort_unstable();
        origins.dedup();
        let mut place = vec![0; self.vertices.len()];
        for (new, &old) in (0..).zip(&origins) {
            place[old as usize] = new;
        }
        for v in triangles.as_flattened_mut() {
            *v = place[*v as usize];
        }
        let part = Self {
            vertices: those(&self.vertices, &origins),
            normals: those(&self.normals, &origins),
            triangles,
            distance_to_points: those(&self.distance_to_points, &origins),
            space: self.space,
        };
        (part, origins)
    }

    pub(super) fn drop_unused_vertices(&mut self) {
        let triangles = std::mem::take(&mut self.triangles);
        *self = self.part(triangles).0;
    }
}

/// The items of an attribute that belong to some vertices; it may have none at all.
fn those<T: Copy>(attribute: &[T], vertices: &[u32]) -> Vec<T> {
    let items = vertices.iter();
    items
        .filter_map(|&v| attribute.get(v as usize).copied())
        .collect()
}
