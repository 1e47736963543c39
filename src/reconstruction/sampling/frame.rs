//! The coordinates in which the network is trained, and the way there and back.

use serde::{Deserialize, Serialize};

use crate::reconstruction::vector::{Bounds, Vec3, add, scale, sub};

/// A shift and a uniform scale: unit = (p - centre) · scale.
///
/// In f64 throughout, so that a cloud far from the origin loses nothing before it is centred.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// What becomes the origin, in the units of the cloud.
    pub centre: Vec3,
    /// Unit lengths per length of the cloud.
    pub scale: f64,
}

impl Frame {
    /// Coordinates as they are given.
    pub const IDENTITY: Self = Self {
        centre: [0.0; 3],
        scale: 1.0,
    };

    /// Centred on `bounds`, whose longest edge becomes `2 half_extent`; `None` for a box without
    /// extent.
    pub fn normalized(bounds: &Bounds, half_extent: f64) -> Option<Self> {
        let scale = 2.0 * half_extent / bounds.longest_edge();
        scale.is_normal().then(|| Self {
            centre: bounds.centre(),
            scale,
        })
    }

    /// A point of the cloud in the frame.
    pub fn to_unit(&self, p: Vec3) -> Vec3 {
        scale(sub(p, self.centre), self.scale)
    }

    /// A point of the frame in the coordinates of the cloud.
    pub fn to_world(&self, p: Vec3) -> Vec3 {
        add(scale(p, 1.0 / self.scale), self.centre)
    }

    /// A length of the cloud in the frame.
    pub fn length_to_unit(&self, length: f64) -> f64 {
        length * self.scale
    }

    /// A length of the frame in the units of the cloud.
    pub fn length_to_world(&self, length: f64) -> f64 {
        length / self.scale
    }
}
