//! What the command line does about a mesh that is likely wrong.

use std::fs;

use tempfile::TempDir;

use crate::command_line::{meshway, quick, read_json, strings, succeed};

/// So little training leaves the fingers out.
const HARDLY: &str = "--set=training.max_evaluations=5";

#[test]
fn a_mesh_that_is_likely_wrong_is_never_silent() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    succeed(folder, &["sample", "hand", "-n", "800", "-o", "hand.xyz"]);
    let mut lines = Vec::new();
    for (strict, code) in [
        (&["--report=r.json", HARDLY][..], 0),
        (&["--report=r.json", HARDLY, "--strict"], 5),
    ] {
        let arguments = quick("hand.xyz", "m.ply", strict);
        let output = meshway(folder, &strings(&arguments));
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        assert!(
            said.starts_with("warning: the mesh is likely wrong: "),
            "{said}"
        );
        let report = read_json(&folder.join("r.json"));
        assert_eq!(report["verdict"], "poor");
        let reason = report["verdict_reasons"][0]["message"].as_str().unwrap();
        assert!(said.contains(reason), "{said}");
        assert!(
            fs::read(folder.join("m.ply"))
                .unwrap()
                .starts_with(b"ply\n")
        );
        for name in ["r.json", "m.ply"] {
            fs::remove_file(folder.join(name)).unwrap();
        }
        lines.push(said);
    }
    assert_eq!(lines[0], lines[1]);
    succeed(
        folder,
        &["sample", "sphere", "-n", "500", "-o", "cloud.xyz"],
    );
    let arguments = quick("cloud.xyz", "m.ply", &["--report=r.json", "--strict"]);
    let output = meshway(folder, &strings(&arguments));
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "");
    assert_eq!(read_json(&folder.join("r.json"))["verdict"], "good");
}
