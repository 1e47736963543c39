//! The files of clouds: `clouds/<sha256>` in the data folder, each with a row of a tenant or several.
//! With an object store new clouds are objects, which go with their rows; of files, only those that
//! were there before are left.
//!
//! A file is in place before its row is written, and is removed after its row. The two steps of an
//! upload must not mix with those of erasing the same bytes, or a row would be left without its
//! file. So uploads take a lock shared and erasing takes it exclusively.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;

use tempfile::NamedTempFile;

use crate::folder::in_folder;
use crate::http::AppState;
use crate::http::upload::spool::{Spooled, storage};
use crate::http::upload::{Upload, blocking};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::identity::{Caller, Tenant};
use crate::intake::{File, Summary};
use crate::jobs::{Cloud, CloudDeletion, CloudId, Error, JobId, Keep, LocalFile, Lookup, NewCloud};
use crate::reconstruction::cloud::Format;

/// A file with the bytes of a cloud.
///
/// # Errors
/// [`Code::NotFound`] if they are not there any more, and those of the store.
pub(in crate::http) async fn local(app: &AppState, cloud: &Cloud) -> Result<LocalFile> {
    let found = app.store.cloud_file(cloud).await?;
    found.ok_or_else(|| {
        let detail = "the bytes of the cloud are not where they were put any more; send them again";
        ApiError::new(Code::NotFound, detail)
    })
}

/// Reads and checks an upload. Without the texts that may name somebody it is written to `clean_to`, if it
/// has any.
///
/// # Errors
/// What is wrong with the cloud.
pub(in crate::http) async fn read(
    app: &AppState,
    upload: &Upload,
    clean_to: Option<&Path>,
) -> Result<Summary> {
    let spooled = &upload.spooled;
    let file = File {
        path: spooled.file.path(),
        bytes: spooled.bytes,
        hint: upload.hint,
        assume_orientation: upload.assume_orientation,
    };
    let read = app.reader.read(file, clean_to).await;
    read.map_err(|error| upload.explain(ApiError::from(error)))
}

/// An upload that was read and can be kept.
#[derive(Debug)]
pub(in crate::http) struct Usable {
    upload: Upload,
    /// The cloud of the same bytes, if they were uploaded before.
    known: Option<Cloud>,
    /// What the reading found, now or then.
    pub(in crate::http) summary: Summary,
}

/// Reads and checks an upload, unless the same bytes are here already.
///
/// # Errors
/// What is wrong with the cloud or the database.
pub(in crate::http) async fn usable(
    app: &AppState,
    tenant: &Tenant,
    mut upload: Upload,
) -> Result<Usable> {
    let records = app.store.of(tenant);
    let known = records.cloud_by_sha256(&upload.spooled.sha256).await?;
    if let Some(cloud) = known
        && app.store.has_cloud_file(&cloud).await?
        && (upload.assume_orientation || !has_assumed(&cloud))
        && upload.keep_identifiers == cloud.summary.keeps_identifiers
        && (upload.keep_identifiers || cloud.summary.cleaned)
    {
        let summary = cloud.summary.clone();
        let known = Some(cloud);
        return Ok(Usable {
            upload,
            known,
            summary,
        });
    }
    let mut summary = if upload.keep_identifiers {
        read(app, &upload, None).await?
    } else {
        read_cleaned(app, &mut upload).await?
    };
    summary.keeps_identifiers = upload.keep_identifiers && summary.format == Format::Dicom;
    let known = None;
    Ok(Usable {
        upload,
        known,
        summary,
    })
}

/// Reads and checks an upload. If it has texts that may name somebody, the file without them takes its place.
async fn read_cleaned(app: &AppState, upload: &mut Upload) -> Result<Summary> {
    let beside = upload.spooled.file.path().parent().map(Path::to_owned);
    let beside = beside.ok_or_else(|| ApiError::internal("an upload lies in no folder"))?;
    let clean = blocking(move || in_folder(&beside, || NamedTempFile::new_in(&beside)));
    let clean = clean.await?.map_err(|error| storage(&error))?;
    let summary = read(app, upload, Some(clean.path())).await?;
    if summary.dropped_texts > 0 {
        let spooled = blocking(move || Spooled::of(clean));
        upload.spooled = spooled.await?.map_err(|error| storage(&error))?;
    }
    Ok(summary)
}

/// Turns an upload into a cloud. `false` if the same bytes were uploaded before.
///
/// # Errors
/// What is wrong with the cloud, the disk or the database.
pub(in crate::http) async fn keep(
    app: &AppState,
    caller: &Caller,
    usable: Usable,
    keep: Keep,
) -> Result<(Cloud, bool)> {
    let Usable {
        upload,
        known,
        summary,
    } = usable;
    if let Some(cloud) = known {
        let acts = app.store.by(caller);
        acts.match_cloud(&cloud.id, keep.ms).await?;
        let now = app.store.of(&caller.tenant).cloud(&cloud.id).await?;
        return Ok((now.unwrap_or(cloud), false));
    }
    let spooled = upload.spooled;
    let new = NewCloud {
        sha256: spooled.sha256,
        bytes: spooled.bytes,
        summary,
        keep_ms: keep.ms,
    };
    let sha256 = new.sha256.clone();
    if !app.store.keeps_files() {
        let acts = app.store.by(caller);
        let kept = acts.upload_cloud(new, spooled.file.path()).await?;
        // Its row may have named a file.
        let _alone = app.cloud_files.write().await;
        remove_unheld(app, &sha256).await?;
        return Ok(kept);
    }
    let target = app.store.cloud_path(&sha256);
    let shared = app.cloud_files.read().await;
    blocking(move || -> std::io::Result<()> {
        let Some(folder) = target.parent() else {
            return Ok(());
        };
        let folder = in_folder(folder, || fs::File::open(folder))?;
        spooled.file.persist(&target)?;
        // The name must survive a loss of power before the row does.
        folder.sync_all()
    })
    .await?
    .map_err(ApiError::internal)?;
    let inserted = app.store.by(caller).insert_cloud(new).await;
    drop(shared);
    if matches!(inserted, Err(Error::Quota { .. })) {
        let _alone = app.cloud_files.write().await;
        remove_unheld(app, &sha256).await?;
    }
    Ok(inserted?)
}

/// Removes a file that no cloud has. The lock must be held exclusively.
async fn remove_unheld(app: &AppState, sha256: &str) -> std::result::Result<(), Error> {
    if !app.store.holds_sha256(sha256).await?
        && let Err(error) = tokio::fs::remove_file(app.store.cloud_path(sha256)).await
        && (app.store.keeps_files() || error.kind() != ErrorKind::NotFound)
    {
        // The next start removes files without a row.
        tracing::warn!(error.message = %error, "the file of a cloud that is gone stays");
    }
    Ok(())
}

/// Whether the cloud could be read only because its orientation was assumed: without leave for that
/// it is refused again.
fn has_assumed(cloud: &Cloud) -> bool {
    let contents = cloud.summary.segmentation.as_ref();
    contents.is_some_and(|contents| contents.assumed_orientation)
}

/// Erases a cloud, row first. The file stays while a cloud of another tenant has the same bytes.
///
/// # Errors
/// Those of the database.
pub(in crate::http) async fn erase(
    app: &AppState,
    caller: &Caller,
    id: &CloudId,
) -> std::result::Result<CloudDeletion, Error> {
    let _alone = app.cloud_files.write().await;
    let deletion = app.store.by(caller).delete_cloud(id).await?;
    remove_of(app, &deletion).await?;
    Ok(deletion)
}

/// The same for a cloud whose time is over.
///
/// # Errors
/// `Stale` if it is not due, and those of the database.
pub(in crate::http) async fn expire(
    app: &AppState,
    caller: &Caller,
    id: &CloudId,
) -> std::result::Result<CloudDeletion, Error> {
    let _alone = app.cloud_files.write().await;
    let deletion = app.store.by(caller).expire_cloud(id).await?;
    remove_of(app, &deletion).await?;
    Ok(deletion)
}

/// Erases a job and its cloud, unless another job names that or it is held. Whether it went.
///
/// # Errors
/// `Held` if the job is held, and those of the database.
pub(in crate::http) async fn erase_with_job(
    app: &AppState,
    caller: &Caller,
    id: &JobId,
) -> std::result::Result<(Lookup, bool), Error> {
    let _alone = app.cloud_files.write().await;
    let (job, cloud) = app.store.by(caller).erase_job_and_cloud(id).await?;
    let Some(cloud) = cloud else {
        return Ok((job, false));
    };
    remove_unheld(app, &cloud.sha256).await?;
    Ok((job, true))
}

/// Removes the file of an erased cloud, unless a cloud of another tenant has the same bytes.
async fn remove_of(app: &AppState, deletion: &CloudDeletion) -> std::result::Result<(), Error> {
    if let CloudDeletion::Deleted(cloud) = deletion {
        remove_unheld(app, &cloud.sha256).await?;
    }
    Ok(())
}
