//! The floating-point types that a network can be trained in.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Mul, Sub};

use safetensors::Dtype;
use serde::Serialize;
use serde::de::DeserializeOwned;

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
    /// Its name in files of tensors.
    const DTYPE: Dtype;

    /// Nearest value of this type.
    fn from_f64(value: f64) -> Self;

    /// The same value, exactly.
    fn to_f64(self) -> f64;

    /// Appends its little-endian bytes.
    fn write(self, bytes: &mut Vec<u8>);
}

impl Scalar for f32 {
    const DTYPE: Dtype = Dtype::F32;

    fn from_f64(value: f64) -> Self {
        value as Self
    }

    fn to_f64(self) -> f64 {
        f64::from(self)
    }

    fn write(self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }
}

impl Scalar for f64 {
    const DTYPE: Dtype = Dtype::F64;

    fn from_f64(value: f64) -> Self {
        value
    }

    fn to_f64(self) -> f64 {
        self
    }

    fn write(self, bytes: &mut Vec<u8>) {
        bytes.extend(self.to_le_bytes());
    }
}
