//! The request for a job, checked as far as possible before any work.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use serde_json::{Map, Value};

use crate::config::Config;
use crate::http::resources::jobs::source::{no_parts, not_chosen, one_source};
use crate::http::resources::retention::Wanted;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{self, Members};
use crate::intake::Summary;
use crate::jobs::{CloudId, Job, JobId, Keep, NewJob};
use crate::reconstruction::cloud::Counts;
use crate::reconstruction::medical::Choice;
use crate::reconstruction::plan::{Cost, grid_bytes, largest_resolution};
use crate::reconstruction::settings::{self, OffSurface};
use crate::reconstruction::{Preset, Settings};

/// Most labels of a job.
pub(in crate::http) const MAX_LABELS: usize = 16;

/// Most characters of a label's key and of its value.
pub(in crate::http) const MAX_LABEL_LENGTH: usize = 64;

/// The priorities that a job may have: they order the jobs of one tenant.
pub(in crate::http) const PRIORITIES: RangeInclusive<i64> = -9..=9;

const MIB: u64 = 1 << 20;

/// A job that is asked for, with complete settings.
#[derive(Debug, Clone)]
pub(in crate::http) struct JobRequest {
    /// The cloud, where it is not part of the request.
    pub(in crate::http) cloud_id: Option<CloudId>,
    /// Preset that the settings started from.
    pub(in crate::http) preset: Preset,
    /// Complete settings.
    pub(in crate::http) settings: Settings,
    labels: BTreeMap<String, String>,
    source: Option<Choice>,
    derived_from: Option<JobId>,
    priority: i64,
    ttl: Option<Wanted>,
    /// How long the job is kept of which this is a retry.
    inherited: Option<Keep>,
}

/// What the address of a request may say: `preset`, `source` and `ttl`.
type OfAddress = (Option<Preset>, Option<Choice>, Option<Wanted>);

impl JobRequest {
    /// Reads `cloud_id`, `preset`, `settings`, `labels`, `source`, `priority` and `ttl`; what the address says
    /// stands in for members of the body.
    ///
    /// # Errors
    /// [`Code::RequestInvalid`], [`Code::SettingsInvalid`], [`Code::SettingsConflict`], each with
    /// all faults.
    pub(in crate::http) fn new(
        mut members: Members,
        (preset, source, ttl): OfAddress,
    ) -> Result<Self> {
        let cloud_id = members.take("cloud_id", extract::json::<CloudId>);
        for (name, is_given) in [
            ("preset", preset.is_some()),
            ("source", source.is_some()),
            ("ttl", ttl.is_some()),
        ] {
            if is_given && members.has(name) {
                members.fault(name, "is given in the address too".to_owned());
            }
        }
        let source = members.take("source", one_source).or(source);
        let preset = members
            .take("preset", |name| {
                preset_named(name.as_str().unwrap_or_default())
            })
            .or(preset);
        let ttl = members.take("ttl", wanted).or(ttl);
        let given = members.take("settings", object);
        let labels = labels(&mut members);
        let priority = members.take("priority", priority);
        members.finish()?;
        let preset = preset.unwrap_or_default();
        Ok(Self {
            cloud_id,
            preset,
            settings: resolve(preset, &given.unwrap_or_default().into())?,
            labels: labels.unwrap_or_default(),
            source,
            derived_from: None,
            priority: priority.unwrap_or(0),
            ttl,
            inherited: None,
        })
    }

    /// A request to repeat a job with changes. Given settings are laid over those of the job, or
    /// over those of a preset if one is named.
    ///
    /// # Errors
    /// As [`JobRequest::new`].
    pub(in crate::http) fn again(job: &Job, mut members: Members) -> Result<Self> {
        let preset = members.take("preset", |name| {
            preset_named(name.as_str().unwrap_or_default())
        });
        let given = members.take("settings", object).unwrap_or_default();
        let source = members.take("source", one_source);
        let ttl = members.take("ttl", wanted);
        let labels = labels(&mut members);
        let priority = members.take("priority", priority);
        members.finish()?;
        let mut base = match preset {
            Some(_) => Value::Object(Map::new()),
            None => serde_json::to_value(&job.settings).map_err(ApiError::internal)?,
        };
        lay_over(&mut base, given);
        let preset = preset.unwrap_or(job.preset);
        Ok(Self {
            cloud_id: Some(job.cloud_id.clone()),
            preset,
            settings: resolve(preset, &base)?,
            labels: labels.unwrap_or_else(|| job.labels.clone()),
            source: source.or_else(|| job.source.clone()),
            derived_from: Some(job.id.clone()),
            priority: priority.unwrap_or(job.priority),
            ttl,
            inherited: Some(job.keep),
        })
    }

    /// Checks choice and settings against the cloud, if it is known, and the limits of the machine,
    /// and estimates the cost.
    ///
    /// # Errors
    /// [`Code::SourceMissing`] and [`Code::SourceUnknown`], [`Code::SettingsConflict`] for labels that
    /// are asked for and not there, [`Code::GridTooLarge`] and [`Code::TrainingTooLarge`].
    pub(in crate::http) fn check(
        &self,
        config: &Config,
        summary: Option<&Summary>,
    ) -> Result<Cost> {
        if let Some(summary) = summary {
            self.check_source(summary)?;
        }
        let labels = summary.and_then(Summary::point_labels);
        if self.settings.sampling.off_surface == OffSurface::Labels
            && labels.is_some_and(|labels| labels.interior + labels.exterior == 0)
        {
            return Err((&settings::Error::conflict(
                "/sampling/off_surface",
                "is labels, but no point of the cloud is labelled interior or exterior; give such \
                 points, or choose generated",
            ))
                .into());
        }
        let budget = Counts {
            surface: self.settings.sampling.surface_points,
            ..Counts::default()
        };
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = config.work.threads(cores, config.workers);
        let cost = Cost::estimated(&self.settings, &labels.unwrap_or(budget), threads);
        if let Some(limit) = config.work.job_memory_bytes() {
            self.check_grid(limit)?;
            self.check_training(&cost, limit)?;
        }
        Ok(cost)
    }

    /// Holds the choice of a part against what the summary of a file lists.
    ///
    /// # Errors
    /// [`Code::SourceMissing`] and [`Code::SourceUnknown`], both with the list.
    fn check_source(&self, summary: &Summary) -> Result<()> {
        let Some(contents) = &summary.segmentation else {
            if self.source.is_none() {
                return Ok(());
            }
            return Err(no_parts());
        };
        let chosen = contents.parts.choose(self.source.as_ref());
        chosen
            .map(drop)
            .map_err(|error| not_chosen(&contents.parts, &error))
    }

    /// A request for each part of a file that is chosen; without a choice there are all parts.
    ///
    /// # Errors
    /// [`Code::SourceMissing`] and [`Code::SourceUnknown`], both with the list.
    pub(in crate::http) fn of_parts(
        &self,
        choices: &[Choice],
        summary: &Summary,
    ) -> Result<Vec<Self>> {
        let of = |source: Choice| Self {
            source: Some(source),
            ..self.clone()
        };
        match (choices, &summary.segmentation) {
            ([only], _) => Ok(vec![of(only.clone())]),
            (_, None) => Err(no_parts()),
            (_, Some(contents)) => {
                let chosen = contents.parts.chosen(choices);
                let chosen = chosen.map_err(|error| not_chosen(&contents.parts, &error))?;
                // A number says which part it is, whatever the file calls its parts.
                let parts = chosen.iter().map(|item| of(Choice::Label(item.number)));
                Ok(parts.collect())
            }
        }
    }

    fn check_grid(&self, limit: u64) -> Result<()> {
        let bytes = grid_bytes(&self.settings);
        if bytes <= limit {
            return Ok(());
        }
        let asked = self.settings.surface.resolution;
        let largest = largest_resolution(&self.settings, limit);
        let detail = format!(
            "is {asked}: the grid takes about {}; {largest} is the most that fits",
            shares(bytes, limit)
        );
        let pointer = "/settings/surface/resolution";
        Err(
            too_large(Code::GridTooLarge, pointer, detail, [bytes, limit])
                .with("asked", asked.into())
                .with("largest", largest.into()),
        )
    }

    fn check_training(&self, cost: &Cost, limit: u64) -> Result<()> {
        let bytes = cost.training_bytes;
        if bytes <= limit {
            return Ok(());
        }
        let (pointer, asked) = if 2 * cost.pairs_bytes > bytes {
            ("/settings/training/history", self.settings.training.history)
        } else {
            ("/settings/network/width", self.settings.network.width)
        };
        let detail = format!(
            "is {asked}: the training takes about {}; lower training.history, network.width, \
             network.hidden_layers or the budgets of sampling",
            shares(bytes, limit)
        );
        Err(too_large(
            Code::TrainingTooLarge,
            pointer,
            detail,
            [bytes, limit],
        ))
    }

    /// The job to submit, for the given cloud, at the cost that [`JobRequest::check`] gave.
    pub(in crate::http) fn of_cloud(
        self,
        cloud_id: CloudId,
        cost: &Cost,
        config: &Config,
    ) -> NewJob {
        let inherited = self.inherited.filter(|_| self.ttl.is_none());
        NewJob {
            keep: inherited.unwrap_or_else(|| Wanted::keep(self.ttl, config.job_ttl)),
            cloud_id,
            preset: self.preset,
            settings: self.settings,
            labels: self.labels,
            source: self.source,
            derived_from: self.derived_from,
            priority: self.priority,
            cost_seconds: cost.seconds,
        }
    }
}

fn too_large(code: Code, pointer: &str, detail: String, [bytes, limit]: [u64; 2]) -> ApiError {
    ApiError::fault(code, pointer, detail)
        .with("memory_bytes", bytes.into())
        .with("limit_bytes", limit.into())
}

fn shares(bytes: u64, limit: u64) -> String {
    format!(
        "{} MiB of the {} MiB that a worker has for it",
        bytes.div_ceil(MIB),
        limit / MIB
    )
}

fn resolve(preset: Preset, given: &Value) -> Result<Settings> {
    Settings::resolve(preset, given).map_err(|error| (&error).into())
}

/// The preset of this name.
pub(in crate::http) fn preset_named(name: &str) -> std::result::Result<Preset, String> {
    let found = Preset::ALL.into_iter().find(|preset| preset.name() == name);
    found.ok_or_else(|| {
        let names = Preset::ALL.map(Preset::name).join(", ");
        format!("must be one of {names}")
    })
}

#[expect(clippy::needless_pass_by_value, reason = "as members are taken")]
fn wanted(value: Value) -> std::result::Result<Wanted, String> {
    Wanted::of_job(value.as_str().unwrap_or_default())
}

fn object(value: Value) -> std::result::Result<Map<String, Value>, String> {
    match value {
        Value::Object(object) => Ok(object),
        _ => Err("must be an object".to_owned()),
    }
}

#[expect(clippy::needless_pass_by_value, reason = "as members are taken")]
pub(in crate::http) fn priority(value: Value) -> std::result::Result<i64, String> {
    let given = value.as_i64().filter(|given| PRIORITIES.contains(given));
    given.ok_or_else(|| {
        let (least, most) = PRIORITIES.into_inner();
        format!("must be a whole number from {least} to {most}")
    })
}

fn labels(members: &mut Members) -> Option<BTreeMap<String, String>> {
    let given = members.take("labels", |value| {
        let labels = object(value)?;
        let count = labels.len();
        if count > MAX_LABELS {
            return Err(format!(
                "has {count} labels, at most {MAX_LABELS} are allowed"
            ));
        }
        Ok(labels)
    })?;
    let fits = |text: &str| text.chars().count() <= MAX_LABEL_LENGTH;
    let mut labels = BTreeMap::new();
    for (key, value) in given {
        match value {
            Value::String(value) if !key.is_empty() && fits(&key) && fits(&value) => {
                labels.insert(key, value);
            }
            _ => {
                let detail = format!(
                    "must be a string of at most {MAX_LABEL_LENGTH} characters, with a name of 1 \
                     to {MAX_LABEL_LENGTH}"
                );
                members.fault_within("labels", &key, detail);
            }
        }
    }
    Some(labels)
}

fn lay_over(base: &mut Value, given: Map<String, Value>) {
    let Value::Object(base) = base else { return };
    for (name, value) in given {
        match (base.get_mut(&name), value) {
            (Some(inner @ Value::Object(_)), Value::Object(value)) => lay_over(inner, value),
            (_, value) => {
                base.insert(name, value);
            }
        }
    }
}
