//! How long something is kept: a number and a unit, as in `30d`.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};

const SECOND_MS: i64 = 1_000;

/// Units, the largest first.
const UNITS: [(char, i64); 4] = [
    ('d', 86_400 * SECOND_MS),
    ('h', 3_600 * SECOND_MS),
    ('m', 60 * SECOND_MS),
    ('s', SECOND_MS),
];

/// Most digits of the number.
const DIGITS: usize = 4;

/// A time to live.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ttl(i64);

impl Ttl {
    /// It from its milliseconds, if they are whole seconds.
    pub fn of_ms(ms: i64) -> Option<Self> {
        (ms > 0 && ms % SECOND_MS == 0).then_some(Self(ms))
    }

    /// Its milliseconds.
    pub fn ms(self) -> i64 {
        self.0
    }
}

impl FromStr for Ttl {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let ttl = || {
            let unit = text.chars().next_back()?;
            let (_, ms) = UNITS.iter().find(|(name, _)| *name == unit)?;
            let digits = text.strip_suffix(unit)?;
            let plain = digits.bytes().all(|b| b.is_ascii_digit()) && !digits.starts_with('0');
            let short = (1..=DIGITS).contains(&digits.len());
            let number: i64 = digits.parse().ok().filter(|_| plain && short)?;
            Self::of_ms(number * ms)
        };
        ttl().ok_or_else(|| {
            let form =
                "must be a number of at most four digits with d, h, m or s, as in 30d or 12h";
            form.to_owned()
        })
    }
}

impl fmt::Display for Ttl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let whole = UNITS.iter().find(|(_, ms)| self.0 % ms == 0);
        let (unit, ms) = whole.unwrap_or(&('s', SECOND_MS));
        write!(f, "{}{unit}", self.0 / ms)
    }
}

impl Serialize for Ttl {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_to_live_is_read_and_written() {
        for (text, ms, written) in [
            ("30d", 2_592_000_000, "30d"),
            ("48h", 172_800_000, "2d"),
            ("90m", 5_400_000, "90m"),
            ("1s", 1_000, "1s"),
        ] {
            let ttl: Ttl = text.parse().unwrap();
            assert_eq!((ttl.ms(), ttl.to_string()), (ms, written.to_owned()));
        }
        for wrong in [
            "", "d", "7", "+7d", "-7d", "0s", "7w", "7 d", "10000d", "07d",
        ] {
            assert!(wrong.parse::<Ttl>().is_err(), "{wrong}");
        }
    }
}
