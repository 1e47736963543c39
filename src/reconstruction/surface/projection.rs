//! Moving vertices onto f = 0 along the gradient, and the normals that the gradient gives.
//!
//! A Newton step for f(p + t ∇f) = 0 is p - f ∇f/|∇f|², here limited to half a cell, halved where
//! |f| did not shrink, and undone around triangles that it turned over.

use super::marching_cubes::Contour;
use super::samples::BATCH;
use super::sparse::PROGRESS;
use super::{Field, Request};
use crate::reconstruction::error::Error;
use crate::reconstruction::vector::{Vec3, add, along, cross, dot, normalized, scale, sub};

/// Longest step, in cells: a vertex is within one cell of the surface, and half of it keeps it from
/// jumping to another sheet.
const LONGEST_STEP: f64 = 0.5;

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
pub(super) fn project(
    field: &dyn Field,
    request: &Request<'_>,
    spacing: f64,
    contour: &Contour,
) -> Result<Projected, Error> {
    let calls = request.projection_steps + 1;
    let share =
        |call: usize, done: f64| PROGRESS + (1.0 - PROGRESS) * (call as f64 + done) / calls as f64;
    let evaluate = |positions: Vec<Vec3>, call: usize| {
        evaluate(field, request, positions, &|done| {
            (request.progress)(share(call, done));
        })
    };
    let start = evaluate(contour.vertices.clone(), 0)?;
    let mut vertices = start.clone();
    let mut longest = vec![LONGEST_STEP * spacing; start.positions.len()];
    for cap in &contour.caps {
        longest[*cap as usize] = 0.0;
    }
    for call in 1..calls {
        let trial = (0..longest.len())
            .map(|v| vertices.step(v, longest[v]))
            .collect();
        let trial = evaluate(trial, call)?;
        for (v, longest) in longest.iter_mut().enumerate() {
            if trial.values[v].abs() < vertices.values[v].abs() {
                vertices.copy(v, &trial);
            } else {
                *longest *= 0.5;
            }
        }
    }
    let undone = undo_reversals(&mut vertices, &start, &contour.triangles);
    Ok(Projected {
        normals: normals(&vertices, contour),
        evaluations: (calls * start.positions.len()) as u64,
        undone,
        vertices: vertices.positions,
    })
}

fn evaluate(
    field: &dyn Field,
    request: &Request<'_>,
    positions: Vec<Vec3>,
    progress: &dyn Fn(f64),
) -> Result<Vertices, Error> {
    let count = positions.len();
    let mut values = vec![0.0; count];
    let mut gradients = vec![[0.0; 3]; count];
    for start in (0..count).step_by(BATCH) {
        if (request.cancelled)() {
            return Err(Error::Cancelled);
        }
        let batch = start..(start + BATCH).min(count);
        field.values_and_gradients(
            &positions[batch.clone()],
            &mut values[batch.clone()],
            &mut gradients[batch.clone()],
        )?;
        progress(batch.end as f64 / count as f64);
    }
    Ok(Vertices {
        positions,
        values,
        gradients,
    })
}

impl Vertices {
    /// Where a Newton step of at most `longest` takes vertex `v`.
    fn step(&self, v: usize, longest: f64) -> Vec3 {
        let (position, gradient) = (self.positions[v], self.gradients[v]);
        let squared = dot(gradient, gradient);
        if !squared.is_normal() {
            return position;
        }
        let longest = longest / squared.sqrt();
        let step = (self.values[v] / squared).clamp(-longest, longest);
        along(position, -step, gradient)
    }

    fn copy(&mut self, v: usize, other: &Self) {
        self.positions[v] = other.positions[v];
        self.values[v] = other.values[v];
        self.gradients[v] = other.gradients[v];
    }
}

/// Puts the corners of triangles back whose normal turned by a right angle or more, until none did.
fn undo_reversals(vertices: &mut Vertices, start: &Vertices, triangles: &[[u32; 3]]) -> usize {
    let mut undone = vec![false; start.positions.len()];
    loop {
        let mut again = false;
        for triangle in triangles {
            let [before, after] =
                [start, &*vertices].map(|state| area(&state.positions, *triangle));
            if dot(before, after) > 0.0 {
                continue;
            }
            for v in triangle.map(|v| v as usize) {
                if !undone[v] {
                    undone[v] = true;
                    again = true;
                    vertices.copy(v, start);
                }
            }
        }
        if !again {
            return undone.into_iter().filter(|undone| *undone).count();
        }
    }
}

/// Twice the area of a triangle, along its normal.
fn area(positions: &[Vec3], triangle: [u32; 3]) -> Vec3 {
    let [a, b, c] = triangle.map(|v| positions[v as usize]);
    cross(sub(b, a), sub(c, a))
}

/// -∇f/|∇f|; where there is no gradient, and on caps, the mean normal of the triangles around.
fn normals(vertices: &Vertices, contour: &Contour) -> Vec<Vec3> {
    let mut normals: Vec<_> = vertices
        .gradients
        .iter()
        .map(|gradient| normalized(scale(*gradient, -1.0)))
        .collect();
    for cap in &contour.caps {
        normals[*cap as usize] = None;
    }
    let mut around = vec![[0.0; 3]; normals.len()];
    for triangle in &contour.triangles {
        let area = area(&vertices.positions, *triangle);
        for v in triangle.map(|v| v as usize) {
            if normals[v].is_none() {
                around[v] = add(around[v], area);
            }
        }
    }
    normals
        .into_iter()
        .zip(around)
        .map(|(normal, around)| {
            normal
                .or_else(|| normalized(around))
                .unwrap_or([0.0, 0.0, 1.0])
        })
        .collect()
}
