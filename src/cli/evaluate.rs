//! `meshway evaluate`: a mesh, judged by itself and against what is known.

use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use serde_json::{Map, Value};

use super::Failure;
use super::files::{OnePart, Sink, read, read_cloud};
use crate::reconstruction::mesh::{self, TriangleMesh};
use crate::reconstruction::quality::{Judge, MeshReport, compare_meshes, describe};
use crate::reconstruction::shapes::Shape;
use crate::reconstruction::surface::{Request, extract};

/// Arguments of `meshway evaluate`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The mesh: PLY, OBJ, OFF, STL, or GLB as `reconstruct` writes it; also gzipped.
    mesh: PathBuf,
    /// What to compare it with: a mesh, a point cloud, or a shape (sphere, sphere:RADIUS,
    /// torus, torus:MAJOR:MINOR, hand, uterus, abdomen).
    reference: Option<String>,
    /// Seed of the points that are drawn from the surfaces.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where the JSON goes; `-` is standard output.
    #[arg(short, long, value_name = "JSON", default_value = "-")]
    output: PathBuf,
}

/// Grid points along the longest edge of the mesh that stands for a shape; its vertices are on the
/// true surface, so that what is left is the sagitta of its triangles: below 0.001 % of the diagonal.
const SHAPE_RESOLUTION: usize = 200;

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let sink = Sink::new(&arguments.output)?;
    let mesh = read_mesh(&arguments.mesh)?;
    if mesh.triangles.is_empty() {
        return Err(Failure::input(
            &arguments.mesh,
            "has no faces, so it is no mesh",
        ));
    }
    let mut result = Map::new();
    result.insert("mesh".to_owned(), json::<MeshReport>(&describe(&mesh))?);
    if let Some(reference) = &arguments.reference {
        result.insert(
            "comparison".to_owned(),
            compare(&mesh, reference, arguments)?,
        );
    }
    sink.write(|out| {
        serde_json::to_writer_pretty(&mut *out, &result)?;
        out.write_all(b"\n")
    })
}

fn read_mesh(path: &Path) -> Result<TriangleMesh, Failure> {
    let name = path.file_name().map(|name| name.to_string_lossy());
    mesh::read::read(&read(path)?, name.as_deref()).map_err(|error| Failure::cloud(path, &error))
}

fn compare(mesh: &TriangleMesh, reference: &str, arguments: &Arguments) -> Result<Value, Failure> {
    let path = Path::new(reference);
    let seed = arguments.seed;
    let no_area = || Failure::input(&arguments.mesh, "has no area, so no distances");
    if !path.exists() {
        let shape: Shape = reference
            .parse()
            .map_err(|error| Failure::input(path, format!("there is no such file; {error}")))?;
        let truth = shape_mesh(&shape)?;
        return json(&compare_meshes(mesh, &truth, seed).ok_or_else(no_area)?);
    }
    let known = read_mesh(path);
    match known {
        Ok(truth) if !truth.triangles.is_empty() => {
            json(&compare_meshes(mesh, &truth, seed).ok_or_else(no_area)?)
        }
        // Not a mesh: perhaps a cloud, whose readers know more formats.
        _ => {
            let (cloud, ..) = read_cloud(path, &OnePart::default())?;
            let judge = Judge::new(mesh, &cloud.points, seed).ok_or_else(no_area)?;
            let comparison = judge.compare(0..cloud.points.len(), cloud.bounds());
            json(&comparison.ok_or_else(no_area)?)
        }
    }
}

fn shape_mesh(shape: &Shape) -> Result<TriangleMesh, Failure> {
    let bounds = shape.bounds();
    let request = Request::new(
        bounds.padded(0.05 * bounds.longest_edge()),
        SHAPE_RESOLUTION,
    );
    let extraction = extract(shape, &request)
        .map_err(|error| Failure::Usage(format!("the shape has no mesh: {error}")))?;
    Ok(extraction.mesh)
}

fn json<T: Serialize>(value: &T) -> Result<Value, Failure> {
    serde_json::to_value(value).map_err(|error| Failure::Output(error.to_string()))
}
