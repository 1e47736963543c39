//! The parts of a GLB file, against the specification.

use meshway::reconstruction::mesh::TriangleMesh;
use meshway::reconstruction::mesh::write::Format;
use serde_json::Value;

use super::formats::written;
use super::{moved, sphere};

/// A GLB file taken apart.
pub(super) struct Parts {
    pub(super) document: Value,
    pub(super) binary: Vec<u8>,
}

fn word(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

pub(super) fn take_apart(bytes: &[u8]) -> Parts {
    assert_eq!(&bytes[..4], b"glTF");
    assert_eq!(word(bytes, 4), 2);
    assert_eq!(word(bytes, 8), bytes.len());
    let json = word(bytes, 12);
    assert_eq!(&bytes[16..20], b"JSON");
    assert_eq!(json % 4, 0);
    let rest = &bytes[20 + json..];
    let binary = if rest.is_empty() {
        Vec::new()
    } else {
        assert_eq!(word(rest, 0), rest.len() - 8);
        assert_eq!(&rest[4..8], b"BIN\0");
        rest[8..].to_vec()
    };
    Parts {
        document: serde_json::from_slice(&bytes[20..20 + json]).unwrap(),
        binary,
    }
}

impl Parts {
    /// The 4-byte words that an accessor describes.
    fn words(&self, accessor: &Value) -> Vec<[u8; 4]> {
        let accessor = &self.document["accessors"][accessor.as_u64().unwrap() as usize];
        let view = &self.document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
        let [start, length] =
            ["byteOffset", "byteLength"].map(|name| view[name].as_u64().unwrap() as usize);
        let bytes = &self.binary[start..start + length];
        let components = if accessor["type"] == "VEC3" { 3 } else { 1 };
        assert_eq!(accessor["count"], length / 4 / components);
        bytes.as_chunks().0.to_vec()
    }

    pub(super) fn floats(&self, accessor: &Value) -> Vec<f32> {
        let words = self.words(accessor);
        words.into_iter().map(f32::from_le_bytes).collect()
    }
}

#[test]
fn a_glb_holds_the_mesh() {
    let mesh = sphere(2.0, 2);
    let parts = take_apart(&written(&mesh, Format::Glb));
    let document = &parts.document;
    assert_eq!(document["asset"]["version"], "2.0");
    assert_eq!(document["scenes"][0]["nodes"][0], 0);
    assert_eq!(document["nodes"][0]["mesh"], 0);
    assert!(document["nodes"][0].get("translation").is_none());
    assert_eq!(document["buffers"][0]["byteLength"], parts.binary.len());

    let primitive = &document["meshes"][0]["primitives"][0];
    let stored = |vectors: &[[f64; 3]]| -> Vec<f32> {
        vectors.as_flattened().iter().map(|&x| x as f32).collect()
    };
    let attributes = &primitive["attributes"];
    assert_eq!(
        parts.floats(&attributes["POSITION"]),
        stored(&mesh.vertices)
    );
    assert_eq!(parts.floats(&attributes["NORMAL"]), stored(&mesh.normals));
    let indices: Vec<u32> = parts
        .words(&primitive["indices"])
        .into_iter()
        .map(u32::from_le_bytes)
        .collect();
    assert_eq!(indices, mesh.triangles.as_flattened());
    // Without a material it would be metal, which is dark where there is nothing to mirror.
    let material = primitive["material"].as_u64().unwrap() as usize;
    let surface = &document["materials"][material]["pbrMetallicRoughness"];
    assert_eq!(surface["metallicFactor"], 0.0);
}

#[test]
fn bounds_are_those_of_the_stored_numbers() {
    for mesh in [sphere(0.1, 2), moved(sphere(0.1, 2), [1e6, 0.3, -2e6])] {
        let parts = take_apart(&written(&mesh, Format::Glb));
        let accessor = &parts.document["accessors"][0];
        let positions = parts.floats(&0.into());
        for axis in 0..3 {
            let values = positions.iter().skip(axis).step_by(3);
            let min = values.clone().fold(f32::INFINITY, |a, &b| a.min(b));
            let max = values.fold(f32::NEG_INFINITY, |a, &b| a.max(b));
            assert_eq!(accessor["min"][axis], f64::from(min));
            assert_eq!(accessor["max"][axis], f64::from(max));
        }
    }
}

#[test]
fn far_from_the_origin_the_node_is_moved() {
    let offset = [1e6, -2e6, 3e5];
    let mesh = moved(sphere(0.1, 2), offset);
    let parts = take_apart(&written(&mesh, Format::Glb));
    let positions = parts.floats(&0.into());
    for (vertex, stored) in mesh.vertices.iter().zip(positions.chunks(3)) {
        for axis in 0..3 {
            let translation = parts.document["nodes"][0]["translation"][axis]
                .as_f64()
                .unwrap();
            let error = translation + f64::from(stored[axis]) - vertex[axis];
            // An f32 of at most 0.1 is rounded by 4e-9, and an f64 of 2e6 by 2e-10.
            assert!(error.abs() < 5e-9);
        }
    }
}

#[test]
fn an_empty_mesh_is_an_empty_document() {
    let parts = take_apart(&written(&TriangleMesh::default(), Format::Glb));
    assert!(parts.binary.is_empty());
    assert!(parts.document.get("meshes").is_none());
}
