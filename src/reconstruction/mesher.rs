//! From a trained field to the mesh that a run gives: everything that is the same for snapshots and the result.

use super::cloud::{Label, PointCloud};
use super::error::Error;
use super::mesh::{PointTree, TriangleMesh, trim};
use super::observer::Observer;
use super::report::SurfaceReport;
use super::sampling::Prepared;
use super::settings::{Components, Settings};
use super::surface::{Field, MAX_TRIANGLES, Request, extract, keep_components};
use super::vector::{Bounds, Vec3};

/// Turns fields into meshes.
pub(super) struct Mesher<'a> {
    cloud: &'a PointCloud,
    pub(super) settings: &'a Settings,
    pub(super) prepared: &'a Prepared,
    pub(super) observer: &'a dyn Observer,
    bounds: Bounds,
    surface_points: Vec<Vec3>,
}

impl<'a> Mesher<'a> {
    pub(super) fn new(
        cloud: &'a PointCloud,
        settings: &'a Settings,
        prepared: &'a Prepared,
        observer: &'a dyn Observer,
    ) -> Self {
        let surface_points: Vec<Vec3> = prepared
            .surface
            .iter()
            .chain(&prepared.held_out)
            .map(|&i| prepared.frame.to_unit(cloud.points[i]))
            .collect();
        let origin = Bounds {
            min: [0.0; 3],
            max: [0.0; 3],
        };
        let bounds = Bounds::of(&surface_points).unwrap_or(origin);
        let bounds = bounds.padded(settings.surface.padding * bounds.longest_edge());
        Self {
            cloud,
            settings,
            prepared,
            observer,
            bounds,
            surface_points,
        }
    }

    /// Grid points along the longest edge.
    fn resolution(&self) -> usize {
        let settings = &self.settings.surface;
        if settings.steps_per_spacing > 0.0 {
            let step = self.prepared.spacing / settings.steps_per_spacing;
            let enough = (self.bounds.longest_edge() / step).ceil();
            settings
                .resolution
                .min((enough as usize).max(LEAST_RESOLUTION))
        } else {
            settings.resolution
        }
    }

    /// The mesh of `field`, in the coordinates of the input.
    pub(super) fn mesh(
        &self,
        field: &dyn Field,
        stopped: &dyn Fn() -> bool,
        progress: &dyn Fn(f64),
    ) -> Result<(TriangleMesh, SurfaceReport), Error> {
        let settings = &self.settings.surface;
        let extraction = extract(
            field,
            &Request {
                bounds: self.bounds,
                resolution: self.resolution(),
                evaluation: settings.evaluation,
                projection_steps: settings.projection_steps,
                max_triangles: MAX_TRIANGLES,
                cancelled: stopped,
                progress,
            },
        )?;
        let mut report = SurfaceReport::new(&extraction, &self.prepared.frame);
        let reach = SUPPORT_REACH * self.prepared.spacing.max(extraction.grid.spacing);
        let (mut mesh, dropped) = keep_components(
            extraction.mesh,
            settings.components,
            &self.surface_points,
            reach,
        );
        if mesh.triangles.is_empty() {
            return Err(Error::NoSurface(
                "no point of the cloud lies near any component of its zero set; try more \
                 training.max_evaluations, or surface.components all"
                    .to_owned(),
            ));
        }
        report.dropped(dropped, &self.prepared.frame);
        for vertex in &mut mesh.vertices {
            *vertex = self.prepared.frame.to_world(*vertex);
        }
        let points: Vec<Vec3> = self
            .cloud
            .indices(Label::Surface)
            .map(|i| self.cloud.points[i])
            .collect();
        if let Some(tree) = PointTree::new(&points) {
            let reach = self.prepared.frame.length_to_world(reach);
            mesh.distance_to_points = tree.distances(&mesh.vertices);
            report.supported(&mesh, reach);
            if report.open(settings.open) {
                let trimmed = trim(&mesh, reach, &|places| tree.distances(places));
                let (trimmed, _) = keep_components(trimmed, Components::Supported, &points, reach);
                // Where nothing is near, nothing would be left; the warning tells that none of it was measured.
                if !trimmed.triangles.is_empty() {
                    report.trimmed(&mesh, &trimmed);
                    mesh = trimmed;
                }
            }
        }
        Ok((mesh, report))
    }
}

/// Least number of grid points along the longest edge that the spacing of the points leads to.
const LEAST_RESOLUTION: usize = 64;

/// How far a point may be from a component, or a piece of the surface, that it supports, in spacings of points
/// or grid. The gaps of a random sampling stay below two.
const SUPPORT_REACH: f64 = 3.0;
