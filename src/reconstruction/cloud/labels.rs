//! Whether labels mean what they can mean here: most columns of that name hold the class or the object
//! that a point belongs to, and classes lie on the surface like all else.

use super::Label;
use crate::reconstruction::cholesky;
use crate::reconstruction::sampling::neighbours::Tree;
use crate::reconstruction::symmetric;
use crate::reconstruction::vector::{Vec3, dot, sub};

/// Fewest surface points that tell what lies beside them; with fewer the labels are believed. The
/// neighbours of a fit are then an eighth of them: on a thin torus of 100 points they reach around it.
const FEWEST: usize = 128;

/// Points of a label that are looked at.
const LOOKED_AT: usize = 300;

/// Neighbours for a local fit: more than twice its six coefficients.
const NEIGHBOURS: usize = 16;

/// Distances to the surface points, in their median spacing, up to which a local fit tells whether a
/// point lies on the surface.
const NEAR: f64 = 2.0;

/// Mean evidence from which on labels are believed. Points that lie on the surface like all others give
/// 0.5, with 50 of them 0.04 more or less; points off it give 0.7 and more where fits can tell.
const BELIEVED: f64 = 0.62;

/// Height of the surface points over their own fits, in their spacing, up to which fits can tell. Clean
/// clouds from 300 points on stay below a fifth; thin shapes of 100 points and noise of 1 % of the
/// diagonal are above a quarter, and points inside are no higher there than others.
const RESOLVED: f64 = 0.25;

/// Why labels are not believed; `None` if they are.
pub(super) fn doubt(points: &[Vec3], labels: &[Label]) -> Option<String> {
    let of = |wanted: Label| -> Vec<Vec3> {
        let labelled = points.iter().zip(labels);
        let alike = labelled.filter(|(_, label)| **label == wanted);
        alike.map(|(point, _)| *point).collect()
    };
    let surface = of(Label::Surface);
    if surface.is_empty() {
        return Some("no point has label 0, the surface".to_owned());
    }
    if surface.len() < FEWEST {
        return None;
    }
    let judge = Judge::new(&surface);
    for (label, name) in [(Label::Interior, "1"), (Label::Exterior, "-1")] {
        let labelled = of(label);
        let every = labelled.len().div_ceil(LOOKED_AT).max(1);
        let looked_at: Vec<_> = labelled.iter().step_by(every).collect();
        let evidence = |point: &&Vec3| judge.evidence(**point, label);
        let found: Vec<f64> = looked_at.iter().filter_map(evidence).collect();
        if found.iter().sum::<f64>() < BELIEVED * found.len() as f64 {
            let side = if label == Label::Interior {
                "inside"
            } else {
                "outside"
            };
            return Some(format!("the points with label {name} do not lie {side}"));
        }
    }
    None
}

/// Surface points, and how well they fit their own surface.
struct Judge<'a> {
    points: &'a [Vec3],
    tree: Tree,
    spacing: f64,
    /// Heights over the fits through their neighbours, ascending.
    heights: Vec<f64>,
}

impl<'a> Judge<'a> {
    fn new(points: &'a [Vec3]) -> Self {
        let mut judge = Self {
            points,
            tree: Tree::new(points),
            spacing: 0.0,
            heights: Vec::new(),
        };
        let every = points.len().div_ceil(LOOKED_AT);
        let (mut spacings, mut heights) = (Vec::new(), Vec::new());
        for &point in points.iter().step_by(every) {
            // The point itself, and copies of it, tell nothing.
            let around = judge.tree.nearest_n(point, NEIGHBOURS + 1);
            let others: Vec<_> = around.into_iter().filter(|(_, d)| *d > 0.0).collect();
            spacings.extend(others.first().map(|(_, distance)| *distance));
            heights.extend(judge.height_of(point, &others));
        }
        judge.spacing = median(&mut spacings);
        heights.sort_unstable_by(f64::total_cmp);
        judge.heights = heights;
        judge
    }

    /// How much speaks for the label of a point, 0 to 1. Near the surface, the share of the surface
    /// points that fit it better; far from it, whether the surface is all around, where it has to be.
    /// `None` near a surface that the fits do not resolve.
    fn evidence(&self, point: Vec3, label: Label) -> Option<f64> {
        let around = self.tree.nearest_n(point, NEIGHBOURS);
        let nearest = around.first().map_or(0.0, |(_, distance)| *distance);
        if nearest > NEAR * self.spacing {
            let fits = label != Label::Interior || self.is_enclosed(point);
            return Some(f64::from(fits));
        }
        let middle = self.heights.get(self.heights.len() / 2)?;
        if *middle > RESOLVED * self.spacing {
            return None;
        }
        let height = self.height_of(point, &around)?;
        let below = self.heights.partition_point(|&other| other < height);
        Some(below as f64 / self.heights.len() as f64)
    }

    /// Whether there are surface points in every octant around a point.
    fn is_enclosed(&self, point: Vec3) -> bool {
        let mut octants = [false; 8];
        for &other in self.points {
            let [x, y, z] = sub(other, point).map(|v| usize::from(v > 0.0));
            octants[4 * x + 2 * y + z] = true;
            if octants == [true; 8] {
                return true;
            }
        }
        false
    }

    /// Distance of a point from the quadratic surface through its neighbours; `None` if there is none.
    fn height_of(&self, point: Vec3, around: &[(usize, f64)]) -> Option<f64> {
        let scale = around.last()?.1;
        if scale <= 0.0 {
            return None;
        }
        let arm = |i: usize| sub(self.points[i], point).map(|v| v / scale);
        let arms: Vec<Vec3> = around.iter().map(|(i, _)| arm(*i)).collect();
        let count = arms.len() as f64;
        let mut mean = [0.0; 3];
        for arm in &arms {
            mean = std::array::from_fn(|i| mean[i] + arm[i] / count);
        }
        let mut covariance = [[0.0; 3]; 3];
        for arm in &arms {
            let d = sub(*arm, mean);
            for (i, row) in covariance.iter_mut().enumerate() {
                for (j, entry) in row.iter_mut().enumerate() {
                    *entry += d[i] * d[j];
                }
            }
        }
        let (_, [normal, first, second]) = symmetric::eigen(covariance);
        let (mut matrix, mut right) = ([0.0; 36], [0.0; 6]);
        for arm in &arms {
            let (u, v) = (dot(*arm, first), dot(*arm, second));
            let terms = [1.0, u, v, u * u, u * v, v * v];
            for (i, a) in terms.iter().enumerate() {
                right[i] += a * dot(*arm, normal);
                for (j, b) in terms.iter().enumerate() {
                    matrix[6 * i + j] += a * b;
                }
            }
        }
        // At the point itself, only the constant counts.
        cholesky::solve(&mut matrix, 6, &mut right)?;
        Some(right[0].abs() * scale)
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on a torus.
    fn torus(count: usize) -> Vec<Vec3> {
        let at = |i: usize| {
            let (u, v) = (
                i as f64 * 2.399_963,
                i as f64 * 0.754_877 * std::f64::consts::TAU,
            );
            let ring = 1.0 + 0.35 * v.cos();
            [ring * u.cos(), ring * u.sin(), 0.35 * v.sin()]
        };
        (0..count).map(at).collect()
    }

    fn labelled(points: &[Vec3], interior: impl Fn(usize, Vec3) -> bool) -> Vec<Label> {
        let label = |(i, &p): (usize, &Vec3)| {
            if interior(i, p) {
                Label::Interior
            } else {
                Label::Surface
            }
        };
        points.iter().enumerate().map(label).collect()
    }

    #[test]
    fn classes_on_the_surface_are_doubted() {
        let points = torus(1000);
        let mixed = labelled(&points, |i, _| i * i % 7 < 3);
        assert!(doubt(&points, &mixed).is_some());
        let halves = labelled(&points, |_, p| p[0] > 0.1);
        assert!(doubt(&points, &halves).is_some());
        assert!(doubt(&points, &vec![Label::Interior; 1000]).is_some());
        let noise: Vec<_> = (0..1000)
            .map(|i| match i * i % 7 {
                4 => Label::Exterior,
                _ => Label::Surface,
            })
            .collect();
        assert!(doubt(&points, &noise).is_some());
    }

    #[test]
    fn points_off_the_surface_are_believed() {
        let surface = torus(1000);
        for depth in [0.9, 0.5] {
            // Points between the surface and the circle in its middle.
            let inner = torus(97).into_iter().map(|[x, y, z]| {
                let ring = x.hypot(y);
                let middle = [x / ring, y / ring, 0.0];
                std::array::from_fn(|i| middle[i] + depth * ([x, y, z][i] - middle[i]))
            });
            let points: Vec<Vec3> = surface.iter().copied().chain(inner).collect();
            let labels = labelled(&points, |i, _| i >= 1000);
            assert_eq!(doubt(&points, &labels), None, "{depth}");
        }
        let outer = surface.iter().map(|p| p.map(|v| 1.1 * v));
        let points: Vec<Vec3> = surface.iter().copied().chain(outer).collect();
        let labels: Vec<_> = (0..2000)
            .map(|i| {
                if i < 1000 {
                    Label::Surface
                } else {
                    Label::Exterior
                }
            })
            .collect();
        assert_eq!(doubt(&points, &labels), None);
    }
}
