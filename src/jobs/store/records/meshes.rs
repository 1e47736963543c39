//! Encoded meshes and trained models. Their bytes are objects.

use std::ops::Range;

use bytes::Bytes;

use super::row::{Columns, integer, of_tenant};
use crate::jobs::store::Transaction;
use crate::jobs::store::content::objects::Kept;
use crate::jobs::store::sql::{Row, query};
use crate::jobs::store::{Records, Store};
use crate::jobs::{JobId, NewMesh, Result, Verdict};

/// A mesh without its bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshInfo {
    /// Names the bytes, and never names others.
    pub object: String,
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
    /// How far a snapshot can be relied on, where that was told with it.
    pub verdict: Option<Verdict>,
}

impl Records<'_> {
    /// The snapshots of a job, in the order of their evaluations; without the result.
    pub async fn snapshots(self, id: &JobId) -> Result<Vec<MeshInfo>> {
        query(of_tenant!(
            "SELECT * FROM meshes WHERE job_id = ?1 AND evaluation > 0",
            "ORDER BY evaluation"
        ))
        .bind(id.as_str())
        .bind(self.tenant.as_str())
        .fetch_all(self.readers())
        .await?
        .iter()
        .map(mesh_of)
        .collect()
    }

    /// The mesh at an evaluation; 0 is the result.
    pub async fn mesh_info(self, id: &JobId, evaluation: u64) -> Result<Option<MeshInfo>> {
        let row = query(of_tenant!(
            "SELECT * FROM meshes WHERE job_id = ?1 AND evaluation = ?3"
        ))
        .bind(id.as_str())
        .bind(self.tenant.as_str())
        .bind(integer(evaluation))
        .fetch_optional(self.readers())
        .await?;
        row.as_ref().map(mesh_of).transpose()
    }
}

impl Store {
    /// Some of the bytes of a range within an object from its start on, at least one; none when it was
    /// erased meanwhile.
    pub async fn object_part(&self, object: &str, range: Range<u64>) -> Result<Option<Bytes>> {
        self.inner.objects.part(object, range).await
    }

    /// All bytes of a mesh; none when it was erased meanwhile.
    pub async fn mesh_bytes(&self, mesh: &MeshInfo) -> Result<Option<Vec<u8>>> {
        let object = Kept {
            key: mesh.object.clone(),
            bytes: mesh.bytes,
        };
        self.inner.objects.whole(&object).await
    }
}

impl Records<'_> {
    /// The trained network (safetensors) of a job that succeeded, and its hash.
    pub async fn model(self, id: &JobId) -> Result<Option<(Vec<u8>, String)>> {
        let row = query(of_tenant!("SELECT * FROM models WHERE job_id = ?1"))
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_optional(self.readers())
            .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let columns = Columns::new("models", &row);
        let data = self.objects().whole(&columns.object()?).await?;
        let sha256 = columns.get("sha256")?;
        Ok(data.map(|data| (data, sha256)))
    }
}

impl Transaction<'_> {
    /// Writes a mesh in the place of an earlier one at the same evaluation.
    pub(in crate::jobs::store) async fn put_mesh(
        &mut self,
        id: &JobId,
        evaluation: u64,
        mesh: &NewMesh,
        object: &Kept,
    ) -> Result<()> {
        for statement in [
            "INSERT INTO graves (key)
                 SELECT object FROM meshes WHERE job_id = ?1 AND evaluation = ?2",
            "DELETE FROM meshes WHERE job_id = ?1 AND evaluation = ?2",
        ] {
            query(statement)
                .bind(id.as_str())
                .bind(integer(evaluation))
                .execute(&mut self.db)
                .await?;
        }
        query(
            "INSERT INTO meshes (job_id, evaluation, vertices, triangles, bytes, sha256,
                 created_at, object, verdict)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)",
        )
        .bind(id.as_str())
        .bind(integer(evaluation))
        .bind(integer(mesh.vertices))
        .bind(integer(mesh.triangles))
        .bind(integer(object.bytes))
        .bind(&mesh.sha256)
        .bind(self.now)
        .bind(&object.key)
        .bind(mesh.verdict.map(Verdict::name))
        .execute(&mut self.db)
        .await?;
        Ok(())
    }

    /// Writes the trained network.
    pub(in crate::jobs::store) async fn put_model(
        &mut self,
        id: &JobId,
        sha256: String,
        object: &Kept,
    ) -> Result<()> {
        query("INSERT INTO models (job_id, object, bytes, sha256) VALUES (?1, ?2, ?3, ?4)")
            .bind(id.as_str())
            .bind(&object.key)
            .bind(integer(object.bytes))
            .bind(sha256)
            .execute(&mut self.db)
            .await?;
        Ok(())
    }
}

fn mesh_of(row: &Row) -> Result<MeshInfo> {
    let columns = Columns::new("meshes", row);
    Ok(MeshInfo {
        object: columns.get("object")?,
        evaluation: columns.count("evaluation")?,
        vertices: columns.count("vertices")?,
        triangles: columns.count("triangles")?,
        bytes: columns.count("bytes")?,
        sha256: columns.get("sha256")?,
        created_at: columns.get("created_at")?,
        verdict: columns
            .get::<Option<&str>>("verdict")?
            .and_then(Verdict::from_name),
    })
}
