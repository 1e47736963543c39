//! What becomes of a complete upload, also where the server died or the client hung up meanwhile; and
//! the end of those that nobody goes on with.

use crate::http::AppState;
use crate::http::resources::clouds::files;
use crate::http::resources::retention::Wanted;
use crate::http::resources::uploads::{give_up, promise};
use crate::http::upload::parts;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::identity::Caller;
use crate::jobs::{self, Reason, Upload, UploadEnd};

/// Uploads that are erased before the others are looked at again.
const AT_ONCE: u32 = 256;

/// Makes a cloud of a complete upload, or finds what came of it before; and whether a new cloud came of
/// it now. Whoever calls it has the turn.
///
/// # Errors
/// What does not lie in the file, such as a full disk: it can be tried again.
pub(super) async fn settle(
    app: &AppState,
    caller: &Caller,
    upload: &Upload,
) -> Result<(UploadEnd, bool)> {
    if let Some(end) = &upload.end {
        return Ok((end.clone(), false));
    }
    let (end, created) = match cloud_of(app, caller, upload).await {
        Ok((cloud, created)) => (UploadEnd::Cloud(cloud.id), created),
        Err(error) if error.code().entry().retryable => return Err(error),
        Err(error) => (UploadEnd::Refused(error.kept()), false),
    };
    let kept = app.store.by(caller).end_upload(&upload.id, end.clone());
    match kept.await {
        // It was erased meanwhile; the cloud is there all the same.
        Ok(()) | Err(jobs::Error::Stale) => {}
        Err(error) => return Err(error.into()),
    }
    parts::remove(app, &upload.id).await;
    Ok((end, created))
}

async fn cloud_of(app: &AppState, caller: &Caller, upload: &Upload) -> Result<(jobs::Cloud, bool)> {
    if upload.bytes == 0 {
        return Err(ApiError::new(Code::CloudEmpty, "the file is empty"));
    }
    let whole = crate::http::upload::Upload {
        spooled: parts::spooled(app, &upload.id).await?,
        hint: upload.hint,
        as_fields: false,
        assume_orientation: upload.assume_orientation,
        keep_identifiers: false,
    };
    let keep = Wanted::keep(None, app.config.cloud_ttl);
    let usable = files::usable(app, &caller.tenant, whole).await?;
    files::keep(app, caller, usable, keep).await
}

/// Finishes what the last server left, and erases the uploads whose time is over.
///
/// # Errors
/// Those of the store.
pub(in crate::http) async fn sweep(app: &AppState) -> Result<()> {
    for upload in app.store.unsettled_uploads().await? {
        let turn = app.turns.take(&upload.id).await?;
        let caller = Caller::service(upload.tenant.clone());
        let now = app.store.of(&upload.tenant).upload(&upload.id).await?;
        if let Some(upload) = now
            && let Err(error) = settle(app, &caller, &upload).await
        {
            let code = error.code().entry().name;
            tracing::warn!(upload = %upload.id, code, "nothing came of an upload yet");
        }
        drop(turn);
    }
    loop {
        let expired = app.store.expired_uploads(AT_ONCE).await?;
        let all = expired.len();
        for (id, tenant) in expired {
            let _turn = app.turns.take(&id).await?;
            give_up(app, &Caller::service(tenant), &id, Reason::Expired).await?;
        }
        if all < AT_ONCE as usize {
            break;
        }
    }
    promise(app).await;
    Ok(())
}
