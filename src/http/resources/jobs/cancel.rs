//! Jobs that are asked to end: all that carry a label.

use axum::Json;
use axum::extract::{Request, State};
use axum::response::{IntoResponse, Response};

use super::{labelled, members_of};
use crate::http::AppState;
use crate::http::api;
use crate::http::upload::{self, bodies::JSON_LIMIT};
use crate::http::wire::error::Result;
use crate::http::wire::extract::Query;
use crate::identity::Caller;
use crate::jobs::{JobFilter, Lookup, Status};

/// Jobs that are listed at a time.
const AT_ONCE: u32 = 200;

/// `POST /v1/jobs/cancel?label=key:value`: all jobs with the label that have not ended.
pub(in crate::http) async fn of_label(
    State(app): State<AppState>,
    caller: Caller,
    mut query: Query,
    request: Request,
) -> Result<Response> {
    let label = query.required("label", |label| labelled(&label));
    query.finish()?;
    let body = upload::json(&app, request, JSON_LIMIT).await?;
    members_of("the body", Some(&body))?.finish()?;
    let (records, acts) = (app.store.of(&caller.tenant), app.store.by(&caller));
    let mut asked = api::Cancelled::default();
    // Those that wait first: what is claimed meanwhile is among the running ones.
    for status in [Status::Queued, Status::Running] {
        let filter = JobFilter {
            label: label.clone(),
            status: Some(status),
            ..JobFilter::default()
        };
        let mut last = None;
        loop {
            let page = records.list_jobs(&filter, last.as_ref(), AT_ONCE).await?;
            let Some(oldest) = page.last() else {
                break;
            };
            last = Some(oldest.id.clone());
            for job in page.iter().filter(|job| !job.cancel_requested) {
                let now = acts.request_cancel(&job.id).await?;
                asked.jobs += u64::from(matches!(now, Lookup::Found(_)));
            }
        }
    }
    Ok(Json(asked).into_response())
}
