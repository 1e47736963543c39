//! Damaged files of each format: no panic, and what is read is consistent.

use std::io::Read;

use flate2::read::GzDecoder;
use meshway::reconstruction::cloud::{Format, Limits, Opened, Options, open};
use meshway::reconstruction::random::{Purpose, stream};
use meshway::reconstruction::slices::Content;

use super::files;
use crate::readers::damage::damage;
use crate::texts::clean;

/// Damaged copies of each format in the suite.
const COPIES: usize = 600;

/// Damaged copies of each format where there is time.
const MANY: usize = 20_000;

/// Most memory that reading them may add, in kB.
const MOST_MEMORY: u64 = 256 << 10;

/// Opens bytes that may be anything, and reads the slices of what they hold.
fn survive(bytes: &[u8], name: &str) -> bool {
    let limits = Limits {
        max_points: 100_000,
        max_expanded_bytes: 16 << 20,
        max_expansion: 100.0,
    };
    let options = Options {
        hint: Format::from_extension(name),
        limits: &limits,
        assume_orientation: true,
    };
    let read = open(bytes, &options, |opened, _| {
        if let Opened::Slices(segmentation) = opened {
            let items = segmentation.contents().parts.items.len();
            assert!(items > 0);
            for item in 0..items.min(3) {
                let geometry = segmentation.geometry(item);
                let numbers = geometry
                    .origins
                    .iter()
                    .chain([&geometry.column, &geometry.row]);
                assert!(numbers.flatten().all(|v| v.is_finite()));
                for plane in segmentation.planes(item) {
                    assert!(plane.slice < geometry.origins.len());
                    match plane.content {
                        Content::Mask(mask) => {
                            assert!(mask.filled.iter().any(|&filled| filled > 0));
                        }
                        Content::Polygons(polygons) => assert!(!polygons.is_empty()),
                    }
                }
            }
        }
        Ok(())
    });
    if read.is_ok() {
        clean(bytes, options.hint, &limits);
    }
    if let Err(error) = &read {
        let message = error.to_string();
        assert!(message.len() < 300, "{message}");
        assert!(!message.chars().any(char::is_control), "{message:?}");
    }
    read.is_ok()
}

/// Damages copies of the files whose name ends so, that many in all; how many were still read.
fn damaged(ending: &str, copies: usize) -> usize {
    let mut generator = stream(3, Purpose::Selection);
    let mut files: Vec<_> = files()
        .into_iter()
        .filter(|(name, _)| name.ends_with(ending))
        .collect();
    assert!(!files.is_empty(), "{ending}");
    for (_, bytes) in &mut files {
        // Damage in a packed file hits its checksum and hardly anything else.
        if bytes.starts_with(&[0x1f, 0x8b]) {
            let mut plain = Vec::new();
            GzDecoder::new(&bytes[..]).read_to_end(&mut plain).unwrap();
            *bytes = plain;
        }
    }
    let mut read = 0;
    for (name, bytes) in files.iter().cycle().take(copies) {
        let mut bytes = bytes.clone();
        damage(&mut bytes, &mut generator);
        read += usize::from(survive(&bytes, name));
    }
    read
}

const ENDINGS: [&str; 6] = [".nii.gz", ".nrrd", ".mha", ".dcm", ".vtk", ".vtp"];

#[test]
fn damaged_segmentations_never_panic() {
    for ending in ENDINGS {
        damaged(ending, COPIES);
    }
}

/// Largest memory that the process has had, in kB.
fn peak_memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find(|line| line.starts_with("VmHWM"))
        .unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}

#[test]
#[ignore = "takes minutes; make fuzz-medical runs it"]
#[expect(clippy::print_stdout, reason = "a long run says what it did")]
fn many_damaged_segmentations_take_little_memory() {
    let before = peak_memory();
    for ending in ENDINGS {
        let read = damaged(ending, MANY);
        let added = peak_memory() - before;
        println!("{ending}: {MANY} damaged files, {read} still read, {added} kB more memory");
        assert!(added < MOST_MEMORY, "{ending}: {added} kB");
    }
}
