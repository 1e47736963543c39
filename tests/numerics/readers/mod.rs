//! Clouds from files: every format in its variants, what is refused, and damaged files.

#![expect(
    clippy::float_cmp,
    reason = "a reader gives back the very numbers that were written"
)]

pub(crate) mod damage;
mod dialects;
pub(crate) mod files;
mod formats;
mod programs;
mod refusals;
mod tables;
mod validation;

use meshway::reconstruction::cloud::{Error, Limits, PointCloud, Source, read};

/// Reads a file with the usual limits.
fn load(bytes: &[u8], name: &str) -> Result<(PointCloud, Source), Error> {
    read(bytes, Some(name), &Limits::default())
}

/// The code of the error that reading a file gives.
fn code(bytes: &[u8], name: &str) -> &'static str {
    match load(bytes, name) {
        Ok((cloud, _)) => panic!("{name}: read {} points", cloud.points.len()),
        Err(error) => error.code(),
    }
}

/// The codes of the warnings that reading a file gives.
fn warnings(bytes: &[u8], name: &str) -> Vec<&'static str> {
    let (_, source) = load(bytes, name).unwrap();
    source.warnings.iter().map(|warning| warning.code).collect()
}
