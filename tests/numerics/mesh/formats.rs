//! What is written is what is read.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;
use meshway::reconstruction::cloud::{self, Limits};
use meshway::reconstruction::mesh::TriangleMesh;
use meshway::reconstruction::mesh::read::read;
use meshway::reconstruction::mesh::write::{Format, write};
use meshway::reconstruction::vector::Vec3;

use super::{cube, moved, sphere, tetrahedron};

/// All formats that our reader knows.
pub(crate) const READABLE: [Format; 6] = [
    Format::PlyBinary,
    Format::PlyAscii,
    Format::Obj,
    Format::Stl,
    Format::Off,
    Format::Glb,
];

pub(crate) fn written(mesh: &TriangleMesh, format: Format) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(mesh, format, &mut bytes).unwrap();
    bytes
}

fn as_f32(vectors: &[Vec3]) -> Vec<[f32; 3]> {
    vectors.iter().map(|v| v.map(|x| x as f32)).collect()
}

/// Positions of the corners of all triangles: what is left of a mesh where vertices are not shared.
fn corners(mesh: &TriangleMesh) -> Vec<[Vec3; 3]> {
    (0..mesh.triangles.len()).map(|t| mesh.corners(t)).collect()
}

#[test]
fn every_format_gives_the_positions_back_to_the_last_bit_of_an_f32() {
    let with_normals = sphere(0.1, 3);
    let mut without = with_normals.clone();
    without.normals.clear();
    for mesh in [&with_normals, &without] {
        for format in READABLE {
            let again = read(&written(mesh, format), None).unwrap();
            if format == Format::Stl {
                // Merged again, in another order.
                assert_eq!(again.vertices.len(), mesh.vertices.len());
                let (found, expected) = (corners(&again), corners(mesh));
                assert_eq!(
                    as_f32(found.as_flattened()),
                    as_f32(expected.as_flattened())
                );
            } else {
                assert_eq!(
                    as_f32(&again.vertices),
                    as_f32(&mesh.vertices),
                    "{format:?}"
                );
                // OFF that has normals is another format to many readers.
                let normals = if format == Format::Off {
                    Vec::new()
                } else {
                    as_f32(&mesh.normals)
                };
                assert_eq!(as_f32(&again.normals), normals, "{format:?}");
                assert_eq!(again.triangles, mesh.triangles);
            }
        }
    }
}

#[test]
fn far_from_the_origin_and_in_the_small_no_digit_is_lost() {
    let far = moved(sphere(0.1, 2), [1e6, -2e6, 3e5]);
    let tiny = sphere(1e-60, 2);
    // These have numbers of 32 bits.
    let short = [Format::Stl, Format::Glb];
    for format in READABLE.into_iter().filter(|f| !short.contains(f)) {
        for mesh in [&far, &tiny] {
            let again = read(&written(mesh, format), None).unwrap();
            assert_eq!(again.vertices, mesh.vertices, "{format:?}");
        }
    }
}

#[test]
fn tiny_and_huge_numbers_survive_as_text() {
    let mut mesh = tetrahedron();
    // Smallest normal f32, largest coordinate that is accepted, and one without a short decimal.
    mesh.vertices[0] = [f64::from(f32::MIN_POSITIVE), -1e15, 1.0 / 3.0];
    // GLB keeps them by their distance from the middle.
    for format in READABLE.into_iter().filter(|&f| f != Format::Glb) {
        let again = read(&written(&mesh, format), None).unwrap();
        assert!(as_f32(&again.vertices).contains(&as_f32(&mesh.vertices)[0]));
    }
}

#[test]
fn ply_keeps_the_distances_to_the_points_and_other_formats_do_without() {
    let near = sphere(0.1, 2);
    let mut bare = near.clone();
    bare.normals.clear();
    let far = moved(near.clone(), [1e6, -2e6, 3e5]);
    for without in [near, bare, far] {
        let mut mesh = without.clone();
        mesh.distance_to_points = (0..mesh.vertices.len()).map(|i| i as f64 / 3.0).collect();
        for format in READABLE {
            let mut bytes = Vec::new();
            let done = write(&mesh, format, &mut bytes);
            if format == Format::Stl && done.is_err() {
                // Its 32 bits cannot tell the vertices apart so far from the origin.
                assert!(mesh.vertices[0][0] > 1e5);
                continue;
            }
            done.unwrap();
            if !matches!(format, Format::PlyBinary | Format::PlyAscii) {
                assert_eq!(bytes, written(&without, format), "{format:?}");
                continue;
            }
            let again = read(&bytes, None).unwrap();
            assert_eq!(as_f32(&again.vertices), as_f32(&mesh.vertices));
            assert_eq!(as_f32(&again.normals), as_f32(&mesh.normals));
            assert_eq!(again.triangles, mesh.triangles);
            let short = |mesh: &TriangleMesh| -> Vec<f32> {
                mesh.distance_to_points.iter().map(|d| *d as f32).collect()
            };
            assert_eq!(short(&again), short(&mesh), "{format:?}");
        }
        // As clouds, too, such files can be read.
        let cloud = written(&mesh, Format::PlyBinary);
        let (cloud, _) = cloud::read(&cloud, None, &Limits::default()).unwrap();
        assert_eq!(as_f32(&cloud.points), as_f32(&mesh.vertices));
    }
}

#[test]
fn a_cloud_is_a_mesh_without_triangles() {
    let mut cloud = cube();
    cloud.triangles.clear();
    for format in [
        Format::PlyBinary,
        Format::PlyAscii,
        Format::Obj,
        Format::Off,
    ] {
        assert_eq!(read(&written(&cloud, format), None).unwrap(), cloud);
    }
}

#[test]
#[expect(clippy::float_cmp, reason = "read from exact decimals")]
fn ply_of_other_programs_is_read() {
    let big_endian = [
        b"ply\r\nformat binary_big_endian 1.0\r\nelement vertex 4\r\nproperty double x\r\n\
          property uchar red\r\nproperty short z\r\nproperty float y\r\nelement face 1\r\n\
          property uchar flag\r\nproperty list ushort uint vertex_index\r\n\
          property list uchar float texcoord\r\nend_header\r\n"
            .to_vec(),
        [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
            .iter()
            .flat_map(|&[x, y]: &[f64; 2]| {
                let (z, red) = (5i16.to_be_bytes(), 9);
                let mut record = x.to_be_bytes().to_vec();
                record.push(red);
                record.extend(z);
                record.extend((y as f32).to_be_bytes());
                record
            })
            .collect(),
        vec![
            7, 0, 4, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 1, 0, 0, 0, 0,
        ],
    ]
    .concat();
    let mesh = read(&big_endian, None).unwrap();
    assert_eq!(mesh.vertices[2], [1.0, 1.0, 5.0]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);

    let text = b"ply\nformat ascii 1.0\ncomment caf\xe9\nelement vertex 3\nproperty float x\n\
        property float y\nproperty float z\nelement edge 1\nproperty int a\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n1E-5 0 0\n\n.5 1. 0\n0 0 1\n4\n3 0 1 2";
    let mesh = read(text, None).unwrap();
    assert_eq!(mesh.vertices[..2], [[1e-5, 0.0, 0.0], [0.5, 1.0, 0.0]]);
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
}

#[test]
fn obj_of_other_programs_is_read() {
    let text = "# a comment\nmtllib a.mtl\nv 0 0 0 1 0 0\nv 1 0 0\nvt 0 0\nv 1 1 0 # here too\n\
                v 0 1 0\nvn 0 0 1\ns off\nf 1/1/1 2/1/1 3/1/1 -1/1/1\nf -4 -3 -2\n";
    let mesh = read(text.as_bytes(), Some("A.OBJ")).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    assert!(mesh.normals.is_empty(), "one normal is not one a vertex");
}

#[test]
fn off_of_other_programs_is_read() {
    let text = "COFF 4 1 0\n0 0 0 255 0 0 255\n1 0 0 1 1 1 1\n\n# half way\n1 1 0\n0 1 0\n\
                4 0 1 2 3 0.5 0.5 0.5\n";
    let mesh = read(text.as_bytes(), None).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert!(mesh.normals.is_empty());
}

#[test]
fn stl_as_text_is_read_and_merged() {
    let facet = |[a, b, c]: [&str; 3]| {
        format!(
            "facet normal 0 0 0\n outer loop\n  vertex {a}\n  vertex {b}\n  vertex {c}\n endloop\nendfacet\n"
        )
    };
    let text = [
        "solid x\n".to_owned(),
        facet(["0 0 0", "1 0 0", "0 1 0"]),
        facet(["1 0 0", "1 1e0 0", "-0 1 0"]),
        "endsolid x\n".to_owned(),
    ]
    .concat();
    let mesh = read(text.as_bytes(), None).unwrap();
    assert_eq!(mesh.vertices.len(), 4);
    assert_eq!(mesh.triangles, [[0, 1, 2], [1, 3, 2]]);
}

#[test]
fn gzipped_meshes_are_read() {
    let mesh = sphere(1.0, 2);
    for format in READABLE {
        let bytes = written(&mesh, format);
        let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
        packed.write_all(&bytes).unwrap();
        let packed = packed.finish().unwrap();
        assert_eq!(
            read(&packed, None).unwrap(),
            read(&bytes, None).unwrap(),
            "{format:?}"
        );
        let cut = read(&packed[..packed.len() - 9], None).unwrap_err();
        assert_eq!(cut.code(), "unsupported_encoding");
    }
}

#[test]
fn names_and_endings_lead_to_their_format() {
    for format in Format::ALL {
        let name = serde_json::to_value(format).unwrap();
        assert_eq!(name, format.name());
        let expected = match format {
            Format::PlyAscii => Format::PlyBinary,
            other => other,
        };
        assert_eq!(Format::from_extension(format.extension()), Some(expected));
    }
    assert_eq!(Format::from_extension(".PLY"), Some(Format::PlyBinary));
    assert_eq!(Format::from_extension("xyz"), None);
}
