//! The grid of voxels that a label map was given on.

use serde::{Deserialize, Serialize};

use super::Geometry;
use crate::reconstruction::vector::Vec3;

/// Where the voxels of a label map lie.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Number of voxels along each axis, in the order of the file, whose first axis runs fastest.
    pub size: [usize; 3],
    /// From the indices of a voxel to its centre, in millimetres of the patient (LPS): the rows are x, y and
    /// z, the last column is the centre of the first voxel. Steps may be oblique and left-handed.
    pub affine: [[f64; 4]; 3],
}

impl Grid {
    /// The centre of the voxel of these indices, which need not be whole.
    pub fn centre(&self, [i, j, k]: Vec3) -> Vec3 {
        self.affine
            .map(|[x, y, z, origin]| x * i + y * j + z * k + origin)
    }

    /// Its slices along the third axis.
    pub fn geometry(&self) -> Geometry {
        let axis = |n: usize| self.affine.map(|row| row[n]);
        let origins = (0..self.size[2]).map(|k| self.centre([0.0, 0.0, k as f64]));
        Geometry {
            column: axis(0),
            row: axis(1),
            origins: origins.collect(),
        }
    }

    /// Number of its voxels.
    pub fn voxels(&self) -> usize {
        self.size.iter().product()
    }
}
