//! A state of training as bytes: what is needed to go on, exactly, and what it belongs to.
//!
//! ```text
//! magic [8]  identity [32]  SHA-256 of the rest [32]  state (postcard)
//! ```
//!
//! Numbers are kept as their bits, so that a run that is taken up again ends as if it had never
//! stopped.

use std::borrow::Cow;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use thiserror::Error;

use super::Termination;
use super::holdout::Chosen;
use super::iterate::Iterate;
use super::method::Method;
use crate::reconstruction::network::Scalar;
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::settings::Settings;
use crate::reconstruction::vector::Vec3;

/// Changes with the state or with what the optimisers do with it.
const MAGIC: &[u8; 8] = b"MWTRAIN2";
const HASH_BYTES: usize = 32;

/// Hash of all that a training run depends on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Identity([u8; HASH_BYTES]);

impl Identity {
    /// The identity of what these bytes hold.
    pub(in crate::reconstruction) fn of(bytes: &[u8]) -> Self {
        Self(Sha256::digest(bytes).into())
    }

    /// The identity of a run over these samples.
    ///
    /// # Panics
    /// Never: settings always have a form in JSON.
    pub fn new(settings: &Settings, training: &Samples, validation: &Samples) -> Self {
        let mut hash = Sha256::new();
        hash.update(trained_settings(settings));
        for samples in [training, validation] {
            hash.update((samples.points.len() as u64).to_le_bytes());
            samples.points.iter().for_each(|p: &Vec3| add(&mut hash, p));
            add(&mut hash, &samples.targets);
            add(&mut hash, &samples.weights);
            for one_sided in &samples.one_sided {
                hash.update([u8::from(*one_sided)]);
            }
        }
        Self(hash.finalize().into())
    }
}

/// The settings as JSON, without `surface.open` and `surface.target_triangles`, which training does not depend on,
/// and without the settings of blocks where there are none or that say none: checkpoints that are older than these stay good.
fn trained_settings(settings: &Settings) -> String {
    let json =
        |value: serde_json::Result<String>| value.expect("settings are plain numbers and names");
    let open = json(serde_json::to_string(&settings.surface.open));
    let triangles = settings.surface.target_triangles;
    let mut text = json(serde_json::to_string(settings))
        .replacen(&format!(",\"open\":{open}"), "", 1)
        .replacen(&format!(",\"target_triangles\":{triangles}"), "", 1);
    text = text.replacen(",\"coarse_input\":\"none\"", "", 1);
    if settings.network.block_points == 0 {
        text = text.replacen(",\"coarse_input\":\"residual\"", "", 1);
        for (name, value) in [
            ("block_points", 0),
            ("block_width", settings.network.block_width as u64),
            ("block_layers", settings.network.block_layers as u64),
            ("block_evaluations", settings.training.block_evaluations),
        ] {
            text = text.replacen(&format!(",\"{name}\":{value}"), "", 1);
        }
    }
    text
}

fn add(hash: &mut Sha256, values: &[f64]) {
    for value in values {
        hash.update(value.to_le_bytes());
    }
}

/// Where a run stands between two iterations.
#[derive(Debug, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub(super) struct State<'a, T: Clone> {
    pub(super) at: Cow<'a, Iterate<T>>,
    pub(super) method: Cow<'a, Method<T>>,
    pub(super) best: Option<Cow<'a, Chosen<T>>>,
    pub(super) iterations: u64,
    pub(super) evaluations: u64,
    /// Seconds of training so far, for the time limit.
    pub(super) elapsed_seconds: f64,
    /// Why training ended, if it did.
    pub(super) ended: Option<Termination>,
}

/// A state as bytes, with what it belongs to.
pub(in crate::reconstruction) fn seal(
    magic: [u8; 8],
    identity: &Identity,
    state: &impl Serialize,
) -> Vec<u8> {
    let state = postcard::to_allocvec(state).expect("a state is numbers, and memory grows");
    let mut bytes = Vec::with_capacity(magic.len() + 2 * HASH_BYTES + state.len());
    bytes.extend(magic);
    bytes.extend(identity.0);
    bytes.extend(Sha256::digest(&state));
    bytes.extend(state);
    bytes
}

/// The state that [`seal`] made bytes of.
pub(in crate::reconstruction) fn unseal<S: DeserializeOwned>(
    magic: [u8; 8],
    identity: &Identity,
    bytes: &[u8],
) -> Result<S, Refusal> {
    let rest = bytes.strip_prefix(&magic).ok_or(Refusal::Version)?;
    let (found, rest) = rest.split_first_chunk().ok_or(Refusal::Damaged)?;
    if *found != identity.0 {
        return Err(Refusal::Identity);
    }
    let (hash, state) = rest
        .split_first_chunk::<HASH_BYTES>()
        .ok_or(Refusal::Damaged)?;
    if Sha256::digest(state).as_slice() != hash {
        return Err(Refusal::Damaged);
    }
    postcard::from_bytes(state).map_err(|_| Refusal::Damaged)
}

/// Why a checkpoint is not used; completes "the checkpoint …".
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub(in crate::reconstruction) enum Refusal {
    #[error("is of another version")]
    Version,
    #[error("belongs to another cloud or to other settings")]
    Identity,
    #[error("is damaged")]
    Damaged,
}

impl<T: Scalar> State<'_, T> {
    pub(super) fn encode(&self, identity: &Identity) -> Vec<u8> {
        seal(*MAGIC, identity, self)
    }

    /// Reads what [`State::encode`] wrote for a network of `dimension` parameters.
    pub(super) fn decode(
        bytes: &[u8],
        identity: &Identity,
        dimension: usize,
    ) -> Result<State<'static, T>, Refusal> {
        let state: State<'static, T> = unseal(*MAGIC, identity, bytes)?;
        if state.at.parameters.len() != dimension {
            return Err(Refusal::Damaged);
        }
        Ok(state)
    }
}
