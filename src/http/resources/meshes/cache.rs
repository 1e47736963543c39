//! A cache of meshes as files in the requested formats: each is encoded once, and the least recently
//! used ones are removed.
//!
//! The canonical mesh, binary PLY, is in the store and is read from there. A file makes ranges, resumed downloads and a strong `ETag`
//! the same for all other formats, at the price of one encoding.

use std::collections::{BTreeSet, HashMap};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use sha2::{Digest, Sha256};
use tokio::sync::Semaphore;

use crate::folder::in_folder;
use crate::folder::names::{is_encoding, remove_files};
use crate::http::resources::jobs::found::found;
use crate::http::resources::meshes::rendition::Rendition;
use crate::http::wire::download::{Content, hex};
use crate::http::wire::error::{ApiError, Code, Result};
use crate::identity::Tenant;
use crate::jobs::{Job, JobId, MeshInfo, Store};

/// Most bytes of cached files. The newest file stays even if it is larger.
const LIMIT_BYTES: u64 = 4 << 30;

/// The folder of encoded meshes.
pub(in crate::http) struct MeshCache {
    folder: PathBuf,
    kept: Mutex<Kept>,
    /// One encoding at a time, because a mesh of ten million triangles needs about a gigabyte.
    turn: Arc<Semaphore>,
}

/// The files, with a counter of uses to find the least recently used.
#[derive(Default)]
struct Kept {
    files: HashMap<Key, Entry>,
    uses: u64,
}

/// Hash of the tenant and the canonical mesh, and the name of the rendition.
type Key = (String, String);

struct Entry {
    file: Encoded,
    /// Jobs with this mesh for which it was requested. The file is removed with the last of them.
    jobs: BTreeSet<JobId>,
    last_use: u64,
}

/// An encoded mesh.
#[derive(Debug, Clone)]
struct Encoded {
    path: PathBuf,
    bytes: u64,
    /// Hash of the file.
    sha256: String,
}

impl Encoded {
    /// The file for a download, and its hash.
    fn content(&self) -> (Content, String) {
        let content = Content::File {
            path: self.path.clone(),
            bytes: self.bytes,
        };
        (content, self.sha256.clone())
    }

    fn erase(&self) {
        if let Err(error) = fs::remove_file(&self.path)
            && error.kind() != io::ErrorKind::NotFound
        {
            // The next start erases what is left.
            tracing::warn!(error.message = %error, "a cached mesh cannot be erased");
        }
    }
}

impl MeshCache {
    /// A cache in `folder`. Files of an earlier process are removed, because their hashes are not
    /// known.
    pub(in crate::http) fn new(folder: PathBuf) -> Self {
        if let Err(error) = remove_files(&folder, |name, _| is_encoding(name))
            && error.kind() != io::ErrorKind::NotFound
        {
            tracing::warn!(error.message = %error, "the cache cannot be emptied");
        }
        Self {
            folder,
            kept: Mutex::default(),
            turn: Arc::new(Semaphore::new(1)),
        }
    }

    /// Bytes of all files.
    pub(in crate::http) fn bytes(&self) -> u64 {
        self.kept()
            .files
            .values()
            .map(|entry| entry.file.bytes)
            .sum()
    }

    /// A rendition of a mesh of the job, and its hash.
    ///
    /// # Errors
    /// [`Code::NotFound`] and [`Code::Gone`] when it was erased meanwhile, and those of the store.
    pub(in crate::http) async fn get(
        self: &Arc<Self>,
        store: &Store,
        job: &Job,
        mesh: &MeshInfo,
        rendition: Rendition,
    ) -> Result<(Content, String)> {
        let key = (named(&job.tenant, &mesh.sha256), rendition.name());
        if let Some(file) = self.kept().used_by(&key, &job.id) {
            return Ok(file.content());
        }
        let turn = Arc::clone(&self.turn).acquire_owned().await;
        let turn = turn.map_err(ApiError::internal)?;
        let (cache, store) = (Arc::clone(self), store.clone());
        let (tenant, job, mesh) = (job.tenant.clone(), job.id.clone(), mesh.clone());
        // A separate task, which continues when the client hangs up. Otherwise a file that the
        // cache does not know would outlive its job.
        let work = tokio::spawn(async move {
            let _turn = turn;
            let adopted = cache.kept().adopt(&key, &job);
            let content = match adopted {
                Some(file) => file.content(),
                None => cache.make((&store, &job), &mesh, key, rendition).await?,
            };
            // Erasing removes rows before files, so either it sees this file or this sees the
            // missing row.
            let there = store.of(&tenant).job(&job).await.map_err(ApiError::from);
            match there.and_then(found) {
                Ok(_) => Ok(content),
                Err(error) => {
                    cache.erase(&job);
                    Err(error)
                }
            }
        });
        work.await.map_err(ApiError::internal)?
    }

    /// Removes the files of a job's meshes that no other job shares. Call it after its rows are
    /// gone.
    pub(in crate::http) fn erase(&self, job: &JobId) {
        self.kept().files.retain(|_, entry| {
            let last = entry.jobs.remove(job) && entry.jobs.is_empty();
            if last {
                entry.file.erase();
            }
            !last
        });
    }

    async fn make(
        &self,
        (store, job): (&Store, &JobId),
        mesh: &MeshInfo,
        key: Key,
        rendition: Rendition,
    ) -> Result<(Content, String)> {
        let ply = canonical(store, mesh).await?;
        let folder = self.folder.clone();
        let (hash, rest) = &key;
        let name = format!("{hash}.{rest}");
        let encoded = tokio::task::spawn_blocking(move || {
            match encode_to_file(&ply, &rendition, &folder, &name) {
                // On a full disk the mesh is served from memory.
                Err(error) if is_full(&error) => Ok(Err(encode_to_memory(&ply, &rendition)?)),
                file => file.map(Ok),
            }
        });
        let encoded = encoded.await.map_err(ApiError::internal)?;
        match encoded.map_err(refused)? {
            Ok(file) => {
                self.kept().keep(key, file.clone(), job);
                Ok(file.content())
            }
            Err(memory) => Ok(memory),
        }
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Kept {
    /// The file, if this job has requested it before.
    fn used_by(&mut self, key: &Key, job: &JobId) -> Option<Encoded> {
        self.uses += 1;
        // Somebody may have emptied the folder since.
        if !self.files.get(key)?.file.path.exists() {
            self.files.remove(key);
        }
        let entry = self.files.get_mut(key)?;
        entry.jobs.contains(job).then(|| {
            entry.last_use = self.uses;
            entry.file.clone()
        })
    }

    /// The file, also if only another job with the same mesh requested it; notes this job too.
    fn adopt(&mut self, key: &Key, job: &JobId) -> Option<Encoded> {
        self.files.get_mut(key)?.jobs.insert(job.clone());
        self.used_by(key, job)
    }

    /// Adds a file and removes the least recently used ones. Downloads in progress continue: an open
    /// file stays readable until it is closed.
    fn keep(&mut self, key: Key, file: Encoded, job: &JobId) {
        let mut total: u64 = self.files.values().map(|entry| entry.file.bytes).sum();
        while total > LIMIT_BYTES {
            let oldest = self.files.iter().min_by_key(|(_, entry)| entry.last_use);
            let Some(oldest) = oldest.map(|(key, _)| key.clone()) else {
                break;
            };
            if let Some(entry) = self.files.remove(&oldest) {
                total -= entry.file.bytes;
                entry.file.erase();
            }
        }
        self.uses += 1;
        let entry = Entry {
            file,
            jobs: BTreeSet::from([job.clone()]),
            last_use: self.uses,
        };
        self.files.insert(key, entry);
    }
}

/// What a mesh goes by. Each tenant has its own files: how fast one answers must not tell that another
/// tenant has the same mesh.
fn named(tenant: &Tenant, sha256: &str) -> String {
    hex(Sha256::digest(format!("{tenant} {sha256}")))
}

/// The bytes of the mesh from the store.
async fn canonical(store: &Store, mesh: &MeshInfo) -> Result<Vec<u8>> {
    let ply = store.mesh_bytes(mesh).await?;
    ply.ok_or_else(|| ApiError::not_found("mesh"))
}

fn is_full(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded
    )
}

fn refused(error: io::Error) -> ApiError {
    match error.kind() {
        io::ErrorKind::InvalidInput => ApiError::new(Code::NotAcceptable, error.to_string()),
        io::ErrorKind::Unsupported => {
            ApiError::fault(Code::RequestInvalid, "/space", error.to_string())
        }
        _ => ApiError::internal(error),
    }
}

fn encode_to_file(
    ply: &[u8],
    rendition: &Rendition,
    folder: &Path,
    name: &str,
) -> io::Result<Encoded> {
    let file = in_folder(folder, || tempfile::NamedTempFile::new_in(folder))?;
    let mut file = Hashing::new(file);
    rendition.write(ply, &mut file)?;
    let path = folder.join(name);
    file.inner.persist(&path).map_err(|error| error.error)?;
    Ok(Encoded {
        path,
        bytes: file.bytes,
        sha256: hex(file.hash.finalize()),
    })
}

fn encode_to_memory(ply: &[u8], rendition: &Rendition) -> io::Result<(Content, String)> {
    let mut encoded = Hashing::new(Vec::new());
    rendition.write(ply, &mut encoded)?;
    let content = Content::Memory(encoded.inner.into());
    Ok((content, hex(encoded.hash.finalize())))
}

/// Counts and hashes what passes through.
struct Hashing<W> {
    inner: W,
    hash: Sha256,
    bytes: u64,
}

impl<W> Hashing<W> {
    fn new(inner: W) -> Self {
        Self {
            inner,
            hash: Sha256::new(),
            bytes: 0,
        }
    }
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(buffer)?;
        self.hash.update(&buffer[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
