//! Jobs that are erased: one, or all that carry a label.

use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};

use super::found::found;
use super::labelled;
use crate::http::AppState;
use crate::http::api;
use crate::http::resources::clouds::files;
use crate::http::wire::error::Result;
use crate::http::wire::extract::{Id, NoQuery, Query, switch};
use crate::identity::Caller;
use crate::jobs::{Error, JobFilter, JobId, Lookup};

/// Jobs that are listed at a time to be erased.
const AT_ONCE: u32 = 200;

/// `DELETE /v1/jobs/{id}`: with all its results, in any state.
pub(in crate::http) async fn one(
    State(app): State<AppState>,
    caller: Caller,
    _: NoQuery,
    Id(id): Id<JobId>,
) -> Result<StatusCode> {
    found(app.store.by(&caller).delete_job(&id).await?)?;
    forget(&app, id);
    Ok(StatusCode::NO_CONTENT)
}

/// `DELETE /v1/jobs?label=key:value`: all jobs with the label, and their clouds where no other job
/// names them. What is held stays.
pub(in crate::http) async fn of_label(
    State(app): State<AppState>,
    caller: Caller,
    mut query: Query,
) -> Result<Response> {
    let label = query.required("label", |label| labelled(&label));
    let clouds_too = query.take("clouds", switch).unwrap_or(true);
    query.finish()?;
    let filter = JobFilter {
        label,
        ..JobFilter::default()
    };
    let erased = all(&app, &caller, &filter, clouds_too).await?;
    Ok(Json(erased).into_response())
}

/// Erases all jobs that a filter finds, and with `clouds_too` their clouds where no other job names
/// them. What is held stays.
///
/// # Errors
/// Those of the store.
pub(in crate::http) async fn all(
    app: &AppState,
    caller: &Caller,
    filter: &JobFilter,
    clouds_too: bool,
) -> Result<api::Erased> {
    let mut erased = api::Erased::default();
    let mut last = None;
    loop {
        let records = app.store.of(&caller.tenant);
        let page = records.list_jobs(filter, last.as_ref(), AT_ONCE).await?;
        last = page.last().map(|job| job.id.clone());
        if last.is_none() {
            return Ok(erased);
        }
        for job in page {
            let gone = if clouds_too {
                files::erase_with_job(app, caller, &job.id).await
            } else {
                let deleted = app.store.by(caller).delete_job(&job.id).await;
                deleted.map(|job| (job, false))
            };
            match gone {
                Ok((lookup, cloud)) => {
                    erased.jobs += u64::from(matches!(lookup, Lookup::Found(_)));
                    erased.clouds += u64::from(cloud);
                    forget(app, job.id);
                }
                Err(Error::Held) => erased.held += 1,
                Err(error) => return Err(error.into()),
            }
        }
    }
}

/// Lets caches and streams forget a job that is erased.
pub(in crate::http) fn forget(app: &AppState, id: JobId) {
    app.meshes.erase(&id);
    app.feed.erased(id);
}
