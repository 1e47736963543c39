//! Segmentations of pixels (SEG): binary, fractional, and label maps.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::charset::Charset;
use super::element::DataSet;
use super::frames::Frames;
use super::pixels::Pixels;
use super::syntax::Syntax;
use super::tags;
use crate::reconstruction::Warning;
use crate::reconstruction::cloud::Error;
use crate::reconstruction::medical::affine::header;
use crate::reconstruction::medical::contents::{color, name};
use crate::reconstruction::medical::raster::mask;
use crate::reconstruction::medical::{
    Affine, Contents, Item, Kind, Reading, Segmentation, Source, bounds,
};
use crate::reconstruction::slices::{Content, Geometry};
use crate::reconstruction::vector::{cross, distance, norm};

/// How pixels stand for segments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Coding {
    /// A frame is of one segment; what is not zero belongs to it.
    Binary,
    /// A frame is of one segment; a pixel has a share of it, up to this number.
    Shares(u16),
    /// A frame is of all segments; a pixel has the number of one.
    Numbers,
}

/// A segmentation that was opened.
#[derive(Debug)]
struct Stack<'a> {
    pixels: Pixels<'a>,
    frames: Frames,
    coding: Coding,
    /// Number of each item's segment.
    numbers: Vec<u16>,
    /// Frames of each item by their slices.
    shown: Vec<BTreeMap<usize, usize>>,
}

/// Opens a segmentation.
///
/// # Errors
/// What is wrong with it, or is not read.
pub(super) fn open<'d, 'a>(
    data_set: &DataSet<'d>,
    syntax: &Syntax,
    reading: &Reading,
    keep: impl Fn(&'d [u8]) -> Cow<'a, [u8]>,
) -> Result<Segmentation<'a>, Error> {
    // Places first: a tiled slide is told as such, and not by its pixels.
    let count = data_set.integer(tags::FRAMES).unwrap_or(1);
    let groups = data_set.items(tags::FRAME_GROUPS).len();
    // A single frame may do with the shared group.
    let placed = usize::try_from(count)
        .ok()
        .filter(|&count| (1..=groups.max(1)).contains(&count));
    let placed = placed.ok_or_else(|| {
        header(format!(
            "{count} frames, but {groups} groups of attributes for them"
        ))
    })?;
    let frames = Frames::of(data_set, placed)?;
    let pixels = Pixels::of(data_set, syntax, reading, keep)?;
    let coding = coding(data_set)?;
    let described = described(data_set);
    let mut warnings = Vec::new();
    let counts = counts(data_set, &pixels, &frames, coding, &mut warnings);
    let numbers: Vec<u16> = described.keys().chain(counts.keys()).copied().collect();
    let numbers: Vec<u16> = std::collections::BTreeSet::from_iter(numbers)
        .into_iter()
        .collect();
    let shown: Vec<_> = numbers
        .iter()
        .map(|n| counts.get(n).cloned().unwrap_or_default())
        .collect();
    let area = norm(cross(frames.column, frames.row));
    let thickness = thickness(&frames, data_set);
    let items = numbers.iter().zip(&shown).map(|(number, shown)| {
        let voxels = shown.values().map(|&(_, voxels)| voxels).sum::<u64>();
        let (name, color) = described.get(number).cloned().unwrap_or_default();
        Item {
            number: i64::from(*number),
            name,
            color,
            voxels: Some(voxels),
            contours: None,
            slices: shown.len() as u64,
            volume_mm3: voxels as f64 * area * thickness,
        }
    });
    let mut contents = Contents::new(Kind::Segments, items.collect());
    if contents.parts.items.iter().all(|item| item.slices == 0) {
        return Err(Error::Slices("no pixel belongs to a segment".to_owned()));
    }
    let size = [pixels.columns, pixels.rows, frames.origins.len()];
    contents.size = Some(size);
    contents.spacing = Some([norm(frames.column), norm(frames.row), thickness]);
    if let Some(step) = frames.step() {
        let affine = Affine {
            steps: [frames.column, frames.row, step],
            origin: frames.origins[0],
        };
        contents = contents.on_grid(size, affine.checked(size)?);
    }
    contents.warnings = warnings;
    let frames_of = |shown: BTreeMap<usize, (usize, u64)>| {
        shown
            .into_iter()
            .map(|(slice, (frame, _))| (slice, frame))
            .collect()
    };
    let shown = shown.into_iter().map(frames_of).collect();
    let stack = Stack {
        pixels,
        frames,
        coding,
        numbers,
        shown,
    };
    contents.bounds = bounds(&stack.geometry(0), [size[0], size[1]]);
    Ok(Segmentation::new(contents, stack))
}

fn coding(data_set: &DataSet<'_>) -> Result<Coding, Error> {
    let kind = data_set.text(tags::SEGMENTATION_TYPE);
    match kind.as_str() {
        "BINARY" => Ok(Coding::Binary),
        "FRACTIONAL" => match data_set.short(tags::MAXIMUM_FRACTION) {
            Some(most) if most > 0 => Ok(Coding::Shares(most)),
            _ => Err(header("MaximumFractionalValue is missing")),
        },
        "LABELMAP" => Ok(Coding::Numbers),
        _ => Err(header(format!(
            "SegmentationType is {kind:.16}, must be BINARY, FRACTIONAL or LABELMAP"
        ))),
    }
}

/// Names and colours of the segments by their numbers.
fn described(data_set: &DataSet<'_>) -> BTreeMap<u16, (Option<String>, Option<String>)> {
    let segments = data_set.items(tags::SEGMENT_SEQUENCE).iter();
    let charset = Charset::of(data_set);
    let segment = |segment: &DataSet<'_>| {
        let number = segment.short(tags::SEGMENT_NUMBER)?;
        let lab = <[u16; 3]>::try_from(segment.shorts(tags::RECOMMENDED_COLOR)).ok();
        let label = charset.utf8(segment.bytes(tags::SEGMENT_LABEL));
        Some((number, (name(&label), lab.map(of_lab))))
    };
    // A label map may describe its background, which is zero.
    segments
        .filter_map(segment)
        .filter(|(number, _)| *number != 0)
        .collect()
}

/// The colour of CIELab numbers of 16 bits, as DICOM has them, under the light D65.
fn of_lab([l, a, b]: [u16; 3]) -> String {
    let l = f64::from(l) / 65535.0 * 100.0;
    let [a, b] = [a, b].map(|v| f64::from(v) / 65535.0 * 255.0 - 128.0);
    let y = (l + 16.0) / 116.0;
    let linear = |t: f64| {
        if t > 6.0 / 29.0 {
            t.powi(3)
        } else {
            (t - 4.0 / 29.0) * 3.0 * (6.0f64 / 29.0).powi(2)
        }
    };
    let [x, y, z] = [
        0.9505 * linear(y + a / 500.0),
        linear(y),
        1.089 * linear(y - b / 200.0),
    ];
    let gamma = |v: f64| {
        if v <= 0.003_130_8 {
            12.92 * v
        } else {
            1.055 * v.powf(1.0 / 2.4) - 0.055
        }
    };
    color([
        gamma(3.2406 * x - 1.5372 * y - 0.4986 * z),
        gamma(-0.9689 * x + 1.8758 * y + 0.0415 * z),
        gamma(0.0557 * x - 0.204 * y + 1.057 * z),
    ])
}

/// The frame and the number of pixels of each segment in each slice where it is.
fn counts(
    data_set: &DataSet<'_>,
    pixels: &Pixels<'_>,
    frames: &Frames,
    coding: Coding,
    warnings: &mut Vec<Warning>,
) -> BTreeMap<u16, BTreeMap<usize, (usize, u64)>> {
    // Zero is nothing, and so is what fills up images.
    let background = data_set.short(tags::PIXEL_PADDING).unwrap_or(0);
    let mut counts: BTreeMap<u16, BTreeMap<usize, (usize, u64)>> = BTreeMap::new();
    let mut repeated = 0;
    let mut seen = std::collections::BTreeSet::new();
    for frame in 0..pixels.frames {
        let slice = frames.slices[frame];
        let segment = if coding == Coding::Numbers {
            None
        } else {
            frames.segments[frame]
        };
        if !seen.insert((segment, slice)) {
            repeated += 1;
            continue;
        }
        let mut found: BTreeMap<u16, u64> = BTreeMap::new();
        for row in 0..pixels.rows {
            for column in 0..pixels.columns {
                let value = pixels.at(frame, column, row);
                match coding {
                    Coding::Numbers if value != 0 && value != background => {
                        *found.entry(value).or_default() += 1;
                    }
                    Coding::Binary if value > 0 => {
                        *found.entry(segment.unwrap_or(1)).or_default() += 1;
                    }
                    Coding::Shares(most) if 2 * u32::from(value) >= u32::from(most) => {
                        *found.entry(segment.unwrap_or(1)).or_default() += 1;
                    }
                    _ => {}
                }
            }
        }
        for (number, voxels) in found {
            counts
                .entry(number)
                .or_default()
                .insert(slice, (frame, voxels));
        }
    }
    if repeated > 0 {
        let message = format!(
            "{repeated} frames show what another frame of the same slice shows; the first is used"
        );
        warnings.push(Warning::new("frames_repeated", message));
    }
    counts
}

/// Distance of slices: the median of what the places of the frames say.
fn thickness(frames: &Frames, data_set: &DataSet<'_>) -> f64 {
    let mut distances: Vec<f64> = frames
        .origins
        .windows(2)
        .map(|pair| distance(pair[0], pair[1]))
        .collect();
    distances.sort_by(f64::total_cmp);
    if let Some(&distance) = distances.get(distances.len() / 2) {
        return distance;
    }
    // A single slice has its own thickness.
    let measures = data_set
        .item(tags::SHARED_GROUPS)
        .and_then(|group| group.item(tags::PIXEL_MEASURES_SEQUENCE));
    let thickness = measures.and_then(|measures| measures.vector::<1>(tags::SLICE_THICKNESS));
    thickness.map_or(1.0, |[thickness]| thickness.abs().min(1e3))
}

impl Source for Stack<'_> {
    fn geometry(&self, _: usize) -> Geometry {
        Geometry {
            column: self.frames.column,
            row: self.frames.row,
            origins: self.frames.origins.clone(),
        }
    }

    fn content(&self, item: usize, slice: usize) -> Option<Content> {
        let frame = *self.shown[item].get(&slice)?;
        let number = self.numbers[item];
        let size = [self.pixels.columns, self.pixels.rows];
        let at = |column, row| self.pixels.at(frame, column, row);
        let all = |yes| if yes { u8::MAX } else { 0 };
        let mask = match self.coding {
            Coding::Binary => mask(size, false, |column, row| all(at(column, row) > 0)),
            Coding::Numbers => mask(size, false, |column, row| all(at(column, row) == number)),
            Coding::Shares(most) => mask(size, true, |column, row| {
                let share = f64::from(at(column, row)) / f64::from(most);
                (share.min(1.0) * 255.0).round() as u8
            }),
        };
        mask.map(Content::Mask)
    }
}
