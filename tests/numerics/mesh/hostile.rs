//! Damaged and malicious files: an error or a sound mesh, never a panic.

use meshway::reconstruction::cloud::Error;
use meshway::reconstruction::mesh::read::read;
use meshway::reconstruction::quality::describe;
use meshway::reconstruction::random::{Purpose, stream};
use proptest::prelude::*;
use rand::RngExt;

use super::formats::{READABLE, written};
use super::sphere;

/// Reads `bytes` under every name; what comes out is sound enough to be described.
fn survives(bytes: &[u8]) {
    for name in [None, Some("mesh.obj")] {
        if let Ok(mesh) = read(bytes, name) {
            let vertices = mesh.vertices.len() as u32;
            assert!(mesh.triangles.iter().flatten().all(|&v| v < vertices));
            assert!(mesh.vertices.iter().flatten().all(|x| x.is_finite()));
            assert!(mesh.normals.is_empty() || mesh.normals.len() == mesh.vertices.len());
            assert!(mesh.area().is_finite());
            let _ = describe(&mesh);
        }
    }
}

#[test]
fn files_cut_anywhere_do_no_harm() {
    for format in READABLE {
        let bytes = written(&sphere(1.0, 0), format);
        for length in 0..bytes.len() {
            survives(&bytes[..length]);
        }
    }
}

#[test]
fn mutated_files_do_no_harm() {
    let mut generator = stream(11, Purpose::Selection);
    for format in READABLE {
        let original = written(&sphere(1.0, 0), format);
        for _ in 0..3_000 {
            let mut bytes = original.clone();
            for _ in 0..generator.random_range(1..4) {
                let at = generator.random_range(0..bytes.len());
                match generator.random_range(0..4) {
                    0 => bytes[at] = generator.random(),
                    1 => bytes.insert(at, b"0-9e.\n /"[generator.random_range(0..8)]),
                    2 => drop(bytes.remove(at)),
                    _ => bytes[at] ^= 1 << generator.random_range(0..8),
                }
            }
            survives(&bytes);
        }
    }
}

proptest! {
    #[test]
    fn any_bytes_do_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        survives(&bytes);
        for magic in ["ply\nformat ascii 1.0\n", "OFF\n", "solid\n", "v "] {
            survives(&[magic.as_bytes(), &bytes].concat());
        }
    }
}

/// The message that `text` is refused with.
fn refusal(text: &str) -> String {
    read(text.as_bytes(), None).unwrap_err().to_string()
}

fn ply(vertices: &str, body: &str) -> String {
    format!(
        "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
         property float z\nelement face 1\nproperty list uchar int vertex_indices\n\
         end_header\n{body}"
    )
}

#[test]
fn counts_are_not_believed() {
    let Err(Error::Truncated {
        declared, found, ..
    }) = read(ply("9999999999", "0 0 0\n").as_bytes(), None)
    else {
        panic!("one row is not so many");
    };
    assert_eq!((declared, found), (9_999_999_999, 1));
    let beyond = refusal(&ply("99999999999999999999", "0 0 0\n"));
    assert!(beyond.starts_with("header, line 3:"), "{beyond}");
    let many = u64::MAX.to_string();
    for encoding in ["ascii", "binary_little_endian"] {
        let text = format!("ply\nformat {encoding} 1.0\nelement a 9999999999\nend_header\n");
        assert!(refusal(&text).contains("no element \"vertex\""));
    }
    assert!(refusal(&format!("OFF\n{many} 0 0\n0 0 0\n")).contains("cut short"));
    let list = format!("OFF\n1 1 0\n0 0 0\n{many} 0 0 0\n");
    assert!(refusal(&list).contains("missing"));
}

#[test]
fn wrong_indices_name_their_face() {
    let rows = "0 0 0\n1 0 0\n0 1 0\n";
    for text in [
        ply("3", &format!("{rows}3 0 1 3\n")),
        ply("3", &format!("{rows}3 0 1 -1\n")),
        ply("3", &format!("{rows}3 0 1 0.5\n")),
        format!("OFF\n3 1 0\n{rows}3 0 1 3\n"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n".to_owned(),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n".to_owned(),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n".to_owned(),
    ] {
        let message = refusal(&text);
        assert!(message.contains("face 1 refers to vertex"), "{message}");
    }
    assert!(refusal(&ply("3", &format!("{rows}2 0 1\n"))).contains("fewer than 3"));
}

#[test]
fn bad_numbers_name_their_line() {
    assert_eq!(
        refusal("v 0 0 0\nv 0 abc 0\n"),
        "line 2: expected a number, found \"abc\""
    );
    assert_eq!(
        refusal(&ply("1", "0 0 nan\n")),
        "line 10: coordinate NaN is not finite"
    );
    let huge = read(b"v 1e30 0 0\n", None).unwrap_err();
    assert_eq!(huge.code(), "cloud_too_large");
}

#[test]
fn what_is_no_mesh_is_refused() {
    for (bytes, code) in [
        (b"".as_slice(), "cloud_empty"),
        (b"\x89PNG\r\n\x1a\n", "unsupported_format"),
        (b"1 2 3\n4 5 6\n", "unsupported_format"),
        (b"solid nothing\nendsolid\n", "unsupported_format"),
        (b"OFF\n0 0 0\n", "cloud_empty"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
            "cloud_no_coordinates",
        ),
        (b"ply\nformat ascii 1.0\n", "cloud_header"),
    ] {
        assert_eq!(read(bytes, None).unwrap_err().code(), code);
    }
}
