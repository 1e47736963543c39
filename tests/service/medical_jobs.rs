//! Label maps, segments and contours, from their upload over the choice of a part to a mesh.

use std::fs;
use std::path::{Path, PathBuf};

use meshway::reconstruction::mesh::read;
use serde_json::{Value, json};

use crate::http::contract::expect_named;
use crate::http::support::gzip;
use crate::server::{Folder, Server};
use crate::wire::{Answer, Connection};

const SIZE: usize = 24;

/// A NIfTI file with two labels: a ball of 8 mm as 1, a ball of 4 mm as 5, 20 mm to the left of it.
fn label_map(sform_code: i16) -> Vec<u8> {
    let mut header = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348_i32.to_le_bytes());
    let size = [3, 2 * SIZE as i16, SIZE as i16, SIZE as i16, 1, 1, 1, 1];
    put(40, &size.map(i16::to_le_bytes).concat());
    put(70, &2_i16.to_le_bytes());
    put(76, &[1.0_f32; 8].map(f32::to_le_bytes).concat());
    put(108, &352_f32.to_le_bytes());
    put(254, &sform_code.to_le_bytes());
    // From index to RAS: the first axis leads to the left, 10 mm from the middle.
    let rows = [
        -1.0_f32, 0.0, 0.0, 10.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0,
    ];
    put(280, &rows.map(f32::to_le_bytes).concat());
    put(344, b"n+1\0");
    for index in 0..2 * SIZE * SIZE * SIZE {
        let place = [
            index % (2 * SIZE),
            index / (2 * SIZE) % SIZE,
            index / (2 * SIZE * SIZE),
        ];
        let near = |centre: f64, radius: f64| {
            let away = [centre, 12.0, 12.0]
                .into_iter()
                .zip(place)
                .map(|(c, i)| (i as f64 - c).powi(2));
            away.sum::<f64>() < radius * radius
        };
        header.push(u8::from(near(12.0, 8.0)) + 5 * u8::from(near(32.0, 4.0)));
    }
    header
}

async fn post(server: &Server, path: &str, headers: &str, body: &[u8]) -> Answer {
    let mut connection = Connection::open(server.address()).await.unwrap();
    let request = format!("POST {path}");
    connection.ask(&request, headers, &[body]).await.unwrap()
}

#[tokio::test]
async fn a_label_is_chosen_and_becomes_a_mesh_in_the_patient() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let file = gzip(&label_map(1));
    let answer = post(&server, "/v1/clouds", "", &file).await;
    assert_eq!(answer.status, 201, "{:?}", answer.json());
    let cloud = answer.json();
    expect_named("Cloud", &cloud);
    assert_eq!(cloud["format"], "nifti");
    let segmentation = &cloud["segmentation"];
    assert_eq!(segmentation["kind"], "labels");
    assert_eq!(segmentation["orientation"], "LAS");
    assert_eq!(segmentation["size"], json!([48, 24, 24]));
    assert_eq!(segmentation["items"][0]["number"], 1);
    assert_eq!(segmentation["items"][1]["number"], 5);

    let mut connection = Connection::open(server.address()).await.unwrap();
    let settings = json!({"training": {"max_evaluations": 60}, "surface": {"resolution": 32}});
    let mut request = json!({"cloud_id": cloud["id"], "preset": "fast", "settings": settings});
    let refused = connection.post("/v1/jobs", "", &request).await.unwrap();
    assert_eq!(refused.status, 422);
    let problem = refused.json();
    assert_eq!(problem["code"], "source_missing");
    assert_eq!(problem["choices"], segmentation["items"]);
    request["source"] = json!({"label": 2});
    let refused = connection.post("/v1/jobs", "", &request).await.unwrap();
    assert_eq!(refused.json()["code"], "source_unknown");

    request["source"] = json!({"label": 5});
    let wait = "Prefer: wait=120\r\n";
    let job = connection
        .post("/v1/jobs", wait, &request)
        .await
        .unwrap()
        .json();
    assert_eq!(job["status"], "succeeded", "{job}");
    expect_named("Job", &job);
    assert_eq!(job["source"], json!({"label": 5}));
    let path = format!("GET {}.ply", job["links"]["mesh"].as_str().unwrap());
    let mesh = connection.ask(&path, "", &[]).await.unwrap();
    let mesh = read::read(&mesh.body, None).unwrap();
    // LPS: x grows to the left with the index, and y, to the back, falls with it.
    let middle = [32.0 - 10.0, -12.0, 12.0];
    for axis in 0..3 {
        let places = mesh.vertices.iter().map(|vertex| vertex[axis]);
        let (least, most) = places.fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
        assert!(
            (f64::midpoint(least, most) - middle[axis]).abs() < 1.0,
            "axis {axis}: {least} {most}"
        );
        assert!(
            (most - least - 8.0).abs() < 2.0,
            "axis {axis}: {least} {most}"
        );
    }
}

#[tokio::test]
async fn what_lies_nowhere_is_taken_only_if_asked() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let file = label_map(0);
    let code = |answer: &Answer| answer.json()["code"].as_str().map(str::to_owned);
    let missing = Some("orientation_missing".to_owned());
    let answer = post(&server, "/v1/clouds", "", &file).await;
    assert_eq!((answer.status, code(&answer)), (422, missing.clone()));
    let answer = post(&server, "/v1/clouds?assume_orientation=true", "", &file).await;
    assert_eq!(answer.status, 201, "{:?}", answer.json());
    let cloud = answer.json();
    assert_eq!(cloud["segmentation"]["assumed_orientation"], true);
    // The file is here, but its reading was not asked for.
    let answer = post(&server, "/v1/clouds", "", &file).await;
    assert_eq!((answer.status, code(&answer)), (422, missing));
    let again = post(&server, "/v1/clouds?assume_orientation=true", "", &file).await;
    assert_eq!((again.status, &again.json()["id"]), (200, &cloud["id"]));
    let query = "/v1/jobs?assume_orientation=true&source=label:1&dry_run=true";
    let answer = post(&server, query, "", &file).await;
    assert_eq!(answer.status, 200, "{:?}", answer.json());
    let answer = post(&server, "/v1/jobs?source=mask", "", &file).await;
    assert_eq!(answer.status, 422);
}

#[tokio::test]
async fn points_have_no_parts() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let points: String = crate::http::support::sphere_xyz(100, 0.0);
    let answer = post(&server, "/v1/clouds", "", points.as_bytes()).await;
    let cloud = answer.json();
    assert_eq!(cloud["segmentation"], Value::Null);
    let request = json!({"cloud_id": cloud["id"], "preset": "fast", "source": {"label": 1}});
    let mut connection = Connection::open(server.address()).await.unwrap();
    let refused = connection.post("/v1/jobs", "", &request).await.unwrap();
    assert_eq!(refused.json()["code"], "source_unknown");
}

/// All files below a folder.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let below = paths.flat_map(|path| {
        if path.is_dir() {
            files_below(&path)
        } else {
            vec![path]
        }
    });
    below.collect()
}

#[tokio::test]
async fn a_patient_is_named_in_the_uploaded_file_alone() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let name = b"Zwiebelfisch^Adalberta";
    let mut file = include_bytes!("../numerics/medical/files/bare.dcm").to_vec();
    // The name stands before the regions, as the order of elements wants it.
    let regions = [0x06, 0x30, 0x20, 0x00];
    let at = file.windows(4).position(|tag| tag == regions).unwrap();
    let element = [&[0x10, 0, 0x10, 0, name.len() as u8, 0, 0, 0], &name[..]].concat();
    file.splice(at..at, element);
    let settings = json!({"training": {"max_evaluations": 60}, "surface": {"resolution": 32}});
    let answer = post(&server, "/v1/clouds", "", &file).await;
    assert_eq!(answer.status, 201, "{:?}", answer.json());
    let request = json!({"cloud_id": answer.json()["id"], "preset": "fast", "settings": settings,
        "source": {"roi": "Shell"}});
    let mut connection = Connection::open(server.address()).await.unwrap();
    let wait = "Prefer: wait=120\r\n";
    let job = connection.post("/v1/jobs", wait, &request).await.unwrap();
    assert_eq!(job.json()["status"], "succeeded", "{}", job.json());
    let names = |bytes: &[u8]| bytes.windows(name.len()).any(|part| part == name);
    assert!(!names(job.json().to_string().as_bytes()));
    assert!(!names(server.log().as_bytes()));
    let naming = files_below(folder.path());
    let naming = naming
        .into_iter()
        .filter(|path| names(&fs::read(path).unwrap()));
    let naming: Vec<_> = naming.collect();
    // So it is found where it is.
    assert_eq!(naming.len(), 1, "{naming:?}");
    assert!(
        naming[0].starts_with(folder.path().join("clouds")),
        "{naming:?}"
    );
}
