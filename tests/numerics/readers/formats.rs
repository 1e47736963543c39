//! One cloud through all formats, number for number.

use meshway::reconstruction::cloud::{Format, Limits, read};

use super::files::{all, cloud, gzip};
use super::{load, warnings};

#[test]
fn every_format_gives_the_numbers_that_were_written() {
    for file in all() {
        let (read, source) = load(&file.bytes, file.name).unwrap();
        let mut written = cloud();
        written.normals = written.normals.filter(|_| file.normals);
        written.labels = written.labels.filter(|_| file.labels);
        assert_eq!(read, written, "{}", file.name);
        assert_eq!(Some(source.format), Format::from_extension(file.name));
        assert!(!source.gzipped);
        // Before anything is taken as inside, it is told.
        let expected: &[&str] = if file.labels { &["labels_used"] } else { &[] };
        assert_eq!(warnings(&file.bytes, file.name), expected, "{}", file.name);
    }
}

#[test]
fn formats_are_recognised_without_a_name() {
    for file in all() {
        let (_, source) = read(&file.bytes, None, &Limits::default()).unwrap();
        let expected = Format::from_extension(file.name);
        assert_eq!(Some(source.format), expected, "{}", file.name);
    }
}

#[test]
fn every_format_may_be_gzipped_in_one_or_more_members() {
    for file in all() {
        let plain = load(&file.bytes, file.name).unwrap();
        let name = format!("{}.gz", file.name);
        let (cloud, source) = load(&gzip(&file.bytes), &name).unwrap();
        assert!(source.gzipped);
        assert_eq!(cloud, plain.0, "{name}");
        let (left, right) = file.bytes.split_at(file.bytes.len() / 2);
        let members = [gzip(left), gzip(right)].concat();
        assert_eq!(load(&members, &name).unwrap().0, plain.0, "{name}");
    }
}

#[test]
fn without_limits_gzipped_files_are_read_whole() {
    let limits = Limits {
        max_points: usize::MAX,
        max_expanded_bytes: usize::MAX,
        max_expansion: f64::INFINITY,
    };
    for file in all() {
        let plain = load(&file.bytes, file.name).unwrap();
        for bytes in [file.bytes.clone(), gzip(&file.bytes)] {
            let (cloud, _) = read(&bytes, Some(file.name), &limits).unwrap();
            assert_eq!(cloud, plain.0, "{}", file.name);
        }
    }
}

#[test]
fn line_ends_of_any_system_are_read_alike() {
    for file in all() {
        let Ok(text) = std::str::from_utf8(&file.bytes) else {
            continue;
        };
        if file.name.ends_with("npy") || file.name.starts_with("binary") {
            continue;
        }
        let unix = text.replace("\r\n", "\n");
        let expected = load(unix.as_bytes(), file.name).unwrap().0;
        let dos = format!("\u{feff}{}", unix.replace('\n', "\r\n"));
        assert_eq!(
            load(dos.as_bytes(), file.name).unwrap().0,
            expected,
            "{}",
            file.name
        );
    }
}

#[test]
fn ply_headers_in_use_are_read() {
    // Old line ends, indentation, a comment in Latin-1, blank lines, odd names, values like `.5`.
    let file = b"ply\r  format ascii 1.0\rcomment caf\xe9\r\robj_info x\relement vertex 2\r\
        property float x\rproperty float y\rproperty float z\rproperty float scalar_(1)\r\
        property float 3d.w\rend_header\r\r.5 5. 1E-5 0 0\r-1 +2 3e2 0 0\r";
    let (cloud, _) = load(file, "a.ply").unwrap();
    assert_eq!(cloud.points, [[0.5, 5.0, 1e-5], [-1.0, 2.0, 300.0]]);
    // A binary body may begin with a line feed although the header's lines end in one.
    let mut file = b"ply\r\nformat binary_little_endian 1.0\r\nelement vertex 1\r\n\
        property uchar x\r\nproperty char y\r\nproperty ushort z\r\nend_header\r\n"
        .to_vec();
    file.extend([10, 255, 13, 10]);
    assert_eq!(
        load(&file, "a.ply").unwrap().0.points,
        [[10.0, -1.0, 2573.0]]
    );
}

#[test]
fn ply_vertices_may_carry_lists() {
    let header = |encoding| {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex 2\nproperty uchar x\n\
             property list uchar ushort tags\nproperty uchar y\nproperty uchar z\nend_header\n"
        )
    };
    let expected = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
    let text = header("ascii") + "1 2 9 9 2 3\n4 0 5 6\n";
    assert_eq!(load(text.as_bytes(), "a.ply").unwrap().0.points, expected);
    let mut file = header("binary_big_endian").into_bytes();
    file.extend([1, 2, 9, 9, 9, 9, 2, 3, 4, 0, 5, 6]);
    assert_eq!(load(&file, "a.ply").unwrap().0.points, expected);
}

#[test]
fn off_counts_may_follow_the_keyword() {
    for head in [
        "OFF 2 0 0",
        "OFF2 0 0",
        "2 0 0",
        "# note\nCOFF\n\n2 0 0 # note",
    ] {
        let file = format!("{head}\n1 2 3\n# note\n4 5 6 255 0 0\n");
        let (cloud, _) = load(file.as_bytes(), "a.off").unwrap();
        assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "{head}");
    }
}

#[test]
fn normals_without_all_components_are_told() {
    let head = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
                property float z\nproperty float nx\nproperty float ny\n";
    let fewer = format!("{head}end_header\n1 2 3 0 1\n");
    assert_eq!(warnings(fewer.as_bytes(), "a.ply"), ["normals_ignored"]);
    assert_eq!(
        warnings(b"x y z nx\n1 2 3 0\n", "a.csv"),
        ["normals_ignored"]
    );
    let all = format!("{head}property float nz\nend_header\n1 2 3 0 1 0\n");
    assert!(warnings(all.as_bytes(), "a.ply").is_empty());
}

#[test]
fn obj_normals_of_another_numbering_are_not_used() {
    let crossed = b"v 1 2 3\nv 4 5 6 1\nvn 1 0 0\nvn 0 1 0\nf 1//2 2//1 1//2\n";
    assert_eq!(warnings(crossed, "a.obj"), ["normals_ignored"]);
    assert_eq!(load(crossed, "a.obj").unwrap().0.normals, None);
    let fewer = b"v 1 2 3\nv 4 5 6\nvn 1 0 0\n";
    assert_eq!(warnings(fewer, "a.obj"), ["normals_ignored"]);
}

#[test]
fn npy_integers_are_read() {
    let header = "{'descr': '|i1', 'fortran_order': False, 'shape': (2, 3), }\n";
    let mut file = b"\x93NUMPY\x01\0".to_vec();
    file.extend((header.len() as u16).to_le_bytes());
    file.extend(header.as_bytes());
    file.extend([1, 2, 3, 255, 128, 127]);
    let (cloud, _) = load(&file, "a.npy").unwrap();
    assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [-1.0, -128.0, 127.0]]);
}

#[test]
fn points_that_are_not_finite_are_dropped_however_many() {
    let rows = |bad: usize| {
        let row = |i: usize| match i {
            i if i < bad => "1 nan 1\n".to_owned(),
            i => format!("{i} 2 {}\n", i * i),
        };
        (0..200).map(row).collect::<String>()
    };
    for bad in [2, 150] {
        let (cloud, source) = load(rows(bad).as_bytes(), "a.xyz").unwrap();
        assert_eq!(
            (cloud.points.len(), source.dropped_non_finite),
            (200 - bad, bad)
        );
        assert_eq!(
            warnings(rows(bad).as_bytes(), "a.xyz"),
            ["points_not_finite"]
        );
    }
    let none = "x y z\n".to_owned() + &rows(200);
    assert_eq!(super::code(none.as_bytes(), "a.xyz"), "cloud_not_finite");
}

#[test]
fn duplicates_and_broken_normals_are_kept_and_told() {
    let file = b"x y z nx ny nz\n0 0 1 0 0 1\n0 0 1 0 0 0.5\n-0 0 1 nan 0 1\n0 1 1 0 0 0\n";
    let (cloud, source) = load(file, "a.xyz").unwrap();
    assert_eq!(cloud.points.len(), 4);
    assert_eq!(cloud.normals.unwrap()[1..3], [[0.0, 0.0, 0.5], [0.0; 3]]);
    assert_eq!(
        warnings(file, "a.xyz"),
        [
            "normals_not_finite",
            "normals_zero",
            "normals_not_unit",
            "duplicate_points"
        ]
    );
    assert!(source.warnings[3].message.starts_with("2 points"));
}
