//! Encoded meshes, kept in chunks, and trained models.

use sqlx::sqlite::SqliteRow;

use super::Store;
use super::row::{Columns, integer};
use super::writer::Transaction;
use crate::jobs::attempt::sha256_hex;
use crate::jobs::{JobId, NewMesh, Result};

/// Size of every chunk of a mesh but the last: large enough for ~155 MiB/s in and ~700 MiB/s out,
/// small enough that a hundred downloads hold 25 MiB.
pub const MESH_CHUNK_BYTES: usize = 256 * 1024;

/// A mesh without its bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshInfo {
    /// Names the bytes, and never names others.
    pub id: i64,
    /// Function evaluation at which it was extracted; 0 is the result of the job.
    pub evaluation: u64,
    /// Number of vertices.
    pub vertices: u64,
    /// Number of triangles.
    pub triangles: u64,
    /// Size of the canonical encoding, binary PLY.
    pub bytes: u64,
    /// Hash of the canonical encoding, in lower-case hexadecimal digits.
    pub sha256: String,
    /// When it was written, in milliseconds since the epoch.
    pub created_at: i64,
}

impl Store {
    /// The snapshots of a job, in the order of their evaluations; without the result.
    ///
    /// # Errors
    /// As every read: `Busy`, `Closed`, `Inconsistent`, `Database`.
    pub async fn snapshots(&self, id: &JobId) -> Result<Vec<MeshInfo>> {
        sqlx::query("SELECT * FROM meshes WHERE job_id = ?1 AND evaluation > 0 ORDER BY evaluation")
            .bind(id.as_str())
            .fetch_all(self.readers())
            .await?
            .iter()
            .map(mesh_of)
            .collect()
    }

    /// The mesh at an evaluation; 0 is the result.
    ///
    /// # Errors
    /// As every read.
    pub async fn mesh_info(&self, id: &JobId, evaluation: u64) -> Result<Option<MeshInfo>> {
        let row = sqlx::query("SELECT * FROM meshes WHERE job_id = ?1 AND evaluation = ?2")
            .bind(id.as_str())
            .bind(integer(evaluation))
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(mesh_of).transpose()
    }

    /// The bytes of a mesh from `position` · [`MESH_CHUNK_BYTES`] on, that many or to the end; none
    /// past the end, and none when the mesh was erased meanwhile.
    ///
    /// # Errors
    /// As every read.
    pub async fn mesh_chunk(&self, mesh_id: i64, position: u64) -> Result<Option<Vec<u8>>> {
        Ok(
            sqlx::query_scalar("SELECT data FROM mesh_chunks WHERE mesh_id = ?1 AND position = ?2")
                .bind(mesh_id)
                .bind(integer(position))
                .fetch_optional(self.readers())
                .await?,
        )
    }

    /// The trained network (safetensors) of a job that succeeded, and its hash.
    ///
    /// # Errors
    /// As every read.
    pub async fn model(&self, id: &JobId) -> Result<Option<(Vec<u8>, String)>> {
        Ok(
            sqlx::query_as("SELECT data, sha256 FROM models WHERE job_id = ?1")
                .bind(id.as_str())
                .fetch_optional(self.readers())
                .await?,
        )
    }
}

impl Transaction<'_> {
    /// Writes a mesh in the place of an earlier one at the same evaluation.
    pub(super) async fn put_mesh(
        &mut self,
        id: &JobId,
        evaluation: u64,
        mesh: &NewMesh,
    ) -> Result<()> {
        for statement in [
            "DELETE FROM mesh_chunks WHERE mesh_id IN
                 (SELECT id FROM meshes WHERE job_id = ?1 AND evaluation = ?2)",
            "DELETE FROM meshes WHERE job_id = ?1 AND evaluation = ?2",
        ] {
            sqlx::query(statement)
                .bind(id.as_str())
                .bind(integer(evaluation))
                .execute(&mut *self.db)
                .await?;
        }
        let mesh_id: i64 = sqlx::query_scalar(
            "INSERT INTO meshes (job_id, evaluation, vertices, triangles, bytes, sha256, created_at)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7) RETURNING id",
        )
        .bind(id.as_str())
        .bind(integer(evaluation))
        .bind(integer(mesh.vertices))
        .bind(integer(mesh.triangles))
        .bind(mesh.data.len() as i64)
        .bind(&mesh.sha256)
        .bind(self.now)
        .fetch_one(&mut *self.db)
        .await?;
        for (position, chunk) in (0_i64..).zip(mesh.data.chunks(MESH_CHUNK_BYTES)) {
            sqlx::query("INSERT INTO mesh_chunks (mesh_id, position, data) VALUES (?1, ?2, ?3)")
                .bind(mesh_id)
                .bind(position)
                .bind(chunk)
                .execute(&mut *self.db)
                .await?;
        }
        Ok(())
    }

    /// Writes the trained network.
    pub(super) async fn put_model(&mut self, id: &JobId, data: &[u8]) -> Result<()> {
        sqlx::query("INSERT INTO models (job_id, data, sha256) VALUES (?1, ?2, ?3)")
            .bind(id.as_str())
            .bind(data)
            .bind(sha256_hex(data))
            .execute(&mut *self.db)
            .await?;
        Ok(())
    }
}

fn mesh_of(row: &SqliteRow) -> Result<MeshInfo> {
    let columns = Columns::new("meshes", row);
    Ok(MeshInfo {
        id: columns.get("id")?,
        evaluation: columns.count("evaluation")?,
        vertices: columns.count("vertices")?,
        triangles: columns.count("triangles")?,
        bytes: columns.count("bytes")?,
        sha256: columns.get("sha256")?,
        created_at: columns.get("created_at")?,
    })
}
