//! Frames and units through every format: a left hand stays a left hand.

use meshway::reconstruction::cloud::{self, Limits};
use meshway::reconstruction::mesh::TriangleMesh;
use meshway::reconstruction::mesh::read::read;
use meshway::reconstruction::mesh::write::Format;
use meshway::reconstruction::space::{Frame, Space, Unit};
use meshway::reconstruction::vector::{Vec3, cross, dot, sub};

use super::formats::{READABLE, written};
use super::glb::take_apart;
use super::{sphere, tetrahedron};

/// A tetrahedron whose corners lie 2 to the left, 3 to the back and 5 to the head of the first: no rotation makes
/// its mirror image of it.
pub(super) fn hand(space: Space) -> TriangleMesh {
    let mut mesh = tetrahedron();
    mesh.vertices = vec![
        [10.0, 20.0, 30.0],
        [12.0, 20.0, 30.0],
        [10.0, 23.0, 30.0],
        [10.0, 20.0, 35.0],
    ];
    mesh.space = space;
    mesh
}

/// What the corners of the hand are in RAS.
const TURNED: [Vec3; 4] = [
    [-10.0, -20.0, 30.0],
    [-12.0, -20.0, 30.0],
    [-10.0, -23.0, 30.0],
    [-10.0, -20.0, 35.0],
];

/// Corner by corner, so that shared vertices and their order make no difference.
fn corners(vertices: &[Vec3], triangles: &[[u32; 3]]) -> Vec<[Vec3; 3]> {
    let corner = |v: u32| vertices[v as usize];
    triangles.iter().map(|t| t.map(corner)).collect()
}

fn volume(corners: &[[Vec3; 3]]) -> f64 {
    let sixth = |[a, b, c]: &[Vec3; 3]| dot(*a, cross(*b, *c)) / 6.0;
    corners.iter().map(sixth).sum()
}

#[test]
fn frames_are_written_read_and_turned_in_every_format() {
    let lps = hand(Space::PATIENT);
    let ras = lps.clone().in_frame(Frame::Ras).unwrap();
    assert_eq!(ras.vertices, TURNED);
    assert_eq!(ras.clone().in_frame(Frame::Lps).unwrap(), lps);
    for mesh in [&lps, &ras] {
        for format in READABLE {
            let again = read(&written(mesh, format), None).unwrap();
            let found = corners(&again.vertices, &again.triangles);
            assert_eq!(
                found,
                corners(&mesh.vertices, &mesh.triangles),
                "{format:?}"
            );
            assert!((volume(&found) - 5.0).abs() < 1e-12, "{format:?}");
            // OFF has no place for it.
            let expected = match format {
                Format::Off => Space::default(),
                _ => mesh.space,
            };
            assert_eq!(again.space, expected, "{format:?}");
        }
    }
}

#[test]
fn clouds_get_their_frame_from_the_same_tags() {
    let mesh = hand(Space {
        frame: Frame::Ras,
        unit: Unit::Metre,
    });
    for format in [
        Format::PlyBinary,
        Format::PlyAscii,
        Format::Obj,
        Format::Stl,
    ] {
        let (cloud, _) = cloud::read(&written(&mesh, format), None, &Limits::default()).unwrap();
        assert_eq!(cloud.space, mesh.space, "{format:?}");
    }
    let text = "solid 3D Slicer output. SPACE=LPS\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\n\
                vertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
    let (cloud, _) = cloud::read(text.as_bytes(), None, &Limits::default()).unwrap();
    assert_eq!(cloud.space, Space::PATIENT);
    let (mut whole, _) = cloud::read(b"1 2 3\n", Some("a.xyz"), &Limits::default()).unwrap();
    assert_eq!(whole.space, Space::default());
    // A cloud is turned into the frame of the one that it is added to.
    whole.space = mesh.space;
    whole.append(cloud);
    assert_eq!(
        whole.points,
        [
            [1.0, 2.0, 3.0],
            [0.0; 3],
            [-1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0]
        ]
    );
}

#[test]
fn a_mesh_of_unknown_frame_carries_no_tag() {
    let mesh = sphere(2.0, 1);
    for format in Format::ALL.into_iter().filter(|&f| f != Format::Dicom) {
        let bytes = written(&mesh, format);
        let text = String::from_utf8_lossy(&bytes);
        assert!(
            !text.contains("SPACE") && !text.contains("unit="),
            "{format:?}"
        );
        assert!(!text.contains("matrix"), "{format:?}");
    }
    let stl = written(&mesh, Format::Stl);
    assert_eq!(&stl[..80], format!("{:80}", "Meshway").as_bytes());
    let stl = written(&hand(Space::PATIENT), Format::Stl);
    let title = format!("{:80}", "Meshway SPACE=LPS unit=mm");
    assert_eq!(&stl[..80], title.as_bytes());
    let ply = written(&hand(Space::PATIENT), Format::PlyBinary);
    let text = String::from_utf8_lossy(&ply);
    assert!(
        text.contains("comment Meshway\ncomment SPACE=LPS\ncomment unit=mm\nelement vertex 4\n"),
        "{text}"
    );
    let obj = written(&hand(Space::PATIENT), Format::Obj);
    assert!(obj.starts_with(b"# Meshway\n# SPACE=LPS\n# unit=mm\nv 10 20 30\n"));
}

#[test]
fn a_glb_stands_upright_in_metres() {
    let lps = hand(Space::PATIENT);
    let mut far = lps.clone();
    for vertex in &mut far.vertices {
        *vertex = vertex.map(|v| v + 1e9);
    }
    for lps in [lps, far] {
        let ras = lps.clone().in_frame(Frame::Ras).unwrap();
        // To the left, to the head, to the front.
        let expected: Vec<Vec3> = lps
            .vertices
            .iter()
            .map(|[x, y, z]| [x / 1e3, z / 1e3, -y / 1e3])
            .collect();
        for mesh in [&lps, &ras] {
            let parts = take_apart(&written(mesh, Format::Glb));
            let node = &parts.document["nodes"][0];
            assert!(node.get("translation").is_none());
            let matrix: Vec<f64> = serde_json::from_value(node["matrix"].clone()).unwrap();
            let stored = parts
                .floats(&parts.document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]);
            let placed = stored.as_chunks::<3>().0.iter().map(|point| -> Vec3 {
                let [x, y, z] = point.map(f64::from);
                std::array::from_fn(|row| {
                    matrix[row] * x + matrix[4 + row] * y + matrix[8 + row] * z + matrix[12 + row]
                })
            });
            for (found, expected) in placed.zip(&expected) {
                let off = sub(found, *expected);
                let scale = expected[0].abs();
                assert!(
                    dot(off, off).sqrt() < 1e-6 * scale,
                    "{found:?} {expected:?}"
                );
            }
            let again = read(&written(mesh, Format::Glb), None).unwrap();
            assert_eq!(
                (again.vertices, again.space),
                (mesh.vertices.clone(), mesh.space)
            );
        }
    }
}
