//! Label maps, segments and contours, from their upload over the choice of a part to a mesh.

use std::fs;
use std::path::{Path, PathBuf};

use meshway::reconstruction::mesh::read;
use serde_json::{Value, json};

use crate::http::contract::expect_named;
use crate::http::support::gzip;
use crate::server::{Folder, PATIENCE, Server, until};
use crate::wire::{Answer, Connection};

const SIZE: usize = 24;

/// A NIfTI file with two labels: a ball of 8 mm as 1, a ball of 4 mm as 5, 20 mm to the left of it.
pub(crate) fn label_map(sform_code: i16) -> Vec<u8> {
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
    let refused = post(&server, "/v1/jobs", "", &file).await;
    assert_eq!(refused.status, 422, "{:?}", refused.json());
    let mut connection = Connection::open(server.address()).await.unwrap();
    let clouds = connection.ask("GET /v1/clouds", "", &[]).await.unwrap();
    assert!(!clouds.json().to_string().contains("nifti"), "it stays");
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
async fn three_labels_become_three_meshes_in_one_batch() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    // A third label beside the two: a slab of 4 x 24 x 24 mm at the end of the first axis.
    let mut file = label_map(1);
    for (index, voxel) in file[352..].iter_mut().enumerate() {
        if index % (2 * SIZE) >= 2 * SIZE - 6 && index % (2 * SIZE) < 2 * SIZE - 2 {
            *voxel = 9;
        }
    }
    let cloud = post(&server, "/v1/clouds", "", &gzip(&file)).await.json();
    let settings = json!({"training": {"max_evaluations": 60}, "surface": {"resolution": 32}});
    let request = json!({"clouds": [cloud["id"]], "preset": "fast", "settings": settings,
        "source": "label:all", "labels": {"study": "x"}});
    let mut connection = Connection::open(server.address()).await.unwrap();
    let mut some = request.clone();
    some["source"] = json!("label:1,7");
    let refused = connection.post("/v1/batches", "", &some).await.unwrap();
    assert_eq!(refused.json()["code"], "source_unknown");
    assert_eq!(refused.json()["choices"], cloud["segmentation"]["items"]);
    let wait = "Prefer: wait=60\r\n";
    let made = connection
        .post("/v1/batches", wait, &request)
        .await
        .unwrap();
    let mut batch = made.json();
    expect_named("Batch", &batch);
    let own = format!("GET {}", batch["links"]["self"].as_str().unwrap());
    let mut progress = 0.0;
    while batch["status"] != "ended" {
        tokio::time::sleep(std::time::Duration::from_millis(100)).await;
        batch = connection.ask(&own, "", &[]).await.unwrap().json();
        let now = batch["progress"].as_f64().unwrap();
        assert!(now >= progress, "{now} after {progress}");
        progress = now;
    }
    assert_eq!(batch["counts"]["succeeded"], 3, "{batch}");
    let jobs = batch["jobs"].as_array().unwrap();
    let sources: Vec<_> = jobs.iter().map(|job| job["source"].clone()).collect();
    let labels = [1, 5, 9].map(|label| json!({"label": label}));
    assert_eq!(sources, labels);
    // Along the first axis, from the middle of the file: where each part is, and how wide.
    for (job, [from, to]) in jobs.iter().zip([[4.0, 20.0], [28.0, 36.0], [42.0, 46.0]]) {
        let path = format!("GET {}/mesh.ply", job["link"].as_str().unwrap());
        let mesh = connection.ask(&path, "", &[]).await.unwrap();
        let mesh = read::read(&mesh.body, None).unwrap();
        let places = mesh.vertices.iter().map(|vertex| vertex[0] + 10.0);
        let (least, most) = places.fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
        assert!(
            (least - from).abs() < 1.5 && (most - to).abs() < 1.5,
            "{}: {least} {most}",
            job["source"]
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

const NAME: &[u8] = b"Zwiebelfisch^Adalberta";

/// A structure set with the name of a patient.
pub(crate) fn of_a_patient() -> Vec<u8> {
    let mut file = include_bytes!("../numerics/medical/files/bare.dcm").to_vec();
    // The name stands before the regions, as the order of elements wants it.
    let regions = [0x06, 0x30, 0x20, 0x00];
    let at = file.windows(4).position(|tag| tag == regions).unwrap();
    let element = [&[0x10, 0, 0x10, 0, NAME.len() as u8, 0, 0, 0], NAME].concat();
    file.splice(at..at, element);
    file
}

fn names(bytes: &[u8]) -> bool {
    bytes.windows(NAME.len()).any(|part| part == NAME)
}

/// Files below a folder that name the patient.
fn naming(folder: &Folder) -> Vec<PathBuf> {
    let files = files_below(folder.path()).into_iter();
    files
        .filter(|path| names(&fs::read(path).unwrap_or_default()))
        .collect()
}

#[tokio::test]
async fn a_patient_is_taken_over_if_asked_and_erased_with_the_job() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let settings = json!({"training": {"max_evaluations": 60}, "surface": {"resolution": 32}});
    let file = of_a_patient();
    let mut connection = Connection::open(server.address()).await.unwrap();
    let mut run = async |upload: &str| {
        let cloud = post(&server, upload, "", &file).await.json();
        let request = json!({"cloud_id": cloud["id"], "preset": "fast", "settings": settings,
            "source": {"roi": "Shell"}});
        let wait = "Prefer: wait=120\r\n";
        let job = connection.post("/v1/jobs", wait, &request).await.unwrap();
        let job = job.json();
        assert_eq!(job["status"], "succeeded", "{job}");
        let own = job["links"]["self"].as_str().unwrap().to_owned();
        let mesh = format!("GET {own}/mesh.dcm");
        let mesh = connection.ask(&mesh, "", &[]).await.unwrap();
        assert_eq!(mesh.status, 200);
        (cloud, own, names(&mesh.body))
    };
    let (cloud, _, named) = run("/v1/clouds").await;
    assert_eq!((named, &cloud["keeps_identifiers"]), (false, &json!(false)));
    assert!(naming(&folder).is_empty(), "{:?}", naming(&folder));
    let refused = post(&server, "/v1/clouds?keep=all", "", &file).await;
    assert_eq!(refused.json()["code"], "request_invalid");
    // With the name it is another cloud.
    let (other, job, named) = run("/v1/clouds?keep=identifiers").await;
    assert_ne!(other["id"], cloud["id"]);
    assert_eq!((named, &other["keeps_identifiers"]), (true, &json!(true)));
    let (again, _, named) = run("/v1/clouds").await;
    assert_eq!((named, &again["id"]), (false, &cloud["id"]));
    // In the row of the job, until that is erased.
    assert!(naming(&folder).len() > 1, "{:?}", naming(&folder));
    let erased = connection.ask(&format!("DELETE {job}"), "", &[]).await;
    assert_eq!(erased.unwrap().status, 204);
    let only_upload = async || {
        let naming = naming(&folder);
        let cloud = folder.path().join("clouds");
        (naming.len() == 1 && naming[0].starts_with(cloud)).then_some(())
    };
    until("the name is in the upload alone", PATIENCE, only_upload).await;
    let path = format!("DELETE /v1/clouds/{}", other["id"].as_str().unwrap());
    let erased = connection.ask(&path, "", &[]).await;
    assert_eq!(erased.unwrap().status, 204);
    assert!(naming(&folder).is_empty(), "{:?}", naming(&folder));
}

#[tokio::test]
async fn a_patient_is_named_nowhere() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let file = of_a_patient();
    let settings = json!({"training": {"max_evaluations": 60}, "surface": {"resolution": 32}});
    let answer = post(&server, "/v1/clouds", "", &file).await;
    assert_eq!(answer.status, 201, "{:?}", answer.json());
    let request = json!({"cloud_id": answer.json()["id"], "preset": "fast", "settings": settings,
        "source": {"roi": "Shell"}});
    let mut connection = Connection::open(server.address()).await.unwrap();
    let wait = "Prefer: wait=120\r\n";
    let job = connection.post("/v1/jobs", wait, &request).await.unwrap();
    assert_eq!(job.json()["status"], "succeeded", "{}", job.json());
    assert!(!names(job.json().to_string().as_bytes()));
    assert!(!names(server.log().as_bytes()));
    assert!(naming(&folder).is_empty(), "{:?}", naming(&folder));
}
