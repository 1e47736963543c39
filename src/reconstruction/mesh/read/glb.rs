//! glTF 2.0 in its binary container, as our own writer makes it: one list of triangles in one node
//! that is at most moved, or has the matrix that our writer gives it, which is undone (Khronos, glTF 2.0
//! Specification, sections 3.6 and 4.4).

use serde_json::{Value, json};

use super::{Face, position};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::space::Space;
use crate::reconstruction::vector::{Vec3, add};

/// The first bytes of a file.
pub(super) const MAGIC: &[u8] = b"glTF";

const FLOAT: u64 = 5126;
const UNSIGNED_INT: u64 = 5125;

pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh, Error> {
    let (json, rest) = chunk(bytes.get(12..).unwrap_or_default(), "JSON")?;
    let document: Value =
        serde_json::from_slice(json).map_err(|error| header(format!("JSON: {error}")))?;
    if document.get("meshes").is_none() {
        return Err(Error::Empty);
    }
    let (binary, _) = chunk(rest, "BIN\0")?;
    let node = only(&document["nodes"])?;
    let primitive = only(&only(&document["meshes"])?["primitives"])?;
    let extras = &node["extras"];
    let space: Space = serde_json::from_value(extras["space"].clone()).unwrap_or_default();
    let moved = if space == Space::default() {
        node.get("translation")
    } else {
        extras.get("offset").filter(|given| !given.is_null())
    };
    let foreign_matrix = space == Space::default() && node.get("matrix").is_some();
    let turned = ["children", "rotation", "scale"];
    if foreign_matrix
        || turned.iter().any(|name| node.get(name).is_some())
        || primitive.get("mode").is_some()
    {
        return Err(header(
            "a node is turned, or its mesh is no list of triangles",
        ));
    }
    let offset: Vec3 = match moved {
        None => [0.0; 3],
        Some(given) => serde_json::from_value(given.clone())
            .map_err(|_| header("the translation is no three numbers"))?,
    };
    let vectors = |number: &Value| -> Result<Vec<Vec3>, Error> {
        let words = words(&document, binary, number, (FLOAT, "VEC3"))?;
        let vector = |words: &[[u8; 4]; 3]| words.map(|word| f32::from_le_bytes(word).into());
        Ok(words.as_chunks().0.iter().map(vector).collect())
    };
    let mut mesh = TriangleMesh {
        space,
        ..TriangleMesh::default()
    };
    let attributes = &primitive["attributes"];
    for (i, point) in vectors(&attributes["POSITION"])?.into_iter().enumerate() {
        mesh.vertices.push(position(add(point, offset), i + 1)?);
    }
    if let Some(normals) = attributes.get("NORMAL") {
        mesh.normals = vectors(normals)?;
        mesh.normals.resize(mesh.vertices.len(), [0.0; 3]);
    }
    let corners = words(
        &document,
        binary,
        &primitive["indices"],
        (UNSIGNED_INT, "SCALAR"),
    )?;
    for (i, corners) in corners.chunks(3).enumerate() {
        let mut face = Face::new(i + 1, i + 1);
        for corner in corners {
            let corner = f64::from(u32::from_le_bytes(*corner));
            face.push(corner, mesh.vertices.len())?;
        }
        face.triangulate(&mut mesh.triangles)?;
    }
    Ok(mesh)
}

/// The numbers of an accessor of the given component type and shape, four bytes each.
fn words<'a>(
    document: &Value,
    binary: &'a [u8],
    number: &Value,
    (component, shape): (u64, &str),
) -> Result<&'a [[u8; 4]], Error> {
    let item = |list: &str, number: &Value| {
        let number = number.as_u64().unwrap_or(u64::MAX);
        let found = document[list].get(number as usize);
        found.ok_or_else(|| header(format!("{list} has no item {number}")))
    };
    let accessor = item("accessors", number)?;
    let view = item("bufferViews", &accessor["bufferView"])?;
    let plain = view.get("byteStride").or(accessor.get("sparse")).is_none();
    if !plain || accessor["componentType"] != json!(component) || accessor["type"] != shape {
        return Err(header(format!(
            "accessor {number} is no plain list of {shape} of type {component}"
        )));
    }
    let count = |value: &Value| value.as_u64().unwrap_or(0);
    let start = count(&view["byteOffset"]).saturating_add(count(&accessor["byteOffset"]));
    let width = if shape == "VEC3" { 12 } else { 4 };
    let declared = start.saturating_add(count(&accessor["count"]).saturating_mul(width));
    let found = binary.get(start as usize..declared as usize);
    let found = found.ok_or_else(|| truncated("BIN", declared, binary))?;
    Ok(found.as_chunks().0)
}

/// The content of the chunk at the start of `bytes`, and what comes after it.
fn chunk<'a>(bytes: &'a [u8], kind: &str) -> Result<(&'a [u8], &'a [u8]), Error> {
    let name = kind.trim_end_matches('\0');
    match bytes.as_chunks::<4>().0 {
        [length, found, ..] if found == kind.as_bytes() => {
            let (declared, rest) = (u32::from_le_bytes(*length), &bytes[8..]);
            rest.split_at_checked(declared as usize)
                .ok_or_else(|| truncated(name, declared.into(), rest))
        }
        _ => Err(header(format!("the chunk {name} is missing"))),
    }
}

/// The one item of a list.
fn only(list: &Value) -> Result<&Value, Error> {
    match list.as_array().map(Vec::as_slice) {
        Some([item]) => Ok(item),
        _ => Err(header(
            "only files with one node, mesh and primitive can be read",
        )),
    }
}

fn truncated(chunk: &str, declared: u64, found: &[u8]) -> Error {
    Error::Truncated {
        what: format!("the chunk {chunk}"),
        declared,
        found: found.len() as u64,
    }
}

fn header(detail: impl Into<String>) -> Error {
    let detail = detail.into();
    Error::Header { line: 0, detail }
}
