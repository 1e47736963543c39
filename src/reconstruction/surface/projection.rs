//! Moving vertices onto f = 0 along the gradient, and the normals that the gradient gives.
//!
//! A Newton step for f(p + t ∇f) = 0 is p - f ∇f/|∇f|², here limited to half a cell, halved where
//! |f| did not shrink, and undone around triangles that it turned over.

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use super::marching_cubes::Contour;
use super::samples::BATCH;
use super::sparse::PROGRESS;
use super::{Field, Request};
use crate::reconstruction::error::Error;
use crate::reconstruction::vector::{Vec3, add, along, cross, dot, normalized, scale, sub};

/// Longest step, in cells: a vertex is within one cell of the surface, and half of it keeps it from
/// jumping to another sheet.
const LONGEST_STEP: f64 = 0.5;

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

/// Moves the vertices of `contour` in `request.projection_steps` steps; those of caps stay.
///
/// Vertices are moved some at a time, so that the memory beside theirs is bounded.
pub(super) fn project(
    field: &dyn Field,
    request: &Request<'_>,
    spacing: f64,
    contour: &Contour,
) -> Result<Projected, Error> {
    let count = contour.vertices.len();
    let mut positions = Vec::with_capacity(count);
    let mut gradients = Vec::with_capacity(count);
    let mut evaluations = 0;
    for batch in contour.vertices.chunks(BATCH) {
        let mut longest = vec![LONGEST_STEP * spacing; batch.len()];
        let these = positions.len()..positions.len() + batch.len();
        for cap in caps_of(contour, these) {
            longest[cap - positions.len()] = 0.0;
        }
        let mut vertices = evaluate(field, request, batch.to_vec())?;
        evaluations += batch.len();
        let mut moving: Vec<usize> = (0..batch.len()).collect();
        for _ in 0..request.projection_steps {
            moving.retain(|&v| {
                let is_short = vertices.to_zero(v).abs() < SHORT_STEP * spacing;
                if is_short {
                    vertices.positions[v] = vertices.step(v, longest[v]);
                }
                !is_short
            });
            let trial = moving.iter().map(|&v| vertices.step(v, longest[v]));
            let trial = evaluate(field, request, trial.collect())?;
            evaluations += moving.len();
            for (k, &v) in moving.iter().enumerate() {
                if trial.values[k].abs() < vertices.values[v].abs() {
                    vertices.set(v, &trial, k);
                } else {
                    longest[v] *= 0.5;
                }
            }
        }
        positions.extend(vertices.positions);
        gradients.extend(vertices.gradients);
        let done = positions.len() as f64 / count as f64;
        (request.progress)(PROGRESS + (1.0 - PROGRESS) * done);
    }
    let undone = undo_reversals(&mut positions, contour);
    for batch in undone.chunks(BATCH) {
        let start = batch.iter().map(|&v| contour.vertices[v]).collect();
        let start = evaluate(field, request, start)?;
        for (&v, gradient) in batch.iter().zip(start.gradients) {
            gradients[v] = gradient;
        }
    }
    Ok(Projected {
        normals: normals(gradients, &positions, contour),
        evaluations: (evaluations + undone.len()) as u64,
        undone: undone.len(),
        vertices: positions,
    })
}

/// The vertices among `these` that are those of caps.
fn caps_of(contour: &Contour, these: Range<usize>) -> impl Iterator<Item = usize> {
    let first = contour
        .caps
        .partition_point(|&v| (v as usize) < these.start);
    let caps = contour.caps[first..].iter().map(|&v| v as usize);
    caps.take_while(move |v| *v < these.end)
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
