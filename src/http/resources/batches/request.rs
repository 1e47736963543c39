//! The request for a batch: clouds, parts of them, and what is asked of each.

use serde_json::Value;

use crate::config::Config;
use crate::http::resources::jobs::request::JobRequest;
use crate::http::resources::retention::Wanted;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::{self, Members};
use crate::intake::Summary;
use crate::jobs::CloudId;
use crate::reconstruction::Preset;
use crate::reconstruction::medical::Choice;
use crate::reconstruction::plan::Cost;

/// Most jobs of a batch.
pub(in crate::http) const MOST_JOBS: usize = 256;

/// A batch that is asked for, with complete settings.
#[derive(Debug)]
pub(in crate::http) struct BatchRequest {
    /// The clouds, where they are not part of the request.
    pub(in crate::http) clouds: Vec<CloudId>,
    /// Parts of each cloud; none where there is no choice, an empty list for all of them.
    source: Option<Vec<Choice>>,
    /// What is asked of each.
    job: JobRequest,
}

/// What the address of a request may say: `preset`, `source` and `ttl`.
pub(super) type OfAddress = (Option<Preset>, Option<Vec<Choice>>, Option<Wanted>);

impl BatchRequest {
    /// Reads `clouds`, `source`, and the members that a job has, where `files` clouds came with the
    /// request.
    ///
    /// # Errors
    /// [`Code::RequestInvalid`], [`Code::SettingsInvalid`], [`Code::SettingsConflict`], each with
    /// all faults.
    pub(super) fn new(
        mut members: Members,
        (preset, source, ttl): OfAddress,
        files: usize,
    ) -> Result<Self> {
        if files > 0 && members.has("clouds") {
            members.fault("clouds", "is given, but clouds were sent too".to_owned());
        } else if files == 0 && !members.has("clouds") {
            members.fault("clouds", "is missing".to_owned());
        }
        if source.is_some() && members.has("source") {
            members.fault("source", "is given in the address too".to_owned());
        }
        if members.has("cloud_id") {
            let detail = "is for a job; a batch has a list, clouds";
            members.fault("cloud_id", detail.to_owned());
        }
        let clouds = members.take("clouds", |list| {
            let clouds = extract::json::<Vec<CloudId>>(list)?;
            match clouds.len() {
                1..=MOST_JOBS => Ok(clouds),
                _ => Err(format!("must have 1 to {MOST_JOBS} ids of clouds")),
            }
        });
        let source = members.take("source", sources).or(source);
        Ok(Self {
            clouds: clouds.unwrap_or_default(),
            source,
            job: JobRequest::new(members, (preset, None, ttl))?,
        })
    }

    /// The jobs of a cloud, checked, with what each costs.
    ///
    /// # Errors
    /// As [`JobRequest::check`].
    pub(super) fn jobs(
        &self,
        config: &Config,
        summary: &Summary,
    ) -> Result<Vec<(JobRequest, Cost)>> {
        let jobs = match &self.source {
            Some(choices) => self.job.of_parts(choices, summary)?,
            None => vec![self.job.clone()],
        };
        let costs = |job: JobRequest| {
            let cost = job.check(config, Some(summary))?;
            Ok((job, cost))
        };
        jobs.into_iter().map(costs).collect()
    }
}

/// Refuses a batch without jobs, or with too many.
///
/// # Errors
/// [`Code::RequestInvalid`].
pub(super) fn check_number(jobs: usize) -> Result<()> {
    if (1..=MOST_JOBS).contains(&jobs) {
        return Ok(());
    }
    let detail = format!("makes {jobs} jobs; a batch may have 1 to {MOST_JOBS}");
    Err(ApiError::fault(Code::RequestInvalid, "/source", detail))
}

/// Parts as a text, `label:1,3` or `label:all`, as the object that a job takes, or as a list of those.
fn sources(value: Value) -> std::result::Result<Vec<Choice>, String> {
    match value {
        Value::String(text) => Choice::parse_several(&text),
        Value::Array(list) if list.is_empty() => {
            Err("must have at least one part; label:all is all of them".to_owned())
        }
        Value::Array(_) => extract::json(value),
        one => extract::json(one).map(|choice| vec![choice]),
    }
}
