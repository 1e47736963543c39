//! What is refused, with which error; files that declare more than they hold.

use meshway::reconstruction::cloud::{Error, Limits, read};

use super::files::{all, gzip};
use super::{code, load};

fn ply(header: &str, body: &str) -> String {
    format!("ply\nformat ascii 1.0\n{header}\nend_header\n{body}")
}

const XYZ: &str = "property float x\nproperty float y\nproperty float z";

#[test]
fn files_of_no_format_are_refused() {
    assert_eq!(code(b"", "a.xyz"), "cloud_empty");
    assert_eq!(code(b" \n ", "a.bin"), "cloud_empty");
    assert_eq!(code(b"PK\x03\x04\0\0\0", "a.zip"), "unsupported_format");
    assert_eq!(code(b"once upon a time\n", "a.doc"), "unsupported_format");
    assert_eq!(code(b"\xff\xfe1\x002\0", "a.xyz"), "unsupported_format");
}

#[test]
fn ply_headers_are_refused_where_they_are_wrong() {
    let vertex = |count: &str| format!("element vertex {count}\n{XYZ}");
    let lines = |n: u32, line: fn(u32) -> String| (0..n).map(line).collect::<Vec<_>>().join("\n");
    let many = lines(4094, |i| format!("property int p{i}"));
    let elements = lines(17, |i| format!("element e{i} 1\nproperty int p"));
    for header in [
        vertex("99999999999999999999999999"),
        vertex("12345678901"),
        vertex("-1"),
        format!("{XYZ}\n{}", vertex("1")),
        format!("{}\n{}", vertex("1"), vertex("1")),
        format!("{}\nproperty float128 w", vertex("1")),
        format!("{}\nproperty list float int w", vertex("1")),
        format!("{}\n{}", vertex("1"), many),
        format!("{}\n{elements}", vertex("1")),
        format!("format binary_big_endian 1.0\n{}", vertex("1")),
        format!("format ascii 1.99999999999999999999\n{}", vertex("1")),
        format!("surprise\n{}", vertex("1")),
        format!("comment {}\n{}", "x".repeat(70_000), vertex("1")),
        format!("element {} 1\n{}", "x".repeat(2000), vertex("1")),
        format!("{}{}", "comment\n".repeat(10_000), vertex("1")),
    ] {
        let start = &header[..header.len().min(60)];
        assert_eq!(
            code(ply(&header, "1 2 3\n").as_bytes(), "a.ply"),
            "cloud_header",
            "{start}"
        );
    }
    assert_eq!(code(b"ply\nformat ascii 1.0\n", "a.ply"), "cloud_header");
    assert_eq!(
        code(
            &[b"ply\n".as_slice(), &vec![b'x'; 1 << 20]].concat(),
            "a.ply"
        ),
        "cloud_header"
    );
}

#[test]
fn ply_without_coordinates_is_refused() {
    let flat = ply(
        "element vertex 1\nproperty float x\nproperty float y",
        "1 2\n",
    );
    assert_eq!(code(flat.as_bytes(), "a.ply"), "cloud_no_coordinates");
    let faces = ply("element face 1\nproperty list uchar int v", "0\n");
    assert_eq!(code(faces.as_bytes(), "a.ply"), "cloud_no_coordinates");
    // However many of these there are, they have no data.
    let bare = ply("element vertex 9999999999\nelement face 1", "");
    assert_eq!(code(bare.as_bytes(), "a.ply"), "cloud_no_coordinates");
}

/// None of these may reserve memory for what it declares: a terabyte would end the test.
#[test]
fn counts_without_bytes_behind_them_are_truncations() {
    let vertices = format!("element vertex 9999999999\n{XYZ}");
    let before = format!("element list 9999999999\nproperty list uchar int v\n{vertices}");
    for header in [&vertices, &before] {
        let text = ply(header, "1 2 3\n");
        // The limit of points may speak first; both refuse before anything is reserved.
        assert_eq!(code(text.as_bytes(), "a.ply"), "cloud_truncated");
        let binary = text.replace("ascii", "binary_little_endian");
        assert_eq!(code(binary.as_bytes(), "a.ply"), "cloud_truncated");
    }
    let off = b"OFF\n18446744073709551615 0 0\n1 2 3\n";
    assert_eq!(code(off, "a.off"), "cloud_truncated");
    let mut stl = vec![0; 200];
    stl[80..84].fill(0xff);
    assert_eq!(code(&stl, "a.stl"), "cloud_truncated");
    for data in ["ascii", "binary"] {
        let pcd = format!(
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n\
             WIDTH 18446744073709551615\nHEIGHT 1\nDATA {data}\n1 2 3\n"
        );
        assert_eq!(code(pcd.as_bytes(), "a.pcd"), "cloud_truncated");
    }
    let header = "{'descr': '<f8', 'fortran_order': True, 'shape': (18446744073709551615, 3), }\n";
    let mut npy = b"\x93NUMPY\x01\0".to_vec();
    npy.extend((header.len() as u16).to_le_bytes());
    npy.extend(header.as_bytes());
    assert_eq!(code(&npy, "a.npy"), "cloud_truncated");
}

#[test]
fn lists_longer_than_the_file_are_truncations() {
    let header = format!("element a 2\nproperty list uint double v\nelement vertex 1\n{XYZ}");
    let binary = ply(&header, "").replace("ascii", "binary_little_endian");
    let bomb = [binary.as_bytes(), &[0xff; 64]].concat();
    assert_eq!(code(&bomb, "a.ply"), "cloud_truncated");
    let negative = binary.replace("uint", "int");
    let negative = [negative.as_bytes(), &[0xff; 64]].concat();
    assert_eq!(code(&negative, "a.ply"), "cloud_row");
    let vertex = "element vertex 1\nproperty list uchar int v\n".to_owned() + XYZ;
    assert_eq!(
        code(ply(&vertex, "1e18 1 2 3\n").as_bytes(), "a.ply"),
        "cloud_row"
    );
}

#[test]
fn files_with_a_count_that_are_cut_short_say_so() {
    for file in all() {
        // Beyond the last line break, so that text is cut between lines and not within one.
        let end = match file.name {
            "ascii.ply" | "ascii.pcd" | "ascii.stl" | "cloud.off" | "normals.off" => {
                let vertices = &file.bytes[..file.bytes.len() - 30];
                vertices.iter().rposition(|&b| b == b'\n').unwrap() + 1
            }
            name if name.ends_with("ply") => file.bytes.len() - 20,
            name if name.ends_with("stl") || name.ends_with("pcd") || name.ends_with("npy") => {
                file.bytes.len() - 1
            }
            _ => continue,
        };
        assert_eq!(
            code(&file.bytes[..end], file.name),
            "cloud_truncated",
            "{}",
            file.name
        );
    }
}

#[test]
fn truncations_tell_both_numbers() {
    let file = ply(&format!("element vertex 3\n{XYZ}"), "1 2 3\n4 5 6\n");
    match load(file.as_bytes(), "a.ply") {
        Err(Error::Truncated {
            declared, found, ..
        }) => assert_eq!((declared, found), (3, 2)),
        other => panic!("{other:?}"),
    }
}

#[test]
fn gzip_bombs_and_damaged_streams_are_refused() {
    let zeros = gzip(&vec![b'0'; 64 << 20]);
    assert_eq!(code(&zeros, "a.xyz.gz"), "body_too_large");
    let limits = Limits {
        max_expanded_bytes: 1000,
        ..Limits::default()
    };
    let text = gzip("1 2 3\n".repeat(200).as_bytes());
    let error = read(&text, None, &limits).unwrap_err();
    assert_eq!(error.code(), "body_too_large");
    assert_eq!(
        code(&text[..text.len() - 9], "a.xyz.gz"),
        "unsupported_encoding"
    );
    let mut damaged = text.clone();
    let last = damaged.len() - 1;
    damaged[last - 4] ^= 1;
    assert_eq!(code(&damaged, "a.xyz.gz"), "unsupported_encoding");
}

#[test]
fn an_lzf_bomb_is_refused() {
    let head = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 300000000\nHEIGHT 1\n\
                DATA binary_compressed\n";
    let mut file = head.as_bytes().to_vec();
    file.extend(8u32.to_le_bytes());
    file.extend(3_600_000_000u32.to_le_bytes());
    file.extend([0, 0, 0xe0, 0xff, 0, 0xe0, 0xff, 0]);
    assert_eq!(code(&file, "a.pcd"), "body_too_large");
}

#[test]
fn more_points_than_the_limit_are_refused() {
    let limits = Limits {
        max_points: 39,
        ..Limits::default()
    };
    for file in all() {
        let error = read(&file.bytes, Some(file.name), &limits).unwrap_err();
        assert_eq!(error.code(), "too_many_points", "{}", file.name);
    }
}

#[test]
fn messages_echo_little_and_only_what_can_be_printed() {
    let row = format!("1 2 3\n4 5 \x1b[31m{}\n", "x".repeat(100_000));
    let message = load(row.as_bytes(), "a.xyz").unwrap_err().to_string();
    assert!(
        message.len() < 120 && !message.contains('\x1b'),
        "{message}"
    );
    let header = ply(&format!("element {} 1", "\x07".repeat(900)), "");
    let message = load(header.as_bytes(), "a.ply").unwrap_err().to_string();
    assert!(
        message.len() < 160 && !message.contains('\x07'),
        "{message}"
    );
}
