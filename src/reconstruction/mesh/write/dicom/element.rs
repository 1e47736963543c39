//! Data elements in explicit little endian (PS3.5 7.1.2).

use std::io::{self, Write};

/// Group and element.
type Tag = (u16, u16);

/// Data elements, written in the order in which they are added: that of their tags.
#[derive(Debug, Clone, Default)]
pub(super) struct Elements(Vec<u8>);

impl Elements {
    /// A text, filled up to an even length; without characters that would end or part it.
    pub(super) fn text(&mut self, tag: Tag, kind: [u8; 2], text: &str) -> io::Result<()> {
        let mut value: Vec<u8> = text.bytes().filter(|b| !b.is_ascii_control()).collect();
        if value.len() % 2 == 1 {
            value.push(if kind == *b"UI" { 0 } else { b' ' });
        }
        self.head(tag, kind);
        self.0.extend(length_16(value.len())?.to_le_bytes());
        self.0.extend(value);
        Ok(())
    }

    /// An unsigned number of 32 bits.
    pub(super) fn number(&mut self, tag: Tag, number: u32) -> io::Result<()> {
        self.head(tag, *b"UL");
        self.0.extend(length_16(4)?.to_le_bytes());
        self.0.extend(number.to_le_bytes());
        Ok(())
    }

    /// Bytes of an even number, under a kind whose lengths have 32 bits.
    pub(super) fn bytes(&mut self, tag: Tag, kind: [u8; 2], value: &[u8]) -> io::Result<()> {
        Self::long_head(tag, kind, length_32(value.len())?, &mut self.0)?;
        self.0.extend_from_slice(value);
        Ok(())
    }

    /// A sequence of items.
    pub(super) fn sequence(&mut self, tag: Tag, items: &[Self]) -> io::Result<()> {
        let mut value = Vec::new();
        for item in items {
            value.extend([0xfe, 0xff, 0x00, 0xe0]);
            value.extend(item.len()?.to_le_bytes());
            value.extend_from_slice(&item.0);
        }
        self.bytes(tag, *b"SQ", &value)
    }

    /// What comes before a value of so many bytes, under a kind whose lengths have 32 bits.
    pub(super) fn long_head(
        (group, element): Tag,
        kind: [u8; 2],
        length: u32,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        out.write_all(&group.to_le_bytes())?;
        out.write_all(&element.to_le_bytes())?;
        out.write_all(&kind)?;
        out.write_all(&[0, 0])?;
        out.write_all(&length.to_le_bytes())
    }

    /// Bytes of all of them.
    pub(super) fn len(&self) -> io::Result<u32> {
        length_32(self.0.len())
    }

    pub(super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        out.write_all(&self.0)
    }

    fn head(&mut self, (group, element): Tag, kind: [u8; 2]) {
        self.0.extend(group.to_le_bytes());
        self.0.extend(element.to_le_bytes());
        self.0.extend(kind);
    }
}

fn length_16(length: usize) -> io::Result<u16> {
    u16::try_from(length).map_err(|_| too_long())
}

fn length_32(length: usize) -> io::Result<u32> {
    u32::try_from(length).map_err(|_| too_long())
}

fn too_long() -> io::Error {
    io::Error::new(
        io::ErrorKind::InvalidInput,
        "a value is too long for a DICOM file",
    )
}
