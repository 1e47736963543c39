//! How long things are kept: what clients wish, and the end of what has expired.

use axum::body::Body;
use axum::http::StatusCode;
use axum::http::header::CONTENT_LENGTH;
use axum::response::Response;
use futures_util::StreamExt;
use serde_json::Value;

use crate::config::Ttl;
use crate::http::AppState;
use crate::http::resources::clouds::files;
use crate::http::resources::jobs::{self, request};
use crate::http::wire::error::Result;
use crate::http::wire::extract::{self, Members};
use crate::identity::Caller;
use crate::jobs::{Error, Job, Keep, KeepChange};

/// What is erased before it is looked again for what is due.
const AT_ONCE: u32 = 256;

/// How long a client wants something to be kept, its `ttl`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::http) enum Wanted {
    /// For ever.
    Never,
    /// So long.
    For(Ttl),
    /// A job: until its mesh was fetched whole.
    Download,
}

impl Wanted {
    /// Reads `30d`, `never` or, for a job, `download`.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub(in crate::http) fn of_job(text: &str) -> std::result::Result<Self, String> {
        match text {
            "download" => Ok(Self::Download),
            text => Self::of_cloud(text).map_err(|_| {
                "must be never, download, or a number with d, h, m or s, as in 30d".to_owned()
            }),
        }
    }

    /// The same for a cloud, which no download ends.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub(in crate::http) fn of_cloud(text: &str) -> std::result::Result<Self, String> {
        match text {
            "never" => Ok(Self::Never),
            text => text.parse().map(Self::For).map_err(|_: String| {
                "must be never, or a number with d, h, m or s, as in 30d".to_owned()
            }),
        }
    }

    /// What follows of it; `default` is the operator's.
    pub(in crate::http) fn keep(wanted: Option<Self>, default: Option<Ttl>) -> Keep {
        let default = default.map(Ttl::ms);
        let (ms, once) = match wanted {
            None => (default, false),
            Some(Self::Never) => (None, false),
            Some(Self::For(ttl)) => (Some(ttl.ms()), false),
            Some(Self::Download) => (default, true),
        };
        Keep { ms, once }
    }
}

/// The change that a PATCH of a job asks for.
///
/// # Errors
/// All faults, and a request that changes nothing.
pub(in crate::http) fn of_job(mut members: Members, default: Option<Ttl>) -> Result<KeepChange> {
    let priority = members.take("priority", request::priority);
    change(members, Wanted::of_job, default, priority)
}

/// The change that a PATCH asks for: `hold`, `ttl` as `parse` reads it, and what was taken before.
///
/// # Errors
/// All faults, and a request that changes nothing.
pub(in crate::http) fn change(
    mut members: Members,
    parse: impl FnOnce(&str) -> std::result::Result<Wanted, String>,
    default: Option<Ttl>,
    priority: Option<i64>,
) -> Result<KeepChange> {
    let hold = members.take("hold", extract::json::<bool>);
    let wanted = members.take("ttl", |value: Value| {
        parse(value.as_str().unwrap_or_default())
    });
    if hold.is_none() && wanted.is_none() && priority.is_none() {
        members.fault("hold", "or ttl is needed".to_owned());
    }
    members.finish()?;
    Ok(KeepChange {
        keep: wanted.map(|wanted| Wanted::keep(Some(wanted), default)),
        hold,
        priority,
    })
}

/// The answer with the result of a job. When it was sent whole, a job that goes with that goes soon.
pub(in crate::http) fn counted(app: &AppState, job: &Job, response: Response) -> Response {
    let length = response.headers().get(CONTENT_LENGTH);
    let length = length.and_then(|length| length.to_str().ok()?.parse::<u64>().ok());
    let Some(length) = length.filter(|_| job.keep.once && response.status() == StatusCode::OK)
    else {
        return response;
    };
    let mut left = length;
    let mut fetched = Some((AppState::clone(app), job.id.clone(), job.tenant.clone()));
    response.map(|body| {
        let body = body.into_data_stream().inspect(move |chunk| {
            left -= chunk
                .as_ref()
                .map_or(0, |chunk| chunk.len() as u64)
                .min(left);
            if left == 0
                && let Some((app, id, tenant)) = fetched.take()
            {
                tokio::spawn(async move {
                    if let Err(error) = app.store.fetched(&id, &tenant).await {
                        tracing::warn!(error.message = %error, "a download was not noted");
                    }
                });
            }
        });
        Body::from_stream(body)
    })
}

/// Erases the jobs and clouds whose time is over.
///
/// # Errors
/// Those of the store.
pub(in crate::http) async fn sweep(app: &AppState) -> Result<()> {
    loop {
        let mut erased = 0;
        for (id, tenant) in app.store.due_jobs(AT_ONCE).await? {
            let service = Caller::service(tenant);
            match app.store.by(&service).expire_job(&id).await {
                Ok(_) => jobs::erase::forget(app, id),
                // It was held, or is kept longer, since.
                Err(Error::Stale) => continue,
                Err(error) => return Err(error.into()),
            }
            erased += 1;
        }
        for (id, tenant) in app.store.due_clouds(AT_ONCE).await? {
            match files::expire(app, &Caller::service(tenant), &id).await {
                Ok(_) => erased += 1,
                Err(Error::Stale) => {}
                Err(error) => return Err(error.into()),
            }
        }
        if erased < AT_ONCE {
            return Ok(());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wishes_are_read_and_the_operators_time_is_the_default() {
        let month: Ttl = "30d".parse().unwrap();
        let keep = |text: &str| Wanted::keep(Some(Wanted::of_job(text).unwrap()), Some(month));
        let ms = Some(month.ms());
        assert_eq!(Wanted::keep(None, Some(month)), Keep { ms, once: false });
        assert_eq!(keep("never"), Keep::default());
        assert_eq!(keep("download"), Keep { ms, once: true });
        let (ms, once) = (Some(60_000), false);
        assert_eq!(keep("1m"), Keep { ms, once });
        assert!(Wanted::of_cloud("download").is_err() && Wanted::of_job("soon").is_err());
    }
}
