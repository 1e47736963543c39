//! Clouds as users bring them: a job tells the same about its mesh as the command line does.

use std::fmt::Write as _;
use std::fs;
use std::process::Command;

use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use meshway::reconstruction::vector::Vec3;
use serde_json::{Value, json};

use crate::http::support::sphere;
use crate::server::{Folder, PROGRAM, Server};
use crate::wire::Connection;

const KINDS: usize = 5;

/// A name of the kind, its file, and the settings of its run.
fn kinds() -> [(&'static str, String, Value); KINDS] {
    let usual = json!({"training": {"max_evaluations": 60}, "surface": {"resolution": 48}});
    let hardly = json!({"training": {"max_evaluations": 5}, "surface": {"resolution": 48}});
    let ball = sphere(400, 0.0);
    let strays = [[40.0, 0.0, 0.0], [0.0, -35.0, 9.0], [3.0, 4.0, 50.0]];
    let with_strays = [&ball[..], &strays].concat();
    let hand = sample(
        &Shape::Hand,
        &Recipe {
            points: 800,
            seed: 4,
            ..Recipe::default()
        },
    );
    [
        ("even", table(&ball), usual.clone()),
        ("strays", table(&with_strays), usual.clone()),
        // Rows that are not finite or are there twice: the reader tells both, the run what it leaves out.
        (
            "rows",
            "nan 0 0\n".to_owned() + &table(&[&ball[..], &ball[..50]].concat()),
            usual.clone(),
        ),
        ("terrain", table(&terrain()), usual),
        ("hardly trained", table(&hand.points), hardly),
    ]
}

fn terrain() -> Vec<Vec3> {
    let at = |i: usize| {
        let (x, y) = ((i % 30) as f64 * 0.1, (i / 30) as f64 * 0.1);
        [x, y, 0.1 * (2.0 * x).sin() * (3.0 * y).cos()]
    };
    (0..900).map(at).collect()
}

fn table(points: &[Vec3]) -> String {
    points.iter().fold(String::new(), |mut text, [x, y, z]| {
        writeln!(text, "{x} {y} {z}").unwrap();
        text
    })
}

/// The members that say how far a mesh can be relied on.
fn told(document: &Value) -> Value {
    let names = ["verdict", "verdict_reasons", "warnings"];
    let member = |name: &str| (name.to_owned(), document.get(name).unwrap().clone());
    Value::Object(names.map(member).into_iter().collect())
}

/// What the command line tells of the same cloud with the same settings.
fn by_the_command_line(folder: &Folder, cloud: &str, settings: &Value) -> Value {
    let path = |name: &str| folder.path().join(name);
    fs::write(path("cloud.xyz"), cloud).unwrap();
    fs::write(path("settings.json"), settings.to_string()).unwrap();
    let mut command = Command::new(PROGRAM);
    command.current_dir(folder.path()).args([
        "reconstruct",
        "cloud.xyz",
        "--preset=fast",
        "--settings=settings.json",
        "--report=report.json",
        "-o=mesh.ply",
    ]);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{output:?}");
    told(&serde_json::from_slice(&fs::read(path("report.json")).unwrap()).unwrap())
}

async fn by_a_job(server: &Server, cloud: &str, settings: &Value) -> Value {
    let mut connection = Connection::open(server.address()).await.unwrap();
    let parts = [cloud.as_bytes()];
    let upload = connection.ask("POST /v1/clouds", "", &parts);
    let request = json!({
        "cloud_id": upload.await.unwrap().json()["id"],
        "preset": "fast",
        "settings": settings,
    });
    let answer = connection.post("/v1/jobs", "Prefer: wait=240\r\n", &request);
    let job = answer.await.unwrap().json();
    assert_eq!(job["status"], "succeeded", "{job}");
    told(&job)
}

#[tokio::test]
async fn jobs_and_the_command_line_tell_the_same() {
    let folder = Folder::new().await;
    let server = folder.serve(&[]).await;
    let (mut verdicts, mut codes) = (Vec::new(), Vec::new());
    for (kind, cloud, settings) in kinds() {
        let job = by_a_job(&server, &cloud, &settings).await;
        assert_eq!(
            job,
            by_the_command_line(&folder, &cloud, &settings),
            "{kind}"
        );
        let code = |warning: &Value| warning["code"].as_str().unwrap().to_owned();
        verdicts.push(job["verdict"].as_str().unwrap().to_owned());
        codes.push(
            job["warnings"]
                .as_array()
                .unwrap()
                .iter()
                .map(code)
                .collect::<Vec<_>>(),
        );
    }
    // The kinds differ, so that equal answers say something.
    assert_eq!(verdicts, ["good", "good", "good", "doubtful", "poor"]);
    assert_eq!(
        codes[..4],
        [
            &[][..],
            &["strays_left_out"],
            &["points_not_finite", "duplicate_points", "duplicate_points"],
            &["surface_unsupported"],
        ]
    );
}
