//! Texts that may name somebody: gone from a cleaned file, which is read as the same cloud.
#![expect(
    clippy::format_collect,
    reason = "files of a few lines, where it is the shortest way to write them"
)]

mod dicom;

use std::io::{Read, Write};

use flate2::Compression;
use flate2::GzBuilder;
use flate2::read::{DeflateDecoder, MultiGzDecoder};
use flate2::write::{DeflateEncoder, GzEncoder};
use meshway::reconstruction::cloud::{Format, Limits, Opened, Options, cleaned, open};

use crate::medical;
use crate::readers::files;

/// What is looked for.
const NAME: &str = "Rossi^Anna";

fn options(hint: Option<Format>, limits: &Limits) -> Options<'_> {
    Options {
        hint,
        limits,
        assume_orientation: true,
    }
}

/// All that reading tells of a file, and its format; `None` if it is refused.
fn reading(bytes: &[u8], hint: Option<Format>, limits: &Limits) -> Option<(String, Format)> {
    let read = open(bytes, &options(hint, limits), |opened, warnings| {
        Ok(match opened {
            Opened::Points(cloud) => format!("{cloud:?} {warnings:?}"),
            Opened::Slices(slices) => {
                let items = 0..slices.contents().parts.items.len();
                let planes: Vec<_> = items
                    .map(|i| (slices.geometry(i), slices.planes(i).collect::<Vec<_>>()))
                    .collect();
                format!("{:?} {planes:?} {warnings:?}", slices.contents())
            }
        })
    });
    let (told, source) = read.ok()?;
    Some((format!("{told} {source:?}"), source.format))
}

/// Cleans a file that may be anything, and holds what must hold: it is read as before, there is nothing left
/// to clean, and what was not packed has as many bytes. What the file is cleaned to, if there was anything.
pub(crate) fn clean(bytes: &[u8], hint: Option<Format>, limits: &Limits) -> Option<Vec<u8>> {
    let (_, format) = reading(bytes, hint, limits)?;
    // Whoever reads a kept file knows its format.
    let hint = Some(format);
    let (before, _) = reading(bytes, hint, limits)?;
    let clean = cleaned(bytes, &options(hint, limits)).unwrap()?;
    assert!(clean.texts > 0);
    let after = reading(&clean.bytes, hint, limits).map(|(after, _)| after);
    if after.as_deref() != Some(before.as_str()) {
        let (before, after) = (
            excerpt(before.as_bytes()),
            excerpt(after.unwrap_or_default().as_bytes()),
        );
        panic!(
            "read otherwise: {}\n{}\n{before}\n{after}",
            excerpt(bytes),
            excerpt(&clean.bytes)
        );
    }
    let again = cleaned(&clean.bytes, &options(hint, limits)).unwrap();
    if let Some(again) = again {
        panic!("{} texts are left: {}", again.texts, excerpt(&again.bytes));
    }
    Some(clean.bytes)
}

fn excerpt(bytes: &[u8]) -> String {
    let end = bytes.len().min(1500);
    bytes[..end].escape_ascii().to_string()
}

fn unpacked(bytes: &[u8]) -> Vec<u8> {
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return bytes.to_vec();
    }
    let mut content = Vec::new();
    MultiGzDecoder::new(bytes)
        .read_to_end(&mut content)
        .unwrap();
    content
}

fn names(bytes: &[u8]) -> usize {
    let is_name = |part: &&[u8]| part == &NAME.as_bytes();
    bytes.windows(NAME.len()).filter(is_name).count()
}

/// A file names somebody so many times, and no more once it is cleaned.
#[track_caller]
fn expect_gone(bytes: &[u8], name: &str, times: usize) -> Vec<u8> {
    assert_eq!(names(&unpacked(bytes)), times, "{name}");
    let hint = Format::from_extension(name);
    let limits = Limits::default();
    let clean = clean(bytes, hint, &limits).unwrap_or_else(|| panic!("{name} is refused"));
    let content = unpacked(&clean);
    assert_eq!(names(&content), 0, "{name}: {}", excerpt(&content));
    assert_eq!(content.len(), unpacked(bytes).len(), "{name}");
    content
}

/// A text with the name in the places of marks.
fn named(text: &str) -> Vec<u8> {
    text.replace('@', NAME).into_bytes()
}

fn holds(bytes: &[u8], part: &str) -> bool {
    bytes
        .windows(part.len())
        .any(|window| window == part.as_bytes())
}

#[test]
fn every_file_is_read_as_before_without_its_texts() {
    let limits = Limits::default();
    let mut cleaned = 0;
    for file in files::all() {
        let hint = Format::from_extension(file.name);
        assert!(
            reading(&file.bytes, hint, &limits).is_some(),
            "{}",
            file.name
        );
        cleaned += usize::from(clean(&file.bytes, hint, &limits).is_some());
    }
    for (name, bytes) in medical::files() {
        let hint = Format::from_extension(&name);
        assert!(reading(&bytes, hint, &limits).is_some(), "{name}");
        cleaned += usize::from(clean(&bytes, hint, &limits).is_some());
    }
    // All of DICOM, and others in which a program says that it wrote them.
    assert!(cleaned > 15, "{cleaned}");
}

#[test]
fn comments_of_lines_are_gone_and_the_frame_stays() {
    let points: String = (0..30)
        .map(|i| format!("{} {} {}\n", i, i * i % 7, i * 3 % 5))
        .collect();
    let ply = "ply\nformat ascii 1.0\ncomment by @ SPACE=LPS unit=mm\nobj_info @\nelement vertex 30\n\
        property float x\nproperty float y\nproperty float z\nend_header\n";
    let content = expect_gone(&named(&(ply.to_owned() + &points)), "a.ply", 2);
    assert!(holds(&content, "SPACE=LPS unit=mm"));
    let vertices: String = points
        .lines()
        .map(|line| format!("v {line} # @\n"))
        .collect();
    let obj = format!(
        "# @ space=ras\n\nmtllib @.mtl\no @\n{vertices}g @ \\\n @\nusemtl @\nl 1 2 # @\n#@\n@ note\n"
    );
    let content = expect_gone(&named(&obj), "a.obj", 30 + 9);
    assert!(holds(&content, "space=ras") && holds(&content, "\nmtllib "));
    let off = format!("# @\nOFF\n// @\n30 0 0 # @\n{points}");
    expect_gone(&named(&off), "a.off", 3);
    let pcd = format!(
        "# .PCD v0.7 - Point Cloud Data file format\n# @\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n\
         COUNT 1 1 1\nWIDTH 30\nHEIGHT 1\nPOINTS 30\nDATA ascii\n# @\n{points}"
    );
    let content = expect_gone(&named(&pcd), "a.pcd", 2);
    assert!(holds(
        &content,
        "# .PCD v0.7 - Point Cloud Data file format\n"
    ));
}

#[test]
fn names_of_solids_are_gone_in_both_forms() {
    let facets: String = (0..12)
        .map(|i| {
            let j = i * 7 % 11;
            format!("facet normal 0 0 1 # @\nouter loop\nvertex {i} 0 {j}\nvertex {i} 1 {j}\nvertex {j} {i} 2\nendloop\nendfacet\n")
        })
        .collect();
    let text = format!("solid @ SPACE=RAS\n{facets}remark @\nendsolid @\nsolid @\nend solid @\n");
    let content = expect_gone(&named(&text), "a.stl", 12 + 5);
    assert!(holds(&content, "SPACE=RAS"));
    let mut binary = files::all()
        .into_iter()
        .find(|file| file.name == "binary.stl")
        .unwrap()
        .bytes;
    binary[..80].fill(0);
    let title = named("solid @ SPACE=LPS; by @");
    binary[..title.len()].copy_from_slice(&title);
    let content = expect_gone(&binary, "a.stl", 2);
    assert!(content.starts_with(b"solid ") && holds(&content, "SPACE=LPS"));
}

#[test]
fn tables_keep_the_names_of_their_columns() {
    let rows: String = (0..30)
        .map(|i| format!("P{i} of @,{},{},{},\"@, 1\"\n", i, i * i % 7, i * 3 % 5))
        .collect();
    let csv = format!("Patient: @\n# @\n# by @: who,x,y,z,note\n{rows}# @\n");
    let content = expect_gone(&named(&csv), "a.csv", 3 + 60 + 1);
    assert!(holds(&content, "who,x,y,z,note"), "{}", excerpt(&content));
    let plain: String = (0..30)
        .map(|i| format!("{i} {} {} @ # @\n", i * i % 7, i * 3 % 5))
        .collect();
    expect_gone(&named(&plain), "a.xyz", 60);
    let fields = format!("@\n@ age sex\nx y z\n{}", plain.replace(" @ # @", ""));
    expect_gone(&named(&fields), "a.txt", 2);
    let scan: String = (0..30)
        .map(|i| format!("{i} {} {} 0.5\n", i * i % 7, i * 3 % 5))
        .collect();
    let ptx = format!(
        "10\n3\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n# @\n{scan}"
    );
    expect_gone(&named(&ptx), "a.ptx", 1);
}

#[test]
fn words_in_arrays_are_gone() {
    let header = format!(
        "{{'descr': [('who', 'S{}'), ('x', '<f4'), ('y', '<f4'), ('z', '<f4')], 'fortran_order': False, 'shape': (20,), }}",
        NAME.len()
    );
    let mut npy = b"\x93NUMPY\x01\0".to_vec();
    npy.extend((header.len() as u16).to_le_bytes());
    npy.extend(header.as_bytes());
    for i in 0..20_u16 {
        npy.extend(NAME.as_bytes());
        npy.extend(
            [i, i * i % 7, i * 3 % 5]
                .map(|v| f32::from(v).to_le_bytes())
                .concat(),
        );
    }
    expect_gone(&npy, "a.npy", 20);
}

#[test]
fn titles_and_words_of_vtk_are_gone() {
    let points: String = (0..30)
        .map(|i| format!("{i} {} {}\n", i * i % 7, i * 3 % 5))
        .collect();
    let legacy = format!(
        "# vtk DataFile Version 4.2\n@ SPACE=RAS\nASCII\nDATASET POLYDATA\nPOINTS 30 float\n{points}\
         FIELD FieldData 1\nwho 1 2 string\nby @\n@\nPOINT_DATA 30\nNORMALS n float\n{points}"
    );
    let content = expect_gone(&named(&legacy), "a.vtk", 3);
    assert!(holds(&content, "SPACE=RAS") && holds(&content, "NORMALS n float"));
    let codes: String = NAME.bytes().map(|byte| format!("{byte} ")).collect();
    let xml = format!(
        "<?xml version=\"1.0\"?>\n<!-- @ -->\n<VTKFile type=\"PolyData\" version=\"0.1\">\n<PolyData>\n<FieldData>\
         <Array type=\"String\" Name=\"who\" NumberOfTuples=\"1\" format=\"ascii\">{codes}0</Array>\
         <Array type=\"String\" Name=\"SPACE\" NumberOfTuples=\"1\" format=\"ascii\">82 65 83 0</Array></FieldData>\n\
         <Piece NumberOfPoints=\"30\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">\n\
         {points}</DataArray></Points></Piece>\n<!-- @ <b> @ -->\n</PolyData>\n</VTKFile>\n"
    );
    let content = expect_gone(&named(&xml), "a.vtp", 3);
    assert!(!holds(&content, &codes) && holds(&content, "82 65 83 0"));
}

#[test]
fn headers_of_label_maps_are_gone() {
    for (file, texts, extension) in [
        ("nifti1_little.nii.gz", 148, 348),
        ("nifti2_big.nii.gz", 240, 540),
    ] {
        let mut bytes = unpacked(&medical::file(file));
        let wide = extension == 540;
        let mut put = |at: usize, text: &[u8]| bytes[at..at + text.len()].copy_from_slice(text);
        put(texts, NAME.as_bytes());
        put(texts + 80, NAME.as_bytes());
        put(if wide { 508 } else { 328 }, NAME.as_bytes());
        put(if wide { 525 } else { 14 }, NAME.as_bytes());
        // An extension of 32 bytes, which moves the voxels.
        let (size, code) = (32_u32, 6_u32);
        let number = |number: u32| {
            if wide {
                number.to_be_bytes()
            } else {
                number.to_le_bytes()
            }
        };
        let mut text = NAME.as_bytes().to_vec();
        text.resize(24, b'!');
        bytes[extension] = 1;
        bytes.splice(
            extension + 4..extension + 4,
            [&number(size)[..], &number(code), &text].concat(),
        );
        let start = (extension + 4 + 32) as u16;
        if wide {
            bytes[168..176].copy_from_slice(&i64::from(start).to_be_bytes());
        } else {
            bytes[108..112].copy_from_slice(&f32::from(start).to_le_bytes());
        }
        let content = expect_gone(&bytes, "a.nii", 5);
        assert_eq!(content[extension + 4..extension + 8], number(size));
        // Packed again, without the name that the file had.
        let mut packed = GzBuilder::new()
            .filename(NAME)
            .write(Vec::new(), Compression::fast());
        packed.write_all(&bytes).unwrap();
        let packed = packed.finish().unwrap();
        assert_eq!(names(&packed), 1);
        let clean = clean(&packed, Some(Format::Nifti), &Limits::default()).unwrap();
        assert_eq!((names(&clean), unpacked(&clean)), (0, content));
    }
}

#[test]
fn a_name_on_the_package_alone_is_gone() {
    let points: String = (0..30)
        .map(|i| format!("{i} {} {}\n", i * i % 7, i * 3 % 5))
        .collect();
    let mut packed = GzBuilder::new()
        .filename(NAME)
        .write(Vec::new(), Compression::fast());
    packed.write_all(points.as_bytes()).unwrap();
    let clean = clean(
        &packed.finish().unwrap(),
        Some(Format::Xyz),
        &Limits::default(),
    )
    .unwrap();
    assert_eq!(unpacked(&clean), points.as_bytes());
    assert_eq!(names(&clean), 0);
    let mut nameless = GzEncoder::new(Vec::new(), Compression::fast());
    nameless.write_all(points.as_bytes()).unwrap();
    let nameless = nameless.finish().unwrap();
    assert_eq!(
        cleaned(&nameless, &options(None, &Limits::default())).unwrap(),
        None
    );
}

#[test]
fn fields_of_nrrd_and_metaimage_are_gone_and_segments_stay() {
    let insert = |bytes: &[u8], text: &str| {
        let line = bytes.iter().position(|&byte| byte == b'\n').unwrap() + 1;
        [&bytes[..line], &named(text)[..], &bytes[line..]].concat()
    };
    let nrrd = medical::file("layers.seg.nrrd");
    let text = "# @\ncontent: @\nPatientName:=@\nSegment0_Tags:=by:@|\n";
    let content = expect_gone(&insert(&nrrd, text), "a.nrrd", 4);
    assert!(holds(&content, "Segment0_Name:="));
    let mut broken = insert(&nrrd, "content: !@\nsizes!@\n");
    for byte in broken.iter_mut().take(40).filter(|byte| **byte == b'!') {
        *byte = 0xff;
    }
    expect_gone(&broken, "a.nrrd", 2);
    let text = "PatientName = @\r\nComment = @\nno key @\n";
    expect_gone(&insert(&medical::file("plain.mha"), text), "a.mha", 3);
}
