//! Where the fitting of blocks stands, as bytes.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::fit::Done;
use crate::reconstruction::network::Scalar;
use crate::reconstruction::training::{Identity, Trained, seal, unseal};

/// Changes with the state or with what a block is.
const MAGIC: &[u8; 8] = b"MWBLOCK2";

/// The coarse network, and the blocks that are done; none at the start.
pub(in crate::reconstruction) struct State<T> {
    pub(in crate::reconstruction) coarse: Trained<T>,
    pub(super) done: Done<T>,
    identity: Identity,
}

#[derive(Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
struct Kept<'a, T: Clone> {
    coarse: Cow<'a, Trained<T>>,
    done: Cow<'a, Done<T>>,
}

impl<T: Scalar> State<T> {
    /// Where the coarse network is trained and no block is done.
    pub(in crate::reconstruction) fn start(coarse: Trained<T>, identity: Identity) -> Self {
        Self {
            coarse,
            done: Vec::new(),
            identity,
        }
    }

    /// The state in a checkpoint of the run of this identity; none in that of a single network, which training
    /// judges.
    pub(in crate::reconstruction) fn decode(bytes: &[u8], identity: &Identity) -> Option<Self> {
        let kept: Kept<'static, T> = unseal(*MAGIC, identity, bytes).ok()?;
        Some(Self {
            coarse: kept.coarse.into_owned(),
            done: kept.done.into_owned(),
            identity: *identity,
        })
    }

    /// The same where so many blocks are done, as a checkpoint.
    pub(super) fn encode(&self, done: &Done<T>) -> Vec<u8> {
        let kept = Kept {
            coarse: Cow::Borrowed(&self.coarse),
            done: Cow::Borrowed(done),
        };
        seal(*MAGIC, &self.identity, &kept)
    }
}
