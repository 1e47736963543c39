//! Files of each format against nibabel, pydicom, pynrrd and SimpleITK.

use std::fs;
use std::path::PathBuf;

use meshway::reconstruction::cloud::{Limits, read};
use meshway::reconstruction::vector::{Vec3, along, distance};
use serde_json::Value;

use super::found::{Found, found, is_dicom};
use super::{expected, file, files};

/// What is left of a hundredth of a voxel where writers round.
const SAME: f64 = 2e-4;

fn vector(value: &Value) -> Vec3 {
    std::array::from_fn(|i| value[i].as_f64().unwrap())
}

/// Compares what is read with what other readers found.
fn compare(name: &str, found: &Found, expected: &Value) {
    let items = expected["items"].as_object().unwrap();
    for (number, expected) in items {
        let is_it = |item: &&super::found::FoundItem| item.number.to_string() == *number;
        let item = found.items.iter().find(is_it);
        let item = item.unwrap_or_else(|| panic!("{name}: {number} is missing"));
        let listed = found
            .contents
            .parts
            .items
            .iter()
            .find(|listed| listed.number == item.number);
        let listed = listed.unwrap();
        if let Some(voxels) = expected["voxels"].as_u64() {
            assert_eq!(item.voxels, voxels, "{name}: {number}");
            assert_eq!(
                format!("{:016x}", item.sum),
                expected["sum"],
                "{name}: {number}"
            );
            assert_eq!(listed.voxels, Some(voxels), "{name}: {number}");
        } else {
            assert_eq!(
                item.contours as u64, expected["contours"],
                "{name}: {number}"
            );
            assert_eq!(item.points as u64, expected["points"], "{name}: {number}");
            let off = distance(item.total, vector(&expected["total"]));
            assert!(off < SAME * item.points as f64, "{name}: {number}: {off}");
        }
        assert!(
            listed.volume_mm3 > 0.0 && listed.slices > 0,
            "{name}: {number}"
        );
    }
    let others = found
        .items
        .iter()
        .filter(|item| item.voxels > 0 || item.contours > 0);
    assert_eq!(others.count(), items.len(), "{name}");
    if let Some(rows) = expected["affine"].as_array() {
        let affine = found.contents.affine.unwrap();
        for (axis, step) in affine.steps.iter().chain([&affine.origin]).enumerate() {
            let column = std::array::from_fn(|row| rows[row][axis].as_f64().unwrap());
            assert!(
                distance(*step, column) < SAME,
                "{name}: axis {axis}: {step:?}"
            );
        }
    }
    if let Some(slices) = expected["slices"].as_u64() {
        let geometry = &found.geometry;
        assert_eq!(geometry.origins.len() as u64, slices, "{name}");
        for (what, ours) in [
            ("column", geometry.column),
            ("row", geometry.row),
            ("origin", geometry.origins[0]),
        ] {
            assert!(
                distance(ours, vector(&expected[what])) < SAME,
                "{name}: {what}"
            );
        }
    }
}

/// Compares points and normals with what VTK found.
fn compare_points(name: &str, bytes: &[u8], expected: &Value) {
    let (cloud, _) = read(bytes, Some(name), &Limits::default()).unwrap();
    assert_eq!(cloud.points.len() as u64, expected["points"], "{name}");
    // A sum that tells one order from another.
    let total = |vectors: &[Vec3]| {
        let numbered = vectors.iter().enumerate();
        numbered.fold([0.0; 3], |sum, (i, &v)| along(sum, (i + 1) as f64, v))
    };
    let least = SAME * (cloud.points.len() as f64).powi(2);
    let off = distance(total(&cloud.points), vector(&expected["total"]));
    assert!(off < least, "{name}: {off}");
    assert_eq!(
        cloud.normals.is_some(),
        !expected["normals"].is_null(),
        "{name}"
    );
    if let Some(normals) = cloud.normals {
        let off = distance(total(&normals), vector(&expected["normals"]));
        assert!(off < least, "{name}: {off}");
    }
}

#[test]
fn every_format_is_read_as_others_read_it() {
    let expected = expected("expected.json");
    assert_eq!(
        expected.len(),
        files().len(),
        "run scripts/medical.py again"
    );
    for (name, expected) in expected {
        if expected.get("points").is_some() {
            compare_points(&name, &file(&name), &expected);
            continue;
        }
        let read = found(&file(&name), &name, false);
        if expected.get("refused").is_some() {
            assert_eq!(read.unwrap_err().code(), "orientation_missing", "{name}");
            assert!(
                found(&file(&name), &name, true)
                    .unwrap()
                    .contents
                    .assumed_orientation
            );
        } else {
            compare(
                &name,
                &read.unwrap_or_else(|error| panic!("{name}: {error}")),
                &expected,
            );
        }
    }
}

/// A shape without a mirror image lies at the same places of the patient in every format.
#[test]
fn left_stays_left_in_every_format() {
    let names = [
        "plain.nrrd",
        "ras.nrrd",
        "nifti1_u1.nii.gz",
        "nifti2_big.nii.gz",
        "nifti1_turned.nii.gz",
        "packed.mha",
        "binary.dcm",
    ];
    let extremes = |name: &str| {
        let read = found(&file(name), name, false).unwrap();
        let bounds = read.contents.bounds.unwrap();
        let voxels = read.items[0].voxels;
        (voxels, bounds)
    };
    let (voxels, grid) = extremes(names[0]);
    for name in names {
        let (found, bounds) = extremes(name);
        assert_eq!(found, voxels, "{name}");
        // DICOM leaves out slices in which nothing is.
        if !is_dicom(name) {
            assert!(distance(bounds.min, grid.min) < SAME, "{name}: {bounds:?}");
            assert!(distance(bounds.max, grid.max) < SAME, "{name}: {bounds:?}");
        }
    }
}

/// The code, as the table in `docs/formats.md` has it, for what kept other readers from finding labels.
fn refusal(reason: &str) -> &'static str {
    match reason {
        "no orientation" | "not placed" => "orientation_missing",
        // Of this one its bytes were damaged, so that lengths are too large.
        "no segmentation" => "cloud_truncated",
        _ => "unsupported_format",
    }
}

/// Real files lie outside of the project, where `MESHWAY_MEDICAL_FILES` says when this is compiled.
fn real_files() -> Option<PathBuf> {
    let folder = option_env!("MESHWAY_MEDICAL_FILES").map(PathBuf::from)?;
    folder.is_dir().then_some(folder)
}

#[test]
#[expect(clippy::print_stdout, reason = "what was left out is said so")]
fn real_files_are_read_as_others_read_them() {
    let Some(folder) = real_files() else {
        println!("skipped: MESHWAY_MEDICAL_FILES names no folder");
        return;
    };
    let mut compared = 0;
    for (name, expected) in expected("real.json") {
        let Ok(bytes) = fs::read(folder.join(&name)) else {
            println!("skipped: {name} is not there");
            continue;
        };
        compared += 1;
        if expected.get("points").is_some() {
            compare_points(&name, &bytes, &expected);
            continue;
        }
        let read = found(&bytes, &name, false);
        match expected["refused"].as_str() {
            None => compare(
                &name,
                &read.unwrap_or_else(|error| panic!("{name}: {error}")),
                &expected,
            ),
            // Ways of packing that are read here, and not by pydicom.
            Some("not decoded") => {
                let voxels: u64 = read.unwrap().items.iter().map(|item| item.voxels).sum();
                assert!(voxels > 100_000, "{name}: {voxels}");
            }
            Some(reason) => {
                let error = read.unwrap_err();
                assert_eq!(error.code(), refusal(reason), "{name}: {error}");
            }
        }
    }
    assert!(compared > 0, "none of the files is in the folder");
    println!("{compared} files compared");
}
