//! From a trained field to the mesh that a run gives: everything that is the same for snapshots and the result.

use super::cloud::PointCloud;
use super::error::Error;
use super::mesh::{Limits, PointTree, TriangleMesh, simplify, trim};
use super::observer::Observer;
use super::plan::{Extent, Plan};
use super::report::{SurfaceReport, Verdict, verdict_on};
use super::sampling::Prepared;
use super::settings::Components;
use super::surface::{Begun, Field, MAX_TRIANGLES, Request, extract, keep_components};
use super::vector::{Bounds, Vec3};

/// Turns fields into meshes.
pub(super) struct Mesher<'a> {
    cloud: &'a PointCloud,
    pub(super) plan: &'a Plan<'a>,
    pub(super) prepared: &'a Prepared,
    pub(super) observer: &'a dyn Observer,
    bounds: Bounds,
    surface_points: Vec<Vec3>,
}

impl<'a> Mesher<'a> {
    pub(super) fn new(
        cloud: &'a PointCloud,
        plan: &'a Plan<'a>,
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
        let bounds = bounds.padded(plan.settings.surface.padding * bounds.longest_edge());
        Self {
            cloud,
            plan,
            prepared,
            observer,
            bounds,
            surface_points,
        }
    }

    /// What is extracted.
    pub(super) fn request<'r>(
        &self,
        stopped: &'r dyn Fn() -> bool,
        progress: &'r dyn Fn(f64),
    ) -> Request<'r> {
        let settings = &self.plan.settings.surface;
        let extent = Extent {
            bounds: self.bounds,
            spacing: self.prepared.spacing,
            area: self.prepared.area,
        };
        Request {
            bounds: self.bounds,
            resolution: self.plan.resolution(&extent, self.prepared.blocks > 0),
            evaluation: settings.evaluation,
            refined: settings.steps_per_spacing > 0.0,
            projection_steps: settings.projection_steps,
            max_triangles: MAX_TRIANGLES,
            cancelled: stopped,
            progress,
        }
    }

    /// The mesh of `field`, in the coordinates of the input, of which an extraction may have `begun`.
    pub(super) fn mesh(
        &self,
        (field, begun): (&dyn Field, Option<Begun>),
        stopped: &dyn Fn() -> bool,
        progress: &dyn Fn(f64),
    ) -> Result<(TriangleMesh, SurfaceReport), Error> {
        let settings = &self.plan.settings.surface;
        let request = self.request(stopped, progress);
        let extraction = match begun {
            Some(begun) => begun.finish(field, &request)?,
            None => extract(field, &request)?,
        };
        let mut report = SurfaceReport::new(&extraction, &self.prepared.frame);
        let reach = SUPPORT_REACH * self.prepared.spacing.max(extraction.grid.spacing);
        let points: Vec<Vec3> = self.prepared.measured(self.cloud).collect();
        let (which, supporting) = (settings.components, &self.surface_points);
        // Either is work for one thread.
        let ((mut mesh, dropped), tree) = rayon::join(
            || keep_components(extraction.mesh, which, supporting, reach),
            || PointTree::new(&points),
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
        if let Some(tree) = tree {
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
        let mut mesh = self.simplified(mesh, &mut report, stopped)?;
        mesh.space = self.cloud.space;
        Ok((mesh, report))
    }

    /// How far a mesh that was made here can be relied on.
    pub(super) fn verdict(&self, mesh: &TriangleMesh, surface: &SurfaceReport) -> Verdict {
        verdict_on(self.cloud, self.plan, self.prepared, mesh, surface)
    }

    /// The mesh with as few triangles as asked for, as far as the points bear it out. What is cut away is gone by
    /// then: what was measured is told of all of the surface, the boundary is where it is, and the triangles are
    /// those that the user gets.
    fn simplified(
        &self,
        mesh: TriangleMesh,
        report: &mut SurfaceReport,
        stopped: &dyn Fn() -> bool,
    ) -> Result<TriangleMesh, Error> {
        let before = mesh.triangles.len();
        let target = self.plan.settings.surface.target_triangles;
        if target == 0 || before <= target {
            return Ok(mesh);
        }
        let prepared = self.prepared;
        let noise = prepared.noise().unwrap_or_default();
        let error = (SPACING_SHARE * prepared.spacing).max(NOISE_SHARE * noise);
        let limits = Limits {
            triangles: target,
            error: prepared.frame.length_to_world(error),
        };
        let simplified = simplify(mesh, limits, stopped)?;
        report.simplified(before, limits, &simplified);
        Ok(simplified.mesh)
    }
}

/// Furthest that simplification may move the surface, in spacings of the points. Where these are exact, about two
/// triangles a point are left then: as many as join the points themselves.
const SPACING_SHARE: f64 = 0.05;

/// The same in standard deviations of their noise, where that is more: the error of the surface, which the noise
/// has made, grows by less than a fifth then, in the median.
const NOISE_SHARE: f64 = 0.25;

/// How far a point may be from a component, or a piece of the surface, that it supports, in spacings of points
/// or grid. The gaps of a random sampling stay below two.
const SUPPORT_REACH: f64 = 3.0;
