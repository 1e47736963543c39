//! Identifiers: a prefix that says what they name, and a `UUIDv7`, so that they sort by time.

use std::fmt;
use std::str::FromStr;
use std::sync::Mutex;

use serde::{Deserialize, Deserializer, Serialize, de};
use thiserror::Error;
use uuid::{ContextV7, Timestamp, Uuid};

/// A text that is not an identifier of the kind that was asked for.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("an identifier has the form {prefix}_ and 32 lower-case hexadecimal digits")]
pub struct InvalidId {
    prefix: &'static str,
}

/// Writes one kind of identifier; the kinds cannot be confused by the compiler.
macro_rules! identifier {
    ($(#[$doc:meta])* $name:ident, $prefix:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
        #[serde(transparent)]
        pub struct $name(String);

        impl $name {
            /// A new identifier, larger than all that this process made before. `now`: the time, in
            /// milliseconds since the epoch, by the clock that all go by who share the database: lists are
            /// in the order of identifiers.
            pub fn at(now: i64) -> Self {
                Self(format!(concat!($prefix, "_{}"), uuid_at(now).simple()))
            }

            /// Its text.
            pub fn as_str(&self) -> &str {
                &self.0
            }
        }

        impl FromStr for $name {
            type Err = InvalidId;

            fn from_str(text: &str) -> Result<Self, InvalidId> {
                if is_well_formed(text, concat!($prefix, "_")) {
                    Ok(Self(text.to_owned()))
                } else {
                    Err(InvalidId { prefix: $prefix })
                }
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(&self.0)
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
            }
        }
    };
}

identifier!(
    /// Names a job: `job_` and a `UUIDv7` without hyphens.
    JobId,
    "job"
);
identifier!(
    /// Names a cloud: `cld_` and a `UUIDv7` without hyphens.
    CloudId,
    "cld"
);
identifier!(
    /// Names an upload: `upl_` and a `UUIDv7` without hyphens.
    UploadId,
    "upl"
);

identifier!(
    /// Names a batch: `bat_` and a `UUIDv7` without hyphens.
    BatchId,
    "bat"
);
identifier!(
    /// Names a webhook: `whk_` and a `UUIDv7` without hyphens.
    WebhookId,
    "whk"
);
identifier!(
    /// Names a message to a webhook: `msg_` and a `UUIDv7` without hyphens.
    DeliveryId,
    "msg"
);

fn uuid_at(now: i64) -> Uuid {
    /// Counts where two have the same time, or the clock was set back.
    static ORDER: Mutex<ContextV7> = Mutex::new(ContextV7::new());
    let (seconds, rest) = (now.max(0) / 1_000, now.max(0) % 1_000);
    let nanoseconds = rest as u32 * 1_000_000;
    Uuid::new_v7(Timestamp::from_unix(&ORDER, seconds as u64, nanoseconds))
}

fn is_well_formed(text: &str, prefix: &str) -> bool {
    text.strip_prefix(prefix).is_some_and(|rest| {
        rest.len() == 32 && rest.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_identifier_survives_its_text_and_sorts_by_time() {
        let times = [7_000, 7_000, 7_001, 6_000, 9_000];
        let ids = times.map(JobId::at);
        assert!(ids.is_sorted_by(|one, next| one < next), "{ids:?}");
        assert_eq!(ids[0].as_str().parse(), Ok(ids[0].clone()));
    }

    #[test]
    fn other_texts_are_refused() {
        let digits = "0".repeat(32);
        for text in [
            String::new(),
            "job_".to_owned(),
            digits.clone(),
            format!("cld_{digits}"),
            format!("job_{digits}0"),
            format!("job_{}", "A".repeat(32)),
            format!("job_{}", "é".repeat(16)),
        ] {
            assert!(text.parse::<JobId>().is_err(), "{text}");
        }
        assert!(format!("cld_{digits}").parse::<CloudId>().is_ok());
    }
}
