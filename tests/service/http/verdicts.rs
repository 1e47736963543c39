//! How good a mesh is, where clients look: in the job, in its last event, at its mesh.

use std::collections::BTreeSet;

use axum::body::Body;
use axum::http::Request;
use meshway::jobs::{NewMesh, Record, Success, Verdict};
use serde_json::{Value, json};

use crate::http::contract::{expect_contract, expect_named};
use crate::http::support::{Service, json_request, sphere_xyz, tetrahedron};
use crate::server::{Folder, PATIENCE, job_ended, until};
use crate::wire::Connection;

const MEMBERS: [&str; 5] = ["verdict", "verdict_reasons", "warnings", "mesh", "slices"];

/// What the report of a reconstruction has, as far as the job shows it, and some more.
fn report(verdict: Verdict) -> Value {
    json!({
        "verdict": verdict,
        "verdict_reasons": [{"code": "surface_unsupported", "message": "A third is made up."}],
        "warnings": [
            {"code": "duplicate_points", "message": "2 points repeat another one."},
            {"code": "surface_unsupported", "message": "A third is made up."},
        ],
        "mesh": {
            "vertices": 4, "triangles": 4, "components": 1, "closed": true, "manifold": true,
            "genus": 0, "volume": 0.25, "area": 2.5,
        },
        "surface": {"unsupported_area_percent": 33.5, "support_distance": 0.5},
        "slices": slices(),
    })
}

/// What it says of a segmentation.
fn slices() -> Value {
    json!({
        "slices": 9, "slice_distance": 5.0, "pixel_size": [0.5, 0.5], "voxels": 27000.0, "volume": 33750.0,
        "contour_points": 2160, "thinning_radius": 1.75, "surface_points": 343, "interior_points": 3000,
        "exterior_points": 3000, "slices_repeated": 1, "gaps": 0, "contours_ignored": 0,
        "invented_at": ["first_slice"], "dice": 0.99, "volume_change_percent": 0.2,
    })
}

/// What a job shows of that report.
fn shown(verdict: Verdict) -> Value {
    let report = report(verdict);
    json!({
        "verdict": verdict,
        "verdict_reasons": report["verdict_reasons"],
        "warnings": report["warnings"],
        "mesh": {
            "vertices": 4, "triangles": 4, "components": 1, "closed": true, "genus": 0,
            "volume": 0.25, "unsupported_area_percent": 33.5,
            "orientation_confidence": null,
        },
        "slices": slices(),
    })
}

fn nothing() -> Value {
    let members = MEMBERS.map(|name| (name.to_owned(), Value::Null));
    Value::Object(members.into_iter().collect())
}

/// These members of a document; each must be there.
#[track_caller]
fn members(document: &Value) -> Value {
    let member = |name: &str| (name.to_owned(), document.get(name).unwrap().clone());
    Value::Object(MEMBERS.map(member).into_iter().collect())
}

fn success(report: Value) -> Success {
    Success {
        mesh: NewMesh::new(4, 4, tetrahedron()),
        report,
        model: vec![1],
        last: Record::default(),
    }
}

/// A job with the report; its address.
async fn job_with(service: &Service, report: Value) -> String {
    let id = service.submit().await;
    let claim = service.claim().await;
    let mesh = NewMesh::new(4, 4, tetrahedron());
    let judged = mesh.clone().judged(Verdict::Doubtful);
    for (evaluation, mesh) in [(5, mesh), (6, judged)] {
        let snapshot = service.store().put_snapshot(&claim, evaluation, mesh);
        snapshot.await.unwrap();
    }
    let success = success(report);
    service.store().succeed(&claim, success).await.unwrap();
    format!("/v1/jobs/{id}")
}

#[tokio::test]
async fn a_job_shows_what_its_report_says_in_short() {
    let service = Service::new().await;
    let waiting = service.submit().await;
    let waiting = format!("/v1/jobs/{waiting}");
    let answer = service.get(&waiting).await.expect(200);
    expect_contract(&answer, "get", "/v1/jobs/{id}");
    assert_eq!(members(&answer.json()), nothing());
    service.delete(&waiting).await.expect(204);

    for verdict in Verdict::ALL {
        let path = job_with(&service, report(verdict)).await;
        let answer = service.get(&path).await.expect(200);
        expect_contract(&answer, "get", "/v1/jobs/{id}");
        assert_eq!(members(&answer.json()), shown(verdict));
        let list = service.get("/v1/jobs?limit=1").await.expect(200);
        expect_contract(&list, "get", "/v1/jobs");
        assert_eq!(members(&list.json()["items"][0]), shown(verdict));
        let report = service.get(&format!("{path}/report")).await;
        expect_contract(&report, "get", "/v1/jobs/{id}/report");
    }
}

#[tokio::test]
async fn the_last_event_tells_it_too() {
    let service = Service::new().await;
    for (report, told) in [
        (report(Verdict::Doubtful), shown(Verdict::Doubtful)),
        (json!({}), nothing()),
    ] {
        let path = job_with(&service, report).await;
        let request = Request::get(format!("{path}/events")).header("accept", "application/json");
        let events = service.send(request.body(Body::empty()).unwrap()).await;
        expect_contract(&events, "get", "/v1/jobs/{id}/events");
        let events = events.json();
        let last = events["items"].as_array().unwrap().last().unwrap();
        assert_eq!(last["event"], "job.succeeded");
        expect_named("Event", last);
        assert_eq!(members(&last["data"]), told);
        assert_eq!(last["data"]["bytes"], tetrahedron().len());
    }
}

#[tokio::test]
async fn a_mesh_comes_with_its_verdict() {
    let service = Service::new().await;
    for verdict in Verdict::ALL {
        let path = job_with(&service, report(verdict)).await;
        let mut tag = String::new();
        for end in [
            "mesh", "mesh.ply", "mesh.obj", "mesh.stl", "mesh.off", "mesh.glb",
        ] {
            let answer = service.get(&format!("{path}/{end}")).await.expect(200);
            assert_eq!(answer.header("meshway-verdict"), verdict.name(), "{end}");
            answer.header("etag").clone_into(&mut tag);
        }
        for (name, value, status) in [
            ("range", "bytes=0-9", 206),
            ("if-none-match", tag.as_str(), 304),
        ] {
            let request = Request::get(format!("{path}/mesh.glb")).header(name, value);
            let answer = service.send(request.body(Body::empty()).unwrap()).await;
            let answer = answer.expect(status);
            assert_eq!(answer.header("meshway-verdict"), verdict.name());
        }
        // Snapshots have their own, if any: that of the result says nothing of them.
        let snapshot = service.get(&format!("{path}/snapshots/5.ply")).await;
        let snapshot = snapshot.expect(200);
        assert!(!snapshot.headers.contains_key("meshway-verdict"));
        let snapshot = service.get(&format!("{path}/snapshots/6.obj")).await;
        assert_eq!(snapshot.expect(200).header("meshway-verdict"), "doubtful");
        let snapshots = service.get(&format!("{path}/snapshots")).await.expect(200);
        expect_contract(&snapshots, "get", "/v1/jobs/{id}/snapshots");
        let verdicts = snapshots.json()["items"].as_array().unwrap().clone();
        let verdicts: Vec<_> = verdicts
            .iter()
            .map(|item| item["verdict"].clone())
            .collect();
        assert_eq!(verdicts, [json!(null), json!("doubtful")]);
    }
}

#[tokio::test]
async fn what_a_wait_answers_has_it_too() {
    let service = Service::new().await;
    let body = json!({"cloud_id": service.upload().await});
    for accept in ["application/json", "model/obj"] {
        let mut request = json_request("/v1/jobs", &body);
        for (name, value) in [("prefer", "wait=60"), ("accept", accept)] {
            request.headers_mut().insert(name, value.parse().unwrap());
        }
        let answer = tokio::spawn(service.send(request));
        let claim = until("a job is submitted", PATIENCE, async || {
            service.store().claim("worker-0-1", 60_000).await.unwrap()
        });
        let claim = claim.await;
        let success = success(report(Verdict::Poor));
        service.store().succeed(&claim, success).await.unwrap();
        let answer = answer.await.unwrap().expect(200);
        if accept == "model/obj" {
            assert_eq!(answer.header("meshway-verdict"), "poor");
        } else {
            assert_eq!(members(&answer.json()), shown(Verdict::Poor));
        }
    }
}

#[tokio::test]
async fn jobs_of_versions_without_verdicts_have_none() {
    let service = Service::new().await;
    let mut old = report(Verdict::Good);
    for name in ["verdict", "verdict_reasons"] {
        old.as_object_mut().unwrap().remove(name);
    }
    let path = job_with(&service, old).await;
    let answer = service.get(&path).await.expect(200);
    expect_contract(&answer, "get", "/v1/jobs/{id}");
    let mut expected = shown(Verdict::Good);
    for name in ["verdict", "verdict_reasons"] {
        expected[name] = Value::Null;
    }
    assert_eq!(members(&answer.json()), expected);
    let mesh = service.get(&format!("{path}/mesh.stl")).await.expect(200);
    assert!(!mesh.headers.contains_key("meshway-verdict"));
}

#[tokio::test]
async fn jobs_are_listed_by_verdict() {
    let service = Service::new().await;
    let mut jobs = Vec::new();
    for verdict in [Verdict::Good, Verdict::Poor, Verdict::Good] {
        jobs.push(job_with(&service, report(verdict)).await);
    }
    job_with(&service, json!({})).await;
    service.submit().await;
    let listed = async |query: &str| {
        let list = service.get(&format!("/v1/jobs?{query}")).await.expect(200);
        let list = list.json();
        let link = |job: &Value| job["links"]["self"].as_str().unwrap().to_owned();
        let items = list["items"].as_array().unwrap().iter();
        items.map(link).collect::<Vec<_>>()
    };
    assert_eq!(listed("verdict=poor").await, [jobs[1].clone()]);
    assert_eq!(listed("verdict=doubtful").await, Vec::<String>::new());
    let good = [jobs[2].clone(), jobs[0].clone()];
    assert_eq!(listed("verdict=good&status=succeeded").await, good);
    assert_eq!(listed("verdict=good&limit=1").await, good[..1]);
    assert_eq!(
        listed("verdict=good&status=queued").await,
        Vec::<String>::new()
    );
    let refused = service.get("/v1/jobs?verdict=bad").await;
    let problem = refused.expect_problem(422, "request_invalid");
    assert_eq!(problem["errors"][0]["pointer"], "/verdict");
}

#[tokio::test]
async fn a_served_job_shows_the_warnings_of_its_file_and_of_its_run() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let mut client = Connection::open(server.address()).await.unwrap();
    // The lower half of a sphere is missing, and its first point is there twice.
    let upper: Vec<String> = sphere_xyz(600, 0.0)
        .lines()
        .take(300)
        .map(str::to_owned)
        .collect();
    let body = [upper[0].clone(), upper.join("\n")].join("\n");
    let body = [body.as_bytes()];
    let answer = client.ask("POST /v1/jobs?preset=fast", "", &body).await;
    let job = job_ended(&mut client, &answer.unwrap().json()).await;
    assert_eq!(job["status"], "succeeded", "{job}");
    expect_named("Job", &job);
    let link = job["links"]["report"].as_str().unwrap();
    let report = client.ask(&format!("GET {link}"), "", &[]).await.unwrap();
    let report = report.json();
    expect_named("Report", &report);
    let codes = |list: &Value| -> Vec<String> {
        let items = list.as_array().unwrap().iter();
        items
            .map(|item| item["code"].as_str().unwrap().to_owned())
            .collect()
    };
    let warned = codes(&job["warnings"]);
    for code in ["duplicate_points", "surface_unsupported"] {
        assert!(warned.iter().any(|warned| warned == code), "{warned:?}");
    }
    let warnings = job["warnings"].as_array().unwrap();
    let texts: BTreeSet<&str> = warnings
        .iter()
        .map(|warning| warning["message"].as_str().unwrap())
        .collect();
    assert_eq!(texts.len(), warnings.len(), "told twice: {warnings:?}");
    // That of the reader, who comes first.
    let first = warnings[0]["message"].as_str().unwrap();
    assert!(first.contains("of another point"), "{first}");
    assert_eq!(job["warnings"], report["warnings"]);
    // What is warned of is told while it runs, too.
    let link = job["links"]["events"].as_str().unwrap();
    let json = "Accept: application/json\r\n";
    let events = client.ask(&format!("GET {link}"), json, &[]).await.unwrap();
    let events = events.json();
    let data = events["items"].as_array().unwrap().iter();
    let told = data.filter(|event| event["event"] == "job.warning");
    let told: Vec<&str> = told
        .map(|event| event["data"]["code"].as_str().unwrap())
        .collect();
    assert_eq!(told, warned);
    assert_eq!(job["mesh"]["closed"], true);
    for name in ["vertices", "triangles", "volume"] {
        assert_eq!(job["mesh"][name], report["mesh"][name]);
    }
    let percent = job["mesh"]["unsupported_area_percent"].as_f64().unwrap();
    assert!(percent > 10.0, "{percent}");
    assert_eq!(job["verdict"], "doubtful", "{job}");
    assert_eq!(job["verdict_reasons"][0]["code"], "surface_unsupported");
    for name in ["verdict", "verdict_reasons"] {
        assert_eq!(job[name], report[name]);
    }
}
