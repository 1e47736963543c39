//! What other programs write in other words: names in other character sets, marks in other letters, kinds of axes.

use meshway::reconstruction::cloud::Error;

use super::file;
use super::found::{Found, found};

/// The bytes with the first `old` in them replaced.
fn with(bytes: &[u8], old: &[u8], new: &[u8]) -> Vec<u8> {
    let at = bytes.windows(old.len()).position(|part| part == old);
    let (before, rest) = bytes.split_at(at.expect("the file has what is replaced"));
    [before, new, &rest[old.len()..]].concat()
}

/// A DICOM file whose data set names its character set.
fn in_charset(name: &str, charset: &[u8], old: &[u8], new: &[u8]) -> Vec<u8> {
    assert_eq!((charset.len() % 2, old.len()), (0, new.len()));
    let class = b"\x08\x00\x16\x00UI";
    let length = (charset.len() as u16).to_le_bytes();
    let element = [b"\x08\x00\x05\x00CS", length.as_slice(), charset, class].concat();
    with(&with(&file(name), class, &element), old, new)
}

fn names(found: Result<Found, Error>) -> Vec<String> {
    let items = found.unwrap().contents.parts.items;
    items.into_iter().map(|item| item.name.unwrap()).collect()
}

#[test]
fn names_of_dicom_are_read_in_their_character_sets() {
    let liver = b"\xbf\xd5\xe7\xd5\xdd\xec";
    let regions = in_charset("structures.dcm", b"ISO_IR 144", b"Shell ", liver);
    assert_eq!(names(found(&regions, "a.dcm", false))[0], "Печень");
    let segments = in_charset("binary.dcm", b"GB18030 ", b"bone", b"\xb9\xc7\xcd\xb7");
    assert_eq!(
        names(found(&segments, "a.dcm", false)),
        ["骨头", "bone and marrow"]
    );
    let kanji = b"\x1b$B9|\x1b(B and row";
    let segments = in_charset(
        "binary.dcm",
        b"\\ISO 2022 IR 87 ",
        b"bone and marrow ",
        kanji,
    );
    assert_eq!(names(found(&segments, "a.dcm", false))[1], "骨 and row");
}

#[test]
fn the_mark_of_data_in_the_same_file_may_have_any_case() {
    let whole = file("plain.mha");
    let expected = found(&whole, "a.mha", false).unwrap();
    for spelled in [b"Local", b"local", b"LOCAL"] {
        let other = with(&whole, b"LOCAL", spelled);
        let read = found(&other, "a.mha", false).unwrap();
        assert_eq!(read.items, expected.items);
    }
    let elsewhere = found(&with(&whole, b"LOCAL", b"a.raw"), "a.mha", false).unwrap_err();
    assert!(
        elsewhere.to_string().contains("another file"),
        "{elsewhere}"
    );
}

#[test]
fn components_of_a_voxel_are_no_layers() {
    let layers = file("layers.seg.nrrd");
    let expected = names(found(&layers, "a.nrrd", false));
    let of_kind = |kind: &str| {
        let kinds = format!("encoding: gzip\nkinds: {kind} domain domain domain\n");
        with(&layers, b"encoding: gzip\n", kinds.as_bytes())
    };
    for kind in ["list", "LIST", "???", "none", "domain"] {
        assert_eq!(
            names(found(&of_kind(kind), "a.nrrd", false)),
            expected,
            "{kind}"
        );
    }
    for kind in [
        "vector",
        "2-vector",
        "covariant-vector",
        "RGB-color",
        "complex",
    ] {
        let refused = found(&of_kind(kind), "a.nrrd", false).unwrap_err();
        assert_eq!(refused.code(), "unsupported_format", "{kind}");
        let said = refused.to_string();
        assert!(
            said.contains(kind) && said.contains("2 components"),
            "{said}"
        );
    }
}
