//! Event streams (server-sent events), of one job, of a batch and of all, and the same events as JSON pages.

pub(in crate::http) mod feed;
mod of;
mod subscription;

use std::collections::{HashSet, VecDeque};

use axum::Json;
use axum::body::Body;
use axum::extract::State;
use axum::http::header::{ACCEPT, CACHE_CONTROL, CONTENT_TYPE, LINK};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use futures_util::stream;
use serde_json::{Value, json};
use tokio::time::Instant;

use crate::http::AppState;
use crate::http::api;
use crate::http::resources::batches;
use crate::http::resources::events::of::Of;
use crate::http::resources::events::subscription::{SILENCE, Subscription};
use crate::http::resources::jobs::found::found;
use crate::http::wire::error::{ApiError, Result};
use crate::http::wire::extract::{Id, Query, text, whole};
use crate::identity::{Caller, Tenant};
use crate::jobs::{BatchId, Event, EventKind, JobId, Problem, Status, Track};

/// Time after which a client that lost its connection should come back, in milliseconds.
const RETRY_MILLISECONDS: u32 = 2_000;

/// Most events of a JSON page.
pub(in crate::http) const MAX_LIMIT: u32 = 1_000;

/// GET /v1/jobs/{id}/events
pub(in crate::http) async fn of_job(
    State(app): State<AppState>,
    caller: Caller,
    Id(id): Id<JobId>,
    query: Query,
    headers: HeaderMap,
) -> Result<Response> {
    let asked = Asked::of(query, &headers)?;
    let job = found(app.store.of(&caller.tenant).job(&id).await?)?;
    if wants_json(&headers) {
        return page(&app, &caller.tenant, &Of::Job(id), &asked).await;
    }
    let newest = job.events;
    let after = match asked.after {
        After::Anything => Some(0),
        After::Event(id) => Some(id).filter(|id| (0..=newest).contains(id)),
        After::Unknown => None,
    };
    if job.status.is_final() && after == Some(newest) {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let reset = || Reset {
        newest,
        state: json!(api::JobReset {
            oldest: 1,
            newest,
            job: api::Job::new(&job, None),
        }),
        ended: job.status.is_final(),
    };
    open(app, caller, Of::Job(id), after.ok_or_else(reset)).await
}

/// GET /v1/events
pub(in crate::http) async fn of_all(
    State(app): State<AppState>,
    caller: Caller,
    query: Query,
    headers: HeaderMap,
) -> Result<Response> {
    let asked = Asked::of(query, &headers)?;
    if wants_json(&headers) {
        return page(&app, &caller.tenant, &Of::All, &asked).await;
    }
    let records = app.store.of(&caller.tenant);
    let newest = records.last_seq().await?;
    let after = match asked.after {
        After::Anything => Ok(newest),
        After::Event(id) if (0..=newest).contains(&id) => Ok(id),
        After::Event(_) | After::Unknown => {
            let first = records.all_events_after(0, 1).await?;
            let oldest = first.first().map_or(0, |event| event.seq);
            let counts = records.counts().await?;
            let counts = Status::ALL.map(|status| (status.name(), counts.get(status)));
            Err(Reset {
                newest,
                state: json!(api::AllReset {
                    oldest,
                    newest,
                    jobs: counts.into(),
                }),
                ended: false,
            })
        }
    };
    open(app, caller, Of::All, after).await
}

/// GET /v1/batches/{id}/events
pub(in crate::http) async fn of_batch(
    State(app): State<AppState>,
    caller: Caller,
    Id(id): Id<BatchId>,
    query: Query,
    headers: HeaderMap,
) -> Result<Response> {
    let asked = Asked::of(query, &headers)?;
    let batch = batches::find(&app, &caller.tenant, &id).await?;
    let tracks = app.store.of(&caller.tenant).batch_tracks(&id).await?;
    let oldest = tracks.iter().map(|track| track.first).min().unwrap_or(0);
    let newest = tracks.iter().map(|track| track.last).max().unwrap_or(0);
    let members = tracks.iter().map(|track| track.job.clone()).collect();
    if wants_json(&headers) {
        let of = Of::batch(id, members, HashSet::new());
        return page(&app, &caller.tenant, &of, &asked).await;
    }
    let after = match asked.after {
        After::Anything => Some(oldest - 1),
        After::Event(after) => Some(after).filter(|after| (0..=newest).contains(after)),
        After::Unknown => None,
    };
    let tells = |track: &&Track| !track.ended || after.is_some_and(|after| track.last > after);
    let open_jobs: HashSet<JobId> = tracks
        .iter()
        .filter(tells)
        .map(|track| track.job.clone())
        .collect();
    if after.is_some() && open_jobs.is_empty() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let reset = || Reset {
        newest,
        state: json!(api::BatchReset {
            oldest,
            newest,
            batch: api::Batch::whole(&batch),
        }),
        ended: open_jobs.is_empty(),
    };
    let after = after.ok_or_else(reset);
    open(app, caller, Of::batch(id, members, open_jobs), after).await
}

/// Where to continue.
#[derive(Clone, Copy)]
enum After {
    /// The client does not say.
    Anything,
    /// After this event.
    Event(i64),
    /// After something that is no id of ours.
    Unknown,
}

/// Where to continue, and how much at once.
struct Asked {
    after: After,
    limit: u32,
}

impl Asked {
    /// `Last-Event-ID`, which a browser sends by itself, wins over the address it was given.
    fn of(mut query: Query, headers: &HeaderMap) -> Result<Self> {
        let after = query.take("after", |value| whole(value).map(|id| id as i64));
        let limit = query.take("limit", |value| {
            text::<u32>(value).and_then(|limit| match limit {
                1..=MAX_LIMIT => Ok(limit),
                _ => Err(format!("must be 1 to {MAX_LIMIT}")),
            })
        });
        query.finish()?;
        let last = headers.get("last-event-id");
        let last = last.map(|id| {
            let id = id.to_str().ok().and_then(|id| id.parse().ok());
            id.map_or(After::Unknown, After::Event)
        });
        let after = after.map_or(After::Anything, After::Event);
        Ok(Self {
            after: last.unwrap_or(after),
            limit: limit.unwrap_or(MAX_LIMIT),
        })
    }
}

fn wants_json(headers: &HeaderMap) -> bool {
    let accept = headers.get(ACCEPT).and_then(|accept| accept.to_str().ok());
    accept.is_some_and(|accept| {
        accept.contains("application/json") && !accept.contains("text/event-stream")
    })
}

/// A page of events as JSON.
async fn page(app: &AppState, tenant: &Tenant, of: &Of, asked: &Asked) -> Result<Response> {
    let records = app.store.of(tenant);
    let after = match asked.after {
        After::Event(id) => id,
        After::Anything | After::Unknown => 0,
    };
    let events = of.rows(records, after, asked.limit).await?;
    let next = (events.len() == asked.limit as usize)
        .then(|| events.last().map(|event| of.number(event)))
        .flatten();
    let item = |event: &Event| api::EventItem {
        id: of.number(event),
        event: event.kind,
        data: data(event),
    };
    let body = api::EventPage {
        items: events.iter().map(item).collect(),
        next_after: next,
    };
    let mut response = Json(body).into_response();
    let headers = response.headers_mut();
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    if let Some(next) = next {
        let path = of.path();
        let link = format!("<{path}?after={next}&limit={}>; rel=\"next\"", asked.limit);
        headers.insert(
            LINK,
            HeaderValue::try_from(link).map_err(ApiError::internal)?,
        );
    }
    Ok(response)
}

/// What a client gets that asks to continue after an event that there is not.
struct Reset {
    /// Id of the newest event: the stream goes on after it.
    newest: i64,
    /// The present state.
    state: Value,
    /// Whether the state is the last one, so that nothing can follow.
    ended: bool,
}

/// Opens a stream after an id, or with a reset to the newest one.
async fn open(
    app: AppState,
    caller: Caller,
    of: Of,
    after: std::result::Result<i64, Reset>,
) -> Result<Response> {
    let listener = app.feed.listen(caller.address).await?;
    let mut frames = VecDeque::from([Bytes::from(format!("retry: {RETRY_MILLISECONDS}\n"))]);
    let (last, ended) = match after {
        Ok(id) => (id, false),
        Err(reset) => {
            frames.push_back(frame(Some(reset.newest), "reset", &reset.state));
            (reset.newest, reset.ended)
        }
    };
    let subscription = Subscription {
        app,
        caller,
        of,
        listener,
        last,
        frames,
        behind: true,
        ended,
        comment_at: Instant::now() + SILENCE,
        check_at: Instant::now() + SILENCE,
    };
    let frames = stream::unfold(subscription, async |mut subscription| {
        let frame = subscription.next().await?;
        Some((Ok::<_, std::convert::Infallible>(frame), subscription))
    });
    let mut response = Response::new(Body::from_stream(frames));
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static("text/event-stream"));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert("x-accel-buffering", HeaderValue::from_static("no"));
    Ok(response)
}

fn frame(id: Option<i64>, event: &str, data: &Value) -> Bytes {
    let id = id.map_or(String::new(), |id| format!("id: {id}\n"));
    Bytes::from(format!("{id}event: {event}\ndata: {data}\n\n"))
}

/// What an event tells: what its row has, and the links that only HTTP knows.
fn data(event: &Event) -> Value {
    let mut data = event.data.clone();
    let job = format!("/v1/jobs/{}", event.job_id);
    if let Some(members) = data.as_object_mut() {
        members.insert("job_id".to_owned(), json!(event.job_id));
        members.insert("time".to_owned(), json!(api::Time(event.time)));
        members.insert("attempt".to_owned(), json!(event.attempt));
        match event.kind {
            EventKind::Snapshot => {
                let evaluation = members.get("evaluation").cloned().unwrap_or_default();
                let link = format!("{job}/snapshots/{evaluation}.ply");
                members.insert("link".to_owned(), json!(link));
            }
            EventKind::Succeeded => {
                let links = api::SucceededLinks {
                    mesh: format!("{job}/mesh"),
                    report: format!("{job}/report"),
                    model: format!("{job}/model"),
                };
                members.insert("links".to_owned(), json!(links));
            }
            EventKind::Failed => {
                let problem = members.get("error").cloned().unwrap_or_default();
                if let Ok(problem) = serde_json::from_value::<Problem>(problem) {
                    members.insert("error".to_owned(), json!(api::Problem::from(&problem)));
                }
            }
            _ => {}
        }
    }
    data
}
