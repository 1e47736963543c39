//! NIfTI-1 and -2 in one file, in either byte order.

use std::borrow::Cow;
use std::ops::Range;

use super::affine::header;
use super::raster::{Raster, values};
use super::{Affine, Reading, Segmentation};
use crate::reconstruction::Warning;
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::{ByteOrder, Scalar, enough};
use crate::reconstruction::vector::{Vec3, distance};

/// The patient's axes of NIfTI lead to the right and the front, ours to the left and the back.
const RAS_TO_LPS: Vec3 = [-1.0, -1.0, 1.0];

/// Two places of a voxel, in millimetres, that count as one.
const SAME_PLACE: f64 = 0.1;

/// Where the fields of a header lie, and how wide its integers and floats are.
struct Layout {
    size: usize,
    wide: bool,
    magic: usize,
    dimensions: usize,
    datatype: usize,
    spacing: usize,
    offset: usize,
    slope: usize,
    codes: [usize; 2],
    quaternion: usize,
    rows: usize,
    units: usize,
    /// Texts of whoever wrote the file.
    texts: &'static [Range<usize>],
}

const NIFTI_1: Layout = Layout {
    size: 348,
    wide: false,
    magic: 344,
    dimensions: 40,
    datatype: 70,
    spacing: 76,
    offset: 108,
    slope: 112,
    codes: [252, 254],
    quaternion: 256,
    rows: 280,
    units: 123,
    // data_type and db_name, descrip, aux_file, intent_name
    texts: &[4..32, 148..228, 228..252, 328..344],
};

const NIFTI_2: Layout = Layout {
    size: 540,
    wide: true,
    magic: 4,
    dimensions: 16,
    datatype: 12,
    spacing: 104,
    offset: 168,
    slope: 176,
    codes: [344, 348],
    quaternion: 352,
    rows: 400,
    units: 500,
    // descrip, aux_file, intent_name, unused_str
    texts: &[240..320, 320..344, 508..524, 525..540],
};

/// Whether a file begins as NIfTI does, with or without the data.
pub(in crate::reconstruction) fn is_nifti(bytes: &[u8]) -> bool {
    Header::of(bytes).is_some()
}

/// A header whose bytes are all there.
pub(super) struct Header<'a> {
    bytes: &'a [u8],
    layout: &'static Layout,
    pub(super) order: ByteOrder,
    /// Whether the data are in the same file.
    whole: bool,
}

impl<'a> Header<'a> {
    pub(super) fn of(bytes: &'a [u8]) -> Option<Self> {
        let size = u32::from_le_bytes(*bytes.first_chunk()?);
        let (size, order) = match size {
            348 | 540 => (size, ByteOrder::Little),
            _ => (size.swap_bytes(), ByteOrder::Big),
        };
        let (layout, whole, apart) = match size {
            348 => (&NIFTI_1, b"n+1\0", b"ni1\0"),
            540 => (&NIFTI_2, b"n+2\0", b"ni2\0"),
            _ => return None,
        };
        let bytes = bytes.get(..layout.size)?;
        let magic = bytes.get(layout.magic..layout.magic + 4)?;
        (magic == whole || magic == apart).then_some(Self {
            bytes,
            layout,
            order,
            whole: magic == whole,
        })
    }

    /// Where the values of the voxels begin in a file of so many bytes.
    pub(super) fn data_start(&self, bytes: usize) -> Result<usize, Error> {
        let offset = if self.layout.wide {
            self.number(Scalar::I64, self.layout.offset)
        } else {
            self.number(Scalar::F32, self.layout.offset)
        };
        // Some writers leave it zero; the four bytes of extensions come first.
        let least = self.layout.size + 4;
        let offset = if offset.is_finite() {
            (offset.max(0.0) as usize).max(least)
        } else {
            least
        };
        enough("the values of the voxels", offset, 1, bytes)?;
        Ok(offset)
    }

    /// Where the texts of the header are, and where it ends.
    pub(super) fn texts(&self) -> (&'static [Range<usize>], usize) {
        (self.layout.texts, self.layout.size)
    }

    fn number(&self, scalar: Scalar, at: usize) -> f64 {
        let bytes = self.bytes.get(at..).unwrap_or_default();
        scalar.read(self.order, bytes).unwrap_or(0.0)
    }

    /// An integer that NIfTI-2 has in 64 bits, or, if it is a code, in 32.
    fn integer(&self, at: usize, is_code: bool) -> f64 {
        let scalar = match (self.layout.wide, is_code) {
            (false, _) => Scalar::I16,
            (true, true) => Scalar::I32,
            (true, false) => Scalar::I64,
        };
        self.number(scalar, at)
    }

    /// The `i`th float from `at` on.
    fn float(&self, at: usize, i: usize) -> f64 {
        let scalar = if self.layout.wide {
            Scalar::F64
        } else {
            Scalar::F32
        };
        self.number(scalar, at + i * scalar.size())
    }

    /// Voxels along the three axes.
    fn size(&self) -> Result<[usize; 3], Error> {
        let width = if self.layout.wide { 8 } else { 2 };
        let at = |i: usize| self.integer(self.layout.dimensions + i * width, false);
        let axes = at(0);
        if !(1.0..=7.0).contains(&axes) {
            return Err(header(format!("dim[0] is {axes}, must be from 1 to 7")));
        }
        let axes = axes as usize;
        for i in 1..=axes {
            if !(1.0..=1e9).contains(&at(i)) {
                return Err(header(format!("dim[{i}] is {}", at(i))));
            }
        }
        if let Some(i) = (4..=axes).find(|&i| at(i) > 1.0) {
            return Err(Error::UnsupportedFormat(format!(
                "the file holds a series of {} volumes; save the one with the labels by itself",
                at(i)
            )));
        }
        Ok([1, 2, 3].map(|i| if i <= axes { at(i) as usize } else { 1 }))
    }

    fn scalar(&self) -> Result<Scalar, Error> {
        let datatype = Scalar::I16;
        Ok(match self.number(datatype, self.layout.datatype) as i64 {
            2 => Scalar::U8,
            4 => Scalar::I16,
            8 => Scalar::I32,
            16 => Scalar::F32,
            64 => Scalar::F64,
            256 => Scalar::I8,
            512 => Scalar::U16,
            768 => Scalar::U32,
            1024 => Scalar::I64,
            1280 => Scalar::U64,
            other => {
                return Err(Error::UnsupportedFormat(format!(
                    "datatype {other} is read no labels from; save the labels as integers of 8 to 64 bits"
                )));
            }
        })
    }

    /// Millimetres of the unit of distance, if it is another one.
    fn unit(&self) -> Option<(f64, &'static str)> {
        let code = if self.layout.wide {
            Scalar::I32
        } else {
            Scalar::U8
        };
        match self.number(code, self.layout.units) as i64 & 7 {
            1 => Some((1000.0, "metres")),
            3 => Some((0.001, "micrometres")),
            _ => None,
        }
    }

    fn spacing(&self) -> Vec3 {
        [1, 2, 3].map(|i| self.float(self.layout.spacing, i))
    }

    /// The matrix of three rows.
    fn sform(&self) -> Affine {
        let at = |row: usize, column: usize| self.float(self.layout.rows, 4 * row + column);
        let column = |i| [at(0, i), at(1, i), at(2, i)];
        Affine {
            steps: [column(0), column(1), column(2)],
            origin: column(3),
        }
    }

    /// The rotation by a quaternion, the distances and the shift.
    fn qform(&self) -> Affine {
        let at = |i| self.float(self.layout.quaternion, i);
        let (mut b, mut c, mut d) = (at(0), at(1), at(2));
        let squares = b * b + c * c + d * d;
        let a = if squares < 1.0 {
            (1.0 - squares).sqrt()
        } else {
            let length = squares.sqrt();
            (b, c, d) = (b / length, c / length, d / length);
            0.0
        };
        let [x, y, z] = self.spacing().map(f64::abs);
        // The sign that belongs to the third axis.
        let z = if self.float(self.layout.spacing, 0) < 0.0 {
            -z
        } else {
            z
        };
        let of = |v: Vec3, length: f64| v.map(|v| v * length);
        Affine {
            steps: [
                of(
                    [
                        a * a + b * b - c * c - d * d,
                        2.0 * (b * c + a * d),
                        2.0 * (b * d - a * c),
                    ],
                    x,
                ),
                of(
                    [
                        2.0 * (b * c - a * d),
                        a * a + c * c - b * b - d * d,
                        2.0 * (c * d + a * b),
                    ],
                    y,
                ),
                of(
                    [
                        2.0 * (b * d + a * c),
                        2.0 * (c * d - a * b),
                        a * a + d * d - b * b - c * c,
                    ],
                    z,
                ),
            ],
            origin: [at(3), at(4), at(5)],
        }
    }

    /// How the voxels lie in the patient; the flag tells that it had to be assumed.
    fn affine(
        &self,
        size: [usize; 3],
        reading: &Reading,
        warnings: &mut Vec<Warning>,
    ) -> Result<(Affine, bool), Error> {
        let [by_quaternion, by_matrix] = self.layout.codes.map(|at| self.integer(at, true) > 0.0);
        let found = match (by_matrix, by_quaternion) {
            (true, false) => (self.sform(), false),
            (false, true) => (self.qform(), false),
            (true, true) => {
                let (matrix, quaternion) = (self.sform(), self.qform());
                let last = size.map(|count| count.saturating_sub(1) as f64);
                let corner =
                    |bits: usize| [0, 1, 2].map(|i| if bits >> i & 1 == 1 { last[i] } else { 0.0 });
                let apart = (0..8)
                    .map(|bits| distance(matrix.at(corner(bits)), quaternion.at(corner(bits))))
                    .fold(0.0, f64::max);
                if apart > SAME_PLACE {
                    let message = format!(
                        "sform and qform place the voxels up to {apart:.1} mm apart; sform is used"
                    );
                    warnings.push(Warning::new("qform_differs", message));
                }
                (matrix, false)
            }
            (false, false) if reading.assume_orientation => {
                (Affine::of_spacing(self.spacing().map(f64::abs)), true)
            }
            (false, false) => {
                return Err(Error::OrientationMissing(
                    "sform_code and qform_code are 0, so the file does not say which side is left"
                        .to_owned(),
                ));
            }
        };
        Ok(found)
    }
}

/// Opens a label map.
///
/// # Errors
/// What is wrong with it, or is not read.
pub(in crate::reconstruction) fn read<'a>(
    bytes: &'a [u8],
    reading: &Reading,
) -> Result<Segmentation<'a>, Error> {
    let header = Header::of(bytes).ok_or_else(|| header("the magic of NIfTI is missing"))?;
    if !header.whole {
        return Err(Error::UnsupportedFormat(
            "this is the header of a pair of files; save both as one .nii or .nii.gz".to_owned(),
        ));
    }
    let size = header.size()?;
    let scalar = header.scalar()?;
    let data = &bytes[header.data_start(bytes.len())?..];
    let count = values(&size, scalar, data.len())?;
    let mut warnings = Vec::new();
    let (mut affine, assumed) = header.affine(size, reading, &mut warnings)?;
    if let Some((factor, unit)) = header.unit() {
        affine = affine.scaled(factor);
        let message = format!("distances are given in {unit} and were turned into millimetres");
        warnings.push(Warning::new("unit_converted", message));
    }
    let [slope, intercept] = [0, 1].map(|i| header.float(header.layout.slope, i));
    let scaled = slope != 0.0 && slope.is_finite() && intercept.is_finite();
    let [nx, ny, _] = size;
    let raster = Raster {
        data: Cow::Borrowed(&data[..count * scalar.size()]),
        scalar,
        order: header.order,
        slope: if scaled { slope } else { 1.0 },
        intercept: if scaled { intercept } else { 0.0 },
        size,
        strides: [1, nx, nx * ny],
        layers: [1, count],
        affine: affine.signed(RAS_TO_LPS).checked(size)?,
    };
    let mut segmentation = raster.open(&[], warnings)?;
    segmentation.contents.assumed_orientation = assumed;
    Ok(segmentation)
}
