//! Frames of meshes on the wire, and what is made for clinics: DICOM, masks.

use std::io::Read;

use flate2::read::GzDecoder;
use meshway::jobs::{NewMesh, Record, Success};
use meshway::reconstruction::mesh::read::read;
use meshway::reconstruction::mesh::write::{Format, write};
use meshway::reconstruction::space::{Frame, Space};
use serde_json::{Value, json};

use crate::http::contract::expect_contract;
use crate::http::support::{Service, sphere_xyz, tetrahedron, upload_request};

/// The tetrahedron of the support as a patient's.
fn of_a_patient() -> Vec<u8> {
    let mut mesh = read(&tetrahedron(), None).unwrap();
    mesh.space = Space::PATIENT;
    let mut bytes = Vec::new();
    write(&mesh, Format::PlyBinary, &mut bytes).unwrap();
    bytes
}

/// A job that has ended with this mesh and report.
async fn ended(service: &Service, mesh: Vec<u8>, report: Value) -> String {
    let id = service.submit().await;
    let claim = service.claim().await;
    let success = Success {
        mesh: NewMesh::new(4, 4, mesh),
        report,
        model: Vec::new(),
        last: Record::default(),
    };
    service.store().succeed(&claim, success).await.unwrap();
    id
}

fn report() -> Value {
    json!({
        "frame": "lps", "unit": "mm",
        "mesh": {"closed": true, "vertices": 4, "triangles": 4},
        "grid": {
            "size": [4, 3, 2],
            "affine": [[0.2, 0.0, 0.0, -0.1], [0.0, 0.3, 0.0, 0.1], [0.0, 0.0, 0.4, 0.12]],
        },
    })
}

#[tokio::test]
async fn a_mesh_is_given_in_the_frame_that_is_asked_for() {
    let service = Service::new().await;
    let id = ended(&service, of_a_patient(), report()).await;
    let job = service.get(&format!("/v1/jobs/{id}")).await;
    expect_contract(&job, "get", "/v1/jobs/{id}");
    let job = job.json();
    assert_eq!([&job["frame"], &job["unit"]], ["lps", "mm"], "{job}");
    let path = format!("/v1/jobs/{id}/mesh.ply");
    for same in ["", "?space=source", "?space=lps"] {
        let answer = service.get(&format!("{path}{same}")).await.expect(200);
        assert_eq!(answer.body, of_a_patient(), "{same}");
    }
    let expected = read(&of_a_patient(), None).unwrap();
    let expected = expected.in_frame(Frame::Ras).unwrap();
    for ending in ["ply", "obj", "stl", "glb", "vtp", "3mf"] {
        let path = format!("/v1/jobs/{id}/mesh.{ending}");
        let as_is = service.get(&path).await.expect(200);
        let turned = service.get(&format!("{path}?space=ras")).await.expect(200);
        expect_contract(&turned, "get", "/v1/jobs/{id}/mesh.{format}");
        assert_ne!(as_is.header("etag"), turned.header("etag"), "{ending}");
        if !matches!(ending, "vtp" | "3mf") {
            let mesh = read(&turned.body, None).unwrap();
            assert_eq!(mesh.space.frame, Frame::Ras, "{ending}");
            assert!(mesh.vertices.contains(&[-1.0, 0.0, 0.0]), "{ending}");
            assert!((mesh.volume() - expected.volume()).abs() < 1e-9, "{ending}");
        }
        // Asked for the first one again, it is not the other.
        assert_eq!(service.get(&path).await.body, as_is.body);
    }
    let problem = service.get(&format!("{path}?space=mni")).await;
    expect_contract(&problem, "get", "/v1/jobs/{id}/mesh.{format}");
    let problem = problem.expect_problem(422, "request_invalid");
    assert_eq!(problem["errors"][0]["pointer"], "/space");
}

#[tokio::test]
async fn a_mesh_of_unknown_frame_is_given_as_it_is_only() {
    let service = Service::new().await;
    let report = json!({"frame": "unknown", "unit": "unknown", "mesh": {"closed": true}});
    let id = ended(&service, tetrahedron(), report).await;
    let path = format!("/v1/jobs/{id}/mesh");
    let source = service.get(&format!("{path}?space=source")).await;
    assert_eq!(source.expect(200).body, tetrahedron());
    for asked in ["mesh?space=ras", "mesh.stl?space=lps"] {
        let problem = service.get(&format!("/v1/jobs/{id}/{asked}")).await;
        let problem = problem.expect_problem(422, "request_invalid");
        assert_eq!(problem["errors"][0]["pointer"], "/space", "{problem}");
        assert!(problem["detail"].as_str().unwrap().contains("frame"));
    }
    let refused = service.get(&format!("{path}.dcm")).await;
    expect_contract(&refused, "get", "/v1/jobs/{id}/mesh.{format}");
    let refused = refused.expect_problem(406, "not_acceptable");
    let detail = refused["detail"].as_str().unwrap();
    assert!(
        detail.contains("frame") && detail.contains("SPACE=LPS"),
        "{detail}"
    );
    let none = service.get(&format!("/v1/jobs/{id}/mask.nii.gz")).await;
    expect_contract(&none, "get", "/v1/jobs/{id}/mask.nii.gz");
    let none = none.expect_problem(404, "not_found");
    assert!(none["detail"].as_str().unwrap().contains("no label map"));
}

#[tokio::test]
async fn a_cloud_says_its_frame() {
    let service = Service::new().await;
    let plain = service.send(upload_request(sphere_xyz(100, 0.0))).await;
    expect_contract(&plain, "post", "/v1/clouds");
    let plain = plain.json();
    assert_eq!([&plain["frame"], &plain["unit"]], ["unknown", "unknown"]);
    let lines = sphere_xyz(100, 0.0).replace('\n', "\nv ");
    let points = format!("v {}", lines.trim_end_matches("v "));
    let obj = format!("# 3D Slicer output. SPACE=RAS\n{points}");
    let tagged = service.send(upload_request(obj)).await;
    expect_contract(&tagged, "post", "/v1/clouds");
    let tagged = tagged.json();
    assert_eq!(
        [&tagged["frame"], &tagged["unit"]],
        ["ras", "mm"],
        "{tagged}"
    );
}

#[tokio::test]
async fn a_dicom_file_is_the_same_for_a_job_and_another_for_another() {
    let service = Service::new().await;
    let mut kept = report();
    kept["identifiers"] = json!({"patient_name": "Doe^Jane", "study_uid": "1.2.840.99"});
    let id = ended(&service, of_a_patient(), kept).await;
    let other = ended(&service, of_a_patient(), report()).await;
    let path = format!("/v1/jobs/{id}/mesh.dcm");
    let file = service.get(&path).await.expect(200);
    expect_contract(&file, "get", "/v1/jobs/{id}/mesh.{format}");
    assert_eq!(file.header("content-type"), "application/dicom");
    assert_eq!(&file.body[128..132], b"DICM");
    for asked in ["", "?space=lps", "?space=source"] {
        let again = service.get(&format!("{path}{asked}")).await.expect(200);
        assert_eq!(again.header("etag"), file.header("etag"), "{asked}");
        assert_eq!(again.body, file.body);
    }
    let has = |body: &[u8], text: &[u8]| body.windows(text.len()).any(|part| part == text);
    assert!(has(&file.body, b"Doe^Jane") && has(&file.body, b"1.2.840.99"));
    let ras = service.get(&format!("{path}?space=ras")).await;
    let ras = ras.expect_problem(422, "request_invalid");
    assert_eq!(ras["errors"][0]["pointer"], "/space");
    let other = service.get(&format!("/v1/jobs/{other}/mesh.dcm")).await;
    let other = other.expect(200);
    assert_ne!(other.header("etag"), file.header("etag"));
    assert!(!has(&other.body, b"Doe^Jane"));
    service.delete(&format!("/v1/jobs/{id}")).await.expect(204);
    service.get(&path).await.expect_problem(410, "gone");
    let files = service.files("cache");
    assert!(!files.iter().any(|name| name.contains(&id)), "{files:?}");
}

#[tokio::test]
async fn a_mask_lies_on_the_voxels_of_the_label_map() {
    let service = Service::new().await;
    let id = ended(&service, of_a_patient(), report()).await;
    let path = format!("/v1/jobs/{id}/mask.nii.gz");
    let link = service.get(&format!("/v1/jobs/{id}")).await.json()["links"]["mask"].clone();
    assert_eq!(link, path);
    let file = service.get(&path).await.expect(200);
    expect_contract(&file, "get", "/v1/jobs/{id}/mask.nii.gz");
    assert_eq!(service.get(&path).await.header("etag"), file.header("etag"));
    let mut nifti = Vec::new();
    GzDecoder::new(file.body.as_slice())
        .read_to_end(&mut nifti)
        .unwrap();
    assert_eq!(nifti.len(), 352 + 4 * 3 * 2);
    for (voxel, &found) in nifti[352..].iter().enumerate() {
        let [i, j, k] = [voxel % 4, voxel / 4 % 3, voxel / 12].map(|i| i as f64);
        let [x, y, z] = [0.2 * i - 0.1, 0.3 * j + 0.1, 0.4 * k + 0.12];
        let inside = x > 0.0 && y > 0.0 && z > 0.0 && x + y + z < 1.0;
        assert_eq!(found, u8::from(inside), "{x} {y} {z}");
    }
    let mut open = report();
    open["mesh"]["closed"] = json!(false);
    let id = ended(&service, of_a_patient(), open).await;
    let problem = service.get(&format!("/v1/jobs/{id}/mask.nii.gz")).await;
    let problem = problem.expect_problem(404, "not_found");
    assert!(problem["detail"].as_str().unwrap().contains("closed"));
}
