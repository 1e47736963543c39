//! What the resources below a job share: is it here, has it ended, what does it have.

use super::error::{ApiError, Code, Result};
use crate::jobs::{Job, Lookup, Status};

/// The job.
///
/// # Errors
/// [`Code::NotFound`] and [`Code::Gone`].
pub(super) fn found(lookup: Lookup) -> Result<Job> {
    match lookup {
        Lookup::Found(job) => Ok(*job),
        Lookup::Gone(tombstone) => Err(ApiError::gone(&tombstone)),
        Lookup::Missing => Err(ApiError::not_found("job")),
    }
}

/// The job if it has a result.
///
/// # Errors
/// [`Code::ResultNotReady`] while it can still get one, [`Code::NotFound`] when it never will.
pub(super) fn succeeded(lookup: Lookup) -> Result<Job> {
    let job = found(lookup)?;
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
        Status::Failed | Status::Cancelled => Err(ApiError::new(
            Code::NotFound,
            format!("the job is {}: it has no result", job.status),
        )),
    }
}
