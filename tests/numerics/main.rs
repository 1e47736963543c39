//! Tests of the mathematics. One binary, because linking libtorch is slow.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod blocks;
mod checkpoint;
mod engines;
mod ensemble;
mod fewer_triangles;
mod gated;
mod helpers;
mod kinds;
mod medical;
mod mesh;
mod network;
mod open;
mod optimiser;
mod orientation;
mod plan;
mod readers;
mod reconstruction;
mod sampling;
mod shapes;
mod slices;
mod surface;
mod texts;
mod traces;
mod training;
mod uncertainty;
mod verdict;
