//! What every reader pours its rows into: limits, labels and values that are not finite are dealt
//! with here, once.

use super::roles::UNIT_TOLERANCE;
use super::{Error, Label, Limits, PointCloud, labels, precision};
use crate::reconstruction::Warning;
use crate::reconstruction::space::Space;
use crate::reconstruction::vector::{Vec3, norm, normalized};

/// One row of a file: x, y, z, the normal's components, the label. Unused slots are zero.
pub(in crate::reconstruction) type Row = [f64; 7];

/// A cloud that is being read.
#[derive(Debug)]
pub(super) struct Collector<'a> {
    limits: &'a Limits,
    cloud: PointCloud,
    rows: usize,
    normals: NormalCounts,
    /// Why labels that the file has are not used.
    doubt: Option<String>,
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
            space: Space::default(),
        };
        Self {
            limits,
            cloud,
            rows: 0,
            normals: NormalCounts::default(),
            doubt: None,
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

    /// Takes a row, or counts it as dropped; with a label that is none, no label counts. `line` is its line or record number for messages.
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
            if let Some(label) = Label::from_number(label) {
                labels.push(label);
            } else {
                let value = if label.is_nan() {
                    "text or nothing".to_owned()
                } else {
                    label.to_string()
                };
                self.doubt = Some(format!("{value} in line or record {line} is none"));
                self.cloud.labels = None;
            }
        }
        if let Some(normals) = &mut self.cloud.normals {
            normals.push(self.normals.checked([nx, ny, nz]));
        }
        self.cloud.points.push([x, y, z]);
        Ok(())
    }

    /// Notes what the coordinates mean.
    pub(super) fn space(&mut self, space: Space) {
        self.cloud.space = space;
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
        if dropped == total {
            return Err(Error::NotFinite { dropped, total });
        }
        if dropped > 0 {
            let message = format!(
                "{dropped} of {total} points have no position (empty, not finite, or without a \
                 return) and were dropped"
            );
            self.warn("points_not_finite", message);
        }
        self.judge_labels();
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
        self.warnings.extend(precision::warning(&self.cloud.points));
        Ok((self.cloud, dropped, self.warnings))
    }

    /// Decides whether the labels are used, and tells it before anything is taken as inside.
    fn judge_labels(&mut self) {
        if let Some(labels) = &self.cloud.labels {
            self.doubt = labels::doubt(&self.cloud.points, labels);
        }
        if let Some(doubt) = &self.doubt {
            let message = format!(
                "the column label was ignored, so that all points count as surface: {doubt}; it holds \
                 0 on the surface, 1 inside, -1 outside, and no classes"
            );
            self.cloud.labels = None;
            self.warn("labels_ignored", message);
        } else if self.cloud.labels.is_some() {
            let count = |label| self.cloud.indices(label).count();
            let (inside, outside) = (count(Label::Interior), count(Label::Exterior));
            if inside + outside > 0 {
                let surface = count(Label::Surface);
                let message = format!(
                    "by the column label, {surface} points lie on the surface, {inside} inside and \
                     {outside} outside; rename the column if it means something else"
                );
                self.warn("labels_used", message);
            }
        }
    }

    fn too_many(&self) -> Error {
        Error::TooManyPoints {
            limit: self.limits.max_points,
        }
    }
}
