//! From slices, one after the other, to a cloud: thinned points of their contours and places inside and outside.
//!
//! Points in the slices are right to a tenth of a pixel; any that are made between thick slices have the stairs of
//! the slices in them. Along the contours they would be far denser than across the slices, where no fit can make
//! sense of them: they are thinned to an even density.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;

use super::layers::{GAP, Layer, Stack};
use super::occupancy::Occupancy;
use super::polygons::Contours;
use super::priority::Chosen;
use super::runs::repeated;
use super::sides::{Band, Beside};
use super::summary::{Face, Summary};
use super::thinning::Thinned;
use super::told::{Seen, Told};
use super::{Content, Geometry, Plane};
use crate::reconstruction::cloud::{Error, Label, PointCloud};
use crate::reconstruction::observer::Warning;
use crate::reconstruction::random::{Generator, Purpose, stream};
use crate::reconstruction::space::Space;
use crate::reconstruction::vector::Vec3;

/// Slices in a row without the label between two with it, up to which it may be that they were left out.
const LEFT_OUT: usize = 2;

/// What was done with slices, and what a mesh can be held against.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// What was done.
    pub summary: Summary,
    /// The pixels that show the label.
    pub occupancy: Occupancy,
}

/// Takes in slices and gives the cloud.
#[derive(Debug)]
pub struct Builder {
    stack: Stack,
    band: Band,
    random: Generator,
    /// The layer before the open one, if it lies right below.
    below: Option<Layer>,
    below_unknown: bool,
    /// The layer that the next slice may belong to, and what its slices show.
    open: Option<(Layer, Content)>,
    last: Option<usize>,
    /// What slices tell, one by one.
    by_slice: Told,
    /// The same with one slice in the middle for each run of identical ones.
    by_run: Told,
    runs: Vec<RangeInclusive<usize>>,
    /// How far slices are apart between which some are missing.
    gaps: Vec<f64>,
    faces: BTreeSet<Face>,
    occupancy: Occupancy,
    voxels: Option<f64>,
    volume: f64,
    contour_points: usize,
    ignored: usize,
}

impl Builder {
    /// Begins with a stack.
    ///
    /// # Errors
    /// [`Error::Slices`] where the stack is flat, has one slice only or is in disorder.
    pub fn new(geometry: &Geometry) -> Result<Self, Error> {
        let stack = Stack::new(geometry)?;
        let radius = stack.radius(stack.distance);
        Ok(Self {
            band: Band::new(stack.pixel, stack.reach()),
            random: stream(0, Purpose::Slices),
            below: None,
            below_unknown: false,
            open: None,
            last: None,
            by_slice: Told::new(radius),
            by_run: Told::new(radius),
            runs: Vec::new(),
            gaps: Vec::new(),
            faces: BTreeSet::new(),
            occupancy: Occupancy::new(geometry),
            voxels: None,
            volume: 0.0,
            contour_points: 0,
            ignored: 0,
            stack,
        })
    }

    /// Takes the next slice. Those without the label may be left out.
    ///
    /// # Errors
    /// [`Error::Slices`] where it is not behind the last one or not in the stack.
    pub fn push(&mut self, plane: Plane) -> Result<(), Error> {
        let Plane { slice, content } = plane;
        if slice >= self.stack.slices() || self.last.is_some_and(|last| slice <= last) {
            return Err(Error::Slices(format!(
                "slice {slice} is not behind the one before it"
            )));
        }
        self.last = Some(slice);
        self.count(slice, &content);
        if let Some((mut layer, same)) = self.open.take() {
            if same == content && layer.slices.end() + 1 == slice {
                layer.slices = *layer.slices.start()..=slice;
                self.fill(slice, &content, &layer);
                self.open = Some((layer, same));
                return Ok(());
            }
            self.open = Some((layer, same));
        }
        let Some(layer) = Layer::new(slice, &content, &self.stack) else {
            return Ok(());
        };
        self.fill(slice, &content, &layer);
        self.close(Some(&layer));
        self.open = Some((layer, content));
        Ok(())
    }

    /// The cloud, what was done, and what the user should know.
    ///
    /// # Errors
    /// [`Error::Slices`] where fewer than two slices show the label.
    pub fn finish(mut self) -> Result<(PointCloud, Record, Vec<Warning>), Error> {
        self.close(None);
        let times = repeated(&self.runs);
        let told = if times > 1 {
            self.by_run
        } else {
            self.by_slice
        };
        let heights = told.slices.iter().map(|&slice| self.stack.height(slice));
        let heights: Vec<f64> = heights.collect();
        let mut steps: Vec<f64> = heights.windows(2).map(|p| (p[1] - p[0]).abs()).collect();
        if steps.is_empty() {
            let shown = heights.len();
            return Err(Error::Slices(format!(
                "{shown} slice(s) show the label; a surface needs two at least"
            )));
        }
        let middle = steps.len() / 2;
        let distance = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
        let missing = |step: &&f64| **step > GAP * distance;
        let gaps = self.gaps.iter().filter(missing).count();
        let radius = self.stack.radius(distance);
        let points = thinned(told.points, radius);
        let [interior, exterior] = [told.interior, told.exterior].map(Chosen::places);
        let summary = Summary {
            slices: heights.len(),
            slice_distance: distance,
            pixel_size: self.stack.pixel,
            voxels: self.voxels,
            volume: self.volume,
            contour_points: self.contour_points,
            thinning_radius: radius,
            surface_points: points.len(),
            interior_points: interior.len(),
            exterior_points: exterior.len(),
            slices_repeated: times,
            gaps,
            contours_ignored: self.ignored,
            invented_at: self.faces.into_iter().collect(),
        };
        let warnings = summary.warnings();
        let mut cloud = labelled(points, Label::Surface);
        cloud.append(labelled(interior, Label::Interior));
        cloud.append(labelled(exterior, Label::Exterior));
        let occupancy = self.occupancy;
        Ok((cloud, Record { summary, occupancy }, warnings))
    }

    /// Notes what a slice shows.
    fn count(&mut self, slice: usize, content: &Content) {
        match content {
            Content::Mask(mask) => {
                let filled = mask.pixels();
                *self.voxels.get_or_insert(0.0) += filled;
                self.faces.extend(Face::touched(mask));
                let ends = [
                    (Face::FirstSlice, slice == 0),
                    (Face::LastSlice, slice + 1 == self.stack.slices()),
                ];
                let touched = ends.into_iter().filter(|(_, at)| *at && filled > 0.0);
                self.faces.extend(touched.map(|(face, _)| face));
            }
            Content::Polygons(polygons) => self.ignored += Contours::new(polygons).ignored,
        }
    }

    /// Notes how much of a slice a layer fills.
    fn fill(&mut self, slice: usize, content: &Content, layer: &Layer) {
        let pixels = match content {
            Content::Mask(mask) => mask.pixels(),
            Content::Polygons(_) => layer.lattice.filled(),
        };
        self.volume += pixels * self.stack.pixel_area() * self.stack.thickness(slice);
        self.occupancy.add(slice, content, &layer.lattice);
    }

    /// Ends the open layer; `above` is the next one.
    fn close(&mut self, above: Option<&Layer>) {
        let Some((layer, _)) = self.open.take() else {
            return;
        };
        let gap = above.and_then(|above| self.left_out(&layer, above));
        let adjacent = above.filter(|above| *above.slices.start() == layer.slices.end() + 1);
        let below = self.below.take();
        let beside = [
            side(below.as_ref(), self.below_unknown),
            side(adjacent, gap.is_some()),
        ];
        let seen = Seen {
            layer: &layer,
            beside,
            slice: layer.middle(),
            next: layer.count() as f64,
        };
        let told = seen.told(&self.stack, self.band, &mut self.random);
        self.by_run.add(&told, seen.slice);
        if layer.count() == 1 {
            self.by_slice.add(&told, seen.slice);
        } else {
            for slice in layer.slices.clone() {
                let seen = seen.at(slice);
                let told = seen.told(&self.stack, self.band, &mut self.random);
                self.by_slice.add(&told, seen.slice);
            }
        }
        self.contour_points += layer.contour.len() * layer.count();
        self.runs.push(layer.slices.clone());
        self.gaps.extend(gap);
        self.below_unknown = gap.is_some();
        self.below = adjacent.is_some().then_some(layer);
    }

    /// How far two layers are apart, if slices are missing between them: the distance is too large, or a few slices
    /// are empty although the label goes on behind them.
    fn left_out(&self, layer: &Layer, above: &Layer) -> Option<f64> {
        let [from, to] = [*layer.slices.end(), *above.slices.start()];
        let away = (self.stack.height(to as f64) - self.stack.height(from as f64)).abs();
        let empty = to - from - 1;
        let missing = if empty == 0 {
            away > GAP * self.stack.distance
        } else {
            empty <= LEFT_OUT && layer.lattice.overlaps(&above.lattice)
        };
        missing.then_some(away)
    }
}

fn side(layer: Option<&Layer>, unknown: bool) -> Beside<'_> {
    match layer {
        Some(layer) => Beside::Layer(layer),
        None if unknown => Beside::Unknown,
        None => Beside::Nothing,
    }
}

/// The points with `radius` between them, if they are not that far apart already.
fn thinned(points: Thinned, radius: f64) -> Vec<Vec3> {
    if points.radius() >= radius {
        return points.points();
    }
    let mut fewer = Thinned::new(radius);
    for point in points.points() {
        fewer.offer(point);
    }
    fewer.points()
}

fn labelled(points: Vec<Vec3>, label: Label) -> PointCloud {
    PointCloud {
        points,
        space: Space::PATIENT,
        ..PointCloud::default()
    }
    .with_label(label)
}
