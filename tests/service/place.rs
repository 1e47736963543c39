//! The places that content may be in: the data folder, and an object store that `scripts/s3.sh` starts.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use meshway::config::ObjectsUrl;
use meshway::jobs::Options;
use uuid::Uuid;

/// Where a test has its content.
#[derive(Clone)]
pub(crate) enum Place {
    Embedded,
    Bucket(Bucket),
}

/// Part of an object store that no other test uses.
#[derive(Clone)]
pub(crate) struct Bucket {
    pub(crate) url: String,
    /// Its objects as files.
    pub(crate) folder: PathBuf,
}

/// What `scripts/s3.sh` tells.
///
/// # Panics
/// Without it where nothing may be skipped.
pub(crate) fn told(name: &str) -> Option<String> {
    let told = std::env::var_os(name).map(|value| value.into_string().unwrap());
    if told.is_none() {
        let ci = std::env::var_os("CI").is_some();
        assert!(!ci, "{name} is missing: run the tests by scripts/s3.sh");
        let told = format!("skipped without an object store ({name}): run by scripts/s3.sh\n");
        fs::write("/dev/stderr", told).unwrap_or_default();
    }
    told
}

impl Bucket {
    /// A part of the object store; none, and said so, where there is no store.
    pub(crate) fn new() -> Option<Self> {
        let url = told("MESHWAY_TEST_OBJECTS")?;
        let folder = PathBuf::from(told("MESHWAY_TEST_OBJECTS_FOLDER")?);
        let prefix = Uuid::now_v7().to_string();
        let (bucket, query) = url.split_once('?').unwrap();
        Some(Self {
            url: format!("{bucket}/{prefix}?{query}"),
            folder: folder.join(prefix),
        })
    }

    pub(crate) fn url(&self) -> ObjectsUrl {
        self.url.parse().unwrap()
    }

    /// The flag of a server whose content is here.
    pub(crate) fn flag(&self) -> String {
        format!("--objects={}", self.url)
    }

    /// Keys of all objects, without the marker.
    pub(crate) fn keys(&self) -> Vec<String> {
        let Ok(entries) = fs::read_dir(&self.folder) else {
            return Vec::new();
        };
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut keys: Vec<String> = names.filter(|name| !name.contains("meshway")).collect();
        keys.sort();
        keys
    }
}

impl Place {
    /// A place in an object store; none, and said so, where there is no store.
    pub(crate) fn bucket() -> Option<Self> {
        Bucket::new().map(Self::Bucket)
    }

    /// The options of a store with its content here. Garbage may be of any age.
    pub(crate) fn options(&self, options: Options) -> Options {
        match self {
            Self::Embedded => options,
            Self::Bucket(bucket) => Options {
                objects: Some(bucket.url()),
                garbage_age: Duration::ZERO,
                ..options
            },
        }
    }

    /// Where what was erased must not be: the data folder, and the place itself.
    pub(crate) fn folders(&self, data_dir: &Path) -> Vec<PathBuf> {
        let mut folders = vec![data_dir.to_owned()];
        if let Self::Bucket(bucket) = self {
            folders.push(bucket.folder.clone());
        }
        folders
    }
}

/// A test of content, once in each place.
macro_rules! in_both_places {
    ($($(#[doc = $doc:literal])* async fn $name:ident($place:ident: Place) $body:block)*) => {$(
        $(#[doc = $doc])*
        mod $name {
            use super::*;

            async fn holds($place: Place) $body

            #[tokio::test]
            async fn embedded() {
                holds(Place::Embedded).await;
            }

            #[tokio::test]
            async fn bucket() {
                if let Some(place) = Place::bucket() {
                    holds(place).await;
                }
            }
        }
    )*};
}
pub(crate) use in_both_places;
