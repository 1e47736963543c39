//! Lists in a setting: values with commas between them.

use std::fmt::Display;
use std::str::FromStr;

/// Values with commas between them, as they were given.
pub(super) fn list<T: FromStr<Err: Display>>(text: &str) -> Result<String, String> {
    let faults = parts(text).filter_map(|part| {
        let fault = part.parse::<T>().err()?;
        Some(format!("{part}: {fault}"))
    });
    match faults.collect::<Vec<_>>() {
        faults if faults.is_empty() => Ok(text.to_owned()),
        faults => Err(faults.join("; ")),
    }
}

/// The parts of a list with commas.
pub(super) fn parts(list: &str) -> impl Iterator<Item = &str> {
    let parts = list.split(',').map(str::trim);
    parts.filter(|part| !part.is_empty())
}
