//! Where the frames of a segmentation lie, and what each one shows.

use super::element::DataSet;
use super::tags;
use crate::reconstruction::cloud::Error;
use crate::reconstruction::medical::affine::header;
use crate::reconstruction::vector::{Vec3, cross, distance, dot, norm, scale, sub};

/// Frames closer than this, in millimetres along their normal, lie in one slice.
const SAME_SLICE: f64 = 0.01;

/// How far the frames of one slice may be apart within it, in pixels.
const SAME_PLACE: f64 = 0.1;

/// Farthest place in millimetres.
const FARTHEST: f64 = 1e5;

/// How far the cosines of frames may differ.
const SAME_DIRECTION: f64 = 1e-3;

/// The frames of a segmentation, in slices.
#[derive(Debug)]
pub(super) struct Frames {
    pub(super) column: Vec3,
    pub(super) row: Vec3,
    /// First pixels of the slices, in order along the normal.
    pub(super) origins: Vec<Vec3>,
    /// Slice of each frame.
    pub(super) slices: Vec<usize>,
    /// Segment that a frame shows, where frames show one each.
    pub(super) segments: Vec<Option<u16>>,
}

impl Frames {
    /// The frames as their groups of attributes place them; their order in the file says nothing.
    ///
    /// # Errors
    /// [`Error::OrientationMissing`] for frames that are not placed in the patient,
    /// [`Error::UnsupportedFormat`] for those that are no stack.
    pub(super) fn of(data_set: &DataSet<'_>, count: usize) -> Result<Self, Error> {
        let groups = data_set.items(tags::FRAME_GROUPS);
        let is_tiled = data_set.get(tags::TOTAL_PIXEL_MATRIX_COLUMNS).is_some()
            || groups
                .iter()
                .any(|group| group.get(tags::PLANE_POSITION_SLIDE_SEQUENCE).is_some());
        if is_tiled {
            return Err(Error::UnsupportedFormat(
                "the segmentation is of a tiled slide of microscopy, which has no slices to make a surface of"
                    .to_owned(),
            ));
        }
        let shared = data_set.item(tags::SHARED_GROUPS);
        let nothing = DataSet::default();
        let mut cosines = None;
        let mut spacing = None;
        let mut places = Vec::new();
        let mut segments = Vec::new();
        for frame in 0..count {
            let group = groups.get(frame).unwrap_or(&nothing);
            // What holds for all frames stands in the shared group, else in that of each.
            let within = |sequence| {
                let own = group.item(sequence);
                own.or_else(|| shared?.item(sequence)).unwrap_or(&nothing)
            };
            let orientation =
                within(tags::PLANE_ORIENTATION_SEQUENCE).vector::<6>(tags::IMAGE_ORIENTATION);
            let orientation = orientation.ok_or_else(|| unplaced("ImageOrientationPatient"))?;
            let first = *cosines.get_or_insert(orientation);
            if (0..6).any(|i| (first[i] - orientation[i]).abs() > SAME_DIRECTION) {
                return Err(no_stack("are not parallel"));
            }
            let measures = within(tags::PIXEL_MEASURES_SEQUENCE).vector::<2>(tags::PIXEL_SPACING);
            let measures = measures.ok_or_else(|| header("PixelSpacing of a frame is missing"))?;
            let first = *spacing.get_or_insert(measures);
            if (0..2).any(|i| (first[i] - measures[i]).abs() > SAME_DIRECTION * first[i].abs()) {
                return Err(no_stack("have pixels of different sizes"));
            }
            let place = within(tags::PLANE_POSITION_SEQUENCE).vector::<3>(tags::IMAGE_POSITION);
            places.push(place.ok_or_else(|| unplaced("ImagePositionPatient"))?);
            segments.push(
                within(tags::SEGMENT_IDENTIFICATION_SEQUENCE).short(tags::REFERENCED_SEGMENT),
            );
        }
        let mut lengths = places.iter().flatten().chain(spacing.iter().flatten());
        if lengths.any(|length| length.abs() > FARTHEST) {
            return Err(header("frames lie farther away than 100 metres"));
        }
        let [ax, ay, az, bx, by, bz] = cosines.ok_or(Error::Empty)?;
        let (along_row, along_column) = ([ax, ay, az], [bx, by, bz]);
        let is_unit = |v: Vec3| (norm(v) - 1.0).abs() < 0.01;
        if !is_unit(along_row)
            || !is_unit(along_column)
            || dot(along_row, along_column).abs() > 0.01
        {
            return Err(header(
                "ImageOrientationPatient must be two orthogonal unit vectors",
            ));
        }
        // PixelSpacing has the distance of rows first.
        let [between_rows, between_columns] = spacing.ok_or(Error::Empty)?;
        if !(between_rows > 0.0 && between_columns > 0.0) {
            return Err(header("PixelSpacing must be greater than zero"));
        }
        let column = scale(along_row, between_columns);
        let row = scale(along_column, between_rows);
        let (origins, slices) = stack(
            &places,
            cross(along_row, along_column),
            norm(column).min(norm(row)),
        )?;
        Ok(Self {
            column,
            row,
            origins,
            slices,
            segments,
        })
    }

    /// Step from slice to slice where all are the same, with a tolerance of a hundredth.
    pub(super) fn step(&self) -> Option<Vec3> {
        let (first, last) = (self.origins.first()?, self.origins.last()?);
        let steps = self
            .origins
            .len()
            .checked_sub(1)
            .filter(|&steps| steps > 0)?;
        let mean = scale(sub(*last, *first), 1.0 / steps as f64);
        let even = |pair: &[Vec3]| distance(sub(pair[1], pair[0]), mean) < 0.01 * norm(mean);
        self.origins.windows(2).all(even).then_some(mean)
    }
}

/// The places in order along the normal, each once, and which one belongs to each frame.
fn stack(places: &[Vec3], normal: Vec3, pixel: f64) -> Result<(Vec<Vec3>, Vec<usize>), Error> {
    let height = |i: &usize| dot(places[*i], normal);
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by(|a, b| height(a).total_cmp(&height(b)));
    let mut origins: Vec<Vec3> = Vec::new();
    let mut slices = vec![0; places.len()];
    for i in order {
        let place = places[i];
        match origins.last() {
            Some(&last) if dot(sub(place, last), normal) < SAME_SLICE => {
                if distance(place, last) > SAME_PLACE * pixel + SAME_SLICE {
                    return Err(no_stack("lie beside each other"));
                }
            }
            _ => origins.push(place),
        }
        slices[i] = origins.len() - 1;
    }
    Ok((origins, slices))
}

fn unplaced(what: &str) -> Error {
    Error::OrientationMissing(format!(
        "a frame has no {what}: the segmentation is of images that are not placed in the patient"
    ))
}

fn no_stack(how: &str) -> Error {
    Error::UnsupportedFormat(format!(
        "the frames of the segmentation {how}; a stack of slices is needed"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_sorted_by_place() {
        let places = [
            [0.0, 0.0, 5.0],
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 5.001],
            [0.0, 0.0, 2.5],
        ];
        let (origins, slices) = stack(&places, [0.0, 0.0, 1.0], 1.0).unwrap();
        assert_eq!(origins.len(), 3);
        assert_eq!(slices, [2, 0, 2, 1]);
        let beside = [[0.0; 3], [7.0, 0.0, 0.0]];
        assert!(stack(&beside, [0.0, 0.0, 1.0], 1.0).is_err());
    }
}
