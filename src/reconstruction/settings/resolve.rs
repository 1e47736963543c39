//! From what a user gives to complete settings, with every violation reported at once.

use std::fmt;

use serde_json::{Map, Value};
use thiserror::Error;

use super::{Preset, Settings};

/// The allowed interval of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// JSON pointer of the parameter.
    pub pointer: &'static str,
    /// Smallest allowed value.
    pub min: f64,
    /// Largest allowed value.
    pub max: f64,
}

const fn bound(pointer: &'static str, min: f64, max: f64) -> Bound {
    Bound { pointer, min, max }
}

/// Largest integer that JSON numbers carry exactly.
const MAX_SAFE_INTEGER: f64 = 9_007_199_254_740_991.0;

/// The bounds of every numeric parameter, both ends included.
pub const BOUNDS: &[Bound] = &[
    bound("/network/width", 1.0, 512.0),
    bound("/network/hidden_layers", 1.0, 32.0),
    bound("/network/residual_every", 1.0, 32.0),
    bound("/training/seed", 0.0, MAX_SAFE_INTEGER),
    bound("/training/learning_rate", 1e-6, 10.0),
    bound("/training/history", 1.0, 1_000.0),
    bound("/training/tolerance_gradient", 0.0, 1.0),
    bound("/training/tolerance_change", 0.0, 1.0),
    bound("/training/max_iterations", 1.0, 1e6),
    bound("/training/max_evaluations", 1.0, 1e6),
    bound("/training/adam_evaluations", 0.0, 1e6),
    bound("/training/adam_learning_rate", 1e-6, 1.0),
    bound("/training/patience", 0.0, 1e6),
    bound("/training/time_limit_seconds", 0.0, 86_400.0),
    bound("/sampling/half_extent", 0.01, 100.0),
    bound("/sampling/band", 1e-4, 10.0),
    bound("/sampling/surface_points", 16.0, 1e6),
    bound("/sampling/labelled_points", 0.0, 1e6),
    bound("/sampling/validation_fraction", 0.0, 0.5),
    bound("/sampling/near_pairs", 0.0, 4.0),
    bound("/sampling/far_points", 0.0, 1e6),
    bound("/sampling/neighbours", 3.0, 100.0),
    bound("/surface/resolution", 8.0, 1_024.0),
    bound("/surface/padding", 0.0, 1.0),
    bound("/surface/projection_steps", 0.0, 10.0),
];

/// Most entries of a list of evaluations: each may store a mesh.
const MAX_CHOSEN_EVALUATIONS: usize = 100;

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

/// Turns `network.scheme=hw` assignments into the JSON object that [`Settings::resolve`] takes.
///
/// A value is read as JSON where it is JSON, otherwise as a string.
///
/// # Errors
/// Every assignment that has no `=` or whose path runs through a value.
pub fn assignments<S: AsRef<str>>(given: &[S]) -> Result<Value, Error> {
    let mut root = Map::new();
    let mut violations = Vec::new();
    for assignment in given {
        let assignment = assignment.as_ref();
        let Some((path, text)) = assignment.split_once('=') else {
            violations.push(Violation {
                pointer: format!("/{}", assignment.replace('.', "/")),
                detail: "needs a value, as in network.scheme=hw".to_owned(),
            });
            continue;
        };
        let value = serde_json::from_str(text).unwrap_or_else(|_| Value::String(text.to_owned()));
        if !insert(&mut root, path, value) {
            violations.push(Violation {
                pointer: format!("/{}", path.replace('.', "/")),
                detail: "is set both as a value and as a group".to_owned(),
            });
        }
    }
    if violations.is_empty() {
        Ok(Value::Object(root))
    } else {
        Err(Error::Invalid(violations))
    }
}

fn insert(object: &mut Map<String, Value>, path: &str, value: Value) -> bool {
    match path.split_once('.') {
        None => {
            object.insert(path.to_owned(), value);
            true
        }
        Some((group, rest)) => object
            .entry(group)
            .or_insert_with(|| Value::Object(Map::new()))
            .as_object_mut()
            .is_some_and(|inner| insert(inner, rest, value)),
    }
}

impl Settings {
    /// Lays `given`, a JSON object of what differs, over the settings of `preset`.
    ///
    /// # Errors
    /// [`Error::Invalid`] with every unknown, mistyped or out-of-bounds parameter, or
    /// [`Error::Conflict`] with every contradiction between parameters.
    pub fn resolve(preset: Preset, given: &Value) -> Result<Self, Error> {
        let base = to_value(&preset.settings());
        let mut merged = base.clone();
        let mut violations = Vec::new();
        overlay(&base, &mut merged, "", given, &mut violations);
        let settings = match serde_json::from_value::<Self>(merged.clone()) {
            Ok(settings) => settings,
            Err(error) if violations.is_empty() => {
                violations.push(Violation {
                    pointer: String::new(),
                    detail: error.to_string(),
                });
                return Err(Error::Invalid(violations));
            }
            Err(_) => return Err(Error::Invalid(violations)),
        };
        for bound in BOUNDS {
            let value = merged.pointer(bound.pointer).and_then(Value::as_f64);
            if !value.is_some_and(|v| bound.min <= v && v <= bound.max) {
                violations.push(Violation {
                    pointer: bound.pointer.to_owned(),
                    detail: format!(
                        "is {}, must be from {} to {}",
                        value.map_or_else(|| "not finite".to_owned(), |v| v.to_string()),
                        bound.min,
                        bound.max
                    ),
                });
            }
        }
        settings.check_lists(&mut violations);
        if !violations.is_empty() {
            return Err(Error::Invalid(violations));
        }
        let conflicts = settings.conflicts();
        if conflicts.is_empty() {
            Ok(settings)
        } else {
            Err(Error::Conflict(conflicts))
        }
    }

    fn check_lists(&self, violations: &mut Vec<Violation>) {
        for (name, evaluations) in [
            (
                "histogram_evaluations",
                &self.training.histogram_evaluations,
            ),
            ("snapshot_evaluations", &self.training.snapshot_evaluations),
        ] {
            let pointer = format!("/training/{name}");
            if evaluations.len() > MAX_CHOSEN_EVALUATIONS {
                violations.push(Violation {
                    pointer,
                    detail: format!(
                        "has {} entries, at most {MAX_CHOSEN_EVALUATIONS} are allowed",
                        evaluations.len()
                    ),
                });
            } else if evaluations.contains(&0) || !evaluations.is_sorted_by(|a, b| a < b) {
                violations.push(Violation {
                    pointer,
                    detail: "must be increasing evaluation numbers, counted from 1".to_owned(),
                });
            }
        }
    }

    fn conflicts(&self) -> Vec<Violation> {
        let mut conflicts = Vec::new();
        let mut conflict = |pointer: &str, detail: &str| {
            conflicts.push(Violation {
                pointer: pointer.to_owned(),
                detail: detail.to_owned(),
            });
        };
        if self.sampling.off_surface == super::OffSurface::Generated
            && self.sampling.near_pairs == 0
            && self.sampling.far_points == 0
        {
            conflict(
                "/sampling/off_surface",
                "is generated, but near_pairs and far_points are both 0; set one, or choose labels",
            );
        }
        if self.surface.evaluation == super::Evaluation::Dense && self.surface.resolution > 512 {
            conflict(
                "/surface/resolution",
                "is above 512, the most for dense evaluation; choose sparse",
            );
        }
        conflicts
    }
}

fn to_value(settings: &Settings) -> Value {
    serde_json::to_value(settings).expect("settings are plain numbers, names and lists")
}

/// Lays `given` over `merged` below `pointer`, leaf by leaf: a leaf that does not fit its type is
/// reported and left out, so that the others are still checked.
fn overlay(
    base: &Value,
    merged: &mut Value,
    pointer: &str,
    given: &Value,
    violations: &mut Vec<Violation>,
) {
    let Some(known) = base.pointer(pointer).and_then(Value::as_object) else {
        return place(base, merged, pointer, given, violations);
    };
    let Some(given) = given.as_object() else {
        violations.push(Violation {
            pointer: pointer.to_owned(),
            detail: format!("must be an object with some of: {}", names(known)),
        });
        return;
    };
    for (name, value) in given {
        let inner = format!("{pointer}/{}", name.replace('~', "~0").replace('/', "~1"));
        if known.contains_key(name) {
            overlay(base, merged, &inner, value, violations);
        } else {
            violations.push(Violation {
                pointer: inner,
                detail: format!("is unknown here; known are: {}", names(known)),
            });
        }
    }
}

fn place(
    base: &Value,
    merged: &mut Value,
    pointer: &str,
    value: &Value,
    violations: &mut Vec<Violation>,
) {
    let mut alone = base.clone();
    for document in [&mut alone, merged] {
        if let Some(slot) = document.pointer_mut(pointer) {
            *slot = value.clone();
        }
    }
    if let Err(error) = serde_json::from_value::<Settings>(alone) {
        violations.push(Violation {
            pointer: pointer.to_owned(),
            detail: error.to_string(),
        });
        if let (Some(slot), Some(before)) = (merged.pointer_mut(pointer), base.pointer(pointer)) {
            *slot = before.clone();
        }
    }
}

fn names(object: &Map<String, Value>) -> String {
    object
        .keys()
        .map(String::as_str)
        .collect::<Vec<_>>()
        .join(", ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn presets_resolve_to_themselves() {
        for preset in Preset::ALL {
            let settings = Settings::resolve(preset, &json!({})).unwrap();
            assert_eq!(settings, preset.settings(), "{}", preset.name());
        }
    }

    #[test]
    fn every_number_has_bounds() {
        fn numbers(value: &Value, pointer: &str, found: &mut Vec<String>) {
            match value {
                Value::Object(object) => {
                    for (name, inner) in object {
                        numbers(inner, &format!("{pointer}/{name}"), found);
                    }
                }
                Value::Number(_) => found.push(pointer.to_owned()),
                _ => {}
            }
        }
        let mut found = Vec::new();
        numbers(&to_value(&Preset::Balanced.settings()), "", &mut found);
        let mut bounded: Vec<_> = BOUNDS.iter().map(|b| b.pointer.to_owned()).collect();
        found.sort();
        bounded.sort();
        assert_eq!(found, bounded);
    }

    #[test]
    fn every_violation_is_reported_at_once() {
        let given = json!({
            "network": {"width": 0, "depth": 3, "scheme": "deep"},
            "training": {"learning_rate": "fast", "snapshot_evaluations": [5, 5]},
            "surface": 7,
        });
        let error = Settings::resolve(Preset::Balanced, &given).unwrap_err();
        assert_eq!(error.code(), "settings_invalid");
        let mut pointers: Vec<_> = error
            .violations()
            .iter()
            .map(|v| v.pointer.as_str())
            .collect();
        pointers.sort_unstable();
        assert_eq!(
            pointers,
            [
                "/network/depth",
                "/network/scheme",
                "/network/width",
                "/surface",
                "/training/learning_rate",
                "/training/snapshot_evaluations",
            ]
        );
    }

    #[test]
    fn assignments_become_nested_objects() {
        let value = assignments(&["network.scheme=hw", "training.seed=12"]).unwrap();
        assert_eq!(
            value,
            json!({"network": {"scheme": "hw"}, "training": {"seed": 12}})
        );
        let error = assignments(&["a", "b=1", "b.c=2"]).unwrap_err();
        assert_eq!(error.violations().len(), 2);
    }
}
