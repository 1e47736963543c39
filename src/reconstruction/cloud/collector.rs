//! What every reader pours its rows into: limits, labels and values that are not finite are dealt
//! with here, once.

use super::{Error, Label, Limits, PointCloud};
use crate::reconstruction::Warning;
use crate::reconstruction::vector::{Vec3, norm, normalized};

/// One row of a file: x, y, z, the normal's components, the label. Unused slots are zero.
pub(in crate::reconstruction) type Row = [f64; 7];

/// Share of the points that may be dropped because they are not finite.
const MAX_DROPPED: f64 = 0.01;

/// How far from 1 the length of a unit normal may be: two digits a component are enough.
const UNIT_TOLERANCE: f64 = 0.05;

/// A cloud that is being read.
#[derive(Debug)]
pub(super) struct Collector<'a> {
    limits: &'a Limits,
    cloud: PointCloud,
    rows: usize,
    normals: NormalCounts,
    warnings: Vec<Warning>,
}

/// Normals that cannot be used as they are.
#[derive(Debug, Default)]
struct NormalCounts {
    not_finite: usize,
    zero: usize,
    not_unit: usize,
}

impl NormalCounts {
    /// The normal, counted if something is wrong with it; without a direction it is zero.
    fn checked(&mut self, normal: Vec3) -> Vec3 {
        let length = norm(normal);
        if !normal.iter().all(|v| v.is_finite()) {
            self.not_finite += 1;
            return [0.0; 3];
        }
        if normalized(normal).is_none() {
            self.zero += 1;
        } else if (length - 1.0).abs() > UNIT_TOLERANCE {
            self.not_unit += 1;
        }
        normal
    }
}

impl<'a> Collector<'a> {
    /// An empty cloud, with or without normals and labels.
    pub(super) fn new(limits: &'a Limits, normals: bool, labels: bool) -> Self {
        let cloud = PointCloud {
            points: Vec::new(),
            normals: normals.then(Vec::new),
            labels: labels.then(Vec::new),
        };
        Self {
            limits,
            cloud,
            rows: 0,
            normals: NormalCounts::default(),
            warnings: Vec::new(),
        }
    }

    /// Makes room for `rows` rows, a number that the caller has seen the bytes of.
    pub(super) fn reserve(&mut self, rows: usize) -> Result<(), Error> {
        if rows > self.limits.max_points {
            return Err(self.too_many());
        }
        self.cloud.points.reserve(rows);
        if let Some(normals) = &mut self.cloud.normals {
            normals.reserve(rows);
        }
        if let Some(labels) = &mut self.cloud.labels {
            labels.reserve(rows);
        }
        Ok(())
    }

    /// Takes a row, or counts it as dropped; `line` is its line or record number for messages.
    pub(super) fn push(&mut self, row: &Row, line: usize) -> Result<(), Error> {
        self.rows += 1;
        if self.rows > self.limits.max_points {
            return Err(self.too_many());
        }
        let [x, y, z, nx, ny, nz, label] = *row;
        if !(x.is_finite() && y.is_finite() && z.is_finite()) {
            return Ok(());
        }
        if let Some(labels) = &mut self.cloud.labels {
            let detail =
                || format!("label {label} is none of 0 (surface), 1 (inside), -1 (outside)");
            labels.push(Label::from_number(label).ok_or_else(|| Error::Row {
                line,
                detail: detail(),
            })?);
        }
        if let Some(normals) = &mut self.cloud.normals {
            normals.push(self.normals.checked([nx, ny, nz]));
        }
        self.cloud.points.push([x, y, z]);
        Ok(())
    }

    /// Notes something that the user should know.
    pub(super) fn warn(&mut self, code: &'static str, message: impl Into<String>) {
        self.warnings.push(Warning::new(code, message));
    }

    /// The cloud, the number of dropped points, and what is to be said about it.
    pub(super) fn finish(mut self) -> Result<(PointCloud, usize, Vec<Warning>), Error> {
        let (total, dropped) = (self.rows, self.rows - self.cloud.points.len());
        if total == 0 {
            return Err(Error::Empty);
        }
        if dropped as f64 > MAX_DROPPED * total as f64 {
            return Err(Error::NotFinite { dropped, total });
        }
        if dropped > 0 {
            let message = format!("{dropped} of {total} points are not finite and were dropped");
            self.warn("points_not_finite", message);
        }
        let kept = self.cloud.points.len();
        for (count, code, what) in [
            (
                self.normals.not_finite,
                "normals_not_finite",
                "not finite and count as missing",
            ),
            (
                self.normals.zero,
                "normals_zero",
                "zero and count as missing",
            ),
            (
                self.normals.not_unit,
                "normals_not_unit",
                "far from unit length and are scaled to it",
            ),
        ] {
            if count > 0 {
                self.warn(code, format!("{count} of {kept} normals are {what}"));
            }
        }
        let duplicates = self.cloud.points.len() - self.cloud.distinct();
        if duplicates > 0 {
            let message = format!("{duplicates} points repeat the coordinates of another point");
            self.warn("duplicate_points", message);
        }
        Ok((self.cloud, dropped, self.warnings))
    }

    fn too_many(&self) -> Error {
        Error::TooManyPoints {
            limit: self.limits.max_points,
        }
    }
}
