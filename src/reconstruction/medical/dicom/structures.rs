//! Structure sets (RT-STRUCT): regions of interest, drawn as closed contours in planes.

use std::collections::BTreeMap;

use super::charset::Charset;
use super::contours::Contour;
use super::element::DataSet;
use super::planes::Planes;
use super::tags;
use crate::reconstruction::Warning;
use crate::reconstruction::cloud::Error;
use crate::reconstruction::medical::contents::{color, name};
use crate::reconstruction::medical::{Contents, Item, Kind, Segmentation, Source};
use crate::reconstruction::slices::{Content, Geometry, area};
use crate::reconstruction::vector::Bounds;

/// A structure set that was opened: the planes of each region.
#[derive(Debug)]
struct Structures(Vec<Planes>);

/// What of a file is not used, and why.
#[derive(Debug, Default)]
pub(super) struct Left {
    /// Contours of one or two points.
    pub(super) short: usize,
    /// Points and open lines.
    pub(super) open: usize,
    /// Contours whose points do not lie in a plane, or not in one parallel to the others.
    pub(super) skew: usize,
    /// Contours that are there twice, which would be holes of each other.
    pub(super) repeated: usize,
    /// Contours with numbers that are none.
    pub(super) damaged: usize,
}

impl Left {
    fn warnings(&self) -> Vec<Warning> {
        let all = [
            (self.short, "contours_too_short", "have fewer than 3 points"),
            (self.open, "contours_open", "are points or open lines"),
            (
                self.skew,
                "contours_not_parallel",
                "do not lie in planes parallel to the others of their region",
            ),
            (
                self.repeated,
                "contours_repeated",
                "repeat another one of the same plane",
            ),
            (
                self.damaged,
                "contours_damaged",
                "have coordinates that are no numbers",
            ),
        ];
        let left = all.into_iter().filter(|(count, ..)| *count > 0);
        left.map(|(count, code, what)| {
            Warning::new(code, format!("{count} contours {what} and are not used"))
        })
        .collect()
    }
}

/// Opens a structure set.
///
/// # Errors
/// [`Error::Slices`] without a closed contour.
pub(super) fn open<'a>(data_set: &DataSet<'_>) -> Result<Segmentation<'a>, Error> {
    let mut left = Left::default();
    let mut names: BTreeMap<i64, Option<String>> = BTreeMap::new();
    let charset = Charset::of(data_set);
    for roi in data_set.items(tags::STRUCTURE_SEQUENCE) {
        if let Some(number) = roi.integer(tags::ROI_NUMBER) {
            names.insert(number, name(&charset.utf8(roi.bytes(tags::ROI_NAME))));
        }
    }
    let mut drawn: BTreeMap<i64, (Option<String>, Vec<Contour>)> = BTreeMap::new();
    for roi in data_set.items(tags::ROI_CONTOUR_SEQUENCE) {
        let Some(number) = roi.integer(tags::REFERENCED_ROI) else {
            continue;
        };
        let rgb = roi.vector::<3>(tags::ROI_COLOR);
        let region = drawn.entry(number).or_default();
        region.0 = rgb.map(|rgb| color(rgb.map(|v| v / 255.0)));
        let contours = roi.items(tags::CONTOUR_SEQUENCE).iter();
        region
            .1
            .extend(contours.filter_map(|contour| Contour::of(contour, &mut left)));
    }
    let (mut items, mut planes) = (Vec::new(), Vec::new());
    let mut bounds: Option<Bounds> = None;
    let numbers: std::collections::BTreeSet<i64> =
        names.keys().chain(drawn.keys()).copied().collect();
    for number in numbers {
        let (color, contours) = drawn.remove(&number).unwrap_or_default();
        let points = contours.iter().flat_map(|contour| &contour.points);
        let region = Bounds::of(
            bounds
                .iter()
                .flat_map(|all| [&all.min, &all.max])
                .chain(points),
        );
        bounds = region.or(bounds);
        let region = Planes::of(contours, &mut left);
        items.push(Item {
            number,
            name: names.get(&number).cloned().flatten(),
            color,
            voxels: None,
            contours: Some(region.polygons.iter().map(|plane| plane.len() as u64).sum()),
            slices: region.polygons.len() as u64,
            // A sum of nothing would be -0.
            volume_mm3: region.distance()
                * region
                    .polygons
                    .iter()
                    .fold(0.0, |sum, plane| sum + area(plane)),
        });
        planes.push(region);
    }
    if items.iter().all(|item| item.slices == 0) {
        return Err(Error::Slices("the file has no closed contours".to_owned()));
    }
    let mut contents = Contents::new(Kind::Rois, items);
    contents.bounds = bounds;
    contents.warnings = left.warnings();
    Ok(Segmentation::new(contents, Structures(planes)))
}

impl Source for Structures {
    fn geometry(&self, item: usize) -> Geometry {
        let planes = &self.0[item];
        Geometry {
            column: planes.column,
            row: planes.row,
            origins: planes.origins.clone(),
        }
    }

    fn content(&self, item: usize, slice: usize) -> Option<Content> {
        let polygons = self.0[item].polygons.get(slice)?;
        Some(Content::Polygons(polygons.clone()))
    }
}
