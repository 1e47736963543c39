//! Moving vertices onto f = 0 along the gradient, and the normals that the gradient gives.
//!
//! A Newton step for f(p + t ∇f) = 0 is p - f ∇f/|∇f|², here limited to half a cell, halved where
//! |f| did not shrink, and undone around triangles that it turned over.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::marching_cubes::Contour;
use super::samples::BATCH;
use super::sparse::PROGRESS;
use super::{Field, Request};
use crate::reconstruction::error::Error;
use crate::reconstruction::vector::{Vec3, add, along, cross, dot, normalized, scale, sub};

/// Longest step, in cells: a vertex is within one cell of the surface, and half of it keeps it from
/// jumping to another sheet.
pub(super) const LONGEST_STEP: f64 = 0.5;

/// Steps shorter than this share of a cell are taken without asking the field again: what they leave is about their
/// square, and the normal turns by no more than their length over the radius of the surface.
const SHORT_STEP: f64 = 1e-3;

/// Vertices on the zero set.
pub(super) struct Projected {
    pub(super) vertices: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    /// Evaluations of the field with its gradient.
    pub(super) evaluations: u64,
    /// Vertices that were put back.
    pub(super) undone: usize,
}

/// Vertices with the field at them.
#[derive(Clone)]
struct Vertices {
    positions: Vec<Vec3>,
    values: Vec<f64>,
    gradients: Vec<Vec3>,
}

/// Moves vertices in the steps of a request, all at once: those of a contour are moved some at a time, so that the memory
/// beside theirs is bounded.
pub(super) struct Mover<'a> {
    pub(super) field: &'a dyn Field,
    pub(super) request: &'a Request<'a>,
    /// Edge length of a cell.
    pub(super) spacing: f64,
}

/// Vertices that were moved.
pub(super) struct Moved<Name> {
    pub(super) names: Vec<Name>,
    positions: Vec<Vec3>,
    gradients: Vec<Vec3>,
    /// Evaluations of the field with its gradient.
    evaluations: usize,
}

impl<Name> Moved<Name> {
    /// The same vertices under other names.
    pub(super) fn named<Other>(self, names: Vec<Other>) -> Moved<Other> {
        Moved {
            names,
            positions: self.positions,
            gradients: self.gradients,
            evaluations: self.evaluations,
        }
    }
}

impl Mover<'_> {
    /// Moves these vertices, which are at `from`, but for those whose places in it are given: these stay.
    pub(super) fn moved<Name>(
        &self,
        names: Vec<Name>,
        from: Vec<Vec3>,
        staying: &[usize],
    ) -> Result<Moved<Name>, Error> {
        let mut longest = vec![LONGEST_STEP * self.spacing; from.len()];
        for &v in staying {
            longest[v] = 0.0;
        }
        let mut evaluations = from.len();
        let mut moving: Vec<usize> = (0..from.len()).collect();
        let mut vertices = evaluate(self.field, self.request, from)?;
        for _ in 0..self.request.projection_steps {
            moving.retain(|&v| {
                let is_short = vertices.to_zero(v).abs() < SHORT_STEP * self.spacing;
                if is_short {
                    vertices.positions[v] = vertices.step(v, longest[v]);
                }
                !is_short
            });
            let trial = moving.iter().map(|&v| vertices.step(v, longest[v]));
            let trial = evaluate(self.field, self.request, trial.collect())?;
            evaluations += moving.len();
            for (k, &v) in moving.iter().enumerate() {
                if trial.values[k].abs() < vertices.values[v].abs() {
                    vertices.set(v, &trial, k);
                } else {
                    longest[v] *= 0.5;
                }
            }
        }
        Ok(Moved {
            names,
            positions: vertices.positions,
            gradients: vertices.gradients,
            evaluations,
        })
    }

    /// Moves the vertices of `contour` but for those of caps, which stay, and those that were `moved` before.
    pub(super) fn project(
        &self,
        contour: &Contour,
        moved: Vec<Moved<u32>>,
    ) -> Result<Projected, Error> {
        let count = contour.vertices.len();
        let mut all = All::new(count);
        for moved in moved {
            all.take(moved);
        }
        let mut next = 0;
        while next < count {
            let batch = all.left_from(next).take(BATCH);
            let batch: Vec<u32> = batch.map(|v| v as u32).collect();
            next = batch.last().map_or(count, |last| *last as usize + 1);
            let from = batch.iter().map(|&v| contour.vertices[v as usize]);
            let from = from.collect();
            let caps = (0..).zip(&batch);
            let caps = caps.filter(|(_, v)| contour.caps.binary_search(v).is_ok());
            let staying: Vec<usize> = caps.map(|(place, _)| place).collect();
            all.take(self.moved(batch, from, &staying)?);
            let done = next as f64 / count as f64;
            (self.request.progress)(PROGRESS + (1.0 - PROGRESS) * done);
        }
        self.projected(contour, all)
    }

    /// All vertices, with those put back that turned a triangle over.
    fn projected(&self, contour: &Contour, mut all: All) -> Result<Projected, Error> {
        let undone = undo_reversals(&mut all.positions, contour);
        for batch in undone.chunks(BATCH) {
            let start = batch.iter().map(|&v| contour.vertices[v]).collect();
            let start = evaluate(self.field, self.request, start)?;
            for (&v, gradient) in batch.iter().zip(start.gradients) {
                all.gradients[v] = gradient;
            }
        }
        Ok(Projected {
            normals: normals(all.gradients, &all.positions, contour),
            evaluations: (all.evaluations + undone.len()) as u64,
            undone: undone.len(),
            vertices: all.positions,
        })
    }
}

/// All vertices of a contour, as far as they were moved.
struct All {
    positions: Vec<Vec3>,
    gradients: Vec<Vec3>,
    is_moved: Vec<bool>,
    evaluations: usize,
}

impl All {
    fn new(count: usize) -> Self {
        Self {
            positions: vec![[0.0; 3]; count],
            gradients: vec![[0.0; 3]; count],
            is_moved: vec![false; count],
            evaluations: 0,
        }
    }

    fn take(&mut self, moved: Moved<u32>) {
        let places = moved.positions.into_iter().zip(moved.gradients);
        for (v, (position, gradient)) in moved.names.into_iter().zip(places) {
            self.positions[v as usize] = position;
            self.gradients[v as usize] = gradient;
            self.is_moved[v as usize] = true;
        }
        self.evaluations += moved.evaluations;
    }

    /// Those from the given one on that were not moved, increasing.
    fn left_from(&self, first: usize) -> impl Iterator<Item = usize> {
        (first..self.is_moved.len()).filter(|&v| !self.is_moved[v])
    }
}

fn evaluate(
    field: &dyn Field,
    request: &Request<'_>,
    positions: Vec<Vec3>,
) -> Result<Vertices, Error> {
    if (request.cancelled)() {
        return Err(Error::Cancelled);
    }
    let mut values = vec![0.0; positions.len()];
    let mut gradients = vec![[0.0; 3]; positions.len()];
    field.values_and_gradients(&positions, &mut values, &mut gradients)?;
    Ok(Vertices {
        positions,
        values,
        gradients,
    })
}

impl Vertices {
    /// How far the zero set is from vertex `v` by the slope there, along -∇f; 0 where there is no slope.
    fn to_zero(&self, v: usize) -> f64 {
        let squared = dot(self.gradients[v], self.gradients[v]);
        if squared.is_normal() {
            self.values[v] / squared.sqrt()
        } else {
            0.0
        }
    }

    /// Where a Newton step of at most `longest` takes vertex `v`.
    fn step(&self, v: usize, longest: f64) -> Vec3 {
        let length = self.to_zero(v).clamp(-longest, longest);
        let direction = normalized(self.gradients[v]).unwrap_or_default();
        along(self.positions[v], -length, direction)
    }

    /// Makes vertex `v` number `k` of the others.
    fn set(&mut self, v: usize, others: &Self, k: usize) {
        self.positions[v] = others.positions[k];
        self.values[v] = others.values[k];
        self.gradients[v] = others.gradients[k];
    }
}

/// Puts the corners of triangles back whose normal turned by a right angle or more, until none did; these vertices,
/// increasing.
fn undo_reversals(positions: &mut [Vec3], contour: &Contour) -> Vec<usize> {
    let mut undone = vec![false; positions.len()];
    loop {
        let is_reversed = |triangle: &&[u32; 3]| {
            let before = area(&contour.vertices, **triangle);
            dot(before, area(positions, **triangle)) <= 0.0
                && triangle.iter().any(|&v| !undone[v as usize])
        };
        let triangles = contour.triangles.par_iter();
        let reversed: Vec<[u32; 3]> = triangles.filter(is_reversed).copied().collect();
        if reversed.is_empty() {
            return (0..undone.len()).filter(|&v| undone[v]).collect();
        }
        for v in reversed.into_iter().flatten() {
            undone[v as usize] = true;
            positions[v as usize] = contour.vertices[v as usize];
        }
    }
}

/// Twice the area of a triangle, along its normal.
fn area(positions: &[Vec3], triangle: [u32; 3]) -> Vec3 {
    let [a, b, c] = triangle.map(|v| positions[v as usize]);
    cross(sub(b, a), sub(c, a))
}

/// -∇f/|∇f|; where there is no gradient, and on caps, the mean normal of the triangles around.
fn normals(mut gradients: Vec<Vec3>, positions: &[Vec3], contour: &Contour) -> Vec<Vec3> {
    for cap in &contour.caps {
        gradients[*cap as usize] = [0.0; 3];
    }
    let without: Vec<usize> = gradients
        .par_iter_mut()
        .enumerate()
        .filter_map(|(v, gradient)| {
            let normal = normalized(scale(*gradient, -1.0));
            *gradient = normal.unwrap_or_default();
            normal.is_none().then_some(v)
        })
        .collect();
    let mut around: BTreeMap<usize, Vec3> = without.into_iter().map(|v| (v, [0.0; 3])).collect();
    if !around.is_empty() {
        for triangle in &contour.triangles {
            let area = area(positions, *triangle);
            for v in triangle {
                if let Some(around) = around.get_mut(&(*v as usize)) {
                    *around = add(*around, area);
                }
            }
        }
    }
    for (v, around) in around {
        gradients[v] = normalized(around).unwrap_or([0.0, 0.0, 1.0]);
    }
    gradients
}
