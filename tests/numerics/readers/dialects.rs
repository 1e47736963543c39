//! Formats of their own in the dialects of programs, and formats that are not read.

use std::fmt::Write as _;

use super::programs::{COUNT, Vec3, gives_points, plain, points, rows};
use super::{code, load};

#[test]
fn ply_headers_of_programs_are_read() {
    let head = |more: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {COUNT}\nproperty float x\nproperty float y\n\
             property float z\n{more}end_header\n"
        )
    };
    let many: String = (0..300).fold(String::new(), |text, i| {
        text + &format!("property float s{i}\n")
    });
    let zeros = " 0".repeat(300);
    for (name, file) in [
        ("bare", head("element face 0\n") + &plain(" ")),
        (
            "camera",
            head("element face 0\nelement camera 1\nproperty float f\n") + &plain(" ") + "1\n",
        ),
        (
            "twice",
            head("property float i\nproperty float i\nproperty float x\n")
                + &rows(|i, [x, y, z]| format!("{x} {y} {z} {i} 2 3")),
        ),
        (
            "types",
            head("property int64 id\nproperty bool keep\nproperty list uint8 long l\n")
                + &rows(|i, [x, y, z]| format!("{x} {y} {z} {i} 1 1 9")),
        ),
        (
            "many",
            head(&many) + &rows(|_, [x, y, z]| format!("{x} {y} {z}{zeros}")),
        ),
        (
            "comment",
            head(&format!("comment {}\n", "crs ".repeat(3000))) + &plain(" "),
        ),
        ("among", head("") + "comment a\n" + &plain(" ")),
    ] {
        gives_points(file.as_bytes(), name, &[]);
    }
    let mut binary = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty int64 id\n\
        property float x\nproperty uint64 n\nproperty half y\nproperty bool b\nproperty double z\n\
        element face 0\nend_header\n"
        .to_vec();
    binary.extend(7i64.to_le_bytes());
    binary.extend(1.5f32.to_le_bytes());
    binary.extend(8u64.to_le_bytes());
    binary.extend(0xc000_u16.to_le_bytes());
    binary.push(1);
    binary.extend(0.25f64.to_le_bytes());
    assert_eq!(
        load(&binary, "a.ply").unwrap().0.points,
        [[1.5, -2.0, 0.25]]
    );
}

#[test]
fn stl_of_other_spelling_is_read() {
    let facets: Vec<Vec3> = points();
    let text = |end: &str, vertex: &str| {
        let mut file = "solid a part\n".to_owned();
        for facet in facets.chunks(3) {
            file += "facet normal nan nan nan\nouter loop\n";
            for [x, y, z] in facet {
                writeln!(file, "{vertex} {x} {y} {z}").unwrap();
            }
            file += "end loop\nendfacet\n";
        }
        file + end
    };
    gives_points(text("end solid a\n", "vertex").as_bytes(), "a.stl", &[]);
    let upper = text("endsolid\n", "vertex").to_uppercase();
    gives_points(upper.as_bytes(), "a.stl", &[]);
    gives_points(upper.as_bytes(), "a", &[]);
    // Written as a stream, without the number of facets.
    let mut stream = vec![0; 84];
    stream.extend([0; 12]);
    let corners = (0..9u8).flat_map(|v| f32::from(v).to_le_bytes());
    stream.extend(corners);
    stream.extend([0; 2]);
    assert_eq!(load(&stream, "a.stl").unwrap().0.points[2], [6.0, 7.0, 8.0]);
}

#[test]
fn obj_lines_may_go_on() {
    let file = rows(|_, [x, y, z]| format!("v {x} {y} \\\n {z} 0.5 0.5 0.5"));
    gives_points(format!("# C:\\\n{file}").as_bytes(), "a.obj", &[]);
}

/// An array of NumPy from its dictionary and its data.
fn npy(dictionary: &str, data: impl IntoIterator<Item = u8>) -> Vec<u8> {
    let mut file = b"\x93NUMPY\x01\0".to_vec();
    file.extend((dictionary.len() as u16).to_le_bytes());
    file.extend(dictionary.as_bytes());
    file.extend(data);
    file
}

fn doubles(values: impl IntoIterator<Item = f64>) -> impl Iterator<Item = u8> {
    values.into_iter().flat_map(f64::to_le_bytes)
}

#[test]
fn arrays_of_any_shape_are_read() {
    let all = points();
    let plain =
        |shape: &str| format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n");
    let homogeneous = all.iter().flat_map(|&[x, y, z]| [x, y, z, 1.0]);
    gives_points(
        &npy(&plain("(60, 4)"), doubles(homogeneous)),
        "a.npy",
        &["columns_ignored"],
    );
    let transposed = (0..3).flat_map(|axis| points().into_iter().map(move |p| p[axis]));
    gives_points(
        &npy(&plain("(3, 60)"), doubles(transposed)),
        "a.npy",
        &["array_transposed"],
    );
    let image = all.iter().flatten().copied();
    gives_points(&npy(&plain("(6, 10, 3)"), doubles(image)), "a.npy", &[]);
    assert_eq!(
        code(&npy(&plain("(180,)"), doubles(all.concat())), "a.npy"),
        "cloud_no_coordinates"
    );
    let descr = "[('id', '<U3'), ('z', '<f8'), ('rgb', '|u1', (3,)), (('title', 'x'), '>f8'), ('y', '<f8')]";
    let fields = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': (60,), }}\n");
    let records = all.iter().flat_map(|[x, y, z]| {
        [
            &[0; 12][..],
            &z.to_le_bytes(),
            &[1, 2, 3],
            &x.to_be_bytes(),
            &y.to_le_bytes(),
        ]
        .concat()
    });
    gives_points(&npy(&fields, records.collect::<Vec<_>>()), "a.npy", &[]);
    let part = "{'descr': [('xyz', '<f8', (3,))], 'fortran_order': False, 'shape': (60,), }\n";
    gives_points(&npy(part, doubles(all.concat())), "a.npy", &[]);
    let half = "{'descr': '<f2', 'fortran_order': False, 'shape': (1, 3), }\n";
    let (cloud, _) = load(&npy(half, [0, 0x3c, 0, 0xc0, 0, 0x38]), "a.npy").unwrap();
    assert_eq!(cloud.points, [[1.0, -2.0, 0.5]]);
    for (descr, word) in [
        ("'|O'", "objects"),
        ("'<c16'", "f4"),
        ("[('a', '<f8')]", "fields"),
    ] {
        let file = npy(
            &format!("{{'descr': {descr}, 'fortran_order': False, 'shape': (9, 3), }}\n"),
            [0; 999],
        );
        let message = load(&file, "a.npy").unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    }
}

#[test]
fn formats_that_are_not_read_are_named_with_a_way_out() {
    let at = |place: usize, mark: &[u8]| [&vec![0; place], mark, &[0; 40]].concat();
    let las = |format: u8| {
        let mut file = at(0, b"LASF");
        file.resize(400, 0);
        file[104] = format;
        file
    };
    for (file, name) in [
        (las(3), "LAS"),
        (las(0x83), "LAZ"),
        (at(0, b"ASTM-E57"), "E57"),
        (
            b"# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_GRID\n".to_vec(),
            "VTK",
        ),
        (
            b"<?xml version=\"1.0\"?>\n<!-- x -->\n<VTKFile>".to_vec(),
            "VTK",
        ),
        (at(0, b"PK\x03\x04"), "ZIP"),
        (at(0, b"PK\x03\x04 points.npy"), "NPZ"),
        (at(0, b"glTF"), "glTF"),
        (b"{\n \"asset\": {}}".to_vec(), "glTF"),
        (b"{ \"markups\": []}".to_vec(), "Slicer"),
        (b"** made by\n*Node\n1, 0, 0, 0\n".to_vec(), "Abaqus"),
        (b"ncols 4\nnrows 4\n1 2 3 4\n".to_vec(), "ESRI"),
        (b"<!DOCTYPE html><html>".to_vec(), "web page"),
        (
            [0.5f32, 1.0, 2.0, 3.5]
                .iter()
                .flat_map(|v| v.to_le_bytes())
                .collect(),
            "binary",
        ),
    ] {
        for ending in ["a", "a.dat", "a.las"] {
            let message = load(&file, ending).unwrap_err().to_string();
            assert!(message.contains(name), "{name}: {message}");
            let ways = ["export", "convert", "save", "unpack", "download"];
            assert!(ways.iter().any(|way| message.contains(way)), "{message}");
            assert_eq!(code(&file, ending), "unsupported_format");
        }
    }
}
