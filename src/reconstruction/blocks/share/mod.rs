//! A share: a run of blocks that somebody else fits, as bytes.
//!
//! The fused engine adds in the order of the processor's widest vectors: who fits a share must have the same, see
//! [`processor`].

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use thiserror::Error as ThisError;

use super::input::{BlockInput, Fitted};
use crate::reconstruction::error::Error;
use crate::reconstruction::network::{Scalar, vector_width};
use crate::reconstruction::observer::{Event, Observer};
use crate::reconstruction::training::{Identity, Refusal, seal, unseal};

/// Changes with the input of a block or with what a fit does with it.
const INPUT: &[u8; 8] = b"MWSHARE1";
/// Changes with what is kept of a fit.
const FITTED: &[u8; 8] = b"MWFITTD1";

/// Blocks that are to be fitted, in their order.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Share {
    pub(super) blocks: Vec<BlockInput>,
}

/// Why bytes are not a share, or not the networks that were fitted to it.
#[derive(Debug, ThisError)]
#[error("the bytes of blocks cannot be used: what they hold {0}")]
pub struct ShareRefusal(Refusal);

/// Why a share has no networks.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum ShareError {
    /// The bytes are damaged or of another version.
    #[error(transparent)]
    Input(#[from] ShareRefusal),
    /// The fit was stopped or failed.
    #[error(transparent)]
    Fit(#[from] Error),
}

/// What networks of the same bits ask of who fits them: the same version of this program and vectors of the same
/// width.
pub fn processor() -> String {
    // libtorch is there for these two.
    let kind = if cfg!(target_arch = "aarch64") {
        "aarch64"
    } else {
        "x86_64"
    };
    format!("{} {kind} {}", env!("CARGO_PKG_VERSION"), vector_width())
}

/// Fits the blocks of a share that a run [offered](crate::reconstruction::Helpers::offer), on all threads of the
/// pool; the answer is their networks as bytes. Asks between steps whether it is `stopped`.
///
/// # Errors
/// [`ShareError::Input`] for other bytes; [`Error::Cancelled`] where it was stopped; what an engine reports.
///
/// # Determinism
/// The same bytes on a processor of the same [name](processor) give the same networks, bit for bit.
pub fn fit_share(input: &[u8], stopped: &(dyn Fn() -> bool + Sync)) -> Result<Vec<u8>, ShareError> {
    let share = Share::decode(input)?;
    let stop = Stop {
        stopped,
        failed: AtomicBool::new(false),
    };
    let fitted: Result<Vec<Fitted<f32>>, Error> = share
        .blocks
        .par_iter()
        // One after the other: blocks take different times.
        .with_max_len(1)
        .map(|block| {
            let fitted = block.fit(&stop);
            stop.failed.fetch_or(fitted.is_err(), Ordering::Relaxed);
            fitted
        })
        .collect();
    Ok(seal(*FITTED, &Identity::of(input), &fitted?))
}

/// Ends all blocks where one has failed or nobody wants them.
struct Stop<'a> {
    stopped: &'a (dyn Fn() -> bool + Sync),
    failed: AtomicBool,
}

impl Observer for Stop<'_> {
    fn event(&self, _: Event<'_>) {}

    fn cancelled(&self) -> bool {
        self.failed.load(Ordering::Relaxed) || (self.stopped)()
    }

    fn seconds(&self) -> f64 {
        0.0
    }
}

/// Reads what [`fit_share`] gave for the input of this identity.
///
/// # Errors
/// [`ShareRefusal`] for bytes that are damaged, of another version, or the networks of another share.
pub(super) fn networks<T: Scalar>(
    bytes: &[u8],
    input: &Identity,
) -> Result<Vec<Fitted<T>>, ShareRefusal> {
    unseal(*FITTED, input, bytes).map_err(ShareRefusal)
}

impl Share {
    /// As bytes, with a version and a hash.
    pub(super) fn encode(&self) -> Vec<u8> {
        seal(*INPUT, &Identity::default(), self)
    }

    /// Reads what [`Self::encode`] wrote.
    ///
    /// # Errors
    /// [`ShareRefusal`] for bytes that are damaged, of another version, or contradict themselves.
    fn decode(bytes: &[u8]) -> Result<Self, ShareRefusal> {
        let share: Self = unseal(*INPUT, &Identity::default(), bytes).map_err(ShareRefusal)?;
        if share.blocks.iter().all(BlockInput::is_sound) {
            Ok(share)
        } else {
            Err(ShareRefusal(Refusal::Damaged))
        }
    }
}

#[cfg(test)]
mod tests;
