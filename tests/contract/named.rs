//! Whoever deals with bytes that rows name knows all tables that do.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Tables with a column `object`, by migrations.
fn tables(folder: &str) -> BTreeSet<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut files: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    let mut found = BTreeSet::new();
    for file in files.iter().filter(|file| file.is_file()) {
        let (text, mut table) = (fs::read_to_string(file).unwrap(), String::new());
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words[..] {
                ["CREATE", "TABLE", name, ..] | ["ALTER", "TABLE", name, "ADD", ..] => {
                    name.clone_into(&mut table);
                }
                _ => {}
            }
            if words.starts_with(&["object", "TEXT"])
                || words.ends_with(&["COLUMN", "object", "TEXT;"])
            {
                found.insert(table.clone());
            }
        }
    }
    // What the audit trail tells of, which is no key.
    found.remove("audit");
    found
}

#[test]
fn all_tables_that_name_bytes_are_known_where_bytes_are_dealt_with() {
    let there = tables("migrations/postgres");
    assert!(there.len() >= 6, "{there:?}");
    for file in [
        "src/jobs/store/content/graves.rs",
        "src/jobs/store/check.rs",
        "src/jobs/store/moving/bytes.rs",
    ] {
        let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap();
        for table in &there {
            assert!(
                text.contains(&format!("FROM {table}")),
                "{file} does not know {table}"
            );
        }
    }
}
