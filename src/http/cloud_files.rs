//! The files of clouds: `clouds/<sha256>` in the data folder, each with a row.
//!
//! A file is in place before its row and goes after it. The two steps of an upload must not mix
//! with those of erasing the same bytes, or a row would be left without its file: uploads share a
//! lock that erasing takes alone.

use std::fs::File;
use std::path::PathBuf;

use super::AppState;
use super::error::{ApiError, Result};
use super::inspect;
use super::upload::{Upload, blocking};
use crate::jobs::{Cloud, CloudDeletion, CloudId, NewCloud};

/// Where the bytes of a cloud are.
pub(super) fn path(app: &AppState, sha256: &str) -> PathBuf {
    app.config.data_dir.join("clouds").join(sha256)
}

/// Turns an upload into a cloud; whether it is new, or the same bytes were here already.
///
/// # Errors
/// What is wrong with the cloud, the disk or the database.
pub(super) async fn keep(app: &AppState, upload: Upload) -> Result<(Cloud, bool)> {
    let known = app.store.cloud_by_sha256(&upload.spooled.sha256).await?;
    if let Some(cloud) = known
        && tokio::fs::try_exists(path(app, &cloud.sha256))
            .await
            .unwrap_or(false)
        && (upload.assume_orientation || !has_assumed(&cloud))
    {
        return Ok((cloud, false));
    }
    let summary = inspect::read(app, &upload).await?;
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

/// Whether the cloud could be read only because its orientation was assumed: without leave for that
/// it is refused again.
fn has_assumed(cloud: &Cloud) -> bool {
    cloud.summary["segmentation"]["assumed_orientation"] == true
}

/// Erases a cloud, row first.
///
/// # Errors
/// Those of the database.
pub(super) async fn erase(app: &AppState, id: &CloudId) -> Result<CloudDeletion> {
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
