//! Meshes with colours by distance, `?colors=distance`.

use meshway::jobs::{NewMesh, Record, Success};
use meshway::reconstruction::mesh::TriangleMesh;
use meshway::reconstruction::mesh::read::read;
use meshway::reconstruction::mesh::write::{Format, write};
use meshway::reconstruction::space::Space;
use serde_json::{Value, json};

use crate::http::contract::expect_contract;
use crate::http::support::{Service, tetrahedron};

/// A job that has ended with this mesh, whose points support it up to `distance`.
async fn ended(service: &Service, mesh: Vec<u8>, distance: f64) -> String {
    let id = service.submit().await;
    let claim = service.claim().await;
    let success = Success {
        mesh: NewMesh::new(4, 4, mesh),
        report: json!({"mesh": {"closed": true}, "surface": {"support_distance": distance}}),
        model: Vec::new(),
        last: Record::default(),
    };
    service.store().succeed(&claim, success).await.unwrap();
    id
}

/// The tetrahedron of the support, changed.
fn changed(change: impl FnOnce(&mut TriangleMesh)) -> Vec<u8> {
    let mut mesh = read(&tetrahedron(), None).unwrap();
    change(&mut mesh);
    let mut bytes = Vec::new();
    write(&mesh, Format::PlyBinary, &mut bytes).unwrap();
    bytes
}

/// Cividis at the distances of the tetrahedron, 0.5, 0, 0.25 and 2, up to 1.
const COLORS: [[u8; 3]; 4] = [
    [0x7f, 0x81, 0x76],
    [0x00, 0x22, 0x4e],
    [0x44, 0x51, 0x6c],
    [0xfe, 0xe8, 0x38],
];

/// Colours of the vertices of a binary PLY without normals.
fn of_ply(bytes: &[u8]) -> Vec<[u8; 3]> {
    let end = b"end_header\n";
    let body = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    let header = String::from_utf8_lossy(&bytes[..body]);
    assert!(
        header.contains("comment colors: cividis of distance_to_points, 0 to 1\n"),
        "{header}"
    );
    let vertices = bytes[body..].chunks(4 * 4 + 3).take(4);
    vertices.map(|v| v[16..].try_into().unwrap()).collect()
}

/// Colours of the vertices of a GLB, as screens show them.
fn of_glb(bytes: &[u8]) -> Vec<[u8; 3]> {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!(word(8), bytes.len());
    let document: Value = serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap();
    let binary = &bytes[20 + word(12) + 8..];
    let mesh = &document["meshes"][0];
    assert_eq!(mesh["extras"]["colors"]["to"], 1.0, "{document}");
    let number = mesh["primitives"][0]["attributes"]["COLOR_0"].as_u64();
    let accessor = &document["accessors"][number.unwrap() as usize];
    let form = json!({"bufferView": accessor["bufferView"], "componentType": 5123, "normalized": true,
                      "count": 4, "type": "VEC4"});
    assert_eq!(*accessor, form);
    let view = &document["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    assert_eq!(view["byteLength"], 4 * 8);
    let start = view["byteOffset"].as_u64().unwrap() as usize;
    let channel = |bytes: &[u8]| {
        let light = f64::from(u16::from_le_bytes(bytes.try_into().unwrap())) / 65535.0;
        // IEC 61966-2-1.
        let shown = if light <= 0.003_130_8 {
            12.92 * light
        } else {
            1.055 * light.powf(1.0 / 2.4) - 0.055
        };
        (255.0 * shown).round() as u8
    };
    let vertices = binary[start..start + 4 * 8].chunks(8);
    vertices
        .map(|v| [0, 2, 4].map(|at| channel(&v[at..at + 2])))
        .collect()
}

#[tokio::test]
async fn colours_are_given_where_they_are_asked_for_and_nothing_else_changes() {
    let service = Service::new().await;
    let id = ended(&service, tetrahedron(), 1.0).await;
    for (ending, colors_of) in [("ply", of_ply as fn(&[u8]) -> _), ("glb", of_glb)] {
        let path = format!("/v1/jobs/{id}/mesh.{ending}");
        let plain = service.get(&path).await.expect(200);
        let coloured = service.get(&format!("{path}?colors=distance")).await;
        expect_contract(&coloured, "get", "/v1/jobs/{id}/mesh.{format}");
        let coloured = coloured.expect(200);
        let [found, expected] = [colors_of(&coloured.body), COLORS.to_vec()];
        for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
            // Shown by sixteen bits of light it may be rounded the other way.
            assert!(
                found.abs_diff(*expected) <= 1,
                "{ending}: {found} {expected}"
            );
        }
        assert_eq!(
            read(&coloured.body, None).unwrap(),
            read(&plain.body, None).unwrap()
        );
        assert_ne!(coloured.header("etag"), plain.header("etag"));
        let again = service.get(&format!("{path}?colors=distance")).await;
        assert_eq!(again.header("etag"), coloured.header("etag"));
        for same in ["", "?colors=none"] {
            let answer = service.get(&format!("{path}{same}")).await.expect(200);
            assert_eq!(answer.body, plain.body, "{ending}{same}");
        }
    }
    let negotiated = service
        .get(&format!("/v1/jobs/{id}/mesh?colors=distance"))
        .await;
    expect_contract(&negotiated, "get", "/v1/jobs/{id}/mesh");
    assert_eq!(of_ply(&negotiated.expect(200).body), COLORS);
    // The colours go with the job.
    assert!(!service.files("cache").is_empty());
    service.delete(&format!("/v1/jobs/{id}")).await.expect(204);
    assert_eq!(service.files("cache"), Vec::<String>::new());
}

#[tokio::test]
async fn two_jobs_with_one_mesh_keep_their_scales() {
    let service = Service::new().await;
    let near = ended(&service, tetrahedron(), 1.0).await;
    let far = ended(&service, tetrahedron(), 4.0).await;
    let mut bodies = Vec::new();
    for id in [&near, &far, &near] {
        let path = format!("/v1/jobs/{id}/mesh.ply?colors=distance");
        bodies.push(service.get(&path).await.expect(200).body);
    }
    assert_eq!(bodies[0], bodies[2]);
    assert!(String::from_utf8_lossy(&bodies[1]).contains("distance_to_points, 0 to 4\n"));
}

#[tokio::test]
async fn a_turned_mesh_has_its_colours_too() {
    let service = Service::new().await;
    let of_a_patient = changed(|mesh| mesh.space = Space::PATIENT);
    let id = ended(&service, of_a_patient, 1.0).await;
    let path = format!("/v1/jobs/{id}/mesh.ply?space=ras&colors=distance");
    let turned = service.get(&path).await.expect(200);
    assert_eq!(of_ply(&turned.body), COLORS);
    let mesh = read(&turned.body, None).unwrap();
    assert!(mesh.vertices.contains(&[-1.0, 0.0, 0.0]));
}

#[tokio::test]
async fn what_has_no_colours_says_why() {
    let service = Service::new().await;
    let id = ended(&service, tetrahedron(), 1.0).await;
    let running = service.submit().await;
    let claim = service.claim().await;
    let snapshot = service
        .store()
        .put_snapshot(&claim, 5, NewMesh::new(4, 4, tetrahedron()));
    snapshot.await.unwrap();
    let early = format!("/v1/jobs/{running}/snapshots/5.ply");
    assert_eq!(service.get(&early).await.expect(200).body, tetrahedron());
    for (path, said) in [
        (
            format!("/v1/jobs/{id}/mesh.obj?colors=distance"),
            "only ply and glb",
        ),
        (
            format!("/v1/jobs/{id}/mesh.ply?colors=rainbow"),
            "none, distance",
        ),
        (format!("{early}?colors=distance"), "support_distance"),
    ] {
        let problem = service.get(&path).await;
        expect_contract(&problem, "get", "/v1/jobs/{id}/mesh.{format}");
        let problem = problem.expect_problem(422, "request_invalid");
        assert_eq!(problem["errors"][0]["pointer"], "/colors", "{problem}");
        assert!(
            problem["detail"].as_str().unwrap().contains(said),
            "{problem}"
        );
    }
    let without = changed(|mesh| mesh.distance_to_points.clear());
    drop(claim);
    let other = Service::new().await;
    let id = ended(&other, without, 1.0).await;
    let refused = other
        .get(&format!("/v1/jobs/{id}/mesh.glb?colors=distance"))
        .await;
    expect_contract(&refused, "get", "/v1/jobs/{id}/mesh.{format}");
    let refused = refused.expect_problem(406, "not_acceptable");
    assert!(
        refused["detail"].as_str().unwrap().contains("distances"),
        "{refused}"
    );
}
