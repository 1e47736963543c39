//! Damaged files and random bytes: no panic, and what is read is consistent.

use meshway::reconstruction::cloud::{Limits, read};
use meshway::reconstruction::random::{Generator, Purpose, stream};
use proptest::prelude::*;
use rand::RngExt;

use super::files::{all, gzip};
use crate::texts::clean;

/// Damaged copies of each file.
const COPIES: usize = 3000;

/// Reads bytes that may be anything, and checks what must hold whatever they are.
fn survive(bytes: &[u8], name: Option<&str>) {
    let limits = Limits {
        max_points: 100_000,
        max_expanded_bytes: 1 << 20,
        max_expansion: 100.0,
    };
    match read(bytes, name, &limits) {
        Ok((cloud, source)) => {
            let n = cloud.points.len();
            assert!(n > 0 && n <= limits.max_points);
            assert!(cloud.normals.is_none_or(|normals| normals.len() == n));
            assert!(cloud.labels.is_none_or(|labels| labels.len() == n));
            assert!(cloud.points.iter().flatten().all(|v| v.is_finite()));
            assert!(source.dropped_non_finite + n <= limits.max_points);
            clean(bytes, Some(source.format), &limits);
        }
        Err(error) => {
            let message = error.to_string();
            assert!(message.len() < 300, "{message}");
            assert!(!message.chars().any(char::is_control), "{message:?}");
        }
    }
}

/// Flips, overwrites, cuts, inserts and repeats, a few at a time.
pub(crate) fn damage(bytes: &mut Vec<u8>, generator: &mut Generator) {
    const TELLING: &[&[u8]] = &[
        b"99999999999",
        b"-1",
        b"nan",
        b"1e999",
        b"\n",
        b"\r",
        b"\0",
        b",",
        b";",
        b"#",
        b" ",
        b"\xff\xff\xff\xff",
        b"\xff\xff\xff\x7f",
        b"element vertex 0\n",
        b"property int x\n",
        b"OFF",
        b"endsolid",
        b"list",
    ];
    for _ in 0..generator.random_range(1..5) {
        if bytes.is_empty() {
            return;
        }
        // Half of the damage goes to the header, which is the smaller but more telling part.
        let end = if generator.random() {
            bytes.len()
        } else {
            bytes.len().min(300)
        };
        let at = generator.random_range(0..end);
        let length = generator.random_range(0..40).min(bytes.len() - at);
        match generator.random_range(0..6) {
            0 => bytes[at] ^= 1 << generator.random_range(0..8),
            1 => bytes[at] = generator.random(),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..at + length)),
            4 => {
                let piece = bytes[at..at + length].to_vec();
                bytes.splice(at..at, piece);
            }
            _ => {
                let piece = TELLING[generator.random_range(0..TELLING.len())];
                bytes.splice(at..at, piece.iter().copied());
            }
        }
    }
}

#[test]
fn damaged_files_never_panic() {
    let mut generator = stream(1, Purpose::Selection);
    for file in all() {
        for _ in 0..COPIES {
            let mut bytes = file.bytes.clone();
            damage(&mut bytes, &mut generator);
            survive(&bytes, Some(file.name));
        }
    }
}

#[test]
fn damaged_gzip_never_panics() {
    let mut generator = stream(2, Purpose::Selection);
    for file in all() {
        let packed = gzip(&file.bytes);
        for _ in 0..COPIES / 10 {
            let mut bytes = packed.clone();
            damage(&mut bytes, &mut generator);
            survive(&bytes, Some(file.name));
        }
    }
}

/// The start of a file of each kind, so that random bytes get past its recognition.
fn marks() -> impl Strategy<Value = (&'static [u8], &'static str)> {
    prop::sample::select(vec![
        (b"".as_slice(), "a"),
        (b"", "a.csv"),
        (b"ply\n", "a.ply"),
        (
            b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty list char double l\n\
              property float x\nproperty float y\nproperty float z\nend_header\n",
            "a.ply",
        ),
        (b"v ", "a.obj"),
        (b"OFF ", "a.off"),
        (b"solid facet\nvertex ", "a.stl"),
        (b"", "a.stl"),
        (b"VERSION 0.7\nFIELDS x y z\n", "a.pcd"),
        (
            b"VERSION 0.7\nFIELDS x y z\nSIZE 1 1 1\nTYPE U U U\nWIDTH 4\nDATA binary_compressed\n",
            "a.pcd",
        ),
        (b"\x93NUMPY\x01\0", "a.npy"),
        (
            b"\x93NUMPY\x01\0\x71\0{'descr': [('x', '<f2'), ('y', '|b1'), ('z', '<i4'), ('label', '|i1')], \
              'fortran_order': False, 'shape': (4,), }\n",
            "a.npy",
        ),
        (b"3\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "a.ptx"),
        (b"x,y,z,nx,ny,nz,label\n1,2,3,0,0,1,1\n", "a.csv"),
        (b"2\n1 2 3\n4 5 6\n", "a.pts"),
        (b"LASF", "a.las"),
        (b"PK\x03\x04", "a.zip"),
        (b"{\"", "a.json"),
        (b"\x1f\x8b", "a.gz"),
    ])
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(3000) })]

    #[test]
    fn random_bytes_never_panic((mark, name) in marks(), bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        survive(&[mark, &bytes].concat(), Some(name));
    }

    #[test]
    fn random_text_never_panics((mark, name) in marks(), text in "[-0-9a-z .,;|#%/\"'()\\[\\]{}=\t\n\r]{0,200}") {
        survive(&[mark, text.as_bytes()].concat(), Some(name));
    }

    #[test]
    fn tables_round_numbers_exactly(rows in prop::collection::vec(prop::array::uniform3(-1e9..1e9), 1..50)) {
        let line = |[x, y, z]: &[f64; 3]| format!("{x} {y:e} {z}\n");
        let text: String = rows.iter().map(line).collect();
        let (cloud, _) = read(text.as_bytes(), Some("a.xyz"), &Limits::default()).unwrap();
        prop_assert_eq!(cloud.points, rows);
    }
}
