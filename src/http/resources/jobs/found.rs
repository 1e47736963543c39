//! Extractors for resources below a job: the job exists, or exists and has a result.

use axum::extract::FromRequestParts;
use axum::http::request::Parts;

use crate::http::AppState;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::Id;
use crate::identity::Caller;
use crate::jobs::{Job, JobId, Lookup, Status};

/// The job of the path, `{id}`, in any state.
#[derive(Debug, Clone)]
pub(in crate::http) struct Found(pub(in crate::http) Job);

impl FromRequestParts<AppState> for Found {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<Self> {
        let Id(id) = Id::<JobId>::from_request_parts(parts, app).await?;
        let caller = Caller::from_request_parts(parts, app).await?;
        found(app.store.of(&caller.tenant).job(&id).await?).map(Self)
    }
}

/// The job of the path, `{id}`, if it has a result.
#[derive(Debug, Clone)]
pub(in crate::http) struct Succeeded(pub(in crate::http) Job);

impl FromRequestParts<AppState> for Succeeded {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<Self> {
        let Found(job) = Found::from_request_parts(parts, app).await?;
        succeeded(job).map(Self)
    }
}

/// The job that was looked up.
///
/// # Errors
/// [`Code::NotFound`] and [`Code::Gone`].
pub(in crate::http) fn found(lookup: Lookup) -> Result<Job> {
    match lookup {
        Lookup::Found(job) => Ok(*job),
        Lookup::Gone(tombstone) => Err(ApiError::gone("job", &tombstone)),
        Lookup::Missing => Err(ApiError::not_found("job")),
    }
}

/// The job if it has a result.
///
/// # Errors
/// [`Code::ResultNotReady`] while it can still get one, [`Code::NotFound`] when it never will.
fn succeeded(job: Job) -> Result<Job> {
    match job.status {
        Status::Succeeded => Ok(job),
        Status::Queued | Status::Running => {
            let seconds = job.eta_seconds.unwrap_or(1.0).clamp(1.0, 60.0);
            Err(ApiError::new(
                Code::ResultNotReady,
                format!("the job is {}; its result comes with its end", job.status),
            )
            .retry_after(seconds.ceil() as u32))
        }
        Status::Failed | Status::Cancelled => {
            let code = job.error.map(|error| format!(" ({})", error.code));
            let detail = format!(
                "the job is {}{}: it has no result; POST /v1/jobs/{}/retry makes another one of it",
                job.status,
                code.unwrap_or_default(),
                job.id
            );
            Err(ApiError::new(Code::NotFound, detail))
        }
    }
}
