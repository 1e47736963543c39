//! PLY in its three encodings: positions, normals and distances of `vertex`, polygons of `face`.

use super::{Face, position};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::columns::Columns;
use crate::reconstruction::cloud::ply::{Body, Element, Header, Kind};
use crate::reconstruction::mesh::{DISTANCE, TriangleMesh};

pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh, Error> {
    let header = Header::read(bytes)?;
    let columns = header.vertex_columns()?;
    let vertices = header.elements.iter().find(|e| e.is_vertex());
    let vertices = vertices.map_or(0, |element| element.count);
    let mut body = header.body(bytes);
    let mut mesh = TriangleMesh {
        space: header.space,
        ..TriangleMesh::default()
    };
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => read_vertices(element, &columns, &mut body, &mut mesh)?,
            "face" => read_faces(element, vertices, &mut body, &mut mesh)?,
            "tristrips" => {
                return Err(Error::UnsupportedFormat(
                    "PLY files with triangle strips cannot be read".to_owned(),
                ));
            }
            _ => body.skip(element)?,
        }
    }
    Ok(mesh)
}

fn read_vertices(
    element: &Element,
    columns: &Columns,
    body: &mut Body<'_>,
    mesh: &mut TriangleMesh,
) -> Result<(), Error> {
    let distances = element
        .properties
        .iter()
        .position(|property| matches!(property.kind, Kind::Scalar(_)) && property.name == DISTANCE);
    for i in 0..element.count {
        let (mut row, mut distance) = ([0.0; 7], 0.0);
        let line = body.record(element, i, |column, value| {
            if let Some(slot) = columns.slot(column) {
                row[slot] = value;
            } else if Some(column) == distances {
                distance = value;
            }
        })?;
        let [x, y, z, nx, ny, nz, _] = row;
        mesh.vertices.push(position([x, y, z], line)?);
        if columns.has_normals() {
            mesh.normals.push([nx, ny, nz]);
        }
        if distances.is_some() {
            mesh.distance_to_points.push(distance);
        }
    }
    Ok(())
}

fn read_faces(
    element: &Element,
    vertices: usize,
    body: &mut Body<'_>,
    mesh: &mut TriangleMesh,
) -> Result<(), Error> {
    let polygon = element.properties.iter().position(|property| {
        matches!(property.kind, Kind::List(..))
            && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
    });
    let Some(polygon) = polygon else {
        return body.skip(element);
    };
    let mut indices = Vec::new();
    for i in 0..element.count {
        indices.clear();
        let line = body.record(element, i, |column, value| {
            if column == polygon {
                indices.push(value);
            }
        })?;
        let mut face = Face::new(i + 1, line);
        for &index in &indices {
            face.push(index, vertices)?;
        }
        face.triangulate(&mut mesh.triangles)?;
    }
    Ok(())
}
