//! A mesh as a label map: NIfTI-1 (nifti1.h of the NIfTI Data Format Working Group), gzipped.

use std::io::{self, Write};

use flate2::{Compression, GzBuilder};

use super::{Grid, Inside};
use crate::reconstruction::mesh::TriangleMesh;

/// Bytes of the header, and where the voxels begin: after four bytes that say that nothing else follows.
const HEADER: usize = 348;
const OFFSET: usize = HEADER + 4;

/// The type of voxels: `uint8`, and its bits.
const UINT8: [i16; 2] = [2, 8];

/// Writes which voxels of `grid` have their centre inside the mesh, 1 or 0. The mesh is in LPS and millimetres, as
/// the grid is.
///
/// # Errors
/// What `out` reports; `InvalidInput` where the grid is too long for the format along an axis.
pub fn write_mask(mesh: &TriangleMesh, grid: &Grid, out: &mut dyn Write) -> io::Result<()> {
    // Neither name nor date.
    let mut out = GzBuilder::new().write(out, Compression::default());
    out.write_all(&header(grid)?)?;
    let geometry = grid.geometry();
    let inside = Inside::new(mesh, &geometry, [grid.size[0], grid.size[1]]);
    for slice in 0..grid.size[2] {
        let voxels: Vec<u8> = inside.slice(slice).into_iter().map(u8::from).collect();
        out.write_all(&voxels)?;
    }
    out.finish()?.flush()
}

fn header(grid: &Grid) -> io::Result<[u8; OFFSET]> {
    let mut header = [0; OFFSET];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &(HEADER as i32).to_le_bytes());
    put(40, &3i16.to_le_bytes());
    for (axis, &size) in grid.size.iter().enumerate() {
        let size = i16::try_from(size).map_err(|_| too_long(size))?;
        put(42 + 2 * axis, &size.to_le_bytes());
        let step = grid.affine.map(|row| row[axis].powi(2));
        let step = step.iter().sum::<f64>().sqrt() as f32;
        put(80 + 4 * axis, &step.to_le_bytes());
    }
    for rest in 3..7 {
        put(42 + 2 * rest, &1i16.to_le_bytes());
    }
    for (place, number) in [70, 72].into_iter().zip(UINT8) {
        put(place, &number.to_le_bytes());
    }
    put(76, &1f32.to_le_bytes());
    put(108, &(OFFSET as f32).to_le_bytes());
    put(112, &1f32.to_le_bytes());
    // Millimetres; no time.
    put(123, &[2]);
    put(148, b"Meshway");
    // The affine alone counts, in coordinates aligned to another image; NIfTI has RAS.
    put(254, &2i16.to_le_bytes());
    for (row, sign) in [-1.0, -1.0, 1.0].into_iter().enumerate() {
        for (column, &value) in grid.affine[row].iter().enumerate() {
            let place = 280 + 16 * row + 4 * column;
            put(place, &((sign * value + 0.0) as f32).to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    Ok(header)
}

fn too_long(size: usize) -> io::Error {
    let message = format!("NIfTI-1 has no {size} voxels along an axis");
    io::Error::new(io::ErrorKind::InvalidInput, message)
}
