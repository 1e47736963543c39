//! Whose the objects are: an object beside them names the database with their rows.

use bytes::Bytes;
use futures_util::TryStreamExt;
use object_store::{Error as StoreError, ObjectStore};
use serde::{Deserialize, Serialize};

use super::connect::has_credentials;
use super::{Bucket, is_bucket_missing};
use crate::jobs::{Error, Result};

/// Code of the answer to a request that was signed at another time.
const SKEWED: &str = "RequestTimeTooSkewed";

/// Its name below the prefix.
const MARKER: &str = "meshway-objects.json";

/// What the marker says of how objects are kept.
const FORMAT: u32 = 1;

#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Marker {
    format: u32,
    database: String,
}

impl Bucket {
    /// Finds that the place is that of the database of this id, or makes it so if nothing is there.
    /// `used`: whether the database has objects there.
    ///
    /// # Errors
    /// `ContentRefused`: why it is not, or cannot be asked.
    pub(in crate::jobs::store) async fn take(&self, database: &str, used: bool) -> Result<()> {
        let ours = Marker {
            format: FORMAT,
            database: database.to_owned(),
        };
        if let Some(found) = self.marker().await? {
            return self.check(&found, &ours);
        }
        if used {
            return Err(self.refused(
                "there is no content of this database here; name the place where it was put",
            ));
        }
        let prefix = (!self.prefix.as_ref().is_empty()).then_some(&self.prefix);
        let mut others = self.store.list(prefix);
        let other = others.try_next().await;
        if let Some(other) = other.map_err(|error| self.unreachable(&error))? {
            return Err(self.refused(&format!(
                "there are other things, such as {}; name a prefix where nothing is",
                other.location
            )));
        }
        let text = serde_json::to_vec(&ours).map_err(|error| self.refused(&error.to_string()))?;
        let put = self.put(MARKER, Bytes::from(text)).await;
        put.map_err(|error| self.refused(&format!("nothing can be written: {error}")))?;
        // Another database may have come at the same moment.
        let found = self.marker().await?;
        self.check(&found.unwrap_or_default(), &ours)
    }

    async fn marker(&self) -> Result<Option<Vec<u8>>> {
        match self.get_range(MARKER, 0..u64::from(u16::MAX)).await {
            Ok(bytes) => Ok(Some(bytes.to_vec())),
            Err(error @ StoreError::NotFound { .. }) if !is_bucket_missing(&error) => Ok(None),
            Err(error) => Err(self.unreachable(&error)),
        }
    }

    fn check(&self, found: &[u8], ours: &Marker) -> Result<()> {
        match serde_json::from_slice::<Marker>(found) {
            Ok(found) if found == *ours => Ok(()),
            Ok(found) if found.format == FORMAT => Err(self.refused(&format!(
                "another database, {}, keeps its content here; give each a prefix of its own",
                found.database
            ))),
            Ok(found) => Err(self.refused(&format!(
                "the content here has format {}; this version knows format {FORMAT}",
                found.format
            ))),
            Err(error) => Err(self.refused(&format!("{MARKER} cannot be read: {error}"))),
        }
    }

    fn unreachable(&self, error: &StoreError) -> Error {
        match error {
            error if is_bucket_missing(error) => {
                self.refused("there is no such bucket; make it first")
            }
            error if error.to_string().contains(SKEWED) => self.refused(&format!(
                "it refuses requests for the time that they are signed for, also for the one that its \
                 answers tell; set the clock of this machine: {error}"
            )),
            StoreError::PermissionDenied { .. } | StoreError::Unauthenticated { .. } => self
                .refused(&format!(
                    "the credentials of the environment (AWS_ACCESS_KEY_ID, …) are refused; they \
                     must allow to list, read, write and delete: {error}"
                )),
            error if !has_credentials() => self.refused(&format!(
                "there are no credentials; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY: {error}"
            )),
            error => self.refused(&format!("it does not answer: {error}")),
        }
    }

    fn refused(&self, reason: &str) -> Error {
        Error::ContentRefused(format!("the object store {}: {reason}", self.url))
    }
}
