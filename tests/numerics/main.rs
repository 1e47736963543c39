//! Tests of the mathematics. One binary, because linking libtorch is slow.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod mesh;
mod readers;
mod surface;
