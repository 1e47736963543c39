//! One small cloud, written in every format and variant.

use std::fmt::Write as _;
use std::io::Write as _;

use flate2::Compression;
use flate2::write::GzEncoder;
use meshway::reconstruction::cloud::{Label, PointCloud};

/// Points whose coordinates are exact in f32, with axis-parallel normals and all three labels.
pub(super) fn cloud() -> PointCloud {
    let grid = |i: u32| f64::from(i) * 0.375 - 2.5;
    let points: Vec<_> = (0..40)
        .map(|i| [grid(i), grid(i * i % 11), grid(i * 7 % 13)])
        .collect();
    let axis = |i: usize| [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]][i % 3];
    let label = |i: usize| [Label::Surface, Label::Interior, Label::Exterior][i % 3];
    PointCloud {
        normals: Some((0..points.len()).map(axis).collect()),
        labels: Some((0..points.len()).map(label).collect()),
        points,
        ..PointCloud::default()
    }
}

/// A file, and which parts of [`cloud`] it holds.
pub(crate) struct File {
    pub(crate) name: &'static str,
    pub(crate) bytes: Vec<u8>,
    pub(crate) normals: bool,
    pub(crate) labels: bool,
}

impl File {
    fn new(name: &'static str, bytes: impl Into<Vec<u8>>, normals: bool, labels: bool) -> Self {
        Self {
            name,
            bytes: bytes.into(),
            normals,
            labels,
        }
    }
}

/// The cloud in every format and variant.
pub(crate) fn all() -> Vec<File> {
    vec![
        File::new("ascii.ply", ply("ascii"), true, true),
        File::new("little.ply", ply("binary_little_endian"), true, true),
        File::new("big.ply", ply("binary_big_endian"), true, true),
        File::new("points.xyz", text(3, " "), false, false),
        File::new("normals.xyzn", text(6, "\t"), true, false),
        File::new("labels.txt", labelled_text(), false, true),
        File::new("all.csv", text(7, ","), true, true),
        File::new("all.tsv", text(7, "; "), true, true),
        File::new("cloud.obj", obj(), true, false),
        File::new("cloud.off", off(false), false, false),
        File::new("normals.off", off(true), true, false),
        File::new("ascii.stl", stl_ascii(), false, false),
        File::new("binary.stl", stl_binary(), false, false),
        File::new("ascii.pcd", pcd("ascii"), true, true),
        File::new("binary.pcd", pcd("binary"), true, true),
        File::new("compressed.pcd", pcd("binary_compressed"), true, true),
        File::new("f4.npy", npy("<f4", 3, false), false, false),
        File::new("f8.npy", npy(">f8", 6, false), true, false),
        File::new("fortran.npy", npy("<f8", 6, true), true, false),
    ]
}

pub(super) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// x, y, z, normal, label of each point.
fn rows() -> Vec<[f64; 7]> {
    let cloud = cloud();
    let normals = cloud.normals.clone().unwrap();
    let row = |(i, [x, y, z]): (usize, [f64; 3])| {
        let [nx, ny, nz] = normals[i];
        [x, y, z, nx, ny, nz, cloud.label(i).target()]
    };
    cloud.points.iter().copied().enumerate().map(row).collect()
}

/// Names of the columns where there are labels, which only a name tells.
fn text(columns: usize, separator: &str) -> String {
    let line = |row: [f64; 7]| {
        row[..columns]
            .iter()
            .map(f64::to_string)
            .collect::<Vec<_>>()
    };
    let names = ["x", "y", "z", "nx", "ny", "nz", "label"];
    let names = (columns == 7).then(|| names.join(separator));
    let lines = rows().into_iter().map(|row| line(row).join(separator));
    names
        .into_iter()
        .chain(lines)
        .collect::<Vec<_>>()
        .join("\n")
}

fn labelled_text() -> String {
    let line = |row: [f64; 7]| format!("{} {} {} {}\r\n", row[0], row[1], row[2], row[6]);
    let rows: String = rows().into_iter().map(line).collect();
    "x y z label\r\n".to_owned() + &rows
}

/// Vertices as double, float and char; before them an element with a list, behind them faces.
fn ply(encoding: &str) -> Vec<u8> {
    let rows = rows();
    let mut file = format!(
        "ply\nformat {encoding} 1.0\ncomment a note\nelement camera 2\n\
         property list uchar short view\nproperty float focus\nelement vertex {}\n\
         property double x\nproperty uchar red\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\nproperty char label\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n",
        rows.len()
    )
    .into_bytes();
    if encoding == "ascii" {
        file.extend(b"2 7 8 0.5\n0 0.25\n");
        for [x, y, z, nx, ny, nz, label] in rows {
            writeln!(file, "{x:E} 255 {y} {z} {nx} {ny} {nz} {label}").unwrap();
        }
        file.extend(b"3 0 1 2\n");
        return file;
    }
    let big = encoding == "binary_big_endian";
    let mut put = |mut bytes: Vec<u8>| {
        if big {
            bytes.reverse();
        }
        file.extend(bytes);
    };
    let float = |v: f64| (v as f32).to_le_bytes().to_vec();
    for view in [&[7i16, 8][..], &[]] {
        put(vec![view.len() as u8]);
        for v in view {
            put(v.to_le_bytes().to_vec());
        }
        put(float(0.5));
    }
    for row in rows {
        put(row[0].to_le_bytes().to_vec());
        put(vec![255]);
        row[1..6].iter().for_each(|&v| put(float(v)));
        put(vec![row[6] as i8 as u8]);
    }
    put(vec![3]);
    (0..3i32).for_each(|v| put(v.to_le_bytes().to_vec()));
    file
}

fn obj() -> String {
    let mut file = "# a note\nmtllib a.mtl\no cloud\n".to_owned();
    for [x, y, z, nx, ny, nz, _] in rows() {
        writeln!(file, "v {x} {y} {z}\nvn {nx} {ny} {nz}").unwrap();
    }
    file + "f 1//1 2//2 3//3\n"
}

fn off(normals: bool) -> String {
    let rows = rows();
    let keyword = if normals {
        "CNOFF # a note\n\n"
    } else {
        "OFF\n"
    };
    let mut file = format!("{keyword}{} 1 0\n", rows.len());
    for [x, y, z, nx, ny, nz, _] in rows {
        if normals {
            writeln!(file, "{x} {y} {z} {nx} {ny} {nz} 255 0 0 255").unwrap();
        } else {
            writeln!(file, "{x} {y} {z}").unwrap();
        }
    }
    file + "3 0 1 2\n"
}

/// Triangles over the points, each point in several of them, first met in order.
fn facets() -> Vec<[[f64; 3]; 3]> {
    let points = cloud().points;
    points.windows(3).map(|w| [w[0], w[1], w[2]]).collect()
}

fn stl_ascii() -> String {
    let mut file = "solid cloud\n".to_owned();
    for facet in facets() {
        file += " facet normal 0 0 1\n  outer loop\n";
        for [x, y, z] in facet {
            writeln!(file, "   vertex {x:e} {y} {z}").unwrap();
        }
        file += "  endloop\n endfacet\n";
    }
    file + "endsolid cloud\n"
}

fn stl_binary() -> Vec<u8> {
    let facets = facets();
    // A header that starts like the text form, as some programs write it.
    let mut file = b"solid".to_vec();
    file.resize(80, b' ');
    file.extend((facets.len() as u32).to_le_bytes());
    for facet in facets {
        file.extend([0; 12]);
        let values = facet.into_iter().flatten();
        file.extend(values.flat_map(|v| (v as f32).to_le_bytes()));
        file.extend([0; 2]);
    }
    file
}

/// Floats and doubles, padding, and the label as a signed byte.
fn pcd(data: &str) -> Vec<u8> {
    let rows = rows();
    let n = rows.len();
    let mut file = format!(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z _ normal_x normal_y normal_z label\n\
         SIZE 4 8 4 1 4 4 4 1\nTYPE F F F U F F F I\nCOUNT 1 1 1 2 1 1 1 1\nWIDTH {n}\nHEIGHT 1\n\
         VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {data}\n"
    )
    .into_bytes();
    let float = |v: f64| (v as f32).to_le_bytes().to_vec();
    let fields = |row: &[f64; 7]| {
        let [x, y, z, nx, ny, nz, label] = *row;
        let padding = vec![9, 9];
        let y = y.to_le_bytes().to_vec();
        let label = vec![label as i8 as u8];
        [
            float(x),
            y,
            float(z),
            padding,
            float(nx),
            float(ny),
            float(nz),
            label,
        ]
    };
    match data {
        "ascii" => {
            for [x, y, z, nx, ny, nz, label] in rows {
                writeln!(file, "{x} {y} {z} 9 9 {nx} {ny} {nz} {label}").unwrap();
            }
        }
        "binary" => file.extend(rows.iter().flat_map(fields).flatten()),
        _ => {
            let table =
                (0..8).flat_map(|k| rows.iter().flat_map(move |row| fields(row)[k].clone()));
            let table: Vec<u8> = table.collect();
            // Literals only; copies are tested with the decoder.
            let packed: Vec<u8> = table
                .chunks(32)
                .flat_map(|chunk| [&[chunk.len() as u8 - 1], chunk].concat())
                .collect();
            file.extend((packed.len() as u32).to_le_bytes());
            file.extend((table.len() as u32).to_le_bytes());
            file.extend(packed);
        }
    }
    file
}

pub(super) fn npy(descr: &str, columns: usize, fortran: bool) -> Vec<u8> {
    let rows = rows();
    let n = rows.len();
    let (python, version) = if fortran { ("True", 2) } else { ("False", 1) };
    let mut text =
        format!("{{'descr': '{descr}', 'fortran_order': {python}, 'shape': ({n}, {columns}), }}");
    text += &" ".repeat(117 - text.len());
    text.push('\n');
    let mut file = b"\x93NUMPY".to_vec();
    file.extend([version, 0]);
    match version {
        1 => file.extend((text.len() as u16).to_le_bytes()),
        _ => file.extend((text.len() as u32).to_le_bytes()),
    }
    file.extend(text.as_bytes());
    let mut put = |v: f64| match descr {
        "<f4" => file.extend((v as f32).to_le_bytes()),
        "<f8" => file.extend(v.to_le_bytes()),
        _ => file.extend(v.to_be_bytes()),
    };
    if fortran {
        for c in 0..columns {
            for row in &rows {
                put(row[c]);
            }
        }
    } else {
        for v in rows.iter().flat_map(|row| &row[..columns]) {
            put(*v);
        }
    }
    file
}
