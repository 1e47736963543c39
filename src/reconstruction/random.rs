//! All randomness of a run: independent streams of one seed.
//!
//! libtorch's generator is global, so a seed would not hold with two runs in one process; and one
//! stream for everything would let a change of the sampling move the initial weights. Hence a
//! generator of ours with one stream for each purpose.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The generator that every random choice draws from.
pub type Generator = ChaCha8Rng;

/// What a stream of random numbers is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// Initial weights of the network.
    Initialisation = 1,
    /// Choice of points within a budget and of the held-out ones.
    Selection = 2,
    /// Off-surface samples.
    Sampling = 3,
    /// Points drawn from a shape or from a mesh.
    Shape = 4,
    /// Off-surface samples of blocks.
    Blocks = 5,
    /// Choice of the points that no block is fitted to.
    HeldOut = 6,
    /// Points and labelled places of slices.
    Slices = 7,
}

/// The stream of `seed` for `purpose`: the same numbers on every platform.
pub fn stream(seed: u64, purpose: Purpose) -> Generator {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    generator.set_stream(purpose as u64);
    generator
}
