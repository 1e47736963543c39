//! Zip archives (PKWARE, APPNOTE 6.3.3), as far as packages of documents need them: deflated files
//! whose lengths follow them, so that nothing is held in memory, and no dates.

use std::io::{self, Write};

use flate2::write::DeflateEncoder;
use flate2::{Compression, Crc};

use super::count_u32;

/// Version 2.0 of the format, which has what is used here.
const VERSION: u16 = 20;
/// Checksum and lengths follow the file; names are UTF-8.
const FLAGS: u16 = 1 << 3 | 1 << 11;
const DEFLATED: u16 = 8;
/// The first day that the format knows, 1 January 1980, at midnight: time, then date.
const NO_DATE: [u16; 2] = [0, 1 << 5 | 1];

/// An archive while it is written.
pub(super) struct Archive<'w, W: Write> {
    out: Counting<&'w mut W>,
    files: Vec<File>,
}

/// A file of an archive as the directory at its end lists it.
struct File {
    name: &'static str,
    start: u32,
    checksum: u32,
    packed: u32,
    unpacked: u32,
}

impl<'w, W: Write> Archive<'w, W> {
    pub(super) fn new(out: &'w mut W) -> Self {
        Self {
            out: Counting::new(out),
            files: Vec::new(),
        }
    }

    /// Adds the file that `content` writes.
    pub(super) fn file(
        &mut self,
        name: &'static str,
        content: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut file = File {
            name,
            start: self.out.count()?,
            checksum: 0,
            packed: 0,
            unpacked: 0,
        };
        self.out.write_all(b"PK\x03\x04")?;
        file.write_head(&mut self.out)?;
        self.out.write_all(name.as_bytes())?;
        let before = self.out.count()?;
        {
            let encoder = DeflateEncoder::new(&mut self.out, Compression::default());
            let mut counted = Counting::new(encoder);
            content(&mut counted)?;
            (file.checksum, file.unpacked) = (counted.checksum.sum(), counted.count()?);
            counted.inner.finish()?;
        }
        file.packed = self.out.count()? - before;
        self.out.write_all(b"PK\x07\x08")?;
        for number in [file.checksum, file.packed, file.unpacked] {
            self.out.write_all(&number.to_le_bytes())?;
        }
        self.files.push(file);
        Ok(())
    }

    /// Ends the archive with its directory.
    pub(super) fn finish(mut self) -> io::Result<()> {
        let start = self.out.count()?;
        for file in &self.files {
            self.out.write_all(b"PK\x01\x02")?;
            self.out.write_all(&VERSION.to_le_bytes())?;
            file.write_head(&mut self.out)?;
            // No comment, the first disk, no attributes.
            self.out.write_all(&[0; 10])?;
            self.out.write_all(&file.start.to_le_bytes())?;
            self.out.write_all(file.name.as_bytes())?;
        }
        let length = self.out.count()? - start;
        let count = (self.files.len() as u16).to_le_bytes();
        self.out.write_all(b"PK\x05\x06\0\0\0\0")?;
        self.out.write_all(&[count, count].concat())?;
        self.out.write_all(&length.to_le_bytes())?;
        self.out.write_all(&start.to_le_bytes())?;
        self.out.write_all(&[0; 2])
    }
}

impl File {
    /// What stands in the directory and, with zeros for what is not known yet, before the file.
    fn write_head(&self, out: &mut impl Write) -> io::Result<()> {
        let [time, date] = NO_DATE;
        for number in [VERSION, FLAGS, DEFLATED, time, date] {
            out.write_all(&number.to_le_bytes())?;
        }
        for number in [self.checksum, self.packed, self.unpacked] {
            out.write_all(&number.to_le_bytes())?;
        }
        // Lengths of the name and of what may follow it.
        out.write_all(&(self.name.len() as u32).to_le_bytes())
    }
}

/// Counts what passes through, and sums it up.
struct Counting<W> {
    inner: W,
    bytes: usize,
    checksum: Crc,
}

impl<W> Counting<W> {
    fn new(inner: W) -> Self {
        Self {
            inner,
            bytes: 0,
            checksum: Crc::new(),
        }
    }

    /// The bytes so far, as the 32 bits that the format has for them.
    fn count(&self) -> io::Result<u32> {
        count_u32(self.bytes)
    }
}

impl<W: Write> Write for Counting<W> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(buffer)?;
        self.checksum.update(&buffer[..written]);
        self.bytes += written;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
