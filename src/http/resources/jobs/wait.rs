//! `Prefer: wait=N`: the answer comes when the job has ended, or after N seconds.

use std::time::Duration;

use axum::http::header::{LINK, LOCATION};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::Response;

use crate::http::AppState;
use crate::http::resources::jobs::answer::{PREFERENCE_APPLIED, answer, url};
use crate::http::resources::jobs::found::found;
use crate::http::resources::jobs::place;
use crate::http::resources::meshes::{self, View};
use crate::http::resources::retention::counted;
use crate::http::resources::witness::witnessed;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::http::wire::extract::preferred_wait;
use crate::http::wire::idempotency::KEY;
use crate::identity::Caller;
use crate::jobs::{Act, Job, Status};
use crate::reconstruction::mesh::write::Format;

/// Longest pause between two looks at the job, in case a wake-up is lost.
const POLL: Duration = Duration::from_secs(1);

/// Shortest pause, because a commit about any job wakes all waiting requests.
const PAUSE: Duration = Duration::from_millis(100);

/// How a client wants to be answered.
#[derive(Debug, Clone)]
pub(in crate::http) struct Wish {
    wait: Option<Duration>,
    /// The format, if the client wants the mesh itself as the answer.
    mesh: Option<Format>,
    /// Whether to include the queue position. Off under an `Idempotency-Key`: the stored answer is
    /// written before the position is known, and a replayed answer must be identical.
    place: bool,
}

impl Wish {
    /// Reads it from the headers of a request.
    ///
    /// # Errors
    /// [`Code::NotAcceptable`] when what the wait is for cannot be given.
    pub(in crate::http) fn of(headers: &HeaderMap) -> Result<Self> {
        let wait = preferred_wait(headers);
        let mesh = match wait {
            Some(_) => meshes::preferred_to_json(headers)?,
            None => None,
        };
        Ok(Self {
            wait,
            mesh,
            place: !headers.contains_key(KEY),
        })
    }

    /// The answer to a submitted job: 202 at once or after the wait, 200 with the job or its mesh
    /// when it ended in time.
    ///
    /// # Errors
    /// [`Code::Gone`] when the job was erased meanwhile; the job's own problem when its mesh was
    /// asked for and there is none.
    pub(in crate::http) async fn answer(
        self,
        app: &AppState,
        caller: &Caller,
        job: Job,
    ) -> Result<Response> {
        let Some(wait) = self.wait else {
            let place = if self.place {
                place(app, &job).await?
            } else {
                None
            };
            return Ok(answer(StatusCode::ACCEPTED, &job, place));
        };
        let job = until_ended(app, &job, wait).await?;
        let mut response = match (job.status, self.mesh) {
            (Status::Queued | Status::Running, _) => {
                answer(StatusCode::ACCEPTED, &job, place(app, &job).await?)
            }
            (Status::Succeeded, Some(format)) => mesh(app, caller, &job, format).await?,
            (Status::Failed, Some(_)) => return Err(failure(&job)),
            (Status::Cancelled, Some(_)) => {
                let detail = format!("the job {} was cancelled: it has no mesh", job.id);
                return Err(ApiError::new(Code::NotFound, detail));
            }
            (_, None) => answer(StatusCode::OK, &job, None),
        };
        let applied = HeaderValue::try_from(format!("wait={}", wait.as_secs()));
        let applied = applied.map_err(ApiError::internal)?;
        response.headers_mut().insert(PREFERENCE_APPLIED, applied);
        Ok(response)
    }
}

/// The problem that a failed job ended with, as the answer itself.
fn failure(job: &Job) -> ApiError {
    match &job.error {
        Some(problem) => ApiError::new(Code::from_name(&problem.code), problem.detail.clone())
            .with("job_id", job.id.as_str().into()),
        None => ApiError::internal(format_args!("{} failed without an error", job.id)),
    }
}

/// The job once it has ended, the time is up, or the service stops.
async fn until_ended(app: &AppState, job: &Job, wait: Duration) -> Result<Job> {
    // Subscribed before the row is read: a commit in between is not missed.
    let mut changed = app.store.changed();
    let deadline = tokio::time::Instant::now() + wait;
    loop {
        changed.mark_unchanged();
        let job = found(app.store.of(&job.tenant).job(&job.id).await?)?;
        if job.status.is_final() || app.shutdown.is_cancelled() {
            return Ok(job);
        }
        tokio::select! {
            _ = changed.changed() => tokio::time::sleep(PAUSE).await,
            () = tokio::time::sleep(POLL) => {}
            () = app.shutdown.cancelled() => {}
            () = tokio::time::sleep_until(deadline) => return Ok(job),
        }
    }
}

/// The mesh itself, and where the job is that made it.
async fn mesh(app: &AppState, caller: &Caller, job: &Job, format: Format) -> Result<Response> {
    let asked = (format, View::default());
    let response = meshes::respond(app, job, 0, asked, &HeaderMap::new()).await?;
    let response = witnessed(app, caller, (Act::MeshRead, job.id.as_str()), response).await?;
    let mut response = meshes::varies(counted(app, job, response));
    let described = format!("<{}>; rel=\"describedby\"", url(job));
    for (name, value) in [(LOCATION, url(job)), (LINK, described)] {
        let value = HeaderValue::try_from(value).map_err(ApiError::internal)?;
        response.headers_mut().insert(name, value);
    }
    Ok(response)
}
