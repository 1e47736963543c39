//! Meshway: point clouds in, watertight meshes out.
//!
//! One way through the rooms; an arrow points at what may be used:
//!
//! ```text
//! reconstruction  <-  jobs  <-  cli  <-  main
//! the mathematics     a job's   the operator
//!                     life
//! ```
//!
//! `reconstruction` is a pure library: bytes and settings in, meshes and reports out. It knows
//! neither clock nor environment nor logging; what it needs of them comes through
//! [`reconstruction::Observer`]. `tests/contract/architecture.rs` reads the `use` lines and fails
//! on a wrong way.

pub mod cli;
pub mod config;
pub mod folder;
pub mod http;
pub mod identity;
pub mod intake;
pub mod jobs;
pub mod reconstruction;
pub mod webhooks;

mod nearest;
mod process;
