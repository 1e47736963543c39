//! Manifests name what the program has: flags, settings of the environment, metrics.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use yaml_serde::Value;

use crate::command_line::succeed;

/// All files of these folders with such an ending.
fn files(folders: &[&str], ending: &str) -> Vec<PathBuf> {
    let mut open: Vec<PathBuf> = folders
        .iter()
        .map(|folder| Path::new(env!("CARGO_MANIFEST_DIR")).join(folder))
        .collect();
    let mut found = Vec::new();
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|is| is == ending) {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn documents(file: &Path) -> Vec<Value> {
    let text = fs::read_to_string(file).unwrap();
    let documents = yaml_serde::Deserializer::from_str(&text);
    documents
        .map(|document| {
            let document = serde::Deserialize::deserialize(document);
            document.unwrap_or_else(|error| panic!("{}: {error}", file.display()))
        })
        .collect()
}

/// What begins with this and goes on with these letters, wherever it stands.
fn names(text: &str, start: &str, letter: fn(char) -> bool) -> BTreeSet<String> {
    let parts = text.split(start).skip(1);
    parts
        .map(|rest| {
            let end = rest.find(|c| !letter(c)).unwrap_or(rest.len());
            format!("{start}{}", &rest[..end])
        })
        .collect()
}

#[test]
fn manifests_use_settings_that_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let help: String = ["serve", "worker", "migrate"]
        .iter()
        .map(|command| succeed(folder.path(), &[command, "--help"]))
        .collect();
    let known = names(&help, "MESHWAY_", |c| c.is_ascii_uppercase() || c == '_');
    assert!(known.len() > 30);
    let manifests = files(&["deploy", "docker"], "yaml");
    assert!(manifests.len() > 10);
    for file in manifests {
        // It is YAML.
        assert!(!documents(&file).is_empty());
        let text = fs::read_to_string(&file).unwrap();
        for name in names(&text, "MESHWAY_", |c| c.is_ascii_uppercase() || c == '_') {
            assert!(known.contains(&name), "{}: {name}", file.display());
        }
        let lines = text
            .lines()
            .filter(|line| line.contains("[serve") || line.contains("[worker"));
        for line in lines {
            for flag in names(line, "--", |c| c.is_ascii_lowercase() || c == '-') {
                assert!(help.contains(&flag), "{}: {flag}", file.display());
            }
        }
    }
}

#[test]
fn alerts_and_dashboards_ask_for_metrics_that_there_are() {
    let source: String = files(&["src/http/telemetry"], "rs")
        .iter()
        .map(|file| fs::read_to_string(file).unwrap())
        .collect();
    let mut asked = BTreeSet::new();
    let texts = [
        files(&["deploy", "docker"], "yaml"),
        files(&["docker"], "json"),
    ]
    .concat();
    for file in texts {
        let text = fs::read_to_string(file).unwrap();
        asked.extend(names(&text, "meshway_", |c| {
            c.is_ascii_lowercase() || c == '_'
        }));
    }
    // Made by a rule of the adapter that stands beside it.
    asked.remove("meshway_jobs_open");
    assert!(asked.len() > 10, "{asked:?}");
    for name in asked {
        let own = name.trim_start_matches("meshway_");
        let own = ["_total", "_info", "_bucket", "_sum", "_count"]
            .iter()
            .fold(own, |name, end| name.trim_end_matches(end));
        assert!(
            source.contains(&format!("\"{own}\"")),
            "{name} is no metric"
        );
    }
}

#[test]
fn alerts_are_the_same_everywhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let docker = documents(&root.join("docker/alerts.yaml")).remove(0);
    let operator = documents(&root.join("deploy/kubernetes/monitoring/alerts.yaml")).remove(0);
    assert_eq!(docker["groups"], operator["spec"]["groups"]);
    assert!(docker["groups"][0]["rules"].as_sequence().unwrap().len() > 5);
}
