//! Whether the bytes are there that the rows name, looked at from beside a service that may run.
//!
//! Bytes come before their row and go after it, so what is seen in two looks may differ without a fault.
//! Whatever seems to be missing is therefore looked at again, row and bytes, before it is told.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use sha2::{Digest, Sha256};

use super::content::graves::is_named;
use super::content::shelf::{Found, Shelf};
use super::postgres::{Access, TIME, home};
use super::sql::{Readers, Row, query, scalar};
use super::sqlite::{connect_options, readers};
use super::{DATABASE_FILE, Options, Store};
use crate::folder::{CLOUDS, names};
use crate::jobs::clock::RemoteClock;
use crate::jobs::{Error, Result};

/// Rows that are read at a time.
const PAGE: i64 = 5_000;

/// What names bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Named {
    /// A cloud, as it was sent.
    Cloud,
    /// A mesh: a result or a snapshot.
    Mesh,
    /// The network of a job.
    Model,
    /// The state of a training that has not ended.
    Checkpoint,
    /// What a job told, packed.
    History,
    /// A part of an upload that may go on.
    Part,
    /// Blocks of a running job, for idle workers.
    Share,
}

/// What is wrong with bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Damage {
    /// They are not there.
    Missing,
    /// There are more or fewer.
    Size {
        /// How many are there.
        found: u64,
    },
    /// They are others.
    Hash {
        /// Their SHA-256.
        found: String,
    },
}

/// A row whose bytes are not as it says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// What it is.
    pub named: Named,
    /// Id of the cloud or of the job.
    pub of: String,
    /// Key of the object, or name of the file of a cloud.
    pub place: String,
    /// How many bytes there should be.
    pub bytes: u64,
    /// What is wrong.
    pub damage: Damage,
}

/// What a check found.
#[derive(Debug, Default)]
pub struct Checked {
    /// Number of rows that name bytes, and their bytes.
    pub rows: BTreeMap<Named, (u64, u64)>,
    /// Those whose bytes are not as they say.
    pub findings: Vec<Finding>,
    /// Keys of objects and names of files that no row names, with their bytes.
    pub left_over: Vec<(String, u64)>,
}

/// A row that names bytes.
struct Claim {
    of: String,
    place: String,
    bytes: u64,
    sha256: Option<String>,
    is_file: bool,
}

impl Named {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Cloud,
        Self::Mesh,
        Self::Model,
        Self::Checkpoint,
        Self::History,
        Self::Part,
        Self::Share,
    ];

    /// Their rows, a page in the order of what the page goes on after.
    fn select(self) -> &'static str {
        match self {
            Self::Cloud => {
                "SELECT id AS of, id AS place, sha256, bytes, object FROM clouds
                 WHERE id > ?1 ORDER BY id LIMIT ?2"
            }
            Self::Mesh => {
                "SELECT job_id AS of, object AS place, sha256, bytes, object FROM meshes
                 WHERE object > ?1 ORDER BY object LIMIT ?2"
            }
            Self::Model => {
                "SELECT job_id AS of, object AS place, sha256, bytes, object FROM models
                 WHERE object > ?1 ORDER BY object LIMIT ?2"
            }
            Self::Checkpoint => {
                "SELECT job_id AS of, object AS place, CAST(NULL AS TEXT) AS sha256, bytes, object
                 FROM checkpoints WHERE object > ?1 ORDER BY object LIMIT ?2"
            }
            Self::History => {
                "SELECT job_id AS of, object AS place, CAST(NULL AS TEXT) AS sha256, bytes, object
                 FROM histories WHERE object > ?1 ORDER BY object LIMIT ?2"
            }
            Self::Part => {
                "SELECT upload_id AS of, object AS place, CAST(NULL AS TEXT) AS sha256, bytes, object
                 FROM upload_parts WHERE object > ?1 ORDER BY object LIMIT ?2"
            }
            Self::Share => {
                "SELECT job_id AS of, object AS place, CAST(NULL AS TEXT) AS sha256, bytes, object
                 FROM shares WHERE object > ?1 ORDER BY object LIMIT ?2"
            }
        }
    }
}

impl Claim {
    fn of(row: &Row) -> Result<Self> {
        let object: Option<String> = row.named("object")?;
        let sha256: Option<String> = row.named("sha256")?;
        let bytes: i64 = row.named("bytes")?;
        Ok(Self {
            of: row.named("of")?,
            is_file: object.is_none(),
            place: object.or_else(|| sha256.clone()).unwrap_or_default(),
            bytes: bytes.unsigned_abs(),
            sha256,
        })
    }
}

/// Rows and bytes, opened to be read.
struct Check {
    rows: Readers,
    shelf: Shelf,
    clouds: PathBuf,
    options: Arc<Options>,
}

impl Store {
    /// Checks all bytes that rows name: that they are there, and are as many; with `hashes` reads
    /// them, too, where their SHA-256 is known. A service may work meanwhile.
    ///
    /// # Errors
    /// Where rows or bytes cannot be read: nothing is known then. `Elsewhere` if the bytes are in
    /// another folder than this one.
    pub async fn check(data_dir: &Path, mut options: Options, hashes: bool) -> Result<Checked> {
        let rows = match &options.database {
            None => {
                let connect = connect_options(&data_dir.join(DATABASE_FILE), &options);
                Readers::Sqlite(readers(connect, &options).await?)
            }
            Some(url) => {
                let access = Access::new(url, options.database_pooled)?;
                let rows = Readers::Postgres(access.readers(&options), access.protocol());
                let clock = RemoteClock::default();
                clock.set(scalar(TIME).fetch_one(&rows).await?);
                options
                    .clock
                    .get_or_insert_with(|| Arc::new(move || clock.now()));
                rows
            }
        };
        let options = Arc::new(options);
        let checked = Check::open(rows.clone(), data_dir, &options).await;
        let checked = match checked {
            Ok(check) => check.run(hashes).await,
            Err(error) => Err(error),
        };
        rows.close().await;
        checked
    }
}

impl Check {
    async fn open(rows: Readers, data_dir: &Path, options: &Arc<Options>) -> Result<Self> {
        let meta = "SELECT value FROM meta WHERE name = ?1";
        let told = async |name| -> Result<Option<String>> {
            scalar(meta).bind(name).fetch_optional(&rows).await
        };
        // Without another address it is where the service left it.
        let objects = match (&options.objects, told("objects").await?) {
            (Some(url), _) => Some(url.clone()),
            (None, Some(url)) => Some(url.parse().map_err(Error::ContentRefused)?),
            (None, None) => None,
        };
        if objects.is_none() && matches!(rows, Readers::Postgres(..)) {
            home::find(told("folder").await?.as_deref(), data_dir)?;
        }
        let id = told("id").await?.unwrap_or_default();
        Ok(Self {
            shelf: Shelf::open(data_dir, objects.as_ref(), &id, options).await?,
            rows,
            clouds: data_dir.join(CLOUDS),
            options: Arc::clone(options),
        })
    }

    async fn run(&self, hashes: bool) -> Result<Checked> {
        let objects = self.shelf.list().await?;
        let files = self.files()?;
        let mut checked = Checked::default();
        let mut named = HashSet::new();
        for kind in Named::ALL {
            let mut last = String::new();
            loop {
                let page = query(kind.select()).bind(&last).bind(PAGE);
                let page = page.fetch_all(&self.rows).await?;
                let Some(row) = page.last() else { break };
                last = row.named("place")?;
                for row in &page {
                    let claim = Claim::of(row)?;
                    let count = checked.rows.entry(kind).or_default();
                    count.0 += 1;
                    count.1 += claim.bytes;
                    let found = if claim.is_file { &files } else { &objects };
                    let damage = self.damage(&claim, found.get(&claim.place), hashes).await?;
                    let finding = damage.map(|damage| Finding {
                        named: kind,
                        of: claim.of.clone(),
                        place: claim.place.clone(),
                        bytes: claim.bytes,
                        damage,
                    });
                    checked.findings.extend(finding);
                    named.insert(claim.place);
                }
            }
        }
        for (place, found) in objects.into_iter().chain(files) {
            if found.old && !named.contains(&place) && !self.is_wanted(&place).await? {
                checked.left_over.push((place, found.bytes));
            }
        }
        checked.left_over.sort();
        Ok(checked)
    }

    /// What is wrong with the bytes of a row; none where nothing is, or the row has gone meanwhile.
    async fn damage(
        &self,
        claim: &Claim,
        found: Option<&Found>,
        hashes: bool,
    ) -> Result<Option<Damage>> {
        let mut damage = match found {
            Some(found) if found.bytes == claim.bytes => None,
            // It was not there yet, or not all of it, when all was listed.
            _ => match self.bytes(claim).await? {
                Some(bytes) if bytes == claim.bytes => None,
                Some(found) => Some(Damage::Size { found }),
                None => Some(Damage::Missing),
            },
        };
        if let (None, true, Some(sha256)) = (&damage, hashes, &claim.sha256) {
            let found = self.sha256(claim).await?;
            damage = (found != *sha256).then_some(Damage::Hash { found });
        }
        Ok(
            if damage.is_some() && !self.is_wanted(&claim.place).await? {
                None
            } else {
                damage
            },
        )
    }

    async fn bytes(&self, claim: &Claim) -> Result<Option<u64>> {
        if !claim.is_file {
            return self.shelf.bytes(&claim.place).await;
        }
        let file = self.clouds.join(&claim.place);
        match tokio::fs::metadata(&file).await {
            Ok(file) => Ok(Some(file.len())),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(unread(&file, &error)),
        }
    }

    async fn sha256(&self, claim: &Claim) -> Result<String> {
        if !claim.is_file {
            return self.shelf.sha256(&claim.place, claim.bytes).await;
        }
        let file = self.clouds.join(&claim.place);
        let hashed = tokio::task::spawn_blocking(move || {
            sha256_of(&file).map_err(|error| unread(&file, &error))
        });
        hashed.await.map_err(|_| Error::Closed)?
    }

    /// Whether a row names the object or the file now.
    async fn is_wanted(&self, place: &str) -> Result<bool> {
        if !names::is_cloud(place) {
            return is_named(&self.rows, place).await;
        }
        let select = "SELECT EXISTS (SELECT 1 FROM clouds WHERE sha256 = ?1 AND object IS NULL)";
        scalar(select).bind(place).fetch_one(&self.rows).await
    }

    /// The files of clouds in the folder.
    fn files(&self) -> Result<HashMap<String, Found>> {
        let failed = |error| unread(&self.clouds, &error);
        let entries = match std::fs::read_dir(&self.clouds) {
            Ok(entries) => entries,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(HashMap::new()),
            Err(error) => return Err(failed(error)),
        };
        let mut files = HashMap::new();
        for entry in entries {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name().to_string_lossy().into_owned();
            // One that has gone meanwhile is none.
            let (true, Ok(file)) = (names::is_cloud(&name), entry.metadata()) else {
                continue;
            };
            let age = |made: SystemTime| made.elapsed().unwrap_or_default();
            let old = file
                .modified()
                .is_ok_and(|made| age(made) >= self.options.garbage_age);
            let bytes = file.len();
            files.insert(name, Found { bytes, old });
        }
        Ok(files)
    }
}

/// The SHA-256 of a file.
pub(in crate::jobs::store) fn sha256_of(file: &Path) -> std::io::Result<String> {
    let mut open = File::open(file)?;
    let mut hash = Sha256::new();
    let mut part = vec![0; 1 << 20];
    loop {
        match open.read(&mut part)? {
            0 => return Ok(hex::encode(hash.finalize())),
            bytes => hash.update(&part[..bytes]),
        }
    }
}

fn unread(file: &Path, error: &std::io::Error) -> Error {
    Error::ContentUnavailable(format!("{}: {error}", file.display()))
}
