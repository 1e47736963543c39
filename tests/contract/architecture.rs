//! One crate has no layers that the compiler enforces; this reads the sources instead.

use std::fs;
use std::path::{Path, PathBuf};

/// A room, and what its sources must not name.
struct Room {
    place: &'static str,
    refused: &'static [&'static str],
}

const ROOMS: &[Room] = &[
    Room {
        place: "src/reconstruction",
        refused: &[
            "crate::cli",
            "crate::config",
            "crate::folder",
            "crate::intake",
            "crate::jobs",
            "crate::http",
            "tokio",
            "sqlx",
            "axum",
            "tracing",
            "anyhow",
            "std::env",
            "std::fs",
            "std::time",
            "std::net",
            "std::process",
            "Instant",
            "SystemTime",
            "println!",
            "eprintln!",
        ],
    },
    Room {
        place: "src/folder",
        refused: &[
            "crate::cli",
            "crate::config",
            "crate::intake",
            "crate::jobs",
            "crate::http",
            "tokio",
            "sqlx",
            "axum",
            "tch",
        ],
    },
    Room {
        place: "src/intake",
        refused: &[
            "crate::cli",
            "crate::config",
            "crate::jobs",
            "crate::http",
            "sqlx",
            "axum",
            "tch",
            "println!",
            "eprintln!",
        ],
    },
    Room {
        place: "src/identity",
        refused: &[
            "crate::cli",
            "crate::config",
            "crate::folder",
            "crate::intake",
            "crate::jobs",
            "crate::http",
            "crate::reconstruction",
            "tokio",
            "sqlx",
            "axum",
            "tch",
            "tracing",
        ],
    },
    Room {
        place: "src/config",
        refused: &[
            "crate::cli",
            "crate::folder",
            "crate::intake",
            "crate::jobs",
            "crate::http",
            "sqlx",
            "axum",
            "tch",
            "tracing",
        ],
    },
    Room {
        place: "src/webhooks",
        refused: &[
            "crate::cli",
            "crate::http",
            "crate::intake",
            "crate::reconstruction",
            "sqlx",
            "tch",
            "SystemTime",
            "println!",
            "eprintln!",
        ],
    },
    Room {
        place: "src/jobs",
        refused: &[
            "crate::cli",
            "crate::http",
            "crate::webhooks",
            "axum",
            "tch",
            "anyhow",
            "println!",
            "eprintln!",
        ],
    },
    Room {
        place: "src/http",
        refused: &[
            "crate::cli",
            "sqlx",
            "tch",
            "anyhow",
            "SystemTime",
            "std::env",
            "println!",
        ],
    },
    Room {
        place: "src/http/api",
        refused: &[
            "crate::http::wire",
            "crate::http::telemetry",
            "crate::http::door",
            "crate::http::upload",
            "crate::http::resources",
            "crate::http::system",
        ],
    },
    Room {
        place: "src/http/wire",
        refused: &[
            "crate::http::telemetry",
            "crate::http::door",
            "crate::http::upload",
            "crate::http::resources",
            "crate::http::system",
        ],
    },
    Room {
        place: "src/http/telemetry",
        refused: &[
            "crate::http::api",
            "crate::http::door",
            "crate::http::upload",
            "crate::http::resources",
            "crate::http::system",
        ],
    },
    Room {
        place: "src/http/door",
        refused: &[
            "crate::http::api",
            "crate::http::telemetry",
            "crate::http::upload",
            "crate::http::resources",
            "crate::http::system",
        ],
    },
    Room {
        place: "src/http/upload",
        refused: &[
            "crate::http::api",
            "crate::http::telemetry",
            "crate::http::door",
            "crate::http::resources",
            "crate::http::system",
        ],
    },
    Room {
        place: "src/http/resources",
        refused: &["crate::http::system"],
    },
    Room {
        place: "src/jobs/store/sql",
        refused: &[
            "crate::jobs::store::content",
            "crate::jobs::store::postgres",
            "crate::jobs::store::records",
            "crate::jobs::store::sqlite",
        ],
    },
    Room {
        place: "src/jobs/store/sqlite",
        refused: &[
            "crate::jobs::store::content",
            "crate::jobs::store::postgres",
            "crate::jobs::store::records",
        ],
    },
    Room {
        place: "src/jobs/store/postgres",
        refused: &[
            "crate::jobs::store::content",
            "crate::jobs::store::records",
            "crate::jobs::store::sqlite",
        ],
    },
    // The statements about rows know no database.
    Room {
        place: "src/jobs/store/records",
        refused: &[
            "crate::jobs::store::postgres",
            "crate::jobs::store::sqlite",
            "sqlx",
        ],
    },
    Room {
        place: "src/jobs/store/content",
        refused: &["crate::jobs::store::records"],
    },
    Room {
        place: "src/cli",
        refused: &["sqlx", "tch"],
    },
];

fn sources(folder: &Path) -> Vec<PathBuf> {
    if folder.is_file() {
        return vec![folder.to_owned()];
    }
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// The code of a line: without its comment.
fn code(line: &str) -> &str {
    line.split("//").next().unwrap_or_default()
}

fn names(line: &str, word: &str) -> bool {
    let boundary = |c: Option<char>| !c.is_some_and(|c| c.is_alphanumeric() || c == '_');
    line.match_indices(word).any(|(at, _)| {
        boundary(line[..at].chars().next_back())
            && (word.ends_with('!') || boundary(line[at + word.len()..].chars().next()))
    })
}

#[test]
fn rooms_use_only_what_they_may() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut wrong = Vec::new();
    for room in ROOMS {
        let files = sources(&root.join(room.place));
        assert!(
            !files.is_empty(),
            "{} has no sources: is the folder renamed?",
            room.place
        );
        for file in files {
            let text = fs::read_to_string(&file).unwrap();
            for (number, line) in text.lines().enumerate() {
                for word in room.refused.iter().filter(|word| names(code(line), word)) {
                    let file = file.strip_prefix(root).unwrap().display();
                    wrong.push(format!("{file}:{}: {word}", number + 1));
                }
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "named where they must not be:\n{}",
        wrong.join("\n")
    );
}

/// A path that climbs out of its wing would pass the test above.
#[test]
fn wings_are_named_from_the_top() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for file in ["src/http", "src/jobs"]
        .map(|room| sources(&root.join(room)))
        .concat()
    {
        let text = fs::read_to_string(&file).unwrap();
        let climbs = text.lines().any(|line| code(line).contains("super::super"));
        assert!(!climbs, "{}", file.display());
    }
}

#[test]
fn sql_stays_in_the_store() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for file in sources(&root.join("src")) {
        // The error of the room names the driver's errors to sort them.
        if file.starts_with(root.join("src/jobs/store")) || file.ends_with("jobs/error.rs") {
            continue;
        }
        let text = fs::read_to_string(&file).unwrap();
        for word in ["sqlx", "SELECT", "INSERT", "UPDATE"] {
            let found = text.lines().any(|line| names(code(line), word));
            assert!(!found, "{}: {word}", file.display());
        }
    }
}

#[test]
fn files_stay_small() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for folder in ["src", "tests", "benches"] {
        for file in sources(&root.join(folder)) {
            let lines = fs::read_to_string(&file).unwrap().lines().count();
            assert!(
                lines <= 400,
                "{} has {lines} lines: more than one noun?",
                file.display()
            );
        }
    }
}

#[test]
fn a_wrong_way_is_seen() {
    assert!(names("use tokio::sync;", "tokio"));
    assert!(names("use crate::http::router;", "crate::http"));
    assert!(!names("use crate::http_like;", "crate::http"));
    assert!(!names(code("let a = 1; // tokio is not used"), "tokio"));
}
