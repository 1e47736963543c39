//! The files of clouds: `clouds/<sha256>` in the data folder, each with a row.
//!
//! A file is in place before its row and goes after it. The two steps of an upload must not mix
//! with those of erasing the same bytes, or a row would be left without its file: uploads share a
//! lock that erasing takes alone.

use std::fs::File;
use std::path::PathBuf;

use crate::folder::CLOUDS;
use crate::http::AppState;
use crate::http::upload::{Upload, blocking};
use crate::http::wire::error::{ApiError, Result};
use crate::intake::Summary;
use crate::jobs::{Cloud, CloudDeletion, CloudId, NewCloud};

/// Where the bytes of a cloud are.
pub(in crate::http) fn path(app: &AppState, sha256: &str) -> PathBuf {
    app.config.data_dir.join(CLOUDS).join(sha256)
}

/// What an upload is.
///
/// # Errors
/// What is wrong with the cloud.
pub(in crate::http) async fn read(app: &AppState, upload: &Upload) -> Result<Summary> {
    let spooled = &upload.spooled;
    let read = app
        .reader
        .read(spooled.file.path(), spooled.bytes, upload.hint);
    Ok(read.await?)
}

/// Turns an upload into a cloud; whether it is new, or the same bytes were here already.
///
/// # Errors
/// What is wrong with the cloud, the disk or the database.
pub(in crate::http) async fn keep(app: &AppState, upload: Upload) -> Result<(Cloud, bool)> {
    let known = app.store.cloud_by_sha256(&upload.spooled.sha256).await?;
    if let Some(cloud) = known
        && tokio::fs::try_exists(path(app, &cloud.sha256))
            .await
            .unwrap_or(false)
    {
        return Ok((cloud, false));
    }
    let summary = read(app, &upload).await?;
    let spooled = upload.spooled;
    let new = NewCloud {
        sha256: spooled.sha256,
        bytes: spooled.bytes,
        format: summary.format.name().to_owned(),
        points: summary.points,
        summary: serde_json::to_value(&summary).map_err(ApiError::internal)?,
    };
    let target = path(app, &new.sha256);
    let _shared = app.cloud_files.read().await;
    blocking(move || -> std::io::Result<()> {
        spooled.file.persist(&target)?;
        // The name must survive a loss of power before the row does.
        target
            .parent()
            .map_or(Ok(()), |folder| File::open(folder)?.sync_all())
    })
    .await?
    .map_err(ApiError::internal)?;
    Ok(app.store.insert_cloud(new).await?)
}

/// Erases a cloud, row first.
///
/// # Errors
/// Those of the database.
pub(in crate::http) async fn erase(app: &AppState, id: &CloudId) -> Result<CloudDeletion> {
    let _alone = app.cloud_files.write().await;
    let deletion = app.store.delete_cloud(id).await?;
    if let CloudDeletion::Deleted(cloud) = &deletion
        && let Err(error) = tokio::fs::remove_file(path(app, &cloud.sha256)).await
    {
        // The sweep at the next start takes files without a row.
        tracing::warn!(error.message = %error, "the file of an erased cloud stays");
    }
    Ok(deletion)
}
