//! The way from a cloud to its samples, step by step.

use std::sync::Arc;

use super::frame::Frame;
use super::neighbours::{Neighbourhoods, SPACING_NEIGHBOURS, Tree, median};
use super::oriented::{Located, OrientedSurface};
use super::samples::{Grading, Sampler};
use super::selection::{Split, even_subset, pick};
use super::uncertainty::{Uncertainty, believed_noise};
use super::working::Working;
use super::{Counts, Prepared, Samples};
use crate::reconstruction::cloud::{self, Label, PointCloud};
use crate::reconstruction::error::Error;
use crate::reconstruction::nearby::Threads;
use crate::reconstruction::observer::Warning;
use crate::reconstruction::random::{Generator, Purpose, stream};
use crate::reconstruction::settings::{self, OffSurface, Sampling, Settings};
use crate::reconstruction::vector::{Bounds, Vec3};

/// Most held-out points that are listed.
const MAX_HELD_OUT: usize = 20_000;

/// Points are validated on up to one for so many that are trained on, which keeps validating
/// cheap beside training.
const VALIDATED_EVERY: usize = 4;

/// As many are validated on in any case, if they are there: fewer give a noisy loss.
const MIN_VALIDATED: usize = 500;

/// Turns a cloud into training and validation samples. Its points are `least_noise` off the surface at least,
/// in units of the cloud, as is known of those that were made from voxels; 0 of measured ones.
///
/// # Errors
/// [`cloud::Error::TooFewPoints`] and [`cloud::Error::Degenerate`] where the points labelled surface
/// make none; a conflict at `/sampling/off_surface` where labels are asked for and there are none;
/// [`Error::Cancelled`].
///
/// # Determinism
/// The same cloud, settings and seed give the same samples, bit for bit, with any number of threads.
pub fn prepare(
    cloud: &PointCloud,
    settings: &Settings,
    least_noise: f64,
    cancelled: &dyn Fn() -> bool,
) -> Result<Prepared, Error> {
    scan(cloud, settings, least_noise, cancelled).map(|(prepared, _)| prepared)
}

/// The same, with what is known of the surface from all points; none where only labels are used.
///
/// # Errors
/// As for [`prepare`].
pub(in crate::reconstruction) fn scan(
    cloud: &PointCloud,
    settings: &Settings,
    least_noise: f64,
    cancelled: &dyn Fn() -> bool,
) -> Result<(Prepared, Option<Scan>), Error> {
    let mut warnings = Vec::new();
    let mut choice = stream(settings.training.seed, Purpose::Selection);
    let mut scene = Scene::new(cloud, settings, &mut choice, &mut warnings)?;
    stop_if(cancelled)?;
    let surface = scene.oriented(&mut warnings);
    stop_if(cancelled)?;
    let split = Split::new(
        &scene.points,
        settings.sampling.surface_points,
        held_out_share(&settings.sampling, scene.sparse),
        &mut choice,
    );
    let trained = pick(&scene.points, &split.trained);
    let held_out = pick(&scene.points, &split.held_out);
    let most = MIN_VALIDATED.max(split.trained.len() / VALIDATED_EVERY);
    let validated = pick(&split.held_out, &even_subset(&held_out, most, &mut choice));
    let share = validated.len() as f64 / split.trained.len() as f64;
    let spacing = spacing(&trained, surface.as_ref());
    let uncertainty = surface
        .as_ref()
        .map(|surface| scene.uncertainty(surface, spacing, least_noise));
    let weight = uncertainty.map_or(1.0, |u| u.surface_weight());
    let on_surface = |positions: &[usize]| -> Samples {
        let points = pick(&scene.points, positions);
        let samples: Samples = points.into_iter().map(|p| (p, 0.0)).collect();
        samples.weighing(weight)
    };
    let mut training = on_surface(&split.trained);
    let mut validation = on_surface(&validated);
    stop_if(cancelled)?;
    let [interior, exterior] = [Label::Interior, Label::Exterior].map(|label| {
        let (fitted, checked) = scene.labelled(label, surface.as_ref(), share, &mut choice);
        let count = fitted.len();
        training.append(fitted);
        validation.append(checked);
        count
    });
    stop_if(cancelled)?;

    let mut counts = Counts {
        surface: split.trained.len(),
        interior,
        exterior,
        held_out: split.held_out.len(),
        ..Counts::default()
    };
    if let Some(surface) = &surface {
        let sampler = Sampler {
            surface,
            grading: scene.grading,
            // Spacing goes with the square root of the number of points on a surface.
            thinning: (surface.even_points as f64 / split.trained.len() as f64)
                .sqrt()
                .max(1.0),
            sparse: scene.sparse,
            threads: Threads::All,
        };
        let mut random = stream(settings.training.seed, Purpose::Sampling);
        let [near, far] = scene.generated(&sampler, &split.trained, 1.0, &mut random);
        (counts.near, counts.far) = (near.len(), far.len());
        training.append(near);
        training.append(far);
        stop_if(cancelled)?;
        for samples in scene.generated(&sampler, &validated, share, &mut random) {
            validation.append(samples);
        }
        warn_of_one_side(&training, &mut warnings);
    }
    counts.validation = validation.len();
    let listed = even_subset(&held_out, MAX_HELD_OUT, &mut choice);
    let listed = pick(&split.held_out, &listed);
    let prepared = Prepared {
        frame: scene.frame,
        training,
        validation,
        points: scene.indices.len(),
        surface: pick(&scene.indices, &split.trained),
        held_out: pick(&scene.indices, &listed),
        counts,
        spacing,
        anisotropy: surface.as_ref().map_or(1.0, |surface| surface.anisotropy),
        area: surface.as_ref().map(|surface| surface.area),
        uncertainty,
        blocks: 0,
        diagonal: scene.bounds.diagonal(),
        normals: surface.as_ref().map(|surface| surface.source),
        orientation_confidence: surface.as_ref().map(|surface| surface.confidence),
        strays: scene.strays,
        warnings,
    };
    let scan = surface.zip(uncertainty).map(|(surface, uncertainty)| Scan {
        surface,
        indices: scene.indices,
        held_out: listed,
        uncertainty,
        band: scene.grading.band,
    });
    Ok((prepared, scan))
}

/// The share that is held out of a cloud within the budget: none of a sparse one, which needs every
/// point, and which weight decay alone keeps from overfitting.
pub(in crate::reconstruction) fn held_out_share(sampling: &Sampling, sparse: bool) -> f64 {
    if sparse {
        0.0
    } else {
        sampling.validation_fraction
    }
}

fn stop_if(cancelled: &dyn Fn() -> bool) -> Result<(), Error> {
    if cancelled() {
        Err(Error::Cancelled)
    } else {
        Ok(())
    }
}

/// What is known of the surface from all points that are worked with, in the frame of training.
pub(in crate::reconstruction) struct Scan {
    /// The oriented points.
    pub(in crate::reconstruction) surface: OrientedSurface,
    /// Their indices into the cloud.
    pub(in crate::reconstruction) indices: Vec<usize>,
    /// Positions among them of those that the one network is not fitted to and that are listed
    /// ([`Prepared::held_out`]).
    pub(in crate::reconstruction) held_out: Vec<usize>,
    /// How far they can be trusted.
    pub(in crate::reconstruction) uncertainty: Uncertainty,
    /// Distance from the surface at which the targets of the one network reach ±1.
    pub(in crate::reconstruction) band: f64,
}

/// The surface points that are worked with, in the frame of training.
struct Scene<'a> {
    cloud: &'a PointCloud,
    settings: &'a Settings,
    /// Indices into the cloud.
    indices: Vec<usize>,
    /// Indices into the cloud of what was left out, ascending.
    strays: Vec<usize>,
    frame: Frame,
    /// The points at `indices`, unit frame.
    points: Vec<Vec3>,
    /// Over `points`.
    tree: Arc<Tree>,
    /// The neighbours of `points`, until the surface has them; none where only labels are used.
    near: Option<Neighbourhoods>,
    /// Box of `points`.
    bounds: Bounds,
    grading: Grading,
    /// Whether the points lie far apart beside the band.
    sparse: bool,
}

impl<'a> Scene<'a> {
    fn new(
        cloud: &'a PointCloud,
        settings: &'a Settings,
        choice: &mut Generator,
        warnings: &mut Vec<Warning>,
    ) -> Result<Self, Error> {
        let neighbours = settings.sampling.neighbours.max(SPACING_NEIGHBOURS);
        let Working {
            indices,
            strays,
            near,
        } = Working::new(cloud, (settings, neighbours), choice, warnings)?;
        let given = pick(&cloud.points, &indices);
        let box_of = |points: &[Vec3]| Bounds::of(points).ok_or(cloud::Error::Empty);
        let normalized = Frame::normalized(&box_of(&given)?, settings.sampling.half_extent)
            .ok_or(cloud::Error::Degenerate("all lie at the same place"))?;
        let frame = match settings.sampling.frame {
            settings::Frame::Normalized => normalized,
            settings::Frame::Given => Frame::IDENTITY,
        };
        let points: Vec<Vec3> = given.iter().map(|p| frame.to_unit(*p)).collect();
        let bounds = box_of(&points)?;
        let band = settings.sampling.band * bounds.diagonal();
        let generated = settings.sampling.off_surface == OffSurface::Generated;
        let tree = Tree::new(&points);
        let near = generated
            .then(|| near.unwrap_or_else(|| Neighbourhoods::new(&tree, &points, neighbours)));
        let spacing = near
            .as_ref()
            .map(|near| median(&mut near.spacings(&points)));
        Ok(Self {
            sparse: spacing.is_some_and(|spacing| Uncertainty::is_sparse(spacing, band)),
            tree: Arc::new(tree),
            near: near.map(|near| near.narrowed(settings.sampling.neighbours)),
            cloud,
            settings,
            indices,
            strays,
            frame,
            points,
            bounds,
            grading: Grading {
                targets: settings.sampling.targets,
                band,
            },
        })
    }

    /// The oriented surface; none where only labels are used.
    fn oriented(&mut self, warnings: &mut Vec<Warning>) -> Option<OrientedSurface> {
        let located = Located {
            points: self.points.clone(),
            tree: Arc::clone(&self.tree),
            near: self.near.take()?,
        };
        let given = self.cloud.normals.as_ref();
        Some(OrientedSurface::new(
            located,
            given.map(|normals| pick(normals, &self.indices)).as_deref(),
            self.sparse,
            warnings,
        ))
    }

    /// How far the points of `surface` can be trusted, which are off it by `least_noise` at least, in units of the
    /// cloud.
    fn uncertainty(
        &self,
        surface: &OrientedSurface,
        spacing: f64,
        least_noise: f64,
    ) -> Uncertainty {
        let found = believed_noise(surface.noise, surface.points.len(), spacing);
        Uncertainty {
            noise: found.max(self.frame.length_to_unit(least_noise)),
            spacing,
            band: self.grading.band,
            sparse: self.sparse,
            missing: surface.missing,
            crowding: surface.points.len() as f64 / surface.even_points as f64,
        }
    }

    /// Samples at the points that the user labels `label`: those within the budget, and of the
    /// others as many for validation as make `share` of them.
    fn labelled(
        &self,
        label: Label,
        surface: Option<&OrientedSurface>,
        share: f64,
        choice: &mut Generator,
    ) -> (Samples, Samples) {
        let points: Vec<Vec3> = self
            .cloud
            .indices(label)
            .map(|i| self.frame.to_unit(self.cloud.points[i]))
            .collect();
        let split = Split::new(&points, self.settings.sampling.labelled_points, 0.0, choice);
        let others = pick(&points, &split.held_out);
        let wanted = (share * split.trained.len() as f64).ceil() as usize;
        let sample = |p: Vec3| {
            let distance = surface.map_or_else(
                || self.tree.nearest(p).1,
                |surface| surface.distance(&surface.place(p)),
            );
            (p, self.grading.target(label == Label::Interior, distance))
        };
        (
            pick(&points, &split.trained)
                .into_iter()
                .map(sample)
                .collect(),
            pick(&others, &even_subset(&others, wanted, choice))
                .into_iter()
                .map(sample)
                .collect(),
        )
    }

    /// Near samples of the points at `positions`, and `share` of the far samples.
    fn generated(
        &self,
        sampler: &Sampler<'_>,
        positions: &[usize],
        share: f64,
        random: &mut Generator,
    ) -> [Samples; 2] {
        let sampling = &self.settings.sampling;
        let margin = self.settings.surface.padding * self.bounds.longest_edge();
        let far = (share * sampling.far_points as f64).round() as usize;
        [
            sampler.near(positions, sampling.near_pairs, random),
            sampler.far(&self.bounds.padded(margin), far, random),
        ]
    }
}

/// Says so if no sample is inside or none outside: then f = 0 fits and no surface will come out.
fn warn_of_one_side(training: &Samples, warnings: &mut Vec<Warning>) {
    for (side, missing) in [
        ("inside", !training.targets.iter().any(|t| *t > 0.0)),
        ("outside", !training.targets.iter().any(|t| *t < 0.0)),
    ] {
        if missing {
            warnings.push(Warning::new(
                "one_sided",
                format!(
                    "no sample lies surely {side} the surface: the points are too open or too \
                     noisy, or the normals contradict each other"
                ),
            ));
        }
    }
}

/// Median spacing of the points that are trained on. Of contours, the distance between the slices counts: that
/// along them says nothing of the surface.
fn spacing(trained: &[Vec3], surface: Option<&OrientedSurface>) -> f64 {
    let uneven = surface.filter(|surface| surface.even_points < surface.points.len());
    let across = uneven.map_or(0.0, |surface| median(&mut surface.spacings.clone()));
    let near = Neighbourhoods::new(&Tree::new(trained), trained, SPACING_NEIGHBOURS);
    median(&mut near.spacings(trained)).max(across)
}
