//! What is wrong with given settings.

use std::fmt;

use thiserror::Error;

/// One thing that is wrong with the given settings.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Violation {
    /// JSON pointer of the parameter (RFC 6901).
    pub pointer: String,
    /// What is wrong, and what is allowed.
    pub detail: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.pointer, self.detail)
    }
}

/// Why settings are refused.
#[derive(Debug, Error)]
pub enum Error {
    /// Unknown, mistyped or out of bounds; all of them.
    #[error("settings: {}", list(.0))]
    Invalid(Vec<Violation>),
    /// The settings contradict each other or the cloud.
    #[error("settings: {}", list(.0))]
    Conflict(Vec<Violation>),
}

impl Error {
    /// Stable `snake_case` name.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Invalid(_) => "settings_invalid",
            Self::Conflict(_) => "settings_conflict",
        }
    }

    /// What is wrong, parameter by parameter.
    pub fn violations(&self) -> &[Violation] {
        match self {
            Self::Invalid(violations) | Self::Conflict(violations) => violations,
        }
    }

    /// A single contradiction.
    pub fn conflict(pointer: &str, detail: impl Into<String>) -> Self {
        Self::Conflict(vec![Violation {
            pointer: pointer.to_owned(),
            detail: detail.into(),
        }])
    }
}

fn list(violations: &[Violation]) -> String {
    violations
        .iter()
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join("; ")
}
