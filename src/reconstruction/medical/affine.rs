//! From the indices of voxels to places in the patient.

use serde::{Deserialize, Serialize};

use crate::reconstruction::cloud::Error;
use crate::reconstruction::vector::{Vec3, along, cross, dot, norm};

/// Largest magnitude of a place in millimetres: a hundred metres away is no patient.
const FARTHEST: f64 = 1e5;

/// Maps indices to millimetres of the patient (LPS). Its steps need not be orthogonal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Affine {
    /// Step from a voxel to the next one along each axis of the file.
    pub steps: [Vec3; 3],
    /// Centre of the first voxel.
    pub origin: Vec3,
}

impl Affine {
    /// Of axes in millimetres without a place.
    pub(super) fn of_spacing(spacing: Vec3) -> Self {
        let [x, y, z] = spacing;
        Self {
            steps: [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]],
            origin: [0.0; 3],
        }
    }

    /// The same place with the signs of the patient's axes turned: `[-1, -1, 1]` leads from RAS to
    /// LPS and back.
    pub(super) fn signed(self, signs: Vec3) -> Self {
        let turn = |v: Vec3| [v[0] * signs[0], v[1] * signs[1], v[2] * signs[2]];
        Self {
            steps: self.steps.map(turn),
            origin: turn(self.origin),
        }
    }

    /// The same in another unit.
    pub(super) fn scaled(self, factor: f64) -> Self {
        self.signed([factor; 3])
    }

    /// Centre of a voxel.
    pub fn at(&self, index: [f64; 3]) -> Vec3 {
        let [i, j, k] = index;
        let along_two = along(along(self.origin, i, self.steps[0]), j, self.steps[1]);
        along(along_two, k, self.steps[2])
    }

    /// Distances of neighbours along the axes.
    pub fn spacing(&self) -> Vec3 {
        self.steps.map(norm)
    }

    /// Volume of a voxel in cubic millimetres.
    pub fn voxel_volume(&self) -> f64 {
        let [a, b, c] = self.steps;
        dot(cross(a, b), c).abs()
    }

    /// Where each axis of the file mostly leads: `L` or `R`, `P` or `A`, `S` or `I`, each once.
    pub fn letters(&self) -> String {
        const NAMES: [[char; 2]; 3] = [['L', 'R'], ['P', 'A'], ['S', 'I']];
        let spacing = self.spacing();
        let mut letters = ['?'; 3];
        let mut free = [true; 3];
        // The clearest axis chooses first, so that oblique ones do not share a letter.
        for _ in 0..3 {
            let share = |(axis, place): (usize, usize)| {
                (self.steps[axis][place] / spacing[axis].max(f64::MIN_POSITIVE)).abs()
            };
            let pairs = (0..3).flat_map(|axis| (0..3).map(move |place| (axis, place)));
            let open = pairs.filter(|&(axis, place)| letters[axis] == '?' && free[place]);
            let Some((axis, place)) = open.max_by(|&a, &b| share(a).total_cmp(&share(b))) else {
                break;
            };
            letters[axis] = NAMES[place][usize::from(self.steps[axis][place] < 0.0)];
            free[place] = false;
        }
        letters.iter().collect()
    }

    /// Refuses what maps voxels to no volume, or to nowhere near a patient.
    ///
    /// # Errors
    /// [`Error::Header`].
    pub(super) fn checked(self, size: [usize; 3]) -> Result<Self, Error> {
        let last = self.at(size.map(|count| count.saturating_sub(1) as f64));
        let numbers = self.steps.iter().chain([&self.origin, &last]).flatten();
        let mut numbers = numbers.copied();
        let detail = if numbers.clone().any(|v| !v.is_finite()) {
            "places of voxels are not finite"
        } else if numbers.any(|v| v.abs() > FARTHEST) {
            "voxels lie farther away than 100 metres; distances are taken as millimetres"
        } else if self.voxel_volume() <= 1e-12 {
            "voxels have no volume: directions are parallel or a distance is zero"
        } else {
            return Ok(self);
        };
        Err(header(detail))
    }
}

/// A fault of a header.
pub(super) fn header(detail: impl Into<String>) -> Error {
    Error::Header {
        line: 0,
        detail: detail.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_name_each_direction_once() {
        let letters = |steps| {
            Affine {
                steps,
                origin: [0.0; 3],
            }
            .letters()
        };
        let ras = [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 2.0]];
        assert_eq!(letters(ras), "RAS");
        let oblique = [[0.8, 0.6, 0.0], [0.6, 0.7, 0.1], [0.0, 0.1, -5.0]];
        assert_eq!(letters(oblique), "LPI");
        let coronal = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 3.0, 0.0]];
        assert_eq!(letters(coronal), "LIP");
    }

    #[test]
    fn what_has_no_volume_is_refused() {
        let flat = Affine::of_spacing([1.0, 0.0, 1.0]);
        assert!(flat.checked([2, 2, 2]).is_err());
        let far = Affine::of_spacing([1.0, 1.0, 1e4]);
        assert!(far.checked([2, 2, 200]).is_err());
        assert!(far.checked([2, 2, 2]).is_ok());
    }
}
