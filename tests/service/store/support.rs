//! A store in a temporary folder, with a clock that stands until it is moved.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use crate::place::Place;
use crate::who::{ours, us};
use meshway::intake::Summary;
use meshway::jobs::store::{CONTENT_FILE, DATABASE_FILE};
use meshway::jobs::{
    Acts, Claim, CloudId, Event, Job, JobId, Keep, Lease, NewCloud, NewJob, NewMesh, Options,
    Record, Records, Store, Success,
};
use meshway::reconstruction::cloud::{Counts, Format};
use meshway::reconstruction::space::Space;
use meshway::reconstruction::vector::Bounds;
use meshway::reconstruction::{Phase, Preset};
use serde_json::json;
use sqlx::SqliteConnection;
use tempfile::TempDir;

use super::ENGINE;
use crate::store::bare::{Bare, Engine, connect, new_database};

/// Length of the leases of the tests, in milliseconds of the standing clock.
pub(crate) const LEASE_MS: i64 = 6_000;

pub(crate) struct Bench {
    pub(crate) store: Store,
    pub(crate) cloud_id: CloudId,
    clock: Arc<AtomicI64>,
    database: Option<String>,
    dir: TempDir,
    place: Place,
}

impl Bench {
    pub(crate) async fn new() -> Self {
        Self::with(|_| {}).await
    }

    pub(crate) async fn with(change: impl FnOnce(&mut Options)) -> Self {
        Self::over(Place::Embedded, change).await
    }

    pub(crate) async fn at(place: Place) -> Self {
        Self::over(place, |_| {}).await
    }

    async fn over(place: Place, change: impl FnOnce(&mut Options)) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let clock = Arc::new(AtomicI64::new(1_000_000));
        let database = match ENGINE {
            Engine::Sqlite => None,
            Engine::Postgres => new_database().await,
        };
        let mut options = place.options(options(&clock, database.as_ref()));
        change(&mut options);
        let store = Store::open(dir.path(), options).await.unwrap();
        let (cloud, created) = store.by(us()).insert_cloud(new_cloud("a")).await.unwrap();
        assert!(created);
        Self {
            store,
            cloud_id: cloud.id,
            clock,
            database,
            dir,
            place,
        }
    }

    /// The records of the tenant of all.
    pub(crate) fn records(&self) -> Records<'_> {
        self.store.of(ours())
    }

    /// What is done to them.
    pub(crate) fn acts(&self) -> Acts<'_> {
        self.store.by(us())
    }

    pub(crate) fn path(&self) -> &Path {
        self.dir.path()
    }

    /// Another process's hold on the same database.
    pub(crate) async fn second(&self) -> Store {
        Store::open(self.path(), self.options()).await.unwrap()
    }

    pub(crate) fn options(&self) -> Options {
        let options = options(&self.clock, self.database.as_ref());
        self.place.options(options)
    }

    /// Number of the objects of the content.
    pub(crate) async fn objects(&self) -> usize {
        match &self.place {
            Place::Bucket(bucket) => bucket.keys().len(),
            Place::Embedded => {
                let select = "SELECT COUNT(*) FROM objects";
                let count = sqlx::query_scalar::<_, i64>(select);
                count.fetch_one(&mut self.content().await).await.unwrap() as usize
            }
        }
    }

    /// A bare connection to the same database.
    pub(crate) async fn bare(&self) -> Bare {
        match &self.database {
            None => Bare::sqlite(&self.path().join(DATABASE_FILE)).await,
            Some(url) => Bare::postgres(url).await,
        }
    }

    /// What is said in the two kinds of SQL.
    pub(crate) fn either<T>(&self, sqlite: T, postgres: T) -> T {
        if self.database.is_none() {
            sqlite
        } else {
            postgres
        }
    }

    /// A bare connection to its content.
    pub(crate) async fn content(&self) -> SqliteConnection {
        connect(&self.path().join(CONTENT_FILE)).await
    }

    pub(crate) fn pass(&self, milliseconds: i64) {
        self.clock.fetch_add(milliseconds, Ordering::SeqCst);
    }

    pub(crate) fn new_job(&self) -> NewJob {
        NewJob {
            cloud_id: self.cloud_id.clone(),
            preset: Preset::Fast,
            settings: Preset::Fast.settings(),
            labels: BTreeMap::from([("patient".to_owned(), "p 1".to_owned())]),
            source: None,
            derived_from: None,
            priority: 0,
            cost_seconds: 1.0,
            keep: Keep::default(),
        }
    }

    pub(crate) async fn submit(&self) -> Job {
        self.store
            .by(us())
            .submit(self.new_job(), None)
            .await
            .unwrap()
    }

    /// The place of a job of ours in the queue.
    pub(crate) async fn position(&self, id: &JobId) -> Option<u64> {
        let place = self.records().place(id).await.unwrap();
        place.map(|place| place.position)
    }

    pub(crate) async fn claim(&self) -> Claim {
        self.store.claim("w", LEASE_MS).await.unwrap().unwrap()
    }

    pub(crate) async fn renew(&self, claim: &Claim) -> Lease {
        let renewal = self.store.renew(claim, LEASE_MS, Duration::ZERO);
        renewal.await.unwrap()
    }

    /// Takes the jobs of expired leases from their workers, of which none is seen.
    pub(crate) async fn reap(&self) -> Vec<JobId> {
        let none_seen = BTreeSet::new();
        self.store.reap_expired(none_seen).await.unwrap()
    }

    pub(crate) async fn job(&self, id: &JobId) -> Job {
        self.store
            .of(ours())
            .job(id)
            .await
            .unwrap()
            .found()
            .unwrap()
    }

    pub(crate) async fn events(&self, id: &JobId) -> Vec<Event> {
        self.store
            .of(ours())
            .events_after(id, 0, 10_000)
            .await
            .unwrap()
    }

    /// Names of a job's events; checks on the way that their ids are 1, 2, 3, ….
    pub(crate) async fn event_names(&self, id: &JobId) -> Vec<&'static str> {
        let events = self.events(id).await;
        for (event, expected) in events.iter().zip(1..) {
            assert_eq!(event.id, expected);
        }
        assert_eq!(self.job(id).await.events, events.len() as i64);
        events.iter().map(|event| event.kind.name()).collect()
    }
}

fn options(clock: &Arc<AtomicI64>, database: Option<&String>) -> Options {
    let clock = Arc::clone(clock);
    crate::pooled::perhaps(Options {
        clock: Some(Arc::new(move || clock.load(Ordering::SeqCst))),
        database: database.cloned(),
        ..Options::default()
    })
}

pub(crate) fn new_cloud(sha256: &str) -> NewCloud {
    NewCloud {
        sha256: sha256.to_owned(),
        bytes: 12,
        summary: summary(Format::Ply, 1_000),
        keep_ms: None,
    }
}

/// What the upload of a plain cloud finds.
pub(crate) fn summary(format: Format, points: u64) -> Summary {
    Summary {
        format,
        gzipped: false,
        points,
        bounds: Bounds {
            min: [-1.0; 3],
            max: [1.0; 3],
        },
        normals: false,
        labels: Counts {
            surface: points as usize,
            ..Counts::default()
        },
        space: Space::default(),
        dropped_non_finite: 0,
        warnings: Vec::new(),
        keeps_identifiers: false,
        cleaned: true,
        dropped_texts: 0,
        segmentation: None,
    }
}

pub(crate) fn success() -> Success {
    Success {
        mesh: NewMesh::new(4, 4, vec![7; 10]),
        report: json!({"closed": true}),
        model: vec![1, 2, 3],
        last: Record {
            phase: Some(Phase::Report),
            evaluations: Some(300),
            loss: Some(0.5),
            ..Record::default()
        },
    }
}
