//! glTF 2.0 in its binary container: Khronos, glTF 2.0 Specification, section 4.4.
//!
//! One node, one mesh, one buffer: positions, then normals, then indices. glTF knows 32-bit
//! coordinates only, so a mesh far from the origin is stored around its middle and the node is
//! moved there. glTF has y upwards and metres: where frame and unit are known, the node has the matrix that
//! leads there, and names the frame that the stored coordinates belong to.
//!
//! Where colours are asked for, distances and colours come behind the indices, and the mesh says in its extras
//! what the colours mean.

use std::io::{self, Write};

use serde_json::{Value, json};

use super::{Colors, count_u32, distances, fits_f32, has_normals, to_f32, write_f32};
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::space::{Frame, Space};
use crate::reconstruction::vector::{Vec3, multiplied, scale, sub};

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

/// Attribute of the distances: the format wants names of one's own to begin so.
const DISTANCES: &str = "_DISTANCE_TO_POINTS";

pub(super) fn write(
    mesh: &TriangleMesh,
    colors: Option<Colors>,
    out: &mut impl Write,
) -> io::Result<()> {
    let translation = mesh
        .bounds()
        .filter(|_| !fits_f32(mesh))
        .map(|bounds| bounds.centre());
    let origin = translation.unwrap_or_default();
    let mut document = document(mesh, colors, translation).to_string().into_bytes();
    // Chunks are multiples of 4 bytes; JSON is filled up with blanks. Floats and indices are 4
    // bytes each, colours 8, so the binary chunk needs no filling.
    document.resize(document.len().next_multiple_of(4), b' ');
    let binary = binary_length(mesh, colors);

    let chunks = if binary > 0 { 2 } else { 1 };
    out.write_all(b"glTF")?;
    out.write_all(&2u32.to_le_bytes())?;
    out.write_all(&count_u32(12 + 8 * chunks + document.len() + binary)?.to_le_bytes())?;
    out.write_all(&count_u32(document.len())?.to_le_bytes())?;
    out.write_all(b"JSON")?;
    out.write_all(&document)?;
    if binary == 0 {
        return Ok(());
    }
    out.write_all(&count_u32(binary)?.to_le_bytes())?;
    out.write_all(b"BIN\0")?;
    for &vertex in &mesh.vertices {
        write_f32(to_f32(sub(vertex, origin)), out)?;
    }
    if has_normals(mesh) {
        for &normal in &mesh.normals {
            write_f32(to_f32(normal), out)?;
        }
    }
    for v in mesh.triangles.iter().flatten() {
        out.write_all(&v.to_le_bytes())?;
    }
    let Some(colors) = colors else { return Ok(()) };
    for &distance in distances(mesh) {
        out.write_all(&(distance as f32).to_le_bytes())?;
    }
    for &distance in distances(mesh) {
        for channel in colors.linear(distance) {
            out.write_all(&channel.to_le_bytes())?;
        }
    }
    Ok(())
}

/// Bytes of the buffer; none without triangles, because glTF has no empty meshes.
fn binary_length(mesh: &TriangleMesh, colors: Option<Colors>) -> usize {
    if mesh.triangles.is_empty() {
        return 0;
    }
    let attributes = if has_normals(mesh) { 2 } else { 1 };
    let colored = colors.map_or(0, |_| 12 * mesh.vertices.len());
    12 * (attributes * mesh.vertices.len() + mesh.triangles.len()) + colored
}

fn document(mesh: &TriangleMesh, colors: Option<Colors>, translation: Option<Vec3>) -> Value {
    let asset = json!({"version": "2.0", "generator": "Meshway"});
    if mesh.triangles.is_empty() {
        return json!({"asset": asset});
    }
    let vertices = mesh.vertices.len();
    let block = 12 * vertices;
    let (min, max) = stored_bounds(mesh, translation.unwrap_or_default());
    let mut accessors = vec![json!({
        "bufferView": 0, "componentType": FLOAT, "count": vertices, "type": "VEC3",
        "min": min, "max": max,
    })];
    let mut views = vec![view(0, block, ARRAY_BUFFER)];
    let mut attributes = json!({"POSITION": 0});
    if has_normals(mesh) {
        attributes["NORMAL"] = json!(1);
        accessors.push(json!({
            "bufferView": 1, "componentType": FLOAT, "count": vertices, "type": "VEC3",
        }));
        views.push(view(block, block, ARRAY_BUFFER));
    }
    let indices = accessors.len();
    accessors.push(json!({
        "bufferView": indices, "componentType": UNSIGNED_INT, "count": 3 * mesh.triangles.len(),
        "type": "SCALAR",
    }));
    views.push(view(
        indices * block,
        12 * mesh.triangles.len(),
        ELEMENT_ARRAY_BUFFER,
    ));
    if colors.is_some() {
        let behind = indices * block + 12 * mesh.triangles.len();
        attributes[DISTANCES] = json!(indices + 1);
        accessors.push(json!({
            "bufferView": indices + 1, "componentType": FLOAT, "count": vertices, "type": "SCALAR",
        }));
        views.push(view(behind, 4 * vertices, ARRAY_BUFFER));
        attributes["COLOR_0"] = json!(indices + 2);
        accessors.push(json!({
            "bufferView": indices + 2, "componentType": UNSIGNED_SHORT, "normalized": true,
            "count": vertices, "type": "VEC4",
        }));
        views.push(view(behind + 4 * vertices, 8 * vertices, ARRAY_BUFFER));
    }
    let mut surface = json!({
        "primitives": [{"attributes": attributes, "indices": indices, "material": 0}],
    });
    if let Some(colors) = colors {
        let legend = json!({
            "attribute": DISTANCES, "scale": Colors::SCALE, "from": 0.0, "to": colors.most(),
        });
        surface["extras"] = json!({"colors": legend});
    }
    let mut node = json!({"mesh": 0});
    if let Some(matrix) = upright(mesh.space, translation.unwrap_or_default()) {
        node["matrix"] = json!(matrix);
        node["extras"] = json!({"space": mesh.space, "offset": translation});
    } else if let Some(translation) = translation {
        node["translation"] = json!(translation);
    }
    json!({
        "asset": asset,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [surface],
        // The default of the format is metal, which is dark where nothing surrounds it.
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0}}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": binary_length(mesh, colors)}],
    })
}

/// The matrix, column by column, that puts stored coordinates, moved by `offset`, upright: x to the left of the
/// patient, y to the head, z to the front, in metres. None where it is not known where they are now.
fn upright(space: Space, offset: Vec3) -> Option<[f64; 16]> {
    let metre = space.unit.millimetres()? / 1000.0;
    let factors = space.frame.turn(Frame::Lps)?;
    let [x, y, z] = scale(factors, metre);
    let [dx, dy, dz] = multiplied(offset, [x, y, z]);
    let mut matrix = [0.0; 16];
    (matrix[0], matrix[6], matrix[9]) = (x, -y, z);
    (matrix[12], matrix[13], matrix[14], matrix[15]) = (dx, dz, 0.0 - dy, 1.0);
    Some(matrix)
}

fn view(offset: usize, length: usize, target: u32) -> Value {
    json!({"buffer": 0, "byteOffset": offset, "byteLength": length, "target": target})
}

/// Bounds of all vertices as they are stored: the format wants them exact, so after the rounding.
fn stored_bounds(mesh: &TriangleMesh, origin: Vec3) -> ([f32; 3], [f32; 3]) {
    mesh.vertices.iter().fold(
        ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]),
        |(min, max), &vertex| {
            let stored = to_f32(sub(vertex, origin));
            (
                std::array::from_fn(|i| min[i].min(stored[i])),
                std::array::from_fn(|i| max[i].max(stored[i])),
            )
        },
    )
}
