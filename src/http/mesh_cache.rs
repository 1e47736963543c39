//! Meshes as files in the formats that were asked for: made once, thrown away when they are many.
//!
//! The canonical mesh is in the database. A file makes ranges, resumed downloads and a strong `ETag`
//! the same for all formats, at the price of one encoding.

use std::collections::HashMap;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use sha2::{Digest, Sha256};
use tokio::sync::Semaphore;

use super::download::{Content, hex};
use super::error::{ApiError, Code, Result};
use super::own_files::{is_encoding, remove_files};
use crate::jobs::{MeshInfo, Store};
use crate::reconstruction::mesh::read;
use crate::reconstruction::mesh::write::{Format, write};

/// Bytes of files that are kept, apart from the newest one.
const LIMIT_BYTES: u64 = 4 << 30;

/// The folder of encoded meshes.
pub(super) struct MeshCache {
    folder: PathBuf,
    kept: Mutex<Kept>,
    /// One encoding at a time: a mesh of ten million triangles takes about a gigabyte meanwhile.
    turn: Semaphore,
}

/// Which files there are; a count of uses tells the oldest.
#[derive(Default)]
struct Kept {
    files: HashMap<(String, Format), (Encoded, u64)>,
    uses: u64,
}

/// An encoded mesh.
#[derive(Debug, Clone)]
pub(super) struct Encoded {
    path: PathBuf,
    bytes: u64,
    /// Hash of the file.
    pub(super) sha256: String,
}

impl Encoded {
    /// For a download.
    pub(super) fn content(&self) -> Content {
        Content::File {
            path: self.path.clone(),
            bytes: self.bytes,
        }
    }
}

impl MeshCache {
    /// A cache in `folder`. What an earlier process left there is erased: nobody knows its hashes.
    pub(super) fn new(folder: PathBuf) -> Self {
        if let Err(error) = remove_files(&folder, |name, _| is_encoding(name))
            && error.kind() != io::ErrorKind::NotFound
        {
            tracing::warn!(error.message = %error, "the cache cannot be emptied");
        }
        Self {
            folder,
            kept: Mutex::default(),
            turn: Semaphore::new(1),
        }
    }

    /// Bytes of all files.
    pub(super) fn bytes(&self) -> u64 {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.files.values().map(|(file, _)| file.bytes).sum()
    }

    /// The mesh in the format.
    ///
    /// # Errors
    /// [`Code::NotFound`] when it was erased meanwhile, [`Code::InsufficientStorage`], and those of
    /// the store.
    pub(super) async fn get(
        &self,
        store: &Store,
        mesh: &MeshInfo,
        format: Format,
    ) -> Result<Encoded> {
        let key = (mesh.sha256.clone(), format);
        if let Some(file) = self.find(&key) {
            return Ok(file);
        }
        let _turn = self.turn.acquire().await.map_err(ApiError::internal)?;
        if let Some(file) = self.find(&key) {
            return Ok(file);
        }
        let ply = canonical(store, mesh).await?;
        let folder = self.folder.clone();
        let name = format!("{}.{}", mesh.sha256, format.name());
        let encoded = tokio::task::spawn_blocking(move || encode(&ply, format, &folder, &name));
        let file = encoded.await.map_err(ApiError::internal)??;
        self.keep(key, file.clone());
        Ok(file)
    }

    fn find(&self, key: &(String, Format)) -> Option<Encoded> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.uses += 1;
        let uses = kept.uses;
        let (file, last) = kept.files.get_mut(key)?;
        *last = uses;
        Some(file.clone())
    }

    /// Keeps a file, and drops those that were not used for the longest time. Downloads under way
    /// read on: an open file stays until it is closed.
    fn keep(&self, key: (String, Format), file: Encoded) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let mut total: u64 = kept.files.values().map(|(file, _)| file.bytes).sum();
        while total > LIMIT_BYTES {
            let oldest = kept.files.iter().min_by_key(|(_, (_, last))| *last);
            let Some(oldest) = oldest.map(|(key, _)| key.clone()) else {
                break;
            };
            if let Some((file, _)) = kept.files.remove(&oldest) {
                total -= file.bytes;
                if let Err(error) = fs::remove_file(&file.path) {
                    tracing::warn!(error.message = %error, "a cached mesh cannot be erased");
                }
            }
        }
        kept.uses += 1;
        let uses = kept.uses;
        kept.files.insert(key, (file, uses));
    }
}

/// The mesh's bytes as they are in the database.
async fn canonical(store: &Store, mesh: &MeshInfo) -> Result<Vec<u8>> {
    let mut ply = Vec::with_capacity(mesh.bytes as usize);
    let mut position = 0;
    while let Some(chunk) = store.mesh_chunk(mesh.id, position).await? {
        ply.extend_from_slice(&chunk);
        position += 1;
    }
    if ply.len() as u64 == mesh.bytes {
        Ok(ply)
    } else {
        Err(ApiError::not_found("mesh"))
    }
}

fn encode(ply: &[u8], format: Format, folder: &Path, name: &str) -> Result<Encoded> {
    let refused = |error: io::Error| match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            ApiError::new(Code::InsufficientStorage, "the disk is full")
        }
        io::ErrorKind::InvalidInput => ApiError::new(Code::NotAcceptable, error.to_string()),
        _ => ApiError::internal(error),
    };
    fs::create_dir_all(folder).map_err(refused)?;
    let mut file = Hashing {
        inner: tempfile::NamedTempFile::new_in(folder).map_err(refused)?,
        hash: Sha256::new(),
        bytes: 0,
    };
    if format == Format::PlyBinary {
        file.write_all(ply).map_err(refused)?;
    } else {
        let mesh = read::read(ply, None).map_err(ApiError::internal)?;
        write(&mesh, format, &mut file).map_err(refused)?;
    }
    let path = folder.join(name);
    file.inner
        .persist(&path)
        .map_err(|error| refused(error.error))?;
    Ok(Encoded {
        path,
        bytes: file.bytes,
        sha256: hex(file.hash.finalize()),
    })
}

/// Counts and hashes what passes through.
struct Hashing<W> {
    inner: W,
    hash: Sha256,
    bytes: u64,
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
