//! From a field to the closed mesh of its zero set.
//!
//! Sample the field on a grid ([`Evaluation::Sparse`]: only where the surface can be), triangulate
//! with marching cubes, split the triangles where there is more detail, move the vertices onto the zero set, and drop the components that no input
//! point supports. The field counts as outside beyond the grid, so that the mesh is always closed.

mod begun;
mod bits;
mod components;
mod dense;
mod grid;
mod marching_cubes;
mod projection;
mod refinement;
mod samples;
mod sparse;
mod table;

use super::error::Error;
use super::mesh::TriangleMesh;
use super::settings::Evaluation;
use super::vector::{Bounds, Vec3};
pub use begun::Begun;
pub use components::{Dropped, keep_components};
pub use grid::Grid;

/// A scalar field on R³: positive inside, zero on the surface.
pub trait Field: Sync {
    /// Writes f at each of `points` into `values`, which has the same length.
    ///
    /// # Errors
    /// What the engine behind the field reports.
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error>;

    /// The same, and ∇f into `gradients`.
    ///
    /// # Errors
    /// What the engine behind the field reports.
    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error>;

    /// Writes how short the details are that the field shows at each of `points` into `lengths`, which has the same
    /// length; leaves those of which it knows nothing.
    fn detail(&self, _points: &[Vec3], _lengths: &mut [f64]) {}

    /// The least of them anywhere; none where nothing is known.
    fn finest_detail(&self) -> Option<f64> {
        None
    }
}

impl<F: Field + ?Sized> Field for &F {
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
        (**self).values(points, values)
    }

    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error> {
        (**self).values_and_gradients(points, values, gradients)
    }

    fn detail(&self, points: &[Vec3], lengths: &mut [f64]) {
        (**self).detail(points, lengths);
    }

    fn finest_detail(&self) -> Option<f64> {
        (**self).finest_detail()
    }
}

/// Most triangles of a mesh unless the caller says otherwise: about 1 GB of triangles and vertices.
pub const MAX_TRIANGLES: usize = 40_000_000;

/// What to extract, and the window of the caller onto the work.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// Box that the grid covers, in the frame of the field.
    pub bounds: Bounds,
    /// Grid points along the longest edge of the box.
    pub resolution: usize,
    /// Where the field is evaluated.
    pub evaluation: Evaluation,
    /// Whether triangles become smaller where the field shows more detail than the grid.
    pub refined: bool,
    /// Newton steps that move the vertices onto the zero set.
    pub projection_steps: usize,
    /// Most triangles of the mesh.
    pub max_triangles: usize,
    /// Asked before each call of the field whether to stop.
    pub cancelled: &'a dyn Fn() -> bool,
    /// Told the share of the work that is done, 0 to 1.
    pub progress: &'a dyn Fn(f64),
}

impl Request<'_> {
    /// Sparse evaluation over `bounds`, two Newton steps, nobody watching.
    pub fn new(bounds: Bounds, resolution: usize) -> Self {
        Self {
            bounds,
            resolution,
            evaluation: Evaluation::Sparse,
            refined: true,
            projection_steps: 2,
            max_triangles: MAX_TRIANGLES,
            cancelled: &|| false,
            progress: &|_| (),
        }
    }
}

/// The mesh of a zero set, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Extraction {
    /// Closed, manifold and oriented; with unit normals along -∇f.
    pub mesh: TriangleMesh,
    /// The grid that the field was sampled on.
    pub grid: Grid,
    /// Grid points at which the field was evaluated.
    pub evaluations: u64,
    /// Evaluations of the field with its gradient, at vertices.
    pub gradient_evaluations: u64,
    /// Vertices where the surface was closed because it left the grid; they are not on f = 0.
    pub closing_vertices: usize,
    /// Vertices put back to where marching cubes had them, lest the mesh fold over.
    pub unprojected_vertices: usize,
}

/// Extracts the zero set of `field`.
///
/// # Errors
/// [`Error::NoSurface`] where the field does not change its sign on the grid or is not finite,
/// [`Error::MeshTooLarge`], [`Error::Cancelled`], and what the field reports.
///
/// # Determinism
/// The same field values give the same mesh, bit for bit, whatever the number of threads. Without
/// projection, sparse and dense evaluation give the same mesh too, but for components that are
/// smaller than a coarse cell and away from any that is seen.
pub fn extract(field: &dyn Field, request: &Request<'_>) -> Result<Extraction, Error> {
    Begun::new(request)?.finish(field, request)
}
