//! `--colors`: what is written with it, and what is refused.

use std::fs;

use serde_json::Value;
use tempfile::TempDir;

use crate::command_line::{fail, quick, read_json, strings, succeed};

#[test]
fn meshes_are_coloured_by_distance_where_it_is_asked_for() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    succeed(
        folder,
        &["sample", "sphere", "-n", "100", "-o", "cloud.xyz"],
    );
    // Before the work begins: what is there afterwards is the cloud alone.
    let message = fail(
        folder,
        &strings(&quick("cloud.xyz", "m.stl", &["--colors=distance"])),
        2,
    );
    assert!(
        message.contains("stl") && message.contains("ply or glb"),
        "{message}"
    );
    assert!(!folder.join("m.stl").exists());

    let coloured = &["--colors=distance", "--report=report.json"];
    succeed(folder, &strings(&quick("cloud.xyz", "m.glb", coloured)));
    let glb = fs::read(folder.join("m.glb")).unwrap();
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let mesh = &document["meshes"][0];
    assert!(
        mesh["primitives"][0]["attributes"]["COLOR_0"].is_u64(),
        "{document}"
    );
    let report = read_json(&folder.join("report.json"));
    assert_eq!(
        mesh["extras"]["colors"]["to"],
        report["surface"]["support_distance"]
    );

    succeed(
        folder,
        &strings(&quick(
            "cloud.xyz",
            "m.ply",
            &["--format=ply_ascii", "--colors=distance"],
        )),
    );
    let ply = fs::read_to_string(folder.join("m.ply")).unwrap();
    assert!(ply.contains("property uchar red\n"));
}
