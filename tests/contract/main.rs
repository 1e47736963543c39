//! Tests of what the project promises: the way of its rooms, and the command line.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod architecture;
mod colors;
mod command_line;
mod deploy;
mod likely_wrong;
mod named;
mod openapi;
mod places;
