//! Runs of identical slices, and whether they tell that a coarser stack was repeated slice by slice.

use std::ops::RangeInclusive;

/// Runs between the first and the last one that are needed to tell.
const FEWEST: usize = 3;

/// Share of those runs that must be as long as the others.
const REGULAR: f64 = 0.8;

/// How many slices of a stack stand for one slice of the data; 1 where the stack was not repeated.
///
/// Slices of an upsampled label map come in runs of one length, or of two that differ by one. Those of a body that
/// is a prism come in runs of any length. The first and the last run may be cut.
pub(super) fn repeated(runs: &[RangeInclusive<usize>]) -> usize {
    let inner = runs.get(1..runs.len().saturating_sub(1)).unwrap_or(&[]);
    let mut lengths: Vec<usize> = inner
        .iter()
        .map(|run| run.end() - run.start() + 1)
        .collect();
    if lengths.len() < FEWEST {
        return 1;
    }
    lengths.sort_unstable();
    let median = lengths[lengths.len() / 2];
    let alike = |shorter: usize| {
        let count = lengths
            .iter()
            .filter(|&&l| l == shorter || l == shorter + 1)
            .count();
        count as f64 >= REGULAR * lengths.len() as f64
    };
    if median >= 2 && (alike(median) || (median > 2 && alike(median - 1))) {
        median
    } else {
        1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(lengths: &[usize]) -> usize {
        let mut start = 0;
        let runs: Vec<_> = lengths
            .iter()
            .map(|length| {
                let run = start..=start + length - 1;
                start += length;
                run
            })
            .collect();
        repeated(&runs)
    }

    #[test]
    fn only_regular_runs_tell_of_repeated_slices() {
        assert_eq!(of(&[2, 3, 3, 3, 3, 1]), 3);
        assert_eq!(of(&[1, 2, 3, 2, 3, 2, 1]), 2);
        assert_eq!(
            of(&[3, 3, 3, 6, 3, 3, 3, 3]),
            3,
            "two slices of the data may be alike"
        );
        assert_eq!(of(&[1, 1, 1, 2, 1, 1]), 1);
        assert_eq!(of(&[40]), 1, "a prism");
        assert_eq!(of(&[5, 9, 3, 14, 2, 7]), 1, "a body with steps");
        assert_eq!(of(&[]), 1);
    }
}
