//! Coordinates that have lost their digits: stored as float32, or printed with a few digits, far from
//! the origin.

use crate::reconstruction::Warning;
use crate::reconstruction::sampling::neighbours::Tree;
use crate::reconstruction::vector::{Vec3, bits};

/// Points that are looked at.
const LOOKED_AT: usize = 20_000;

/// Fewest points of which steps are told: the differences of a few make any step.
const FEWEST: usize = 16;

/// Points whose nearest neighbour is asked for.
const ASKED: usize = 500;

/// Share of the distance between neighbours from which on a step of the coordinates matters: rounding
/// to it moves points by 7 % of that distance, which is the noise of a good scan.
const COARSE: f64 = 0.25;

/// How far from a whole number of steps a difference may be.
const STEP_TOLERANCE: f64 = 1e-3;

/// The warning about coordinates whose steps are coarse against the distances between points, where the
/// format of the numbers explains the steps. Points on a grid of their own are none.
pub(super) fn warning(points: &[Vec3]) -> Option<Warning> {
    let every = points.len().div_ceil(LOOKED_AT).max(1);
    let mut some: Vec<Vec3> = points.iter().step_by(every).copied().collect();
    some.sort_unstable_by_key(|p| bits(*p));
    some.dedup_by_key(|p| bits(*p));
    if some.len() < FEWEST {
        return None;
    }
    let axes = [0, 1, 2].map(|axis| Axis::of(&some, axis));
    let explained = |&i: &usize| axes[i].digits.is_some() && !shares_a_grid(i, &axes, &some);
    let coarsest = (0..3).filter(explained).map(|i| &axes[i]);
    let coarsest = coarsest.max_by(|a, b| a.step.total_cmp(&b.step))?;
    // Of every n-th point of a surface, the neighbours are √n times as far away.
    let spacing = spacing(&some)? / (every as f64).sqrt();
    if coarsest.step <= COARSE * spacing {
        return None;
    }
    let digits = coarsest.digits?;
    let message = format!(
        "coordinates as large as {} have {digits}, that is steps of {}, while neighbouring points are \
         {} apart: the shape is rounded; subtract the offset of the cloud before it is written, or \
         write double precision with all digits",
        coarsest.largest,
        short(coarsest.step),
        short(spacing)
    );
    Some(Warning::new("coordinates_coarse", message))
}

/// The number with three digits.
fn short(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// The values along an axis.
#[derive(Debug)]
struct Axis {
    /// Largest magnitude.
    largest: f64,
    /// Step that all differences are multiples of; infinite if there is none.
    step: f64,
    /// What explains the step.
    digits: Option<&'static str>,
}

impl Axis {
    fn of(points: &[Vec3], axis: usize) -> Self {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.dedup();
        let largest = values.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
        let differences = || values.windows(2).map(|pair| pair[1] - pair[0]);
        let step = differences().fold(f64::INFINITY, f64::min);
        let is_whole = |difference: f64| {
            let steps = difference / step;
            (steps - steps.round()).abs() <= STEP_TOLERANCE * steps.max(1.0)
        };
        let grid = (step.is_finite() && differences().all(is_whole)).then_some(step);
        // In floating point, so that an axis that is 0 throughout gets steps of 0.
        let single = (largest.log2().floor() - 23.0).exp2();
        let decimal = 10f64.powf(largest.log10().floor() - 5.0);
        let (step, digits) = match grid {
            Some(step) if alike(step, decimal) => (step, Some("six digits")),
            Some(step) if step > 1.5 * single => (step, None),
            _ if values.iter().all(|&v| is_single(v)) => (single, Some("the digits of float32")),
            _ => (grid.unwrap_or(f64::INFINITY), None),
        };
        Self {
            largest,
            step,
            digits,
        }
    }
}

fn alike(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < STEP_TOLERANCE
}

/// Whether float32 and its shortest spelling give the very number.
fn is_single(value: f64) -> bool {
    let single = value as f32;
    f64::from(single).to_bits() == value.to_bits()
        || single
            .to_string()
            .parse()
            .is_ok_and(|spelled: f64| spelled.to_bits() == value.to_bits())
}

/// Whether an axis belongs to a grid of pixels or voxels, so that its step is not a matter of digits:
/// another axis has the same step without an explanation, or the two are those of a raster, where no
/// two points have the same place.
fn shares_a_grid(axis: usize, axes: &[Axis; 3], points: &[Vec3]) -> bool {
    let alike = |&other: &usize| other != axis && alike(axes[other].step, axes[axis].step);
    let is_raster = |other: usize| {
        let place = |p: &Vec3| [p[axis].to_bits(), p[other].to_bits()];
        let mut places: Vec<_> = points.iter().map(place).collect();
        places.sort_unstable();
        places.windows(2).all(|pair| pair[0] != pair[1])
    };
    (0..3)
        .filter(alike)
        .any(|other| axes[other].digits.is_none() || is_raster(other))
}

/// Median distance between neighbours among points that are all different.
fn spacing(points: &[Vec3]) -> Option<f64> {
    let tree = Tree::new(points);
    let asked = points.iter().step_by(points.len().div_ceil(ASKED));
    let mut distances: Vec<f64> = asked
        .filter_map(|p| Some(tree.nearest_n(*p, 2).get(1)?.1))
        .collect();
    distances.sort_unstable_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points all over a sphere, moved and changed.
    fn ball(radius: f64, offset: Vec3, change: impl Fn(usize, f64) -> f64) -> Vec<Vec3> {
        let at = |i: usize| {
            let z = (i as f64 + 0.5) / 1000.0 - 1.0;
            let (r, a) = ((1.0 - z * z).sqrt(), i as f64 * 2.399_963);
            let p = [r * a.cos(), r * a.sin(), z];
            std::array::from_fn(|k| change(k, radius * p[k] + offset[k]))
        };
        (0..2000).map(at).collect()
    }

    const MAP: Vec3 = [512_434.0, 5_405_590.0, 348.5];

    fn single(_: usize, v: f64) -> f64 {
        f64::from(v as f32)
    }

    fn code(points: &[Vec3]) -> Option<&'static str> {
        warning(points).map(|warning| warning.code)
    }

    #[test]
    fn lost_digits_are_told() {
        let coarse = Some("coordinates_coarse");
        assert_eq!(code(&ball(2.0, MAP, single)), coarse);
        let spelled = |_, v: f64| (v as f32).to_string().parse().unwrap();
        assert_eq!(
            code(&ball(1.0, [1_500_000.0, 1_200_000.0, 0.0], spelled)),
            coarse
        );
        let six = |_, v: f64| format!("{v:.5e}").parse().unwrap();
        assert_eq!(code(&ball(40.0, MAP, six)), coarse);
        let message = warning(&ball(2.0, MAP, single)).unwrap().message;
        assert!(
            message.contains("float32") && message.contains("subtract"),
            "{message}"
        );
    }

    #[test]
    fn enough_digits_are_fine() {
        let all = |_, v| v;
        assert_eq!(code(&ball(2.0, MAP, all)), None);
        assert_eq!(code(&ball(2.0, [0.0; 3], single)), None);
        assert_eq!(code(&ball(500.0, MAP, single)), None);
        let millimetres = |_, v: f64| (v * 1000.0).round() / 1000.0;
        assert_eq!(code(&ball(2.0, MAP, millimetres)), None);
        assert_eq!(code(&ball(1e6, [0.0; 3], |_, v| v.round())), None);
        let flat = |axes: usize| move |k: usize, v: f64| if k < axes { v } else { 0.0 };
        for axes in 0..3 {
            assert_eq!(code(&ball(2.0, [0.0; 3], flat(axes))), None, "{axes} axes");
        }
    }

    #[test]
    fn grids_of_voxels_and_pixels_are_fine() {
        let voxels = |_, v: f64| v.round();
        assert_eq!(code(&ball(30.0, [100.0, 200.0, 50.0], voxels)), None);
        assert_eq!(code(&ball(30.0, MAP, voxels)), None);
        assert_eq!(code(&ball(30.0, MAP, |_, v| 0.5 * (2.0 * v).round())), None);
        let raster = |step: f64| -> Vec<Vec3> {
            let at = |i: usize| {
                let (x, y) = ((i % 40) as f64 * step, (i / 40) as f64 * step);
                [
                    3_512_430.0 + x,
                    5_405_590.0 + y,
                    300.0 + (0.05 * (x + 2.0 * y)).sin(),
                ]
            };
            (0..1600).map(at).collect()
        };
        for step in [0.5, 1.0, 10.0] {
            assert_eq!(code(&raster(step)), None, "{step}");
        }
    }
}
