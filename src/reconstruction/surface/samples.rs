//! The field at some of the lattice's points: memory as the surface, not as the volume.
//!
//! A set of bits says which points are known; their values lie in one array in the order of the
//! points. The number of known points before each page of the set makes a look-up one addition
//! and a few counts of bits, without hashing and in an order that never varies.

use std::ops::Range;

use rayon::prelude::*;

use super::bits::{Bits, Page, ones};
use super::grid::Lattice;
use super::{Field, Request};
use crate::reconstruction::error::Error;
use crate::reconstruction::vector::Vec3;

/// Field points asked for in one call: enough for every thread of an engine, and a few
/// milliseconds to the next question whether to stop.
pub(super) const BATCH: usize = 1 << 15;

/// Points that a thread places at a time.
const PIECE: usize = 1 << 12;

/// Known points that a triangle may cost. A smooth surface takes about two; a field that is noise
/// near zero everywhere would fill the memory before its triangles are counted.
const POINTS_PER_TRIANGLE: usize = 4;

/// Known points that are always allowed, whatever the limit on triangles: the coarse grid.
const FREE_POINTS: usize = 1 << 21;

/// Value that the field takes on the frame.
pub(super) const OUTSIDE: f64 = -1.0;

/// What was seen of a field.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Seen {
    /// Points at which it was evaluated.
    pub(super) evaluations: u64,
    /// Points of these at which it was positive.
    pub(super) positive: u64,
}

/// Where values come from, and what was seen of them.
pub(super) struct Source<'a> {
    pub(super) field: &'a dyn Field,
    pub(super) request: &'a Request<'a>,
    pub(super) lattice: Lattice,
    pub(super) seen: Seen,
}

impl Source<'_> {
    /// Appends the values at the lattice points `indices`; those of the frame cost nothing.
    pub(super) fn append(&mut self, indices: &[usize], values: &mut Vec<f64>) -> Result<(), Error> {
        if (self.request.cancelled)() {
            return Err(Error::Cancelled);
        }
        let lattice = &self.lattice;
        let placed = |&index: &usize| {
            let at = lattice.coordinates(index);
            let is_frame = (0..3).any(|axis| lattice.is_frame(axis, at[axis]));
            (!is_frame).then(|| lattice.position(at))
        };
        let placed: Vec<Option<Vec3>> =
            indices.par_iter().with_min_len(PIECE).map(placed).collect();
        let points: Vec<Vec3> = placed.iter().copied().flatten().collect();
        let mut found = vec![0.0; points.len()];
        self.field.values(&points, &mut found)?;
        self.seen.evaluations += points.len() as u64;
        let mut found = found.into_iter();
        for point in placed {
            let known = point.and_then(|point| Some((point, found.next()?)));
            let Some((point, value)) = known else {
                values.push(OUTSIDE);
                continue;
            };
            check_finite(value, point)?;
            self.seen.positive += u64::from(value > 0.0);
            values.push(value);
        }
        Ok(())
    }
}

fn check_finite(value: f64, point: Vec3) -> Result<(), Error> {
    if value.is_finite() {
        Ok(())
    } else {
        Err(Error::NoSurface(format!(
            "it is {value} at {point:?}; try a smaller training.learning_rate"
        )))
    }
}

/// Values of the field at the known points of a lattice.
#[derive(Debug)]
pub(super) struct Samples {
    known: Bits,
    /// Known points before each page of `known` that has bits, by its place.
    ranks: Vec<u32>,
    values: Vec<f64>,
}

impl Samples {
    pub(super) fn none(lattice: &Lattice) -> Self {
        Self {
            known: Bits::new(lattice.len()),
            ranks: Vec::new(),
            values: Vec::new(),
        }
    }

    /// The samples of a set and the values of its members, in their order.
    pub(super) fn of(known: Bits, values: Vec<f64>) -> Self {
        let mut ranks = vec![0; known.places()];
        let mut before = 0;
        for number in 0..known.page_count() {
            if let (Some(place), Some(page)) = (known.place_of(number), known.page(number)) {
                ranks[place] = before as u32;
                before += ones(page).count();
            }
        }
        debug_assert_eq!(before, values.len());
        Self {
            known,
            ranks,
            values,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.values.len()
    }

    pub(super) fn known(&self) -> &Bits {
        &self.known
    }

    /// Place of a known point among the known ones.
    pub(super) fn rank(&self, index: usize) -> Option<usize> {
        let (page, rank) = self.known.rank_in_page(index)?;
        Some(self.ranks[page] as usize + rank)
    }

    /// The value at a known point.
    pub(super) fn get(&self, index: usize) -> Option<f64> {
        self.rank(index).map(|rank| self.values[rank])
    }

    /// Known points of a part, and their values.
    pub(super) fn part(&self, pages: Range<usize>) -> impl Iterator<Item = (usize, f64)> {
        let first = pages.clone().find_map(|page| self.known.place_of(page));
        let first = first.map_or(self.len(), |place| self.ranks[place] as usize);
        self.known
            .members_of(pages)
            .zip(self.values[first..].iter().copied())
    }

    /// Makes the points of `wanted` known; those that were not stay in `wanted`.
    ///
    /// Progress runs through `span`.
    pub(super) fn require(
        &mut self,
        wanted: &mut Bits,
        source: &mut Source<'_>,
        span: Range<f64>,
    ) -> Result<(), Error> {
        wanted.remove_all(&self.known);
        let count = wanted.count();
        check_size(self.len() + count, source.request.max_triangles)?;
        let mut fresh = Vec::with_capacity(count);
        let mut indices = Vec::with_capacity(BATCH.min(count));
        let mut members = wanted.members();
        while fresh.len() < count {
            indices.clear();
            indices.extend(members.by_ref().take(BATCH));
            source.append(&indices, &mut fresh)?;
            let share = fresh.len() as f64 / count as f64;
            (source.request.progress)(span.start + share * (span.end - span.start));
        }
        self.merge(wanted, fresh);
        Ok(())
    }

    fn merge(&mut self, fresh: &Bits, fresh_values: Vec<f64>) {
        let mut merged = Vec::with_capacity(self.len() + fresh_values.len());
        let mut old = std::mem::take(&mut self.values).into_iter();
        let mut new = fresh_values.into_iter();
        let none = Page::default();
        let mut known = std::mem::replace(&mut self.known, Bits::new(0));
        for number in 0..known.page_count() {
            let fresh = fresh.page(number).unwrap_or(&none);
            if *fresh == none && known.page(number).is_none() {
                continue;
            }
            let page = known.page_mut(number);
            for (word, fresh) in page.iter_mut().zip(fresh) {
                *word |= fresh;
            }
            merged.extend(ones(page).filter_map(|bit| {
                if fresh[bit / 64] >> (bit % 64) & 1 == 1 {
                    new.next()
                } else {
                    old.next()
                }
            }));
        }
        *self = Self::of(known, merged);
    }
}

/// Refuses a number of known points that no mesh within the limit needs.
pub(super) fn check_size(points: usize, max_triangles: usize) -> Result<(), Error> {
    let limit = max_triangles
        .saturating_mul(POINTS_PER_TRIANGLE)
        .saturating_add(FREE_POINTS);
    if points > limit.min(u32::MAX as usize) {
        return Err(Error::MeshTooLarge {
            limit: max_triangles,
        });
    }
    Ok(())
}
