//! How a store is opened: rows and content, each in one of two places.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use sqlx::sqlite::SqliteConnectOptions;
use tokio::sync::{Mutex, Notify, watch};

use super::content::ballast::Ballast;
use super::content::embedded::Embedded;
use super::content::graves::{Burial, Undertaker};
use super::content::objects::Objects;
use super::content::{lift, place};
use super::engine::{Engine, Writer};
use super::postgres::notice::Notices;
use super::postgres::{Access, Session};
use super::records::submits::Submits;
use super::sql::{Db, Readers, scalar};
use super::sqlite::shredder::Shredder;
use super::sqlite::writer::ready;
use super::sqlite::{MIGRATIONS, OPENING, connect_options, migrated, readers, writing};
use super::{DATABASE_FILE, Inner, Options, Store};
use crate::jobs::clock::RemoteClock;
use crate::jobs::{Error, Result};

/// The open database of the rows.
struct Rows {
    engine: Engine,
    readers: Readers,
    notices: Option<Notices>,
    /// The databases of the folder with rows, whose write-ahead logs are emptied.
    logs: Vec<SqliteConnectOptions>,
}

impl Store {
    /// Opens the database of a data folder that exists, creating and migrating it as needed, or the one
    /// of a server. Needs a tokio runtime, in which the writing task lives.
    ///
    /// # Errors
    /// `Busy` where other processes still migrate after several times the busy timeout; `Migration` if the database is of a later version;
    /// `Full` if content from before cannot be moved; `ContentRefused` if the object store cannot be used or is not
    /// that of this database; `Database` if it is none of ours or cannot be opened; `Elsewhere` if the content is in
    /// another data folder than this one.
    pub async fn open(data_dir: &Path, options: Options) -> Result<Self> {
        let (changed, _) = watch::channel(0);
        match options.database.clone() {
            None => Self::open_sqlite(data_dir, options, changed).await,
            Some(url) => Self::open_postgres(&url, data_dir, options, changed).await,
        }
    }

    async fn open_sqlite(
        data_dir: &Path,
        options: Options,
        changed: watch::Sender<u64>,
    ) -> Result<Self> {
        let options = Arc::new(options);
        let connect = connect_options(&data_dir.join(DATABASE_FILE), &options);
        let patience = OPENING * options.busy_timeout;
        let mut db = migrated(&writing(&connect), &MIGRATIONS, patience).await?;
        let moved = "SELECT value FROM meta WHERE name = 'moved_to'";
        let moved: Option<String> = scalar(moved)
            .fetch_optional(&mut Db::Sqlite(&mut db))
            .await?;
        if let Some(to) = moved.filter(|_| !options.rows_only) {
            return Err(Error::Moved(to));
        }
        let objects = place::open(&mut Db::Sqlite(&mut db), data_dir, &options).await?;
        if !options.rows_only {
            lift::lift(&mut db, &objects).await?;
        }
        ready(&mut db).await?;
        let readers = readers(connect.clone(), &options).await?;
        let rows = Rows {
            engine: Engine::Sqlite(db),
            readers: Readers::Sqlite(readers),
            notices: None,
            logs: vec![connect],
        };
        Ok(Self::over(rows, objects, data_dir, options, changed))
    }

    async fn open_postgres(
        url: &str,
        data_dir: &Path,
        mut options: Options,
        changed: watch::Sender<u64>,
    ) -> Result<Self> {
        let clock = RemoteClock::default();
        let committed = Arc::new(Notify::new());
        let access = Access::new(url, options.database_pooled)?;
        let mut session = Session::open(&access, clock.clone(), Arc::clone(&committed)).await?;
        options
            .clock
            .get_or_insert_with(|| Arc::new(move || clock.now()));
        let options = Arc::new(options);
        let objects = place::open(&mut session.rows(), data_dir, &options).await?;
        let pool = access.readers(&options);
        let notices = access.notices(pool.clone(), committed, &changed);
        let rows = Rows {
            engine: Engine::Postgres(Box::new(session)),
            readers: Readers::Postgres(pool, access.protocol()),
            notices: Some(notices),
            logs: Vec::new(),
        };
        Ok(Self::over(rows, objects, data_dir, options, changed))
    }

    /// A store over open databases.
    fn over(
        rows: Rows,
        objects: Objects,
        data_dir: &Path,
        options: Arc<Options>,
        changed: watch::Sender<u64>,
    ) -> Self {
        let writer = Writer::start(rows.engine, Arc::clone(&options), changed.clone());
        let writer = Arc::new(writer);
        let objects = Arc::new(objects);
        let mut logs = rows.logs;
        if objects.bucket().is_none() {
            logs.push(Embedded::connect(data_dir, &options));
        }
        let undertaken = !options.rows_only;
        let burial = Arc::new(Burial {
            writer: Arc::clone(&writer),
            readers: rows.readers.clone(),
            objects: Arc::clone(&objects),
            ballast: Ballast::new(data_dir, options.ballast_bytes),
            logs: logs.into_iter().map(Shredder::start).collect(),
            turn: Mutex::default(),
            late: AtomicBool::default(),
        });
        Self {
            inner: Arc::new(Inner {
                undertaker: undertaken
                    .then(|| Undertaker::start(Arc::clone(&burial), changed.subscribe())),
                folder: data_dir.to_owned(),
                writer,
                readers: rows.readers,
                notices: rows.notices,
                objects,
                burial,
                changed,
                options,
                submits: Submits::default(),
            }),
        }
    }
}
