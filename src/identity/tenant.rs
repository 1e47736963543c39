//! Whose a record is.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use thiserror::Error;

/// Most characters of a tenant's name.
const LONGEST: usize = 64;

/// A tenant: a department or a clinic whose records no other one sees.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Tenant(Arc<str>);

/// A text that names no tenant.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error(
    "the name of a tenant has 1 to {LONGEST} lower-case letters, digits, - . _, and begins with a \
     letter or a digit"
)]
pub struct InvalidTenant;

impl Tenant {
    /// The name of the tenant of a service without keys, and of records from before there were any.
    pub const DEFAULT: &'static str = "default";

    /// Its name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Default for Tenant {
    fn default() -> Self {
        Self(Self::DEFAULT.into())
    }
}

impl FromStr for Tenant {
    type Err = InvalidTenant;

    fn from_str(text: &str) -> Result<Self, InvalidTenant> {
        let plain = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit();
        let begins = text.bytes().next().is_some_and(plain);
        if begins && text.len() <= LONGEST && text.bytes().all(|b| plain(b) || b"-._".contains(&b))
        {
            Ok(Self(text.into()))
        } else {
            Err(InvalidTenant)
        }
    }
}

impl fmt::Display for Tenant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_plain() {
        for good in ["default", "radiology", "a", "7-t.x_y"] {
            assert_eq!(good.parse::<Tenant>().unwrap().as_str(), good);
        }
        let long = "a".repeat(65);
        for wrong in ["", "-a", "Radiology", "a b", "ä", "a/b", &long] {
            assert_eq!(wrong.parse::<Tenant>(), Err(InvalidTenant), "{wrong}");
        }
    }
}
