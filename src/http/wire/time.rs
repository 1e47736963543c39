//! Times on the wire: RFC 3339 in UTC with milliseconds; milliseconds since the epoch inside.

use time::format_description::well_known::Rfc3339;
use time::{Duration, OffsetDateTime};

/// The wire form of a time in milliseconds since the epoch.
pub(in crate::http) fn rfc3339(milliseconds: i64) -> String {
    let time = OffsetDateTime::UNIX_EPOCH
        .checked_add(Duration::milliseconds(milliseconds))
        .unwrap_or(OffsetDateTime::UNIX_EPOCH);
    format!(
        "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}Z",
        time.year(),
        u8::from(time.month()),
        time.day(),
        time.hour(),
        time.minute(),
        time.second(),
        time.millisecond()
    )
}

/// Milliseconds since the epoch of an RFC 3339 time with any offset.
pub(in crate::http) fn parse(text: &str) -> Result<i64, String> {
    let time = OffsetDateTime::parse(text, &Rfc3339)
        .map_err(|_| "must be an RFC 3339 time such as 2026-01-31T12:00:00Z".to_owned())?;
    Ok((time - OffsetDateTime::UNIX_EPOCH).whole_milliseconds() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_survives_the_wire() {
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00.000Z");
        let time = 1_795_312_345_678;
        assert_eq!(parse(&rfc3339(time)), Ok(time));
        assert_eq!(parse("1970-01-01T01:00:00.5+01:00"), Ok(500));
        assert!(parse("yesterday").is_err());
    }
}
