//! `Prefer: wait=N`: the answer comes when the job has ended, or after N seconds.

use std::time::Duration;

use axum::http::header::{LINK, LOCATION};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::Response;
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

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
        let mut patience = Patience::new(app, wait);
        let job = loop {
            let job = found(app.store.of(&job.tenant).job(&job.id).await?)?;
            if job.status.is_final() || !patience.again().await {
                break job;
            }
        };
        let response = match (job.status, self.mesh) {
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
        waited(response, wait)
    }
}

/// Says in an answer that it was waited for.
///
/// # Errors
/// None of the client's making.
pub(in crate::http) fn waited(mut response: Response, wait: Duration) -> Result<Response> {
    let applied = HeaderValue::try_from(format!("wait={}", wait.as_secs()));
    let applied = applied.map_err(ApiError::internal)?;
    response.headers_mut().insert(PREFERENCE_APPLIED, applied);
    Ok(response)
}

/// The problem that a failed job ended with, as the answer itself.
fn failure(job: &Job) -> ApiError {
    match &job.error {
        Some(problem) => ApiError::new(Code::from_name(&problem.code), problem.detail.clone())
            .with("job_id", job.id.as_str().into()),
        None => ApiError::internal(format_args!("{} failed without an error", job.id)),
    }
}

/// Looks again and again at something that shall end, until the time is up.
pub(in crate::http) struct Patience {
    changed: watch::Receiver<u64>,
    deadline: Instant,
    shutdown: CancellationToken,
}

impl Patience {
    /// Begins to wait; what is looked at afterwards has missed no commit.
    pub(in crate::http) fn new(app: &AppState, wait: Duration) -> Self {
        Self {
            changed: app.store.changed(),
            deadline: Instant::now() + wait,
            shutdown: app.shutdown.clone(),
        }
    }

    /// Waits until it is worth to look again; `false` when the time is up, or the service stops.
    pub(in crate::http) async fn again(&mut self) -> bool {
        let goes_on = tokio::select! {
            () = self.shutdown.cancelled() => false,
            () = tokio::time::sleep_until(self.deadline) => false,
            () = tokio::time::sleep(POLL) => true,
            _ = self.changed.changed() => {
                tokio::time::sleep(PAUSE).await;
                true
            }
        };
        self.changed.mark_unchanged();
        goes_on
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
