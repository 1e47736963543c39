//! What a parameter may be, and how a value that it may not be is refused.

use std::fmt;

use serde_json::{Map, Value};

use super::{BOUNDS, Bound, CHOICES, Violation};
use crate::nearest::did_you_mean;

/// Most entries of a list of evaluations: each may store a mesh.
pub const MAX_CHOSEN_EVALUATIONS: usize = 100;

/// Most characters of a given value that a message repeats.
const SHOWN: usize = 40;

/// The values that a parameter may have.
enum Domain<'p> {
    Number {
        bound: &'static Bound,
        integer: bool,
    },
    Choice(&'static [&'static str]),
    Evaluations,
    Group(&'p Map<String, Value>),
}

impl<'p> Domain<'p> {
    /// The domain of the parameter that has this value in a preset.
    fn of(pointer: &str, preset: &'p Value) -> Option<Self> {
        match preset {
            Value::Number(number) => Some(Self::Number {
                bound: BOUNDS.iter().find(|bound| bound.pointer == pointer)?,
                integer: !number.is_f64(),
            }),
            Value::String(_) => {
                let choice = CHOICES.iter().find(|choice| choice.pointer == pointer)?;
                Some(Self::Choice(choice.names))
            }
            Value::Array(_) => Some(Self::Evaluations),
            Value::Object(group) => Some(Self::Group(group)),
            Value::Null | Value::Bool(_) => None,
        }
    }
}

impl fmt::Display for Domain<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number { bound, integer } => {
                let kind = if *integer { "an integer" } else { "a number" };
                write!(f, "{kind} from {} to {}", bound.min, bound.max)
            }
            Self::Choice(names) => write!(f, "one of {}", names.join(", ")),
            Self::Evaluations => write!(
                f,
                "a list of at most {MAX_CHOSEN_EVALUATIONS} increasing evaluation numbers, \
                 counted from 1"
            ),
            Self::Group(group) => write!(f, "an object with some of: {}", names(group)),
        }
    }
}

/// Says that the parameter at `pointer`, which has the value `preset` in a preset, cannot be
/// `given`: what it is, what it may be, and what was probably meant.
pub(super) fn refuse(pointer: &str, preset: &Value, given: &Value) -> Violation {
    let domain = Domain::of(pointer, preset);
    let meant = match (&domain, given) {
        (Some(Domain::Choice(names)), Value::String(name)) => {
            did_you_mean(name, names.iter().copied())
        }
        _ => String::new(),
    };
    let allowed = domain.map_or_else(String::new, |domain| format!(", must be {domain}"));
    Violation {
        pointer: pointer.to_owned(),
        detail: format!("is {}{allowed}{meant}", shown(given)),
    }
}

/// The names of the members of an object.
pub(super) fn names(object: &Map<String, Value>) -> String {
    let names: Vec<&str> = object.keys().map(String::as_str).collect();
    names.join(", ")
}

/// A given value for a message: as JSON where that is short.
fn shown(value: &Value) -> String {
    let json = value.to_string();
    match value {
        _ if json.len() <= SHOWN => json,
        Value::Array(items) => format!("a list of {} entries", items.len()),
        Value::Object(_) => "an object".to_owned(),
        _ => json.chars().take(SHOWN).chain("...".chars()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::{Preset, Settings};
    use super::*;

    /// What is said about one wrong value.
    fn said(given: &Value) -> String {
        let error = Settings::resolve(Preset::Balanced, given).unwrap_err();
        error.violations()[0].detail.clone()
    }

    #[test]
    fn a_refusal_says_what_was_got_and_what_is_allowed() {
        let long = "x".repeat(1_000);
        let lists = "must be a list of at most 100 increasing evaluation numbers, counted from 1";
        for (given, expected) in [
            (
                json!({"network": {"width": "wide"}}),
                "is \"wide\", must be an integer from 1 to 512".to_owned(),
            ),
            (
                json!({"network": {"width": 2.5}}),
                "is 2.5, must be an integer from 1 to 512".to_owned(),
            ),
            (
                json!({"network": {"width": -1}}),
                "is -1, must be an integer from 1 to 512".to_owned(),
            ),
            (
                json!({"network": {"width": 513}}),
                "is 513, must be an integer from 1 to 512".to_owned(),
            ),
            (
                json!({"surface": {"padding": null}}),
                "is null, must be a number from 0 to 1".to_owned(),
            ),
            (
                json!({"surface": {"components": "larges"}}),
                "is \"larges\", must be one of supported, largest, all; did you mean largest?"
                    .to_owned(),
            ),
            (
                json!({"surface": {"components": long}}),
                format!("is \"{}..., must be one of supported, largest, all", &long[..39]),
            ),
            (
                json!({"training": {"snapshot_evaluations": [5, 5]}}),
                format!("is [5,5], {lists}"),
            ),
            (
                json!({"training": {"histogram_evaluations": (1..102).collect::<Vec<_>>()}}),
                format!("is a list of 101 entries, {lists}"),
            ),
            (
                json!({"training": {"histogram_evaluations": ["a"]}}),
                format!("is [\"a\"], {lists}"),
            ),
            (
                json!({"surface": 7}),
                "is 7, must be an object with some of: components, evaluation, open, padding, \
                 projection_steps, resolution, steps_per_spacing, target_triangles"
                    .to_owned(),
            ),
            (
                json!({"training": {"sede": 1}}),
                "is unknown here; known are: adam_evaluations, adam_learning_rate, block_evaluations, engine, \
                 histogram_evaluations, history, learning_rate, max_evaluations, max_iterations, optimizer, \
                 output_layer, patience, seed, smoothing, snapshot_evaluations, time_limit_seconds, tolerance_change, \
                 tolerance_gradient; did you mean seed?"
                    .to_owned(),
            ),
        ] {
            let said = said(&given);
            assert_eq!(said, expected, "{given}");
        }
    }
}
