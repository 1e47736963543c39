//! The command line as a user types it: results, exit codes, and what is left behind.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

pub(crate) fn meshway(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_meshway"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Runs and expects success; gives standard output.
pub(crate) fn succeed(folder: &Path, arguments: &[&str]) -> String {
    let output = meshway(folder, arguments);
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {message}");
    String::from_utf8(output.stdout).unwrap()
}

/// Runs and expects this exit code; gives standard error, which is short and no panic.
pub(crate) fn fail(folder: &Path, arguments: &[&str], code: i32) -> String {
    let output = meshway(folder, arguments);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    assert!(
        !message.contains("panicked") && message.len() < 4_000,
        "{arguments:?}: {message}"
    );
    message
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

pub(crate) fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Settings that make a run of a second out of one of half a minute.
const QUICK: &[&str] = &[
    "--preset=fast",
    "--quiet",
    "--set=training.max_evaluations=60",
    "--set=surface.resolution=40",
];

pub(crate) fn quick(cloud: &str, output: &str, more: &[&'static str]) -> Vec<String> {
    let all = [&["reconstruct", cloud, "-o", output], QUICK, more].concat();
    all.into_iter().map(str::to_owned).collect()
}

pub(crate) fn strings(arguments: &[String]) -> Vec<&str> {
    arguments.iter().map(String::as_str).collect()
}

#[test]
fn a_cloud_becomes_a_closed_mesh_with_its_record() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    succeed(
        folder,
        &[
            "sample",
            "sphere:2",
            "-n",
            "500",
            "--interior=50",
            "-o",
            "cloud.ply",
        ],
    );
    let more = &[
        "--report=report.json",
        "--metrics=metrics.csv",
        "--gradients=gradients.json",
        "--snapshots=.",
        "--set=training.histogram_evaluations=[10]",
        "--set=training.snapshot_evaluations=[40]",
    ];
    succeed(folder, &strings(&quick("cloud.ply", "mesh.obj", more)));
    let report = read_json(&folder.join("report.json"));
    assert_eq!(report["mesh"]["closed"], true);
    assert_eq!(report["mesh"]["genus"], 0);
    assert_eq!(report["inputs"][0]["points"], 550);
    let volume = report["mesh"]["volume"].as_f64().unwrap();
    // 4/3 π 8 = 33.51; 2 % is far more than a coarse grid and 60 evaluations cost.
    assert!((volume / 33.51 - 1.0).abs() < 0.02, "{volume}");

    let metrics = fs::read_to_string(folder.join("metrics.csv")).unwrap();
    let columns = metrics.lines().next().unwrap().split(',').count();
    assert!(metrics.lines().count() > 20);
    assert!(
        metrics
            .lines()
            .all(|line| line.split(',').count() == columns)
    );
    assert_eq!(
        read_json(&folder.join("gradients.json"))[0]["evaluation"],
        10
    );
    assert!(folder.join("40.obj").is_file());

    let judged = succeed(folder, &["evaluate", "mesh.obj", "sphere:2"]);
    let judged: Value = serde_json::from_str(&judged).unwrap();
    // In % of the diagonal; a radius off by 1 % would be 0.29.
    assert!(
        judged["comparison"]["chamfer_percent"].as_f64().unwrap() < 0.3,
        "{judged}"
    );
}

#[test]
fn the_same_run_gives_the_same_bytes() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    succeed(folder, &["sample", "torus", "-n", "400", "-o", "cloud.xyz"]);
    for mesh in ["a.ply", "b.ply"] {
        succeed(
            folder,
            &strings(&quick("cloud.xyz", mesh, &["--threads=1"])),
        );
    }
    assert_eq!(
        fs::read(folder.join("a.ply")).unwrap(),
        fs::read(folder.join("b.ply")).unwrap()
    );
}

/// A sphere as a table of `ParaView`, as a scan, and as an organised cloud; each with places without a point.
fn files_of_programs() -> [(&'static str, String); 3] {
    let points: Vec<[f64; 3]> = (0..400)
        .map(|i| {
            let z = (f64::from(i) + 0.5) / 200.0 - 1.0;
            let (r, a) = ((1.0 - z * z).sqrt(), f64::from(i) * 2.399_963);
            [r * a.cos() + 20.0, r * a.sin() + 10.0, z]
        })
        .collect();
    let lines = |row: &dyn Fn([f64; 3]) -> String| -> String {
        points.iter().map(|&point| row(point) + "\n").collect()
    };
    let table = lines(&|[x, y, z]| format!("{},{},{z},{x},{y},{z}", x - 20.0, y - 10.0));
    let scan = lines(&|[x, y, z]| format!("{} {} {z} 0.5", x - 20.0, y - 10.0));
    let cloud = lines(&|[x, y, z]| format!("{x} {y} {z} 20"));
    [
        (
            "table.csv",
            format!(
                "\"Normals:0\",\"Normals:1\",\"Normals:2\",\"Points:0\",\"Points:1\",\"Points:2\"\n\
                 {table}0,0,1,,,\n"
            ),
        ),
        (
            "scan.ptx",
            format!(
                "401\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n20 10 0 1\n\
                 {scan}0 0 0 0.5\n"
            ),
        ),
        (
            "organised.pcd",
            format!(
                "VERSION 0.7\nFIELDS x y z label\nSIZE 4 4 4 4\nTYPE F F F U\nWIDTH 401\nHEIGHT 2\n\
                 DATA ascii\n{cloud}{}",
                "nan nan nan 0\n".repeat(402)
            ),
        ),
    ]
}

#[test]
fn files_of_programs_become_meshes_and_the_report_has_their_warnings() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    for (name, file) in files_of_programs() {
        fs::write(folder.join(name), file).unwrap();
        let arguments = quick(name, "mesh.ply", &["--report=report.json"]);
        succeed(folder, &strings(&arguments));
        let report = read_json(&folder.join("report.json"));
        assert_eq!(report["mesh"]["closed"], true, "{name}");
        let ball = 4.0 / 3.0 * std::f64::consts::PI;
        let volume = report["mesh"]["volume"].as_f64().unwrap();
        assert!((volume / ball - 1.0).abs() < 0.1, "{name}: {volume}");
        let corner = report["mesh"]["bounds"]["min"][0].as_f64().unwrap();
        assert!((corner - 19.0).abs() < 0.1, "{name}: {corner}");
        assert_eq!(report["inputs"][0]["points"], 400, "{name}");
        assert_eq!(report["warnings"][0]["code"], "points_not_finite", "{name}");
        if name == "organised.pcd" {
            assert_eq!(report["warnings"][1]["code"], "labels_ignored");
        }
    }
}

#[test]
fn files_of_labelled_points_and_standard_output() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    succeed(
        folder,
        &["sample", "sphere", "-n", "300", "-o", "surface.xyz"],
    );
    succeed(
        folder,
        &["sample", "sphere:0.5", "-n", "60", "-o", "interior.xyz"],
    );
    succeed(
        folder,
        &["sample", "sphere:1.6", "-n", "60", "-o", "exterior.xyz"],
    );
    let output = meshway(
        folder,
        &[
            "reconstruct",
            "surface.xyz",
            "--interior=interior.xyz",
            "--exterior=exterior.xyz",
            "--preset=paper",
            "--set=training.max_evaluations=40",
            "--format=off",
            "-o",
            "-",
            "-q",
        ],
    );
    assert!(output.status.success());
    assert!(
        output.stdout.starts_with(b"OFF"),
        "{:?}",
        &output.stdout[..20]
    );
    assert_eq!(
        names(folder),
        ["exterior.xyz", "interior.xyz", "surface.xyz"]
    );
}

#[test]
fn every_kind_of_failure_has_its_exit_code_and_leaves_nothing() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    fs::write(
        folder.join("garbage.ply"),
        b"ply\nformat ascii 1.0\nelement vertex 99999\n",
    )
    .unwrap();
    fs::write(folder.join("line.xyz"), "0 0 0\n1 1 1\n".repeat(20)).unwrap();
    fs::write(folder.join("row.xyz"), "0 0 0\n1 x 1\n").unwrap();
    fs::write(
        folder.join("huge.xyz"),
        "1e30 0 0\n0 1e30 0\n0 0 1e30\n1 2 3\n".repeat(9),
    )
    .unwrap();
    fs::write(folder.join("empty.xyz"), "").unwrap();
    succeed(
        folder,
        &["sample", "sphere", "-n", "100", "-o", "cloud.xyz"],
    );
    let before = names(folder);

    let refused = &[
        "--set=network.width=0",
        "--set=training.sed=1",
        "--set=width=3",
        "--set=surface.resolution=9999",
    ];
    let message = fail(folder, &strings(&quick("cloud.xyz", "m.ply", refused)), 2);
    for said in [
        "/network/width: is 0, must be an integer from 1 to 512",
        "/training/sed: is unknown here",
        "did you mean seed?",
        "did you mean network.width?",
        "/surface/resolution: is 9999, must be an integer from 8 to 1024",
    ] {
        assert!(message.contains(said), "{message}");
    }
    fail(folder, &strings(&quick("cloud.xyz", "m.docx", &[])), 2);
    fail(
        folder,
        &strings(&quick("cloud.xyz", "nowhere/m.ply", &[])),
        2,
    );
    fail(folder, &["sample", "cube", "-o", "c.ply"], 2);
    fail(folder, &["reconstruct"], 2);
    // Labels that the paper's way needs and the cloud does not have.
    let message = fail(
        folder,
        &["reconstruct", "cloud.xyz", "--preset=paper", "-qo", "m.ply"],
        2,
    );
    assert!(message.contains("interior"), "{message}");

    for (cloud, named) in [
        ("missing.ply", "missing.ply"),
        ("garbage.ply", "garbage.ply"),
        ("line.xyz", "line.xyz"),
        ("row.xyz", "line 2"),
        ("huge.xyz", "1e30"),
        ("empty.xyz", "empty.xyz"),
    ] {
        let message = fail(folder, &strings(&quick(cloud, "m.ply", &[])), 3);
        assert!(message.contains(named), "{cloud}: {message}");
    }
    fail(folder, &["evaluate", "cloud.xyz"], 3);
    fs::write(
        folder.join("mesh.off"),
        "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n",
    )
    .unwrap();
    let message = fail(folder, &["evaluate", "mesh.off", "spere:1"], 3);
    assert!(
        message.contains("did you mean sphere?") && message.contains("torus[:MAJOR:MINOR]"),
        "{message}"
    );
    fs::remove_file(folder.join("mesh.off")).unwrap();
    fs::write(
        folder.join("serve.toml"),
        "workers = 1\nqueue_limit = \"long\"\n",
    )
    .unwrap();
    let message = fail(folder, &["serve", "--config=serve.toml"], 2);
    assert!(
        message.contains("serve.toml: line 2: queue_limit is \"long\""),
        "{message}"
    );
    fs::remove_file(folder.join("serve.toml")).unwrap();
    fail(folder, &["verify", "."], 3);
    assert_eq!(names(folder), before);
}

#[test]
fn help_names_every_flag_of_the_documents() {
    let help = succeed(Path::new("."), &["reconstruct", "--help"]);
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let documents = [
        "README.md",
        "docs/cli.md",
        "docs/service.md",
        "docs/settings.md",
    ];
    let text = documents.map(|name| fs::read_to_string(root.join(name)).unwrap());
    let text = text.join("\n");
    let flags = text
        .lines()
        .filter(|line| line.contains("meshway reconstruct"))
        .flat_map(str::split_whitespace)
        .filter(|word| word.starts_with("--"))
        .map(|word| word.split('=').next().unwrap());
    for flag in flags {
        assert!(
            help.contains(flag),
            "the documents use {flag}, which `reconstruct` does not have"
        );
    }
}

#[test]
fn presets_are_complete_settings() {
    let all: Value = serde_json::from_str(&succeed(Path::new("."), &["presets"])).unwrap();
    assert_eq!(all["balanced"]["surface"]["resolution"], 256);
    assert_eq!(all["paper"]["training"]["learning_rate"], 0.1);
    assert_eq!(all.as_object().unwrap().len(), 4);
}

#[test]
fn a_service_that_cannot_start_names_the_flag() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let message = fail(folder, &["serve", "--data-dir=/dev/null/data"], 1);
    assert!(message.contains("--data-dir /dev/null/data: "), "{message}");
    let message = fail(folder, &["serve", "--worker-memory-mib=230"], 2);
    assert!(message.contains("at least 288"), "{message}");
    let message = fail(folder, &["serve", "--port=8081"], 2);
    assert!(message.contains("--listen 127.0.0.1:8081"), "{message}");
    let help = succeed(folder, &["presets", "--help"]);
    assert!(help.contains("arXiv") && !help.contains('\\'), "{help}");
}
