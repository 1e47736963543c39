//! Points and directions in R³ as plain arrays, and axis-aligned boxes of them.
//!
//! Plain arrays instead of a linear-algebra crate: every format, tensor and tree here speaks
//! `[f64; 3]`, and nothing larger than three components is ever needed.

use std::borrow::Borrow;

use serde::{Deserialize, Serialize};

/// A point or a direction: `[x, y, z]`.
pub type Vec3 = [f64; 3];

/// `a + b`.
#[inline]
pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline]
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `s a`.
#[inline]
pub fn scale(a: Vec3, s: f64) -> Vec3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// `a + s b`.
#[inline]
pub fn along(a: Vec3, s: f64, b: Vec3) -> Vec3 {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// `a` with each component multiplied by that of `b`; zeros have no sign then.
#[inline]
pub fn multiplied(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] * b[i] + 0.0)
}

/// `a · b`.
#[inline]
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a × b`.
#[inline]
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// `|a|`.
#[inline]
pub fn norm(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

/// `|a - b|`.
#[inline]
pub fn distance(a: Vec3, b: Vec3) -> f64 {
    norm(sub(a, b))
}

/// What tells points apart: equal exactly for equal points, -0 and 0 being the same.
pub fn bits(a: Vec3) -> [u64; 3] {
    a.map(|v| (v + 0.0).to_bits())
}

/// `a / |a|`; `None` where `|a|` is zero, subnormal or not finite.
#[inline]
pub fn normalized(a: Vec3) -> Option<Vec3> {
    let length = norm(a);
    (length.is_normal()).then(|| scale(a, 1.0 / length))
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: Vec3,
    /// Largest coordinates.
    pub max: Vec3,
}

impl Bounds {
    /// The smallest box around `points`; `None` without points. Points are expected to be finite.
    pub fn of(points: impl IntoIterator<Item = impl Borrow<Vec3>>) -> Option<Self> {
        points.into_iter().fold(None, |bounds, p| {
            let p = p.borrow();
            Some(bounds.map_or(Self { min: *p, max: *p }, |b: Self| Self {
                min: std::array::from_fn(|i| b.min[i].min(p[i])),
                max: std::array::from_fn(|i| b.max[i].max(p[i])),
            }))
        })
    }

    /// Edge lengths.
    pub fn extent(&self) -> Vec3 {
        sub(self.max, self.min)
    }

    /// Length of the space diagonal.
    pub fn diagonal(&self) -> f64 {
        norm(self.extent())
    }

    /// Longest edge.
    pub fn longest_edge(&self) -> f64 {
        self.extent().into_iter().fold(0.0, f64::max)
    }

    /// Middle of the box.
    pub fn centre(&self) -> Vec3 {
        scale(add(self.min, self.max), 0.5)
    }

    /// The box moved out by `margin` on every side.
    #[must_use]
    pub fn padded(&self, margin: f64) -> Self {
        Self {
            min: self.min.map(|v| v - margin),
            max: self.max.map(|v| v + margin),
        }
    }

    /// Whether `p` lies inside or on the box.
    #[inline]
    pub fn contains(&self, p: Vec3) -> bool {
        (0..3).all(|i| self.min[i] <= p[i] && p[i] <= self.max[i])
    }

    /// Whether the boxes have a point in common, on their sides too.
    #[inline]
    pub fn meets(&self, other: &Self) -> bool {
        (0..3).all(|i| self.min[i] <= other.max[i] && other.min[i] <= self.max[i])
    }
}
