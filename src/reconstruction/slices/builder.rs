//! From slices, one after the other, to a cloud: thinned points of their contours and places inside and outside.
//!
//! Points in the slices are right to a tenth of a pixel; any that are made between thick slices have the stairs of
//! the slices in them. Along the contours they would be far denser than across the slices, where no fit can make
//! sense of them: they are thinned to an even density.

use std::collections::BTreeSet;

use rand::seq::SliceRandom;

use super::layers::{GAP, Layer, Stack};
use super::polygons::Contours;
use super::priority::Chosen;
use super::runs::repeated;
use super::sides::{self, Band, Beside};
use super::summary::{Face, Summary};
use super::thinning::Thinned;
use super::{Content, Geometry, Plane};
use crate::reconstruction::cloud::{Error, Label, PointCloud};
use crate::reconstruction::observer::Warning;
use crate::reconstruction::random::{Generator, Purpose, stream};
use crate::reconstruction::vector::Vec3;

/// Most places of each side.
const SIDES: usize = 3_000;

/// Points beyond which they are thinned further, so that memory has a bound.
const MAX_POINTS: usize = 500_000;

/// Slices in a row without the label between two with it, up to which it may be that they were left out.
const LEFT_OUT: usize = 2;

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
    runs: Vec<std::ops::RangeInclusive<usize>>,
    faces: BTreeSet<Face>,
    voxels: Option<f64>,
    volume: f64,
    contour_points: usize,
    ignored: usize,
}

/// Points of the contours and places on both sides.
#[derive(Debug)]
struct Told {
    points: Thinned,
    interior: Chosen,
    exterior: Chosen,
    /// Slices, which lie between those of the file for runs of an even number.
    slices: Vec<f64>,
}

impl Told {
    fn new(radius: f64) -> Self {
        Self {
            points: Thinned::new(radius),
            interior: Chosen::new(SIDES),
            exterior: Chosen::new(SIDES),
            slices: Vec::new(),
        }
    }
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
            faces: BTreeSet::new(),
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
        if let Some((layer, same)) = &mut self.open {
            if *same == content && layer.slices.end() + 1 == slice {
                layer.slices = *layer.slices.start()..=slice;
                self.volume += layer_volume(layer, &self.stack, slice, &content);
                return Ok(());
            }
        }
        let Some(layer) = Layer::new(slice, &content, &self.stack) else {
            return Ok(());
        };
        self.volume += layer_volume(&layer, &self.stack, slice, &content);
        self.close(Some(&layer));
        self.open = Some((layer, content));
        Ok(())
    }

    /// The cloud, what was done, and what the user should know.
    ///
    /// # Errors
    /// [`Error::Slices`] where fewer than two slices show the label.
    pub fn finish(mut self) -> Result<(PointCloud, Summary, Vec<Warning>), Error> {
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
        let gaps = steps.iter().filter(|&&step| step > GAP * distance).count();
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
        Ok((cloud, summary, warnings))
    }

    /// Notes what a slice shows.
    fn count(&mut self, slice: usize, content: &Content) {
        match content {
            Content::Mask(mask) => {
                let whole = if mask.fractional { 255.0 } else { 1.0 };
                let value = |v: &u8| {
                    if mask.fractional {
                        f64::from(*v)
                    } else {
                        f64::from(u8::from(*v > 0))
                    }
                };
                let filled = mask.filled.iter().map(value).sum::<f64>() / whole;
                *self.voxels.get_or_insert(0.0) += filled;
                self.faces.extend(Face::touched(mask));
                if filled > 0.0 && slice == 0 {
                    self.faces.insert(Face::FirstSlice);
                }
                if filled > 0.0 && slice + 1 == self.stack.slices() {
                    self.faces.insert(Face::LastSlice);
                }
            }
            Content::Polygons(polygons) => self.ignored += Contours::new(polygons).ignored,
        }
    }

    /// Ends the open layer; `above` is the next one.
    fn close(&mut self, above: Option<&Layer>) {
        let Some((layer, _)) = self.open.take() else {
            return;
        };
        let unknown = above.is_some_and(|above| self.left_out(&layer, above));
        let adjacent = above.filter(|above| *above.slices.start() == layer.slices.end() + 1);
        let below = self.below.take();
        let beside = [
            side(below.as_ref(), self.below_unknown),
            side(adjacent, unknown),
        ];
        let [middle, count] = [layer.middle(), layer.count() as f64];
        self.by_run.take(
            &self.stack,
            (&layer, beside),
            (middle, count),
            (self.band, &mut self.random),
        );
        for slice in layer.slices.clone() {
            let beside = self.within(&layer, slice, beside);
            self.by_slice.take(
                &self.stack,
                (&layer, beside),
                (slice as f64, 1.0),
                (self.band, &mut self.random),
            );
        }
        self.contour_points += layer.contour.len() * layer.count();
        self.runs.push(layer.slices.clone());
        self.below_unknown = unknown;
        self.below = adjacent.is_some().then_some(layer);
    }

    /// What lies beside one slice of a layer.
    fn within<'a>(
        &self,
        layer: &'a Layer,
        slice: usize,
        beside: [Beside<'a>; 2],
    ) -> [Beside<'a>; 2] {
        let ends = [*layer.slices.start(), *layer.slices.end()];
        [0, 1].map(|i| {
            if slice == ends[i] {
                beside[i]
            } else {
                Beside::Layer(layer)
            }
        })
    }

    /// Whether slices are missing between two layers: their distance is too large, or a few are empty although the
    /// label goes on behind them.
    fn left_out(&self, layer: &Layer, above: &Layer) -> bool {
        let [from, to] = [*layer.slices.end(), *above.slices.start()];
        let away = (self.stack.height(to as f64) - self.stack.height(from as f64)).abs();
        let empty = to - from - 1;
        if empty == 0 {
            return away > GAP * self.stack.distance;
        }
        empty <= LEFT_OUT && layer.lattice.overlaps(&above.lattice)
    }
}

fn side(layer: Option<&Layer>, unknown: bool) -> Beside<'_> {
    match layer {
        Some(layer) => Beside::Layer(layer),
        None if unknown => Beside::Unknown,
        None => Beside::Nothing,
    }
}

/// What one more slice adds to the volume.
fn layer_volume(layer: &Layer, stack: &Stack, slice: usize, content: &Content) -> f64 {
    let pixels = match content {
        Content::Mask(mask) if mask.fractional => {
            mask.filled.iter().map(|&v| f64::from(v)).sum::<f64>() / 255.0
        }
        Content::Mask(mask) => mask.filled.iter().filter(|&&v| v > 0).count() as f64,
        Content::Polygons(_) => layer.lattice.filled(),
    };
    pixels * stack.pixel_area() * stack.thickness(slice)
}

impl Told {
    /// Takes what a layer tells at a slice; where nothing lies beside it, the next slice is `next` away.
    fn take(
        &mut self,
        stack: &Stack,
        (layer, beside): (&Layer, [Beside<'_>; 2]),
        (slice, next): (f64, f64),
        (band, random): (Band, &mut Generator),
    ) {
        self.slices.push(slice);
        let mut contour: Vec<Vec3> = layer
            .contour
            .iter()
            .map(|&place| stack.point(place, slice))
            .collect();
        contour.shuffle(random);
        for point in contour {
            self.points.offer(point);
        }
        if self.points.len() > MAX_POINTS {
            self.points.coarsen();
        }
        sides::on_layer(layer, beside, band, |place, inside| {
            let chosen = if inside {
                &mut self.interior
            } else {
                &mut self.exterior
            };
            chosen.offer(stack.point(place, slice), random);
        });
        for (beside, way) in beside.iter().zip([-1.0, 1.0]) {
            if matches!(beside, Beside::Nothing) {
                sides::beyond(layer, band, |place| {
                    self.exterior
                        .offer(stack.point(place, slice + way * next), random);
                });
            }
        }
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
        ..PointCloud::default()
    }
    .with_label(label)
}
