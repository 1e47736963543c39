//! The one place with SQL. (Signatures first.)
#![expect(
    missing_docs,
    clippy::unused_async,
    clippy::missing_errors_doc,
    unused_variables,
    reason = "signatures"
)]

use serde_json::Value;
use std::path::Path;
use std::time::Duration;
use tokio::sync::watch;

use super::clock::{self, Clock};
use super::{
    Claim, Cloud, CloudDeletion, CloudId, Counts, FailureReason, Job, JobFilter, JobId, Lease,
    Lookup, NewCloud, NewJob, NewMesh, Problem, Record, Result, Success,
};
use crate::reconstruction::training::{GradientHistogram, Metrics};

#[derive(Clone)]
pub struct Options {
    pub queue_limit: u64,
    pub max_failures: i64,
    pub events_limit: i64,
    pub metrics_limit: i64,
    pub busy_timeout: Duration,
    pub clock: Clock,
}
impl Default for Options {
    fn default() -> Self {
        Self {
            queue_limit: 1_000,
            max_failures: 3,
            events_limit: 100_000,
            metrics_limit: 200_000,
            busy_timeout: Duration::from_secs(5),
            clock: std::sync::Arc::new(clock::now),
        }
    }
}
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    pub seq: i64,
    pub job_id: JobId,
    pub id: i64,
    pub event: String,
    pub time: i64,
    pub attempt: i64,
    pub data: Value,
}
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshInfo {
    pub id: i64,
    pub evaluation: u64,
    pub vertices: u64,
    pub triangles: u64,
    pub bytes: u64,
    pub sha256: String,
    pub created_at: i64,
}
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Checkpoint {
    pub attempt: i64,
    pub evaluation: u64,
    pub data: Vec<u8>,
    pub created_at: i64,
}
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredResponse {
    pub status: u16,
    pub headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}
/// Makes `submit` write the answer under the key in the job's own transaction.
pub struct Idempotency {
    pub key: String,
    pub scope: String,
    pub respond: Box<dyn FnOnce(&Job) -> StoredResponse + Send>,
}
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum IdempotencyState {
    New,
    Replay(StoredResponse),
    InFlight,
    Mismatch,
}

#[derive(Clone)]
pub struct Store;

impl Store {
    pub async fn open(data_dir: &Path, options: Options) -> Result<Self> {
        unimplemented!()
    }
    pub async fn close(&self) {
        unimplemented!()
    }
    pub fn changed(&self) -> watch::Receiver<u64> {
        unimplemented!()
    }
    pub fn wake(&self) {
        unimplemented!()
    }
    pub fn now(&self) -> i64 {
        unimplemented!()
    }
    /// Proves that the write lock can be had (for /readyz).
    pub async fn check_writable(&self) -> Result<()> {
        unimplemented!()
    }

    pub async fn insert_cloud(&self, new: NewCloud) -> Result<(Cloud, bool)> {
        unimplemented!()
    }
    pub async fn cloud(&self, id: &CloudId) -> Result<Option<Cloud>> {
        unimplemented!()
    }
    pub async fn cloud_by_sha256(&self, sha256: &str) -> Result<Option<Cloud>> {
        unimplemented!()
    }
    /// Newest first; `before` is the last id of the previous page.
    pub async fn list_clouds(&self, before: Option<&CloudId>, limit: u32) -> Result<Vec<Cloud>> {
        unimplemented!()
    }
    pub async fn delete_cloud(&self, id: &CloudId) -> Result<CloudDeletion> {
        unimplemented!()
    }
    pub async fn sha256s(&self) -> Result<Vec<String>> {
        unimplemented!()
    }

    pub async fn submit(&self, new: NewJob, idempotency: Option<Idempotency>) -> Result<Job> {
        unimplemented!()
    }
    pub async fn job(&self, id: &JobId) -> Result<Lookup> {
        unimplemented!()
    }
    /// 1 is next; none when it does not wait.
    pub async fn queue_position(&self, id: &JobId) -> Result<Option<u64>> {
        unimplemented!()
    }
    /// Newest first; `before` is the last id of the previous page.
    pub async fn list_jobs(
        &self,
        filter: &JobFilter,
        before: Option<&JobId>,
        limit: u32,
    ) -> Result<Vec<Job>> {
        unimplemented!()
    }
    pub async fn request_cancel(&self, id: &JobId) -> Result<Lookup> {
        unimplemented!()
    }
    /// Erases in any state; answers what was there before.
    pub async fn delete_job(&self, id: &JobId, reason: &str) -> Result<Lookup> {
        unimplemented!()
    }
    pub async fn finished_before(&self, time: i64, limit: u32) -> Result<Vec<JobId>> {
        unimplemented!()
    }
    pub async fn counts(&self) -> Result<Counts> {
        unimplemented!()
    }
    /// `created_at` of the job that has waited longest.
    pub async fn oldest_queued(&self) -> Result<Option<i64>> {
        unimplemented!()
    }

    pub async fn claim(&self, worker: &str, lease_ms: i64) -> Result<Option<Claim>> {
        unimplemented!()
    }
    pub async fn renew(&self, claim: &Claim, lease_ms: i64) -> Result<Lease> {
        unimplemented!()
    }
    pub async fn record(&self, claim: &Claim, record: Record) -> Result<()> {
        unimplemented!()
    }
    /// Writes its `job.snapshot` event too.
    pub async fn put_snapshot(&self, claim: &Claim, evaluation: u64, mesh: NewMesh) -> Result<()> {
        unimplemented!()
    }
    pub async fn put_checkpoint(
        &self,
        claim: &Claim,
        evaluation: u64,
        data: Vec<u8>,
    ) -> Result<()> {
        unimplemented!()
    }
    pub async fn succeed(&self, claim: &Claim, success: Success) -> Result<()> {
        unimplemented!()
    }
    pub async fn fail(&self, claim: &Claim, problem: Problem) -> Result<()> {
        unimplemented!()
    }
    pub async fn cancelled(&self, claim: &Claim) -> Result<()> {
        unimplemented!()
    }
    /// Back into the queue without a failed attempt (or cancelled if that was asked).
    pub async fn release(&self, claim: &Claim) -> Result<()> {
        unimplemented!()
    }
    /// Requeued, failed or cancelled: the job afterwards. `Error::Stale` if that attempt does not run.
    pub async fn attempt_failed(
        &self,
        id: &JobId,
        attempt: i64,
        reason: FailureReason,
    ) -> Result<Job> {
        unimplemented!()
    }
    pub async fn reap_expired(&self) -> Result<Vec<JobId>> {
        unimplemented!()
    }
    /// The running job held by this worker name: what a supervisor settles when the worker dies.
    pub async fn held_by(&self, worker: &str) -> Result<Option<Job>> {
        unimplemented!()
    }

    pub async fn checkpoint(&self, id: &JobId) -> Result<Option<Checkpoint>> {
        unimplemented!()
    }
    pub async fn events_after(&self, id: &JobId, after: i64, limit: u32) -> Result<Vec<Event>> {
        unimplemented!()
    }
    pub async fn all_events_after(&self, seq: i64, limit: u32) -> Result<Vec<Event>> {
        unimplemented!()
    }
    pub async fn last_seq(&self) -> Result<i64> {
        unimplemented!()
    }
    pub async fn metrics(
        &self,
        id: &JobId,
        after_evaluation: u64,
        limit: u32,
    ) -> Result<Vec<Metrics>> {
        unimplemented!()
    }
    pub async fn gradients(&self, id: &JobId) -> Result<Vec<GradientHistogram>> {
        unimplemented!()
    }
    pub async fn snapshots(&self, id: &JobId) -> Result<Vec<MeshInfo>> {
        unimplemented!()
    }
    /// Evaluation 0 is the result.
    pub async fn mesh_info(&self, id: &JobId, evaluation: u64) -> Result<Option<MeshInfo>> {
        unimplemented!()
    }
    /// Bytes from `position * MESH_CHUNK_BYTES`; none past the end or when the mesh was erased.
    pub async fn mesh_chunk(&self, mesh_id: i64, position: u64) -> Result<Option<Vec<u8>>> {
        unimplemented!()
    }
    pub async fn model(&self, id: &JobId) -> Result<Option<Vec<u8>>> {
        unimplemented!()
    }

    pub async fn idempotency_begin(
        &self,
        key: &str,
        scope: &str,
        request_sha256: &str,
    ) -> Result<IdempotencyState> {
        unimplemented!()
    }
    pub async fn idempotency_complete(
        &self,
        key: &str,
        scope: &str,
        response: StoredResponse,
    ) -> Result<()> {
        unimplemented!()
    }
    /// Forgets a request that was begun and not completed, so that it may be tried again.
    pub async fn idempotency_abandon(&self, key: &str, scope: &str) -> Result<()> {
        unimplemented!()
    }
    /// At the server's start: requests in flight died with the last server.
    pub async fn idempotency_abandon_all(&self) -> Result<u64> {
        unimplemented!()
    }
    pub async fn idempotency_prune(&self, before: i64) -> Result<u64> {
        unimplemented!()
    }
}
/// Size of all chunks of a mesh but the last.
pub const MESH_CHUNK_BYTES: usize = 256 * 1024;
