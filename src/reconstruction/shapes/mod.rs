//! Analytic shapes: examples to try, and ground truth to measure against.

mod blend;
mod sample;

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

use crate::nearest::did_you_mean;

use super::error::Error as ReconstructionError;
use super::surface::Field;
use super::vector::{Bounds, Vec3, along, dot, norm, scale};
use blend::{ABDOMEN, Blend, HAND, UTERUS};

pub use sample::{Recipe, sample};

/// Newton steps of a projection, at most; a handful is used.
const MAX_NEWTON_STEPS: usize = 60;

/// |f| over the diagonal at which a point is on the surface: rounding of a few operations.
const ON_SURFACE: f64 = 1e-13;

/// A solid with a smooth surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A ball around the origin.
    Sphere {
        /// Its radius.
        radius: f64,
    },
    /// A ring around the z axis.
    Torus {
        /// Radius of the circle at the middle of the tube.
        major: f64,
        /// Radius of the tube.
        minor: f64,
    },
    /// A hand: palm, wrist and five fingers.
    Hand,
    /// A uterus: body, cervix and the stubs of the tubes.
    Uterus,
    /// An abdomen: a torso with a waist.
    Abdomen,
}

/// Why a text names no shape.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "{text:?} is no shape: {detail}{meant}; known are sphere[:RADIUS], torus[:MAJOR:MINOR], hand, uterus, abdomen"
)]
pub struct ParseShapeError {
    text: String,
    detail: &'static str,
    meant: String,
}

impl Shape {
    /// Names of all shapes.
    pub fn names() -> [&'static str; 5] {
        ["sphere", "torus", "hand", "uterus", "abdomen"]
    }

    /// f(p): positive inside, zero on the surface, and close to the distance near it.
    pub fn signed(&self, p: Vec3) -> f64 {
        self.signed_and_gradient(p).0
    }

    /// ∇f(p).
    pub fn gradient(&self, p: Vec3) -> Vec3 {
        self.signed_and_gradient(p).1
    }

    /// f(p) and ∇f(p).
    pub fn signed_and_gradient(&self, p: Vec3) -> (f64, Vec3) {
        match self {
            Self::Sphere { radius } => {
                let length = norm(p);
                (radius - length, unit_or_zero(p, length, -1.0))
            }
            Self::Torus { major, minor } => {
                let around = p[0].hypot(p[1]);
                let from_circle = [around - major, p[2]];
                let length = from_circle[0].hypot(from_circle[1]);
                let radial = unit_or_zero([p[0], p[1], 0.0], around, from_circle[0]);
                let outward = [radial[0], radial[1], p[2]];
                (minor - length, unit_or_zero(outward, length, -1.0))
            }
            Self::Hand | Self::Uterus | Self::Abdomen => self.blend().signed_and_gradient(p),
        }
    }

    /// A box around the surface; tight for sphere and torus.
    pub fn bounds(&self) -> Bounds {
        let half = match *self {
            Self::Sphere { radius } => [radius; 3],
            Self::Torus { major, minor } => [major + minor, major + minor, minor],
            Self::Hand | Self::Uterus | Self::Abdomen => return self.blend().bounds(),
        };
        Bounds {
            min: half.map(|x| -x),
            max: half,
        }
    }

    /// The point of the surface that Newton's method along the gradient reaches from `p`: for p close to
    /// the surface nearly the nearest one. `None` where it does not get there.
    pub fn project(&self, p: Vec3) -> Option<Vec3> {
        let tolerance = ON_SURFACE * self.bounds().diagonal();
        let mut p = p;
        for _ in 0..MAX_NEWTON_STEPS {
            let (value, gradient) = self.signed_and_gradient(p);
            if value.abs() <= tolerance {
                return Some(p);
            }
            let square = dot(gradient, gradient);
            if square < 1e-12 {
                return None;
            }
            p = along(p, -value / square, gradient);
        }
        None
    }

    fn blend(&self) -> &'static Blend {
        match self {
            Self::Uterus => &UTERUS,
            Self::Abdomen => &ABDOMEN,
            _ => &HAND,
        }
    }
}

/// `a s / length`; zero where the direction is not defined.
fn unit_or_zero(a: Vec3, length: f64, s: f64) -> Vec3 {
    if length > 0.0 {
        scale(a, s / length)
    } else {
        [0.0; 3]
    }
}

impl Field for Shape {
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), ReconstructionError> {
        for (value, p) in values.iter_mut().zip(points) {
            *value = self.signed(*p);
        }
        Ok(())
    }

    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), ReconstructionError> {
        for ((value, gradient), p) in values.iter_mut().zip(gradients).zip(points) {
            (*value, *gradient) = self.signed_and_gradient(*p);
        }
        Ok(())
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sphere { radius } => write!(f, "sphere:{radius}"),
            Self::Torus { major, minor } => write!(f, "torus:{major}:{minor}"),
            Self::Hand => f.write_str("hand"),
            Self::Uterus => f.write_str("uterus"),
            Self::Abdomen => f.write_str("abdomen"),
        }
    }
}

impl FromStr for Shape {
    type Err = ParseShapeError;

    /// Reads `NAME` or `NAME:LENGTH[:LENGTH]`; a sphere has radius 1 and a torus 1 and 0.4 unless given.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut parts = text.split(':');
        let name = parts.next().unwrap_or_default();
        let error = |detail| ParseShapeError {
            text: text.to_owned(),
            detail,
            meant: String::new(),
        };
        let lengths = parts
            .map(|part| {
                part.parse::<f64>()
                    .ok()
                    .filter(|x| x.is_normal() && *x > 0.0)
            })
            .collect::<Option<Vec<f64>>>()
            .ok_or_else(|| error("its lengths must be positive numbers"))?;
        match (name, lengths.as_slice()) {
            ("sphere", []) => Ok(Self::Sphere { radius: 1.0 }),
            ("sphere", &[radius]) => Ok(Self::Sphere { radius }),
            ("torus", []) => Ok(Self::Torus {
                major: 1.0,
                minor: 0.4,
            }),
            ("torus", &[major, minor]) if minor < major => Ok(Self::Torus { major, minor }),
            ("torus", &[_, _]) => Err(error("the minor radius must be below the major one")),
            ("hand", []) => Ok(Self::Hand),
            ("uterus", []) => Ok(Self::Uterus),
            ("abdomen", []) => Ok(Self::Abdomen),
            (name, _) if Self::names().contains(&name) => {
                Err(error("it has another number of lengths"))
            }
            (name, _) => Err(ParseShapeError {
                meant: did_you_mean(name, Self::names()),
                ..error("the name is unknown")
            }),
        }
    }
}
