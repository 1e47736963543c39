//! Tests of the mathematics. One binary, because linking libtorch is slow.

mod checkpoint;
mod mesh;
mod network;
mod optimiser;
mod readers;
mod sampling;
mod shapes;
mod surface;
mod traces;
mod training;
