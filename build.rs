//! Writes the libtorch folder into the run path, so that `cargo run`, `cargo test` and the built
//! binary find its libraries without environment variables; and the table of the dashboard's files,
//! if they were built.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::{env, fs, process};

/// Where `make web` puts the dashboard.
const DASHBOARD: &str = "web/dist";

/// What it is made from. `sources` in web/build.mjs says the same.
const SOURCES: [&str; 3] = ["web/build.mjs", "web/package-lock.json", "web/src"];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    run_path();
    if let Err(reason) = dashboard() {
        println!("cargo:warning={reason}");
        process::exit(1);
    }
}

fn run_path() {
    println!("cargo:rerun-if-env-changed=LIBTORCH");
    let libtorch = env::var_os("LIBTORCH").map(fs::canonicalize);
    let Some(Ok(libtorch)) = libtorch else {
        println!("cargo:warning=libtorch is not set up: run `make setup`, or set LIBTORCH");
        process::exit(1);
    };
    // $ORIGIN/../lib first: an installed binary carries its libraries beside it.
    println!("cargo:rustc-link-arg=-Wl,-rpath,$ORIGIN/../lib");
    println!(
        "cargo:rustc-link-arg=-Wl,-rpath,{}",
        libtorch.join("lib").display()
    );
}

/// Writes the table. It never runs npm: cargo alone builds a program without the dashboard, also
/// where there is no network.
fn dashboard() -> Result<(), String> {
    println!("cargo:rerun-if-env-changed=MESHWAY_REQUIRE_WEB");
    println!("cargo:rerun-if-changed={DASHBOARD}");
    let stamp = fs::read_to_string(Path::new(DASHBOARD).join("stamp")).ok();
    let mut table = String::from("static FILES: &[(&str, &[u8])] = &[\n");
    if let Some(stamp) = &stamp {
        for source in SOURCES {
            println!("cargo:rerun-if-changed={source}");
        }
        if *stamp != hash_of_sources()? {
            return Err("web/dist is older than what it is made from: run `make web`".into());
        }
        for path in files(Path::new(DASHBOARD))? {
            let path = fs::canonicalize(&path).map_err(|error| error.to_string())?;
            let name = path.file_name().and_then(|name| name.to_str());
            if let Some(name) = name.and_then(|name| name.strip_suffix(".gz")) {
                // Writing to a string does not fail.
                let path = path.to_string_lossy();
                let _ = writeln!(table, "    ({name:?}, include_bytes!({path:?})),");
            }
        }
    } else if env::var_os("MESHWAY_REQUIRE_WEB").is_some_and(|value| value != "0") {
        return Err(
            "the dashboard is not built, and MESHWAY_REQUIRE_WEB is set: run `make web`".into(),
        );
    }
    let _ = writeln!(
        table,
        "];\nconst STAMP: &str = {:?};",
        stamp.unwrap_or_default()
    );
    let out = env::var_os("OUT_DIR").ok_or("cargo sets OUT_DIR")?;
    let out = PathBuf::from(out).join("dashboard.rs");
    fs::write(out, table).map_err(|error| error.to_string())
}

/// FNV-1a of names and contents, as web/build.mjs has it: it tells what is stale, and guards
/// against nothing else.
fn hash_of_sources() -> Result<String, String> {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    let mut add = |bytes: &[u8]| {
        for byte in bytes {
            hash = (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
        }
    };
    for source in SOURCES {
        for path in files(Path::new(source))? {
            add(path.to_string_lossy().as_bytes());
            add(&fs::read(&path).map_err(|error| format!("{}: {error}", path.display()))?);
        }
    }
    Ok(format!("{hash:016x}"))
}

/// The files under a path in the order of their names; itself, if it is one.
fn files(path: &Path) -> Result<Vec<PathBuf>, String> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = fs::read_dir(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut below = Vec::new();
    for entry in entries {
        below.push(entry.map_err(|error| error.to_string())?.path());
    }
    below.sort();
    let mut all = Vec::new();
    for path in below {
        all.extend(files(&path)?);
    }
    Ok(all)
}
