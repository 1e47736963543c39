//! Which values there are among voxels, and how often.

use std::collections::HashMap;

use crate::reconstruction::cloud::Error;

/// Most labels of a file: an atlas has some hundreds, an image has more values.
pub(super) const MOST_LABELS: usize = 2048;

/// How far a value may be from a whole number, as scaling rounds.
const WHOLE: f64 = 1e-4;

/// Share of a voxel from which on it counts as the label's.
const HALF: f64 = 0.5;

/// What is known of a label.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Count {
    pub(super) voxels: u64,
    pub(super) slices: u64,
    last_slice: Option<usize>,
}

/// Counts values, slice by slice.
#[derive(Debug, Default)]
pub(super) struct Tally {
    counts: HashMap<i64, Count>,
    /// The value before, and how often it was there: neighbours are mostly alike.
    run: Option<(f64, u64)>,
    slice: usize,
    /// Voxels that a label fills to one half or more, and not wholly.
    shares: Count,
    /// Whether there are values that are not whole, but between 0 and 1.
    are_shares: bool,
    pub(super) not_finite: u64,
}

impl Tally {
    /// Counts the values of a slice.
    ///
    /// # Errors
    /// [`Error::UnsupportedFormat`] for more values than labels can be, or others than labels are.
    pub(super) fn slice(
        &mut self,
        slice: usize,
        values: impl Iterator<Item = f64>,
    ) -> Result<(), Error> {
        self.slice = slice;
        for value in values {
            match &mut self.run {
                Some((last, count)) if last.to_bits() == value.to_bits() => *count += 1,
                _ => {
                    self.flush()?;
                    self.run = Some((value, 1));
                }
            }
        }
        self.flush()
    }

    fn flush(&mut self) -> Result<(), Error> {
        let Some((value, voxels)) = self.run.take() else {
            return Ok(());
        };
        let slice = self.slice;
        let add = |count: &mut Count| {
            count.voxels += voxels;
            if count.last_slice != Some(slice) {
                count.slices += 1;
                count.last_slice = Some(slice);
            }
        };
        if value.is_nan() {
            self.not_finite += voxels;
        } else if let Some(label) = label(value) {
            if label != 0 {
                add(self.counts.entry(label).or_default());
            }
        } else if (0.0..=1.0).contains(&value) {
            self.are_shares = true;
            // The surface is laid where a voxel is half full.
            if value >= HALF {
                add(&mut self.shares);
            }
        } else {
            // The largest number that there is has 309 digits.
            let shown = if value.abs() < 1e9 {
                format!("{value:.4}")
            } else {
                format!("{value:e}")
            };
            return Err(image(&format!("a voxel has the value {shown}")));
        }
        if self.counts.len() > MOST_LABELS {
            let detail = format!("its voxels have more than {MOST_LABELS} different values");
            return Err(image(&detail));
        }
        Ok(())
    }

    /// The labels and how often they are there, by rising value; for shares of 0 to 1 the only
    /// label is 1. The flag tells shares.
    ///
    /// # Errors
    /// [`Error::UnsupportedFormat`] for shares among labels.
    pub(super) fn finish(self) -> Result<(Vec<(i64, Count)>, bool), Error> {
        let mut counts: Vec<_> = self.counts.into_iter().collect();
        counts.sort_unstable_by_key(|&(label, _)| label);
        if !self.are_shares {
            return Ok((counts, false));
        }
        match counts[..] {
            [] if self.shares.voxels == 0 => Ok((Vec::new(), true)),
            [] => Ok((vec![(1, self.shares)], true)),
            [(1, whole)] => {
                let both = Count {
                    voxels: whole.voxels + self.shares.voxels,
                    slices: whole.slices.max(self.shares.slices),
                    last_slice: None,
                };
                Ok((vec![(1, both)], true))
            }
            _ => Err(image("its voxels have values between whole numbers")),
        }
    }
}

/// The label that a value is, if it is whole.
pub(super) fn label(value: f64) -> Option<i64> {
    let whole = value.round();
    ((value - whole).abs() <= WHOLE && whole.abs() < 1e15).then_some(whole as i64)
}

fn image(detail: &str) -> Error {
    Error::UnsupportedFormat(format!(
        "this is an image, not a label map: {detail}; segment it first, for instance with 3D Slicer or \
         TotalSegmentator, and send the segmentation"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_counted_by_slice() {
        let mut tally = Tally::default();
        tally.slice(0, [0.0, 2.0, 2.0, 5.0].into_iter()).unwrap();
        tally.slice(3, [2.0, 0.0, f64::NAN].into_iter()).unwrap();
        assert_eq!(tally.not_finite, 1);
        let (counts, shares) = tally.finish().unwrap();
        assert!(!shares);
        let plain: Vec<_> = counts
            .iter()
            .map(|(v, c)| (*v, c.voxels, c.slices))
            .collect();
        assert_eq!(plain, [(2, 3, 2), (5, 1, 1)]);
    }

    #[test]
    fn images_are_told_from_labels() {
        let mut tally = Tally::default();
        assert!(tally.slice(0, [0.0, 7.5].into_iter()).is_err());
        let mut tally = Tally::default();
        assert!(tally.slice(0, (0..3000).map(f64::from)).is_err());
        let mut tally = Tally::default();
        tally.slice(0, [0.0, 0.5, 1.0].into_iter()).unwrap();
        assert!(tally.finish().unwrap().1);
    }

    #[test]
    fn of_shares_those_of_one_half_count() {
        let mut tally = Tally::default();
        tally.slice(0, [0.1, 0.4, 0.25].into_iter()).unwrap();
        tally.slice(1, [0.5, 0.75, 0.1, 1.0].into_iter()).unwrap();
        let (counts, shares) = tally.finish().unwrap();
        assert!(shares);
        assert_eq!(counts.len(), 1);
        assert_eq!((counts[0].1.voxels, counts[0].1.slices), (3, 1));
        let mut tally = Tally::default();
        tally.slice(0, [0.1, 0.4].into_iter()).unwrap();
        assert_eq!(tally.finish().unwrap(), (Vec::new(), true));
    }
}
