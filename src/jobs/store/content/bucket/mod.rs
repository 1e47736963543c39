//! Content in an object store of the kind of S3: one object a key, below a prefix.
//!
//! The store may be away, slow or stalled. Every call has limits of its own and fails with
//! `ContentUnavailable`; whoever can wait tries again. Nothing asks it to compare or to overwrite: a
//! key is written once, so whatever answer is lost, asking again is right.

mod connect;
mod credentials;
mod marker;
mod signature;
mod skew;

use std::collections::HashMap;
use std::ops::Range;
use std::path::Path;
use std::time::Duration;

use bytes::Bytes;
use futures_util::stream::{self, BoxStream, StreamExt, TryStreamExt};
use object_store::aws::AmazonS3;
use object_store::path::Path as Location;
use object_store::{Error as StoreError, MultipartUpload, ObjectStore, ObjectStoreExt};
use tokio::fs::File;
use tokio::io::AsyncReadExt;
use tokio::sync::Semaphore;
use uuid::{Uuid, Version};

use super::objects::Kept;
use super::shelf::Found;
use crate::config::ObjectsUrl;
use crate::jobs::store::Options;
use crate::jobs::{Error, Result};
use skew::StoreClock;

/// Size of the parts in which large objects are written and read.
const PART_BYTES: usize = 8 << 20;

/// Parts of an object under way at a time.
const AT_ONCE: usize = 4;

/// Most bytes that one step of a download holds.
const STEP_BYTES: u64 = 2 << 20;

/// Objects that are removed at a time.
const REMOVED_AT_ONCE: usize = 8;

/// Files that are written at a time: each takes the memory of its parts.
const FILES_AT_ONCE: usize = 4;

/// A place in an object store.
pub(in crate::jobs::store) struct Bucket {
    store: AmazonS3,
    clock: StoreClock,
    url: ObjectsUrl,
    prefix: Location,
    garbage_age: Duration,
    files: Semaphore,
}

impl Bucket {
    /// The place at an address; nothing is asked of it yet.
    ///
    /// # Errors
    /// `ContentRefused` if the address or the environment cannot be used.
    pub(in crate::jobs::store) fn new(url: &ObjectsUrl, options: &Options) -> Result<Self> {
        let refused = |reason| Error::ContentRefused(format!("the object store {url}: {reason}"));
        let (store, clock) = connect::connect(url).map_err(refused)?;
        Ok(Self {
            store,
            clock,
            url: url.clone(),
            prefix: Location::from(&*url.prefix),
            garbage_age: options.garbage_age,
            files: Semaphore::new(FILES_AT_ONCE),
        })
    }

    /// Its address.
    pub(in crate::jobs::store) fn url(&self) -> &ObjectsUrl {
        &self.url
    }

    fn location(&self, key: &str) -> Location {
        self.prefix.clone().join(key)
    }

    /// Writes the bytes under a new key.
    pub(in crate::jobs::store) async fn put(&self, key: &str, data: Bytes) -> Result<()> {
        if data.len() <= PART_BYTES {
            let put = self.store.put(&self.location(key), data.into()).await;
            return put.map(drop).map_err(away);
        }
        let parts = stream::iter((0..data.len()).step_by(PART_BYTES)).map(move |from| {
            let to = data.len().min(from + PART_BYTES);
            Ok(data.slice(from..to))
        });
        self.put_parts(key, parts.boxed()).await
    }

    /// Writes a file under a new key.
    pub(in crate::jobs::store) async fn put_file(&self, key: &str, file: &Path) -> Result<Kept> {
        let _turn = self.files.acquire().await.map_err(|_| Error::Closed)?;
        let unread = |error: std::io::Error| Error::Full(format!("{}: {error}", file.display()));
        let open = File::open(file).await.map_err(unread)?;
        let bytes = open.metadata().await.map_err(unread)?.len();
        if bytes <= PART_BYTES as u64 {
            let part = next_part(open).await.map_err(unread)?;
            self.put(key, part.map(|(part, _)| part).unwrap_or_default())
                .await?;
        } else {
            let parts = stream::try_unfold(open, next_part);
            self.put_parts(key, parts.boxed()).await?;
        }
        let key = key.to_owned();
        Ok(Kept { key, bytes })
    }

    /// Writes parts in a task of its own: one whose caller goes away ends as any other, and leaves no
    /// parts behind.
    async fn put_parts(
        &self,
        key: &str,
        parts: BoxStream<'static, std::io::Result<Bytes>>,
    ) -> Result<()> {
        let (store, location) = (self.store.clone(), self.location(key));
        let written = tokio::spawn(async move { put_parts(&store, &location, parts).await });
        match written.await {
            Ok(written) => written.map_err(away),
            Err(_) => Err(Error::Closed),
        }
    }

    /// As many bytes of the range as one step holds; none of an object that is not there.
    pub(in crate::jobs::store) async fn part(
        &self,
        key: &str,
        range: Range<u64>,
    ) -> Result<Option<Bytes>> {
        let end = range.end.min(range.start + STEP_BYTES);
        let part = self.range(key, range.start..end).await?;
        Ok(part.filter(|part| !part.is_empty()))
    }

    /// All bytes of an object that has so many, as far as they are there.
    pub(in crate::jobs::store) async fn whole(&self, key: &str, bytes: u64) -> Result<Vec<u8>> {
        let mut data = Vec::with_capacity(bytes as usize);
        let mut parts = self.parts(key, bytes);
        while let Some(part) = parts.try_next().await? {
            let Some(part) = part else { break };
            data.extend_from_slice(&part);
        }
        Ok(data)
    }

    /// The parts of an object that has so many bytes, in their order.
    pub(in crate::jobs::store) fn parts<'b>(
        &'b self,
        key: &'b str,
        bytes: u64,
    ) -> BoxStream<'b, Result<Option<Bytes>>> {
        let starts = stream::iter((0..bytes).step_by(PART_BYTES));
        starts
            .map(move |from| self.range(key, from..bytes.min(from + PART_BYTES as u64)))
            .buffered(AT_ONCE)
            .boxed()
    }

    async fn range(&self, key: &str, range: Range<u64>) -> Result<Option<Bytes>> {
        match self.get_range(key, range).await {
            Ok(bytes) => Ok(Some(bytes)),
            Err(error @ StoreError::NotFound { .. }) if !is_bucket_missing(&error) => Ok(None),
            Err(error) => Err(away(error)),
        }
    }

    async fn get_range(&self, key: &str, range: Range<u64>) -> object_store::Result<Bytes> {
        self.store.get_range(&self.location(key), range).await
    }

    /// Whether the object is there.
    pub(in crate::jobs::store) async fn has(&self, key: &str) -> Result<bool> {
        match self.store.head(&self.location(key)).await {
            Ok(_) => Ok(true),
            Err(StoreError::NotFound { .. }) => Ok(false),
            Err(error) => Err(away(error)),
        }
    }

    /// The size of an object; none if it is not there.
    pub(in crate::jobs::store) async fn bytes(&self, key: &str) -> Result<Option<u64>> {
        match self.store.head(&self.location(key)).await {
            Ok(object) => Ok(Some(object.size)),
            Err(error @ StoreError::NotFound { .. }) if !is_bucket_missing(&error) => Ok(None),
            Err(error) => Err(away(error)),
        }
    }

    /// All objects of ours.
    pub(in crate::jobs::store) async fn list(&self) -> Result<HashMap<String, Found>> {
        let age = self.garbage_age.as_millis() as i64;
        let mut objects = HashMap::new();
        let prefix = (!self.prefix.as_ref().is_empty()).then_some(&self.prefix);
        let mut found = self.store.list(prefix);
        while let Some(object) = found.try_next().await.map_err(away)? {
            let name = object.location.filename().unwrap_or_default();
            if !is_key(name) || object.location != self.location(name) {
                continue;
            }
            // Both by the clock of the store: that in the key is of whoever made it. The answer that
            // this one is from has told the time.
            let old = object.last_modified.timestamp_millis() <= self.clock.now() - age;
            let bytes = object.size;
            objects.insert(name.to_owned(), Found { bytes, old });
        }
        Ok(objects)
    }

    /// Keys of objects that were begun long enough ago to be named by now, by the time of the store.
    /// What has another name is not ours to judge.
    pub(in crate::jobs::store) async fn old_keys(&self) -> Result<Vec<String>> {
        let old = self
            .list()
            .await?
            .into_iter()
            .filter(|(_, found)| found.old);
        let mut keys: Vec<String> = old.map(|(key, _)| key).collect();
        keys.sort_unstable();
        Ok(keys)
    }

    /// Removes objects; one that is not there is no error.
    pub(in crate::jobs::store) async fn remove(&self, keys: &[String]) -> Result<()> {
        let locations: Vec<Location> = keys.iter().map(|key| self.location(key)).collect();
        let removals = stream::iter(locations).map(|location| async move {
            match self.store.delete(&location).await {
                Err(error @ StoreError::NotFound { .. }) if !is_bucket_missing(&error) => Ok(()),
                removed => removed.map_err(away),
            }
        });
        removals
            .buffer_unordered(REMOVED_AT_ONCE)
            .try_collect()
            .await
    }
}

/// Writes parts, and takes back what was written if one of them fails.
async fn put_parts(
    store: &AmazonS3,
    location: &Location,
    parts: BoxStream<'static, std::io::Result<Bytes>>,
) -> object_store::Result<()> {
    let mut upload = store.put_multipart(location).await?;
    let ended = match send(upload.as_mut(), parts).await {
        Ok(()) => upload.complete().await.map(drop),
        Err(error) => Err(error),
    };
    if ended.is_err()
        && let Err(error) = upload.abort().await
    {
        tracing::warn!(error.message = %error,
            "parts of an object stay in the object store until it forgets them");
    }
    ended
}

/// The next part of a file, and the file after it; none at its end.
async fn next_part(file: File) -> std::io::Result<Option<(Bytes, File)>> {
    let mut part = Vec::new();
    let mut rest = file.take(PART_BYTES as u64);
    rest.read_to_end(&mut part).await?;
    Ok((!part.is_empty()).then(|| (part.into(), rest.into_inner())))
}

async fn send(
    upload: &mut dyn MultipartUpload,
    parts: BoxStream<'static, std::io::Result<Bytes>>,
) -> object_store::Result<()> {
    let unread = |error| StoreError::Generic {
        store: "file",
        source: Box::new(error),
    };
    let sent = parts
        .map_err(unread)
        .map_ok(|part| upload.put_part(part.into()));
    sent.try_buffered(AT_ONCE).try_collect().await
}

fn is_key(name: &str) -> bool {
    Uuid::parse_str(name).is_ok_and(|id| id.get_version() == Some(Version::SortRand))
}

/// Whether not the object is missing but all of them: nothing is said of the object then.
fn is_bucket_missing(error: &StoreError) -> bool {
    error.to_string().contains("NoSuchBucket")
}

#[expect(clippy::needless_pass_by_value, reason = "for `map_err`")]
fn away(error: StoreError) -> Error {
    Error::ContentUnavailable(error.to_string())
}
