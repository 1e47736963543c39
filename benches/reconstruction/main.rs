//! What a run spends its time on, piece by piece. `cargo bench -- NAME` picks out pieces.
//!
//! libtorch gets one thread, as many as a worker beside others would have.

mod reading;
mod surface;
mod training;

use criterion::{criterion_group, criterion_main};

// The surface comes first: its peak memory is then not that of another piece.
criterion_group!(
    benches,
    surface::extraction,
    training::loss,
    training::lbfgs,
    reading::ply
);
criterion_main!(benches);
