//! Label maps, segments and contours: what other readers find in a file, voxel for voxel.

mod choices;
mod damage;
mod found;
mod oracle;
mod spelling;
mod surfaces;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

/// Files that `scripts/medical.py write` made, and what `scripts/medical.py read` says of them.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/numerics/medical/files")
}

/// The bytes of one of them.
pub(crate) fn file(name: &str) -> Vec<u8> {
    fs::read(folder().join(name)).unwrap()
}

/// All of them by name.
pub(crate) fn files() -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(folder())
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let named = files.map(|path| {
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        (name, fs::read(path).unwrap())
    });
    named.collect()
}

/// What other readers found, by the names of files.
fn expected(name: &str) -> BTreeMap<String, Value> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/numerics/medical")
        .join(name);
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}
