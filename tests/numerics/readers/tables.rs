//! What the columns of text tables mean.

use meshway::reconstruction::cloud::{Error, Label};

use super::{code, load, warnings};

const UP: [f64; 3] = [0.0, 0.0, 1.0];

#[test]
fn names_of_columns_count_in_any_order_and_spelling() {
    for head in [
        "nz;ny;nx;label;i;z;y;x",
        "\"nz\" \"ny\" \"nx\" \"Label\" \"i\" \"Z\" \"Y\" \"X\"",
        "// normal_z normal_y normal_x label i z y x",
        "# NZ, NY, NX, label, i, z, y, x",
    ] {
        let file = format!("{head}\n\n1 0 0 0 text 3 2 1\n1 0 0 1 text 6 5 4\n");
        let (cloud, source) = load(file.as_bytes(), "a.csv").unwrap();
        assert_eq!(cloud.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "{head}");
        assert_eq!(cloud.normals.unwrap(), [UP, UP]);
        assert_eq!(cloud.labels.unwrap(), [Label::Surface, Label::Interior]);
        assert_eq!(source.warnings[0].code, "labels_used");
    }
}

#[test]
fn other_first_lines_are_a_count_or_are_skipped() {
    let (cloud, source) = load(b"2\n1 2 3\n4 5 6\n", "a.pts").unwrap();
    assert_eq!(cloud.points.len(), 2);
    assert!(source.warnings.is_empty());
    assert_eq!(code(b"3\n1 2 3\n4 5 6\n", "a.pts"), "cloud_truncated");
    assert_eq!(warnings(b"a b c\n1 2 3\n", "a.csv"), ["header_ignored"]);
}

#[test]
fn rows_that_do_not_fit_are_named_by_their_line() {
    for (file, wrong) in [
        ("1 2 3\n\n# note\n4 5\n", 4),
        ("1 2 3\r\n4 5 6 7\r\n", 2),
        ("x,y,z\n1,2,3\n4,5\n", 3),
        ("1 2 3\n4 5 6\n7 8 9 10\n", 3),
        ("1 2 3 4\n5 6 7\n8 9 10\n", 1),
        ("1 2 3\n4 five 6\n", 2),
        ("1 2 three\n", 1),
        ("1,5;2,5;3,5\n", 1),
        ("1,5 2,5 3,5\n", 1),
    ] {
        match load(file.as_bytes(), "a.csv") {
            Err(Error::Row { line, .. }) => assert_eq!(line, wrong, "{file}"),
            other => panic!("{file}: {other:?}"),
        }
    }
}

#[test]
fn tables_without_three_coordinates_are_refused() {
    assert_eq!(code(b"1 2\n3 4\n", "a.xyz"), "cloud_no_coordinates");
    assert_eq!(code(b"x,y,w\n1,2,3\n", "a.csv"), "cloud_no_coordinates");
    assert_eq!(code(b"x,y,z\n1,2,3,4\n", "a.csv"), "cloud_header");
    assert_eq!(code(b"x,y,z\n", "a.csv"), "cloud_empty");
    assert_eq!(code(b"# nothing\n\n", "a.csv"), "cloud_empty");
}
