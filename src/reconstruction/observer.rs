//! The window of a run: what it tells while it works, and what it asks of the world outside.
//!
//! The library never looks at a clock and never logs. Who calls it gives it an [`Observer`]: a
//! progress bar, rows of a database, or nothing at all.

use serde::{Deserialize, Serialize};

use super::mesh::TriangleMesh;
use super::report::Verdict;
use super::training::{GradientHistogram, Metrics};

/// The stages of a run, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Normals, off-surface samples, hold-out.
    Sampling,
    /// Fitting the network.
    Training,
    /// Extracting the zero level set.
    Surface,
    /// Measuring the mesh.
    Report,
}

/// Something a user should know although the run goes on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Stable `snake_case` name.
    pub code: &'static str,
    /// One sentence.
    pub message: String,
}

impl Warning {
    /// A warning of the given code.
    pub fn new(code: &'static str, message: impl Into<String>) -> Self {
        Self {
            code,
            message: message.into(),
        }
    }
}

/// What a run tells while it works.
#[derive(Debug)]
pub enum Event<'a> {
    /// A stage begins.
    Phase(Phase),
    /// Share of the present stage that is done, 0 to 1.
    Progress(f64),
    /// One accepted iteration of the optimiser.
    Metrics(&'a Metrics),
    /// Distribution of the gradient at a chosen evaluation.
    Gradients(&'a GradientHistogram),
    /// Surface of the network at a chosen evaluation, in the coordinates of the input.
    Snapshot {
        /// Function evaluations so far.
        evaluation: u64,
        /// The mesh.
        mesh: &'a TriangleMesh,
        /// How far it can be relied on.
        verdict: Verdict,
    },
    /// A warning.
    Warning(&'a Warning),
    /// A state from which the training can go on in another run, see [`Observer::checkpoint`].
    Checkpoint {
        /// Function evaluations so far.
        evaluation: u64,
        /// The state, to be kept as it is.
        data: &'a [u8],
    },
}

/// Listens to a run, can stop it, and lends it a clock.
pub trait Observer {
    /// Takes note of an event.
    fn event(&self, event: Event<'_>);

    /// Whether the run shall end now; asked at each loss evaluation and each slab of the grid.
    fn cancelled(&self) -> bool {
        false
    }

    /// Whether the run shall make room for now, to be taken up again later: training hands out a
    /// checkpoint and the run ends with [`super::Error::Interrupted`].
    fn released(&self) -> bool {
        false
    }

    /// Whether training shall hand out a checkpoint; asked after each iteration. At its end it does
    /// so unasked.
    fn checkpoint_due(&self) -> bool {
        false
    }

    /// The last checkpoint of an earlier run over the same cloud with the same settings, from
    /// which training goes on. One that belongs to something else is refused with a warning, and
    /// training starts anew.
    fn checkpoint(&self) -> Option<&[u8]> {
        None
    }

    /// Those who may fit blocks of a large cloud beside the run.
    fn helpers(&self) -> Option<&dyn Helpers> {
        None
    }

    /// Seconds on a monotonic clock, from any fixed start.
    fn seconds(&self) -> f64;
}

/// Others who fit blocks beside a run, in shares.
///
/// They make it faster and nothing else: whoever fits a block, its network is the same, and the run fits itself
/// what does not come back in time.
pub trait Helpers: Sync {
    /// How many more shares may be offered now; 0 where nothing is known that is newer than the last answer.
    fn wanted(&self) -> usize;

    /// Offers a share, whose input goes to [`fit_share`](super::fit_share).
    fn offer(&self, share: usize, input: Vec<u8>);

    /// Takes an offer back: the run begins with the share itself. Who has begun with it may go on.
    fn withdraw(&self, share: usize);

    /// A share that came back, and its networks as [`fit_share`](super::fit_share) gave them.
    fn fitted(&self) -> Option<(usize, Vec<u8>)>;
}
