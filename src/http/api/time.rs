//! Times on the wire: RFC 3339 in UTC with milliseconds; milliseconds since the epoch inside.

use std::fmt::{self, Display, Formatter};

use serde::{Serialize, Serializer};
use time::format_description::well_known::Rfc3339;
use time::{Duration, OffsetDateTime};

/// A time in milliseconds since the epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::http) struct Time(pub(in crate::http) i64);

impl Display for Time {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let time = OffsetDateTime::UNIX_EPOCH
            .checked_add(Duration::milliseconds(self.0))
            .unwrap_or(OffsetDateTime::UNIX_EPOCH);
        write!(
            f,
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
}

impl Time {
    /// As headers have it (RFC 9110 section 5.6.7), in whole seconds.
    pub(in crate::http) fn http_date(self) -> String {
        let time = OffsetDateTime::UNIX_EPOCH + Duration::milliseconds(self.0);
        let (day, month) = (time.weekday().to_string(), time.month().to_string());
        format!(
            "{:.3}, {:02} {:.3} {:04} {:02}:{:02}:{:02} GMT",
            day,
            time.day(),
            month,
            time.year(),
            time.hour(),
            time.minute(),
            time.second()
        )
    }
}

impl Serialize for Time {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Milliseconds since the epoch of an RFC 3339 time with any offset.
pub(in crate::http) fn milliseconds(text: &str) -> Result<i64, String> {
    let time = OffsetDateTime::parse(text, &Rfc3339)
        .map_err(|_| "must be an RFC 3339 time such as 2026-01-31T12:00:00Z".to_owned())?;
    Ok((time - OffsetDateTime::UNIX_EPOCH).whole_milliseconds() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_survives_the_wire() {
        assert_eq!(Time(0).to_string(), "1970-01-01T00:00:00.000Z");
        let time = 1_795_312_345_678;
        assert_eq!(milliseconds(&Time(time).to_string()), Ok(time));
        assert_eq!(milliseconds("1970-01-01T01:00:00.5+01:00"), Ok(500));
        assert!(milliseconds("yesterday").is_err());
        let date = Time(784_111_777_900).http_date();
        assert_eq!(date, "Sun, 06 Nov 1994 08:49:37 GMT");
    }
}
