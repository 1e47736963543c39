//! Texts of data sets.

use super::*;

/// An element with a type, or without one.
fn element(tag: [u16; 2], kind: Option<&[u8; 2]>, value: &[u8]) -> Vec<u8> {
    let mut bytes = tag.map(u16::to_le_bytes).concat();
    let mut value = value.to_vec();
    if !value.len().is_multiple_of(2) {
        value.push(b' ');
    }
    let length = value.len() as u32;
    match kind {
        None => bytes.extend(length.to_le_bytes()),
        Some(kind @ (b"SQ" | b"UN" | b"OB" | b"UT")) => {
            bytes.extend([kind[0], kind[1], 0, 0]);
            bytes.extend(length.to_le_bytes());
        }
        Some(kind) => {
            bytes.extend(kind);
            bytes.extend((length as u16).to_le_bytes());
        }
    }
    [bytes, value].concat()
}

fn item(content: &[u8]) -> Vec<u8> {
    element([0xfffe, 0xe000], None, content)
}

/// Elements that name somebody ten times, and a code of each kind.
fn personal(explicit: bool) -> Vec<u8> {
    let name = NAME.as_bytes();
    let of =
        |tag, kind: &'static [u8; 2], value: &[u8]| element(tag, explicit.then_some(kind), value);
    let code = |meaning: &[u8]| item(&of([0x0008, 0x0104], b"LO", meaning));
    let nested = item(&of([0x0040, 0xa123], b"PN", name));
    let nested = item(
        &[
            of([0x0040, 0xa073], b"SQ", &nested),
            of([0x0008, 0x0080], b"LO", name),
        ]
        .concat(),
    );
    let mut undefined = [0x10, 0, 0x02, 0x10].to_vec();
    if explicit {
        undefined.extend(b"SQ\0\0");
    }
    undefined.extend([0xff; 4]);
    undefined.extend(item(&of([0x0010, 0x0020], b"LO", name)));
    undefined.extend([0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0]);
    [
        of([0x0010, 0x0010], b"PN", name),
        of([0x0010, 0x0040], b"CS", name),
        of([0x0008, 0x1030], b"LO", &[b"Abdomen of ", name].concat()),
        of(
            [0x0020, 0x000d],
            b"UI",
            b"1.3.6.1.4.1.14519.5.2.1.7777.4006.1234567",
        ),
        of([0x0040, 0xa730], b"SQ", &nested),
        undefined,
        of([0x0029, 0x0010], b"LO", name),
        of([0x0029, 0x1010], b"OB", &[&[1, 2], name].concat()),
        of([0x0040, 0xa043], b"SQ", &code(name)),
        of([0x0040, 0xa160], b"UT", name),
        of([0x0062, 0x000f], b"SQ", &code(b"Liver, right lobe")),
    ]
    .concat()
}

const STUDY: &str = "1.3.6.1.4.1.14519.5.2.1.7777.4006.1234567";

/// The bytes behind the group of the transfer syntax.
fn body(bytes: &[u8]) -> usize {
    let length: [u8; 4] = bytes[140..144].try_into().unwrap();
    144 + u32::from_le_bytes(length) as usize
}

#[test]
fn all_of_a_data_set_is_gone_but_geometry_and_segments() {
    for (file, explicit) in [
        ("binary.dcm", true),
        ("structures.dcm", true),
        ("runs.dcm", true),
        ("implicit.dcm", false),
        ("bare.dcm", false),
    ] {
        let bytes = [medical::file(file), personal(explicit)].concat();
        let content = expect_gone(&bytes, "a.dcm", 10);
        assert!(!holds(&content, STUDY), "{file}");
        assert!(holds(&content, "Liver, right lobe"), "{file}");
    }
    let mut preamble = medical::file("binary.dcm");
    preamble[20..30].copy_from_slice(NAME.as_bytes());
    expect_gone(&preamble, "a.dcm", 1);
}

#[test]
fn a_deflated_data_set_is_packed_again() {
    let bytes = medical::file("deflated.dcm");
    let start = body(&bytes);
    let inflated = |bytes: &[u8]| {
        let mut inflated = Vec::new();
        DeflateDecoder::new(&bytes[start..])
            .read_to_end(&mut inflated)
            .unwrap();
        inflated
    };
    let content = [inflated(&bytes), personal(true)].concat();
    let mut packed = DeflateEncoder::new(bytes[..start].to_vec(), Compression::fast());
    packed.write_all(&content).unwrap();
    let packed = packed.finish().unwrap();
    assert_eq!(names(&inflated(&packed)), 10);
    let clean = clean(&packed, None, &Limits::default()).unwrap();
    let cleaned = inflated(&clean);
    assert_eq!((names(&cleaned), cleaned.len()), (0, content.len()));
    assert!(!holds(&cleaned, STUDY) && holds(&cleaned, "Liver, right lobe"));
}

#[test]
fn references_still_lead_somewhere() {
    let study = element([0x0020, 0x000d], Some(b"UI"), STUDY.as_bytes());
    let reference = element([0x0008, 0x1155], Some(b"UI"), STUDY.as_bytes());
    let bytes = [medical::file("binary.dcm"), study, reference].concat();
    let clean = clean(&bytes, None, &Limits::default()).unwrap();
    let made: Vec<&[u8]> = [2, 1]
        .map(|i| &clean[clean.len() - i * 50 + 8..clean.len() - i * 50 + 8 + STUDY.len()])
        .to_vec();
    assert_eq!(made[0], made[1]);
    assert!(made[0].starts_with(b"2.25."), "{}", made[0].escape_ascii());
}
