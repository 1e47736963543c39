//! Clouds drawn from a shape: points, labels, normals, noise and holes.

use rand::RngExt;
use rand_distr::StandardNormal;

use super::Shape;
use crate::reconstruction::cloud::{Label, PointCloud};
use crate::reconstruction::random::{Generator, Purpose, stream};
use crate::reconstruction::vector::{Bounds, Vec3, along, distance, norm, normalized};

/// Half the thickness of the shell from which surface points are drawn, as a share of the
/// diagonal: thin enough that curvature does not show in the density.
const SHELL: f64 = 0.01;

/// Interior and exterior points keep so far from the surface, as a share of the diagonal.
const CLEARANCE: f64 = 0.02;

/// Exterior points lie in the box around the shape, enlarged by this share of its longest edge.
const MARGIN: f64 = 0.2;

/// What to draw.
#[derive(Debug, Clone, PartialEq)]
pub struct Recipe {
    /// Surface points, before any go missing.
    pub points: usize,
    /// Interior points.
    pub interior: usize,
    /// Exterior points.
    pub exterior: usize,
    /// Share of the surface points, in percent, that one hole takes away.
    pub missing_percent: f64,
    /// Standard deviation of the noise of the surface points along each axis, in percent of the
    /// diagonal of their box.
    pub noise_percent: f64,
    /// Seed.
    pub seed: u64,
    /// Whether the true normals come with the surface points; other points get zeros.
    pub normals: bool,
    /// Whether labels come with the points; they do in any case where not all are on the surface.
    pub labels: bool,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            points: 3_000,
            interior: 0,
            exterior: 0,
            missing_percent: 0.0,
            noise_percent: 0.0,
            seed: 1,
            normals: false,
            labels: false,
        }
    }
}

/// Draws a cloud: surface points uniform by area, then interior, then exterior ones uniform by
/// volume, each kept clear of the surface.
pub fn sample(shape: &Shape, recipe: &Recipe) -> PointCloud {
    let mut random = stream(recipe.seed, Purpose::Shape);
    let mut points: Vec<Vec3> = (0..recipe.points)
        .map(|_| on_surface(shape, &mut random))
        .collect();
    let diagonal = Bounds::of(&points).map_or(0.0, |bounds| bounds.diagonal());
    cut_hole(&mut points, recipe.missing_percent, &mut random);
    let mut normals: Vec<Vec3> = points
        .iter()
        .map(|p| normalized(shape.gradient(*p).map(|x| -x)).unwrap_or([0.0; 3]))
        .collect();
    let deviation = 0.01 * recipe.noise_percent * diagonal;
    for p in &mut points {
        let noise: Vec3 = std::array::from_fn(|_| random.sample(StandardNormal));
        *p = along(*p, deviation, noise);
    }
    let mut labels = vec![Label::Surface; points.len()];
    for (label, count) in [
        (Label::Interior, recipe.interior),
        (Label::Exterior, recipe.exterior),
    ] {
        points.extend((0..count).map(|_| off_surface(shape, label, &mut random)));
        labels.resize(points.len(), label);
    }
    normals.resize(points.len(), [0.0; 3]);
    let labelled = recipe.labels || recipe.interior + recipe.exterior > 0;
    PointCloud {
        points,
        normals: recipe.normals.then_some(normals),
        labels: labelled.then_some(labels),
        ..PointCloud::default()
    }
}

/// A point of the surface, uniform by area.
///
/// A place in the shell |f| < δ is moved onto the surface. The shell is 2 δ / |∇f| thick, so the
/// place counts with probability |∇f| over its largest value, which is a little above 1 in blends.
fn on_surface(shape: &Shape, random: &mut Generator) -> Vec3 {
    const STEEPEST: f64 = 1.5;
    let bounds = shape.bounds();
    let shell = SHELL * bounds.diagonal();
    let bounds = bounds.padded(shell);
    loop {
        let (p, chance) = (within(&bounds, random), random.random::<f64>());
        if shape.signed(p).abs() < shell
            && let Some(p) = shape.project(p)
            && chance * STEEPEST < norm(shape.gradient(p))
        {
            return p;
        }
    }
}

fn off_surface(shape: &Shape, label: Label, random: &mut Generator) -> Vec3 {
    let bounds = shape.bounds();
    let clearance = CLEARANCE * bounds.diagonal();
    let margin = MARGIN * bounds.longest_edge();
    let region = bounds.padded(if label == Label::Exterior {
        margin
    } else {
        0.0
    });
    loop {
        let p = within(&region, random);
        if label.target() * shape.signed(p) > clearance {
            return p;
        }
    }
}

fn within(bounds: &Bounds, random: &mut Generator) -> Vec3 {
    let extent = bounds.extent();
    std::array::from_fn(|a| bounds.min[a] + extent[a] * random.random::<f64>())
}

/// Takes away the given share of `points`: those around one of them.
fn cut_hole(points: &mut Vec<Vec3>, percent: f64, random: &mut Generator) {
    let missing = (0.01 * percent.clamp(0.0, 100.0) * points.len() as f64).round() as usize;
    if missing == 0 {
        return;
    }
    let centre = points[random.random_range(0..points.len())];
    let mut distances: Vec<f64> = points.iter().map(|p| distance(*p, centre)).collect();
    distances.sort_by(f64::total_cmp);
    let reach = distances[missing - 1];
    points.retain(|p| distance(*p, centre) > reach);
}
