//! Nearest neighbours of points, and what they tell: local spacing and area.
//!
//! The immutable tree of kiddo is used because it survives identical points and planar grids.

use std::num::NonZero;

use crate::reconstruction::nearby::Walk;
use crate::reconstruction::vector::{Vec3, cross, distance, dot, normalized, sub};
use kiddo::{ImmutableKdTree, SquaredEuclidean};

/// Neighbours over which the local spacing is averaged: those around a point of an even sampling.
pub(super) const SPACING_NEIGHBOURS: usize = 6;

/// Half the edge of the square, in local spacings, to which a cell at an open border is cut.
const CELL_REACH: f64 = 1.5;

/// A search tree over points.
pub struct Tree {
    tree: ImmutableKdTree<f64, 3>,
    len: usize,
}

impl Tree {
    /// A tree over `points`, which are finite and at least one.
    ///
    /// # Panics
    /// Without points, or with more than 2³² of them.
    pub fn new(points: &[Vec3]) -> Self {
        assert!(!points.is_empty(), "a tree is over at least one point");
        Self {
            tree: ImmutableKdTree::new_from_slice(points)
                .expect("the number of points fits into 32 bits"),
            len: points.len(),
        }
    }

    /// Index of the point nearest to `q`, and its distance.
    pub fn nearest(&self, q: Vec3) -> (usize, f64) {
        let found = self
            .tree
            .query(&q)
            .nearest_one::<SquaredEuclidean<f64>>()
            .execute();
        (found.item as usize, found.distance.sqrt())
    }

    /// Indices and distances of the `count` points nearest to `q`, nearest first; all of them if
    /// there are fewer.
    pub fn nearest_n(&self, q: Vec3, count: usize) -> Vec<(usize, f64)> {
        let Some(count) = NonZero::new(count.min(self.len)) else {
            return Vec::new();
        };
        let mut found: Vec<_> = self
            .tree
            .query(&q)
            .nearest_n::<SquaredEuclidean<f64>>(count)
            .execute()
            .into_iter()
            .map(|n| (n.item as usize, n.distance.sqrt()))
            .collect();
        found.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        found
    }
}

/// The nearest other points of every point of a cloud, nearest first.
pub struct Neighbourhoods {
    count: usize,
    indices: Vec<u32>,
    walk: Walk,
}

impl Neighbourhoods {
    /// The `count` nearest others of each of `points`, over which `tree` was made.
    pub fn new(tree: &Tree, points: &[Vec3], count: usize) -> Self {
        let count = count.min(points.len() - 1);
        let mut indices = vec![0; count * points.len()];
        let near = |i: usize| tree.nearest_n(points[i], count + 1);
        let walk = Walk::along(points);
        walk.for_each(near, |i, near| {
            let others = near.into_iter().map(|(j, _)| j).filter(|j| *j != i);
            let list = &mut indices[i * count..(i + 1) * count];
            for (to, j) in list.iter_mut().zip(others) {
                *to = j as u32;
            }
        });
        Self {
            count,
            indices,
            walk,
        }
    }

    /// The points in an order in which most follow their neighbours.
    pub(super) fn order(&self) -> impl Iterator<Item = usize> + '_ {
        self.walk.order()
    }

    /// What `work` gives for each point, one after its neighbours, on all threads.
    pub(super) fn map<R: Send + Clone + Default>(
        &self,
        work: impl Fn(usize) -> R + Sync,
    ) -> Vec<R> {
        self.walk.map(work)
    }

    /// The `count` nearest of them, or all where there are fewer.
    pub(super) fn narrowed(self, count: usize) -> Self {
        if count >= self.count {
            return self;
        }
        let lists = self.indices.chunks_exact(self.count);
        Self {
            count,
            indices: lists.flat_map(|list| &list[..count]).copied().collect(),
            ..self
        }
    }

    /// Number of neighbours of each point.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Neighbours of point `i`.
    pub fn of(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        self.indices[i * self.count..(i + 1) * self.count]
            .iter()
            .map(|&j| j as usize)
    }

    /// Local spacing of each point: the mean distance to its nearest distinct neighbours.
    pub fn spacings(&self, points: &[Vec3]) -> Vec<f64> {
        self.map(|i| spacing(self.of(i).map(|j| distance(points[i], points[j]))))
    }

    /// Which points are marked or have a neighbour that is.
    pub(super) fn beside(&self, marked: &[bool]) -> Vec<bool> {
        self.map(|i| marked[i] || self.of(i).any(|j| marked[j]))
    }

    /// Area of the surface that each point stands for: its Voronoi cell among its neighbours in
    /// the tangent plane.
    ///
    /// Neighbours whose normal points the other way belong to the far side of a thin part and are
    /// left out. The others are projected, so that noise along the normal adds no area.
    pub fn areas(&self, points: &[Vec3], normals: &[Vec3], spacings: &[f64]) -> Vec<f64> {
        self.map(|i| self.area(i, points, normals, spacings[i]))
    }

    /// That of point `i`, where the points are so far apart.
    pub(super) fn area(&self, i: usize, points: &[Vec3], normals: &[Vec3], spacing: f64) -> f64 {
        let (u, v) = tangents(normals[i]);
        let reach = CELL_REACH * spacing;
        let mut cell = vec![
            [-reach, -reach],
            [reach, -reach],
            [reach, reach],
            [-reach, reach],
        ];
        let mut clipped = Vec::with_capacity(cell.len() + 4);
        for j in self.of(i).filter(|&j| dot(normals[i], normals[j]) > 0.0) {
            let edge = sub(points[j], points[i]);
            clip(&cell, [dot(edge, u), dot(edge, v)], &mut clipped);
            std::mem::swap(&mut cell, &mut clipped);
        }
        area(&cell)
    }
}

/// Local spacing of a point: the mean of its distances to the nearest distinct others, of these, nearest first.
pub(super) fn spacing(distances: impl Iterator<Item = f64>) -> f64 {
    let near = distances.filter(|d| *d > 0.0).take(SPACING_NEIGHBOURS);
    let (count, sum) = near.fold((0_u32, 0.0), |(count, sum), d| (count + 1, sum + d));
    sum / f64::from(count.max(1))
}

/// The middle one of `values` in their order; 0 without values.
pub(in crate::reconstruction) fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

/// The value that this share of `values` is below, less than 1; 0 without values.
pub(super) fn quantile(values: &mut [f64], share: f64) -> f64 {
    let position = (share * values.len() as f64) as usize;
    if values.is_empty() {
        return 0.0;
    }
    *values.select_nth_unstable_by(position, f64::total_cmp).1
}

/// Two unit vectors that make a right-handed basis with the unit vector `normal`.
pub(super) fn tangents(normal: Vec3) -> (Vec3, Vec3) {
    let axis = if normal[0].abs() < 0.6 {
        [1.0, 0.0, 0.0]
    } else {
        [0.0, 1.0, 0.0]
    };
    let u = normalized(cross(axis, normal)).unwrap_or([0.0, 0.0, 1.0]);
    (u, cross(normal, u))
}

/// Makes `kept` the part of a convex polygon that is nearer to the origin than to `other`.
fn clip(polygon: &[[f64; 2]], other: [f64; 2], kept: &mut Vec<[f64; 2]>) {
    let limit = 0.5 * (other[0] * other[0] + other[1] * other[1]);
    let excess = |p: [f64; 2]| p[0] * other[0] + p[1] * other[1] - limit;
    kept.clear();
    for (k, &a) in polygon.iter().enumerate() {
        let b = polygon[(k + 1) % polygon.len()];
        let (outside_a, outside_b) = (excess(a), excess(b));
        if outside_a <= 0.0 {
            kept.push(a);
        }
        if (outside_a < 0.0 && outside_b > 0.0) || (outside_a > 0.0 && outside_b < 0.0) {
            let t = outside_a / (outside_a - outside_b);
            kept.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
        }
    }
}

fn area(polygon: &[[f64; 2]]) -> f64 {
    let twice: f64 = (0..polygon.len())
        .map(|k| {
            let (a, b) = (polygon[k], polygon[(k + 1) % polygon.len()]);
            a[0] * b[1] - a[1] * b[0]
        })
        .sum();
    0.5 * twice
}
