//! From what a user gives to complete settings, with every violation reported at once.

use serde_json::{Value, json};

use super::domain::{MAX_CHOSEN_EVALUATIONS, names, refuse};
use super::{BOUNDS, Error, Preset, Settings, Training, Violation};
use crate::nearest::did_you_mean;

/// What is wrong with asking for the fused engine where there is none.
pub(in crate::reconstruction) const NO_FUSED_ENGINE: &str = "is fused, which has neither precision f64 nor the schemes highway and gated; choose auto or libtorch";

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
            let value = merged.pointer(bound.pointer).unwrap_or(&Value::Null);
            let number = value.as_f64();
            if !number.is_some_and(|v| bound.min <= v && v <= bound.max) {
                violations.push(refuse(bound.pointer, value, value));
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
        for (pointer, evaluations) in self.training.chosen_evaluations() {
            if evaluations.len() > MAX_CHOSEN_EVALUATIONS
                || evaluations.contains(&0)
                || !evaluations.is_sorted_by(|a, b| a < b)
            {
                let value = json!(evaluations);
                violations.push(refuse(pointer, &value, &value));
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
                || matches!(
                    self.network.scheme,
                    super::Scheme::Highway | super::Scheme::Gated
                ))
        {
            conflict("/training/engine", NO_FUSED_ENGINE);
        }
        if self.surface.evaluation == super::Evaluation::Dense && self.surface.resolution > 512 {
            conflict(
                "/surface/resolution",
                "is above 512, the most for dense evaluation; choose sparse",
            );
        }
        for (pointer, evaluations) in self.training.chosen_evaluations() {
            let most = self.training.max_evaluations;
            if let Some(last) = evaluations.last().filter(|last| **last > most) {
                let detail = format!("has {last}, but training ends with max_evaluations {most}");
                conflict(pointer, &detail);
            }
        }
        conflicts
    }
}

impl Training {
    /// The lists of evaluations, each with its pointer.
    fn chosen_evaluations(&self) -> [(&'static str, &[u64]); 2] {
        [
            (
                "/training/histogram_evaluations",
                &self.histogram_evaluations,
            ),
            ("/training/snapshot_evaluations", &self.snapshot_evaluations),
        ]
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
    let before = base.pointer(pointer).unwrap_or(&Value::Null);
    let Some(known) = before.as_object() else {
        return place(base, merged, pointer, given, violations);
    };
    let Some(given) = given.as_object() else {
        violations.push(refuse(pointer, before, given));
        return;
    };
    for (name, value) in given {
        let inner = format!("{pointer}/{}", name.replace('~', "~0").replace('/', "~1"));
        if known.contains_key(name) {
            overlay(base, merged, &inner, value, violations);
        } else {
            let meant = match groups_with(base, name).as_slice() {
                [] => did_you_mean(name, known.keys().map(String::as_str)),
                groups => format!("; did you mean {}?", groups.join(" or ")),
            };
            violations.push(Violation {
                pointer: inner,
                detail: format!("is unknown here; known are: {}{meant}", names(known)),
            });
        }
    }
}

/// The settings of that name, each with its group, as in `network.width`.
fn groups_with(base: &Value, name: &str) -> Vec<String> {
    let groups = base.as_object().into_iter().flatten();
    groups
        .filter(|(_, settings)| settings.get(name).is_some())
        .map(|(group, _)| format!("{group}.{name}"))
        .collect()
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
    if serde_json::from_value::<Settings>(alone).is_err() {
        let before = base.pointer(pointer).unwrap_or(&Value::Null);
        violations.push(refuse(pointer, before, value));
        if let Some(slot) = merged.pointer_mut(pointer) {
            *slot = before.clone();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::CHOICES;
    use super::*;

    #[test]
    fn presets_resolve_to_themselves() {
        for preset in Preset::ALL {
            let settings = Settings::resolve(preset, &json!({})).unwrap();
            assert_eq!(settings, preset.settings(), "{}", preset.name());
        }
    }

    /// Pointers of the parameters whose value is of a kind.
    fn pointers(is: fn(&Value) -> bool) -> Vec<String> {
        let settings = to_value(&Preset::Balanced.settings());
        let groups = settings.as_object().unwrap().iter();
        let mut found: Vec<_> = groups
            .flat_map(|(group, values)| {
                let values = values.as_object().unwrap().iter();
                let values = values.filter(|(_, value)| is(value));
                values.map(move |(name, _)| format!("/{group}/{name}"))
            })
            .collect();
        found.sort();
        found
    }

    #[test]
    fn every_number_has_bounds() {
        let mut bounded: Vec<_> = BOUNDS.iter().map(|b| b.pointer.to_owned()).collect();
        bounded.sort();
        assert_eq!(pointers(Value::is_number), bounded);
    }

    #[test]
    fn every_name_has_its_choices() {
        let mut chosen: Vec<_> = CHOICES.iter().map(|c| c.pointer.to_owned()).collect();
        chosen.sort();
        assert_eq!(pointers(Value::is_string), chosen);
        for choice in CHOICES {
            let mut settings = to_value(&Preset::Balanced.settings());
            *settings.pointer_mut(choice.pointer).unwrap() = json!("?");
            // What the type takes, as its deserializer lists it between backticks.
            let error = serde_json::from_value::<Settings>(settings).unwrap_err();
            let error = error.to_string();
            let names: Vec<&str> = error.split('`').skip(1).step_by(2).skip(1).collect();
            assert_eq!(names, choice.names, "{error}");
        }
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
