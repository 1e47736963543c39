//! From what a user gives to complete settings, with every violation reported at once.

use serde_json::{Map, Value};

use super::{BOUNDS, Error, Preset, Settings, Violation};

/// Most entries of a list of evaluations: each may store a mesh.
const MAX_CHOSEN_EVALUATIONS: usize = 100;

/// What is wrong with asking for the fused engine where there is none.
pub(in crate::reconstruction) const NO_FUSED_ENGINE: &str =
    "is fused, which has neither precision f64 nor scheme highway; choose auto or libtorch";

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
        if self.training.engine == super::Engine::Fused
            && (self.network.precision == super::Precision::F64
                || self.network.scheme == super::Scheme::Highway)
        {
            conflict("/training/engine", NO_FUSED_ENGINE);
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
}
