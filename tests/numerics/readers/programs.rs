//! Tables as programs write them: each must give the points of a torus, whatever else is in it.

use std::fmt::Write as _;

use meshway::reconstruction::cloud::Label;

use super::{code, load, warnings};

pub(super) const COUNT: usize = 60;

pub(super) type Vec3 = [f64; 3];

/// Points on a torus away from the origin, rounded to millimetres.
pub(super) fn points() -> Vec<Vec3> {
    (0..COUNT).map(|i| at(i).0).collect()
}

/// A point and its normal.
fn at(i: usize) -> (Vec3, Vec3) {
    let (u, v) = (i as f64 * 2.4, i as f64 * 4.7);
    let normal = [u.cos() * v.cos(), u.sin() * v.cos(), v.sin()];
    let middle = [12.0 + u.cos(), 7.0 + u.sin(), 3.0];
    let point = |k: usize| middle[k] + 0.35 * normal[k];
    (
        std::array::from_fn(|k| (point(k) * 1000.0).round() / 1000.0),
        normal,
    )
}

/// A file of one line a point.
pub(super) fn rows(row: impl Fn(usize, Vec3) -> String) -> String {
    let line = |i| row(i, at(i).0) + "\n";
    (0..COUNT).map(line).collect()
}

pub(super) fn plain(separator: &str) -> String {
    rows(|_, [x, y, z]| format!("{x}{separator}{y}{separator}{z}"))
}

/// Checks that a file gives the points, without normals and labels, with the given warnings.
pub(super) fn gives_points(file: &[u8], name: &str, expected: &[&str]) {
    let (cloud, _) = load(file, name).unwrap_or_else(|error| panic!("{name}: {error}"));
    assert_eq!(cloud.points, points(), "{name}");
    assert_eq!(cloud.normals, None, "{name}");
    assert_eq!(cloud.labels, None, "{name}");
    assert_eq!(warnings(file, name), expected, "{name}");
}

#[test]
fn headers_of_programs_name_the_coordinates() {
    let numbered = rows(|i, [x, y, z]| format!("{},{x},{y},{z}", i * 3));
    let scalars = rows(|i, [x, y, z]| format!("{i},0.5,-0.25,{x},{y},{z}"));
    for (header, body) in [
        (
            "\"p\",\"U:0\",\"U:1\",\"Points:0\",\"Points:1\",\"Points:2\"",
            &scalars,
        ),
        ("p,U_0,U_1,Points_0,Points_1,Points_2", &scalars),
        ("Point,Easting,Northing,Elevation", &numbered),
        ("id,pos_x,pos_y,pos_z", &numbered),
        ("index,X(m),Y(m),Z(m)", &numbered),
        ("Nr,X [mm],Y [mm],Z [mm]", &numbered),
        ("nr,l,p,s", &numbered),
        ("# columns = id,x,y,z", &numbered),
        ("#id X Y Z", &numbered),
        // Tables of R do not name the names of the rows.
        (
            "x,y,z",
            &rows(|i, [x, y, z]| format!("\"{i}\",{x},{y},{z}")),
        ),
    ] {
        gives_points(format!("{header}\n{body}").as_bytes(), header, &[]);
    }
    let swapped = rows(|_, [x, y, z]| format!("{y} {x} {z}"));
    gives_points(format!("N E H\n{swapped}").as_bytes(), "a.txt", &[]);
}

#[test]
fn names_that_are_nearly_coordinates_are_refused() {
    for (header, reason) in [
        ("lat,lon,h", "latitude"),
        ("x,y,depth", "not all of x, y and z"),
    ] {
        let file = format!("{header}\n{}", plain(","));
        let message = load(file.as_bytes(), "a.csv").unwrap_err().to_string();
        assert!(message.contains(reason), "{message}");
    }
    let local = rows(|i, [x, y, z]| format!("{i},0,1,{x},{y},{z}"));
    let file = format!("world_x,world_y,world_z,x,y,z\n{local}");
    gives_points(file.as_bytes(), "a.csv", &["columns_ambiguous"]);
}

#[test]
fn unnamed_columns_are_told_by_their_values() {
    let ignored = ["columns_ignored"];
    for (name, file) in [
        (
            "class",
            rows(|i, [x, y, z]| format!("{x} {y} {z} {}", i % 2)),
        ),
        (
            "colours",
            rows(|i, [x, y, z]| format!("{x} {y} {z} {} 0.5 0.1", i as f64 / 60.0)),
        ),
        (
            "bytes",
            rows(|i, [x, y, z]| format!("{x} {y} {z} {} 7 255", i % 2)),
        ),
        (
            "words",
            rows(|i, [x, y, z]| format!("{x} {y} {z} {} 1 65535", i * 1000)),
        ),
        (
            "returns",
            rows(|i, [x, y, z]| format!("{x} {y} {z} -{} 1 2", i * 9)),
        ),
        (
            "number",
            rows(|i, [x, y, z]| format!("{} {x} {y} {z}", 7 * i + 100)),
        ),
        ("name", rows(|i, [x, y, z]| format!("P{i};{x};{y};{z}"))),
        (
            "pts",
            format!(
                "{COUNT}\n{}",
                rows(|i, [x, y, z]| format!("{x} {y} {z} -{i} 1 2 3"))
            ),
        ),
    ] {
        gives_points(file.as_bytes(), name, &ignored);
    }
    let normals = rows(|i, [x, y, z]| {
        let (_, [nx, ny, nz]) = at(i);
        format!("{x} {y} {z} 10 20 30 {nx:.3} {ny:.3} {nz:.3}")
    });
    let (cloud, _) = load(normals.as_bytes(), "a.xyz").unwrap();
    assert_eq!(cloud.points, points());
    let read = cloud.normals.unwrap();
    assert!((read[5][1] - at(5).1[1]).abs() < 1e-3);
    let message = &load(normals.as_bytes(), "a.xyz").unwrap().1.warnings[0].message;
    assert!(message.contains("7, 8, 9"), "{message}");
}

#[test]
fn spellings_of_cells_are_understood() {
    let fortran = |v: f64| format!("{v:E}").replace('E', "D");
    for (name, file) in [
        (
            "quotes",
            rows(|_, [x, y, z]| format!("\"{x}\",\"{y}\",\"{z}\"")),
        ),
        ("fortran", rows(|_, p| p.map(fortran).join(" "))),
        (
            "minus",
            rows(|_, p| p.map(|v| format!("\u{2212}{}", -v)).join(",")).replace("\u{2212}-", ""),
        ),
        ("brackets", rows(|_, [x, y, z]| format!("[{x}, {y}, {z}],"))),
        ("tabs", rows(|_, [x, y, z]| format!("\t{x}\t{y}\t{z}\t"))),
        ("open", rows(|_, [x, y, z]| format!("{x},{y},{z},"))),
        ("excel", format!("\u{feff}sep=;\r\nX;Y;Z\r\n{}", plain(";"))),
        ("count", format!("//X Y Z\n{COUNT}\n{}", plain(" "))),
    ] {
        gives_points(file.as_bytes(), name, &[]);
    }
}

#[test]
fn words_above_the_rows_are_skipped_and_told() {
    let file = format!(
        "Scanner 3.1\nDate: 2020-01-01 10:00\nScale 1 1 1\nPoints: {COUNT}\nx y z\n{}",
        plain(" ")
    );
    gives_points(file.as_bytes(), "a.txt", &["preamble_skipped"]);
    let message = &load(file.as_bytes(), "a.txt").unwrap().1.warnings[0].message;
    assert!(message.contains("line 1 to line 4"), "{message}");
}

#[test]
fn empty_cells_are_points_without_a_place() {
    for (separator, empty) in [
        (",", "NaN,,"),
        (",", "1,,2"),
        ("\t", "\t1\t2"),
        (" ", "1 NA 2"),
        (";", "1;2;"),
    ] {
        // In front of all rows, and among them.
        let body = plain(separator);
        let file = format!("x{separator}y{separator}z\n{empty}\n{body}{empty}\n");
        gives_points(file.as_bytes(), empty, &["points_not_finite"]);
        assert_eq!(load(file.as_bytes(), "a").unwrap().1.dropped_non_finite, 2);
    }
}

#[test]
fn the_content_wins_over_a_wrong_ending() {
    for name in ["a.pcd", "a.ply", "a.obj", "a.npy"] {
        gives_points(plain(" ").as_bytes(), name, &["format_by_content"]);
    }
    for name in ["a.bin", "a", "a.xyzrgb"] {
        gives_points(plain("\t").as_bytes(), name, &[]);
    }
}

#[test]
fn point_lists_may_hold_several_clouds() {
    let text = plain(" ");
    let lines: Vec<_> = text.lines().collect();
    let (first, second) = (lines[..40].join("\n"), lines[40..].join("\n"));
    let file = format!("40\n{first}\n20\n{second}\n");
    gives_points(file.as_bytes(), "a.pts", &[]);
    let short = format!("40\n{first}\n21\n{second}\n");
    assert_eq!(code(short.as_bytes(), "a.pts"), "cloud_truncated");
}

/// A scan of a grid whose last point has no return, moved by a matrix.
fn ptx(points: &[Vec3], shift: Vec3) -> String {
    let [dx, dy, dz] = shift;
    let mut file = format!(
        "{}\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n{dx} {dy} {dz} 1\n",
        points.len() + 1
    );
    for [x, y, z] in points {
        // Turned by a quarter, which the matrix turns back.
        writeln!(file, "{} {} {} 0.5", y - dy, dx - x, z - dz).unwrap();
    }
    file + "0 0 0 0.5\n"
}

#[test]
fn scans_are_moved_into_the_common_frame() {
    let all = points();
    let file = ptx(&all[..40], [1.0, 2.0, 3.0]) + &ptx(&all[40..], [-4.0, 0.5, 0.0]);
    let (cloud, source) = load(file.as_bytes(), "a.ptx").unwrap();
    let rounded: Vec<_> = cloud
        .points
        .iter()
        .map(|p| p.map(|v| (v * 1000.0).round() / 1000.0))
        .collect();
    assert_eq!(rounded, all);
    assert_eq!(source.dropped_non_finite, 2);
    let end = file[..file.len() - 30].rfind('\n').unwrap();
    assert_eq!(code(&file.as_bytes()[..=end], "a.ptx"), "cloud_truncated");
}

/// Points of a torus with labels, and points on the circle in its middle with label 1.
fn labelled(count: usize, inside: usize, label: impl Fn(usize) -> String) -> String {
    let row = |i: usize| {
        let [x, y, z] = at(i).0;
        format!("{x},{y},{z},{}\n", label(i))
    };
    let middle = |i: usize| {
        let angle = 0.7 * i as f64;
        format!("{},{},3,1\n", 12.0 + angle.cos(), 7.0 + angle.sin())
    };
    let rows = (0..count).map(row).chain((0..inside).map(middle));
    "x,y,z,label\n".to_owned() + &rows.collect::<String>()
}

#[test]
fn labels_that_are_classes_are_told_and_ignored() {
    let classes: [fn(usize) -> String; 5] = [
        |_| "1".to_owned(),
        |_| "20".to_owned(),
        |i| (i % 3).to_string(),
        |_| "wall".to_owned(),
        |_| String::new(),
    ];
    for class in classes {
        let file = labelled(COUNT, 0, class);
        gives_points(file.as_bytes(), "a.csv", &["labels_ignored"]);
    }
    let halves = labelled(600, 0, |i| (i * i % 7 % 2).to_string());
    assert_eq!(warnings(halves.as_bytes(), "a.csv"), ["labels_ignored"]);
    assert_eq!(load(halves.as_bytes(), "a.csv").unwrap().0.labels, None);
    for count in [COUNT, 600] {
        let file = labelled(count, 9, |_| "0".to_owned());
        let (cloud, _) = load(file.as_bytes(), "a.csv").unwrap();
        assert_eq!(cloud.indices(Label::Interior).count(), 9);
        assert_eq!(warnings(file.as_bytes(), "a.csv"), ["labels_used"]);
    }
}

#[test]
fn lost_digits_are_told_by_the_reader() {
    let far = rows(|_, [x, y, z]| {
        let single = |v: f64| f64::from(v as f32);
        format!(
            "{} {} {}",
            single(512_434.0 + x),
            single(5_405_590.0 + y),
            single(z)
        )
    });
    let told = warnings(far.as_bytes(), "a.xyz");
    assert!(told.contains(&"coordinates_coarse"), "{told:?}");
}
