//! DICOM Encapsulated STL (PS3.3 A.85): a mesh that a picture archive takes, in the frame of the
//! patient and in millimetres.
//!
//! A file of part 10 in explicit little endian: the attributes in the order of their tags, the STL among the
//! last of them.

mod element;

use std::io::{self, Write};

use sha2::{Digest, Sha256};

use self::element::Elements;
use super::{count_u32, stl};
use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::slices::Identifiers;
use crate::reconstruction::space::{Frame, Unit};
use crate::reconstruction::vector::scale;

const ENCAPSULATED_STL: &str = "1.2.840.10008.5.1.4.1.1.104.3";
const EXPLICIT_LITTLE_ENDIAN: &str = "1.2.840.10008.1.2.1";

/// What stands before the group of the file itself.
const PREAMBLE: usize = 128;

/// What a DICOM file says besides the mesh.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Instance {
    /// The text that all unique identifiers are made of which are not taken over: the same for the same series,
    /// another one for each other.
    pub series: String,
    /// Its place in the series, from 1.
    pub number: u64,
    /// When the mesh was made: `YYYYMMDD` and `HHMMSS`; empty where that is not told.
    pub made: (String, String),
    /// Patient and study, where they are to be taken over.
    pub identifiers: Identifiers,
}

impl Instance {
    /// The one mesh of a series, named by its content.
    pub fn of(mesh: &TriangleMesh) -> Self {
        let mut hash = Sha256::new();
        for v in mesh.vertices.as_flattened() {
            hash.update(v.to_le_bytes());
        }
        for v in mesh.triangles.as_flattened() {
            hash.update(v.to_le_bytes());
        }
        Self {
            series: hex::encode(hash.finalize()),
            number: 1,
            ..Self::default()
        }
    }

    /// A unique identifier of a thing of this series.
    fn uid(&self, thing: &str) -> String {
        uid(&format!("{thing} {}", self.series))
    }
}

/// The unique identifier that stands for a text: a UUID of version 8 under the root that DICOM has for them
/// (PS3.5 B.2).
fn uid(text: &str) -> String {
    let hash = Sha256::digest(format!("meshway {text}"));
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&hash[..16]);
    bytes[6] = bytes[6] & 0x0f | 0x80;
    bytes[8] = bytes[8] & 0x3f | 0x80;
    format!("2.25.{}", u128::from_be_bytes(bytes))
}

/// Writes a mesh.
///
/// # Errors
/// What `out` reports; `InvalidInput` where frame or unit of the mesh are unknown, and where STL cannot hold it.
pub fn write(mesh: &TriangleMesh, instance: &Instance, out: &mut dyn Write) -> io::Result<()> {
    let mesh = in_patient(mesh)?;
    let stl_bytes = count_u32(stl::length(&mesh))?;
    let instance_uid = instance.uid(&format!("instance {}", instance.number));
    let mut meta = Elements::default();
    meta.bytes((0x0002, 0x0001), *b"OB", &[0, 1])?;
    meta.text((0x0002, 0x0002), *b"UI", ENCAPSULATED_STL)?;
    meta.text((0x0002, 0x0003), *b"UI", &instance_uid)?;
    meta.text((0x0002, 0x0010), *b"UI", EXPLICIT_LITTLE_ENDIAN)?;
    meta.text((0x0002, 0x0012), *b"UI", &uid("implementation"))?;
    meta.text((0x0002, 0x0013), *b"SH", "MESHWAY")?;
    let mut length = Elements::default();
    length.number((0x0002, 0x0000), meta.len()?)?;

    out.write_all(&[0; PREAMBLE])?;
    out.write_all(b"DICM")?;
    length.write(out)?;
    meta.write(out)?;
    before(instance, &instance_uid)?.write(out)?;
    Elements::long_head((0x0042, 0x0011), *b"OB", stl_bytes, out)?;
    stl::write(&mesh, &mut &mut *out)?;
    let mut after = Elements::default();
    after.text((0x0042, 0x0012), *b"LO", "model/stl")?;
    after.number((0x0042, 0x0015), stl_bytes)?;
    after.write(out)
}

/// The mesh in LPS and millimetres.
fn in_patient(mesh: &TriangleMesh) -> io::Result<TriangleMesh> {
    let unknown = |what| {
        let message = format!(
            "the {what} of the cloud is unknown, and DICOM needs it; clouds of medical images and files with a \
             tag SPACE=LPS or SPACE=RAS have it"
        );
        io::Error::new(io::ErrorKind::InvalidInput, message)
    };
    let factor = mesh.space.unit.millimetres();
    let mut mesh = mesh
        .clone()
        .in_frame(Frame::Lps)
        .ok_or_else(|| unknown("frame"))?;
    let factor = factor.ok_or_else(|| unknown("unit"))?;
    for vertex in &mut mesh.vertices {
        *vertex = scale(*vertex, factor);
    }
    mesh.space.unit = Unit::Millimetre;
    Ok(mesh)
}

/// The attributes before the STL. Those of type 2 may be empty, but must be there.
fn before(instance: &Instance, instance_uid: &str) -> io::Result<Elements> {
    let kept = &instance.identifiers;
    let or_own = |kept: &str, thing: &str| match kept {
        "" => instance.uid(thing),
        kept => kept.to_owned(),
    };
    let (date, time) = (&instance.made.0, &instance.made.1);
    let study = or_own(&kept.study_uid, "study");
    let series = instance.uid("series");
    let frame = or_own(&kept.frame_of_reference_uid, "frame of reference");
    let number = instance.number.to_string();
    let mut set = Elements::default();
    for (tag, kind, value) in [
        ((0x0008, 0x0005), b"CS", "ISO_IR 192"),
        ((0x0008, 0x0016), b"UI", ENCAPSULATED_STL),
        ((0x0008, 0x0018), b"UI", instance_uid),
        ((0x0008, 0x0020), b"DA", kept.study_date.as_str()),
        ((0x0008, 0x0023), b"DA", date.as_str()),
        ((0x0008, 0x002a), b"DT", ""),
        ((0x0008, 0x0030), b"TM", kept.study_time.as_str()),
        ((0x0008, 0x0033), b"TM", time.as_str()),
        ((0x0008, 0x0050), b"SH", kept.accession_number.as_str()),
        ((0x0008, 0x0060), b"CS", "M3D"),
        ((0x0008, 0x0070), b"LO", "Meshway"),
        ((0x0008, 0x0090), b"PN", kept.referring_physician.as_str()),
        ((0x0008, 0x103e), b"LO", "Surface by Meshway"),
        ((0x0008, 0x1090), b"LO", "Meshway"),
        ((0x0010, 0x0010), b"PN", kept.patient_name.as_str()),
        ((0x0010, 0x0020), b"LO", kept.patient_id.as_str()),
        ((0x0010, 0x0030), b"DA", kept.patient_birth_date.as_str()),
        ((0x0010, 0x0040), b"CS", kept.patient_sex.as_str()),
        // A program has no serial number, but the attribute must have a value.
        ((0x0018, 0x1000), b"LO", "1"),
        ((0x0018, 0x1020), b"LO", env!("CARGO_PKG_VERSION")),
        ((0x0020, 0x000d), b"UI", study.as_str()),
        ((0x0020, 0x000e), b"UI", series.as_str()),
        ((0x0020, 0x0010), b"SH", kept.study_id.as_str()),
        ((0x0020, 0x0011), b"IS", "1"),
        ((0x0020, 0x0013), b"IS", number.as_str()),
        ((0x0020, 0x0052), b"UI", frame.as_str()),
        ((0x0020, 0x1040), b"LO", ""),
        ((0x0028, 0x0301), b"CS", "NO"),
    ] {
        set.text(tag, *kind, value)?;
    }
    let mut unit = Elements::default();
    unit.text((0x0008, 0x0100), *b"SH", "mm")?;
    unit.text((0x0008, 0x0102), *b"SH", "UCUM")?;
    unit.text((0x0008, 0x0104), *b"LO", "mm")?;
    set.sequence((0x0040, 0x08ea), &[unit])?;
    set.sequence((0x0040, 0xa043), &[])?;
    set.text((0x0042, 0x0010), *b"ST", "")?;
    Ok(set)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_valid_and_told_apart() {
        let all = ["a", "b", "study a", ""].map(uid);
        for (i, one) in all.iter().enumerate() {
            let number = one.strip_prefix("2.25.").unwrap();
            let value: u128 = number.parse().unwrap();
            assert_eq!(value.to_string(), number);
            assert_eq!(value >> 76 & 0xf, 8, "version");
            assert_eq!(value >> 62 & 0b11, 0b10, "variant");
            assert!(one.len() <= 64);
            assert!(all[..i].iter().all(|other| other != one));
        }
        assert_eq!(uid("a"), all[0]);
    }
}
