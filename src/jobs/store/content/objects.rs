//! Where the bytes of meshes, models and checkpoints are, and with an object store those of clouds.
//!
//! Nothing here knows what an object is. One is complete, and stays, once a row of `meshway.db`
//! names its key: see `graves.rs`.

use std::ops::Range;
use std::time::Duration;

use bytes::Bytes;
use uuid::Uuid;

use super::bucket::Bucket;
use super::embedded::Embedded;
use crate::jobs::Result;

/// How long erasing waits for an object store: what it did not remove then is removed later.
const PATIENCE: Duration = Duration::from_secs(3);

/// A key whose bytes are there to stay, all of them. Only writing them gives one: so bytes are there
/// before their row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::jobs::store) struct Kept {
    pub(in crate::jobs::store) key: String,
    pub(in crate::jobs::store) bytes: u64,
}

/// A key that nothing was written under.
pub(in crate::jobs::store) fn new_key() -> String {
    Uuid::now_v7().to_string()
}

/// A process's hold on the content.
pub(in crate::jobs::store) enum Objects {
    /// In `content.db` of the data folder.
    Embedded(Embedded),
    /// In an object store.
    Bucket(Box<Bucket>),
}

impl Objects {
    pub(in crate::jobs::store) async fn close(&self) {
        if let Self::Embedded(place) = self {
            place.close().await;
        }
    }

    /// The object store, if there is one.
    pub(in crate::jobs::store) fn bucket(&self) -> Option<&Bucket> {
        match self {
            Self::Embedded(_) => None,
            Self::Bucket(bucket) => Some(bucket),
        }
    }

    /// How long erasing may wait for bytes to go; none: as long as it takes.
    pub(in crate::jobs::store) fn patience(&self) -> Option<Duration> {
        self.bucket().map(|_| PATIENCE)
    }

    /// Writes the bytes under a new key. After an error some may be there.
    pub(in crate::jobs::store) async fn put(&self, key: &str, data: Bytes) -> Result<Kept> {
        let bytes = data.len() as u64;
        match self {
            Self::Embedded(place) => place.put(key, data).await?,
            Self::Bucket(place) => place.put(key, data).await?,
        }
        let key = key.to_owned();
        Ok(Kept { key, bytes })
    }

    /// Some of the bytes of a range within an object from its start on, at least one; none of an object
    /// that was removed.
    pub(in crate::jobs::store) async fn part(
        &self,
        key: &str,
        range: Range<u64>,
    ) -> Result<Option<Bytes>> {
        match self {
            Self::Embedded(place) => place.part(key, range).await,
            Self::Bucket(place) => place.part(key, range).await,
        }
    }

    /// The whole object; none if it was removed.
    pub(in crate::jobs::store) async fn whole(&self, object: &Kept) -> Result<Option<Vec<u8>>> {
        let Kept { key, bytes } = object;
        let data = match self {
            Self::Embedded(place) => place.whole(key, *bytes).await?,
            Self::Bucket(place) => place.whole(key, *bytes).await?,
        };
        Ok((data.len() as u64 == *bytes).then_some(data))
    }

    /// Keys of all objects that may be garbage, or of those that a process made, in the order of
    /// their making. An object store does not know who made what: it tells those that are old enough.
    pub(in crate::jobs::store) async fn keys(&self, made_by: Option<&str>) -> Result<Vec<String>> {
        match (self, made_by) {
            (Self::Embedded(place), made_by) => place.keys(made_by).await,
            (Self::Bucket(place), None) => place.old_keys().await,
            (Self::Bucket(_), Some(_)) => Ok(Vec::new()),
        }
    }

    /// Removes objects; one that is not there is no error.
    pub(in crate::jobs::store) async fn remove(&self, keys: &[String]) -> Result<()> {
        match self {
            Self::Embedded(place) => {
                for key in keys {
                    place.remove(key).await?;
                }
                Ok(())
            }
            Self::Bucket(place) => place.remove(keys).await,
        }
    }

    /// Gives the space of what was removed back to the file system.
    pub(in crate::jobs::store) async fn vacuum(&self) -> Result<()> {
        match self {
            Self::Embedded(place) => place.vacuum().await,
            Self::Bucket(_) => Ok(()),
        }
    }
}
