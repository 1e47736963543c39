//! Parts of files: listed, chosen, and refused with what there is.

use meshway::reconstruction::cloud::{Error, Format, Limits, Options, read, read_part};
use meshway::reconstruction::medical::{Choice, Kind};
use meshway::reconstruction::space::Space;

use super::file;
use super::found::found;

fn choose(name: &str, choice: Option<&str>) -> Result<usize, Error> {
    let options = Options {
        hint: Format::from_extension(name),
        limits: &Limits::default(),
        assume_orientation: false,
    };
    let choice = choice.map(|text| Choice::parse(text).unwrap());
    let (cloud, _) = read_part(&file(name), &options, choice.as_ref())?;
    Ok(cloud.points.len())
}

#[test]
fn one_of_several_labels_must_be_chosen() {
    let name = "nifti1_u1.nii.gz";
    let error = read(&file(name), Some(name), &Limits::default()).unwrap_err();
    assert_eq!(error.code(), "source_missing");
    assert!(error.to_string().contains("labels 1, 5"), "{error}");
    assert!(choose(name, Some("label:1")).unwrap() > 10);
    let error = choose(name, Some("label:2")).unwrap_err();
    assert_eq!(error.code(), "source_unknown");
}

#[test]
fn segments_and_regions_have_names_and_colours() {
    let read = found(&file("layers.seg.nrrd"), "a.seg.nrrd", false).unwrap();
    assert_eq!(read.contents.parts.kind, Kind::Segments);
    let items = &read.contents.parts.items;
    assert_eq!(items[0].name.as_deref(), Some("bone"));
    assert_eq!(items[0].color.as_deref(), Some("#ff8000"));
    assert_eq!(items[1].name.as_deref(), Some("marrow"));
    assert!(choose("layers.seg.nrrd", Some("segment:marrow")).unwrap() > 10);

    let read = found(&file("binary.dcm"), "a.dcm", false).unwrap();
    let names = read
        .contents
        .parts
        .items
        .iter()
        .map(|item| item.name.clone().unwrap());
    assert_eq!(names.collect::<Vec<_>>(), ["bone", "bone and marrow"]);

    let read = found(&file("bare.dcm"), "a.dcm", false).unwrap();
    assert_eq!(read.contents.parts.kind, Kind::Rois);
    let items = &read.contents.parts.items;
    let names = items.iter().map(|item| item.name.clone().unwrap());
    assert_eq!(
        names.collect::<Vec<_>>(),
        ["Shell", "Tilted", "Marks", "Nothing"]
    );
    // A square of 20 mm with a hole of 8 mm, in three planes 3 mm apart.
    let shell = (400.0 - 64.0) * 9.0;
    assert!(
        (items[0].volume_mm3 - shell).abs() < 1e-6 * shell,
        "{}",
        items[0].volume_mm3
    );
    assert!(
        (items[1].volume_mm3 - 256.0 * 6.0).abs() < 0.1,
        "{}",
        items[1].volume_mm3
    );
    let codes: Vec<_> = read
        .contents
        .warnings
        .iter()
        .map(|warning| warning.code)
        .collect();
    assert_eq!(codes, ["contours_too_short", "contours_open"]);
    assert_eq!(
        choose("bare.dcm", Some("roi:Marks")).unwrap_err().code(),
        "source_unknown"
    );
}

#[test]
fn what_is_known_of_the_grid_is_listed() {
    let read = found(&file("nifti1_u1.nii.gz"), "a.nii.gz", false).unwrap();
    assert_eq!(read.contents.size, Some([11, 9, 6]));
    assert_eq!(read.contents.orientation.as_deref(), Some("LPS"));
    let spacing = read.contents.spacing.unwrap();
    for (found, made) in spacing.into_iter().zip([1.0, 1.5, 4.0]) {
        assert!((found - made).abs() < 1e-6);
    }
    assert_eq!(read.contents.space, Space::PATIENT);
    let volume = read.contents.parts.items[1].volume_mm3;
    assert!((volume - 18.0 * 6.0).abs() < 1e-4, "{volume}");
}

#[test]
fn images_and_other_syntaxes_are_refused_with_advice() {
    let refusal =
        |bytes: &[u8], name: &str| read(bytes, Some(name), &Limits::default()).unwrap_err();
    // An image: every voxel has another value.
    let mut image = b"NRRD0004\ntype: ushort\ndimension: 3\nspace: LPS\nsizes: 16 16 16\n\
        space directions: (1,0,0) (0,1,0) (0,0,1)\nendian: little\nencoding: raw\n\n"
        .to_vec();
    image.extend((0..4096_u16).flat_map(u16::to_le_bytes));
    let error = refusal(&image, "a.nrrd");
    assert_eq!(error.code(), "unsupported_format");
    assert!(error.to_string().contains("segment it first"), "{error}");
    let replaced = |name: &str, from: &[u8], to: &[u8]| {
        let mut bytes = file(name);
        let places = 0..=bytes.len() - from.len();
        for at in places {
            if bytes[at..].starts_with(from) {
                bytes[at..at + to.len()].copy_from_slice(to);
            }
        }
        bytes
    };
    let big = replaced(
        "binary.dcm",
        b"1.2.840.10008.1.2.1\0",
        b"1.2.840.10008.1.2.2\0",
    );
    assert!(refusal(&big, "a.dcm").to_string().contains("Big Endian"));
    let series = replaced(
        "structures.dcm",
        b"1.2.840.10008.5.1.4.1.1.481.3\0",
        b"1.2.840.10008.5.1.4.1.1.2\0\0\0\0\0",
    );
    let series = {
        let mut bytes = series;
        let at = bytes
            .windows(8)
            .position(|window| window == b"RTSTRUCT")
            .unwrap();
        bytes[at..at + 8].copy_from_slice(b"CT      ");
        bytes
    };
    let error = refusal(&series, "a.dcm");
    assert!(error.to_string().contains("modality CT"), "{error}");
    let slide = replaced("binary.dcm", &[0x20, 0, 0x13, 0x91], &[0x48, 0, 0x1a, 0x02]);
    assert!(refusal(&slide, "a.dcm").to_string().contains("microscopy"));
}
