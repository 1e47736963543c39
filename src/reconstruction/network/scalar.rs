//! The floating-point types that a network can be trained in.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Mul, Sub};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{Architecture, Engine, Fused, Threads};
use crate::reconstruction::sampling::Samples;

/// `f32` or `f64`.
pub trait Scalar:
    tch::kind::Element
    + Copy
    + Debug
    + PartialEq
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + AddAssign
    + Serialize
    + DeserializeOwned
    + Send
    + Sync
    + 'static
{
    /// Nearest value of this type.
    fn from_f64(value: f64) -> Self;

    /// The same value, exactly.
    fn to_f64(self) -> f64;

    /// The fused engine over these samples, where it computes in this type and has the
    /// architecture.
    fn fused(
        architecture: &Architecture,
        samples: &Samples,
        threads: Threads,
    ) -> Option<Box<dyn Engine<Self>>>;
}

impl Scalar for f32 {
    fn from_f64(value: f64) -> Self {
        value as Self
    }

    fn to_f64(self) -> f64 {
        f64::from(self)
    }

    fn fused(
        architecture: &Architecture,
        samples: &Samples,
        threads: Threads,
    ) -> Option<Box<dyn Engine<Self>>> {
        let engine = Fused::new(architecture.clone(), samples)?;
        Some(Box::new(engine.on_threads(threads)))
    }
}

impl Scalar for f64 {
    fn from_f64(value: f64) -> Self {
        value
    }

    fn to_f64(self) -> f64 {
        self
    }

    fn fused(_: &Architecture, _: &Samples, _: Threads) -> Option<Box<dyn Engine<Self>>> {
        None
    }
}
