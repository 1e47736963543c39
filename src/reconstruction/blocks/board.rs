//! Which blocks are fitted, by whom, and which are next: the run goes through them from the first one on, and offers
//! others the last ones in shares.

use std::collections::VecDeque;

use super::fit::Done;
use super::share::networks;
use crate::reconstruction::network::Scalar;
use crate::reconstruction::training::Identity;

/// Blocks of a share. They take a core some seconds, much longer than their bytes are on their way, and a cloud that
/// is done in seconds has no share to offer.
const BLOCKS: usize = 256;

/// Blocks and their networks.
pub(super) struct Board<T> {
    pub(super) done: Done<T>,
    shares: Vec<Share>,
}

/// A run of blocks.
struct Share {
    /// Those that the run has not begun.
    open: VecDeque<usize>,
    /// Whether it has begun any.
    is_begun: bool,
    offer: Option<Offer>,
}

/// What others were offered.
struct Offer {
    blocks: Vec<usize>,
    /// That of the bytes; none until there are some.
    input: Option<Identity>,
    is_withdrawn: bool,
}

/// A block that the run is to fit now.
pub(super) struct Next {
    pub(super) block: usize,
    /// A share that is to be withdrawn for it.
    pub(super) withdrawn: Option<usize>,
}

impl Share {
    /// Whether the run leaves it to others for now.
    fn is_out(&self) -> bool {
        self.offer.as_ref().is_some_and(|offer| !offer.is_withdrawn)
    }
}

impl<T: Scalar> Board<T> {
    pub(super) fn new(done: Done<T>) -> Self {
        let all: Vec<usize> = (0..done.len()).collect();
        let share = |blocks: &[usize]| {
            let open: VecDeque<usize> = blocks
                .iter()
                .copied()
                .filter(|&k| done[k].is_none())
                .collect();
            Share {
                is_begun: open.len() < blocks.len(),
                open,
                offer: None,
            }
        };
        let shares = all.chunks(BLOCKS).map(share).collect();
        Self { done, shares }
    }

    /// The block that is next. Once there are none but those of others, the run begins with these, too: the last
    /// offer first, with which nobody may have begun.
    pub(super) fn next(&mut self) -> Option<Next> {
        let has_open = |share: &Share| !share.open.is_empty();
        let own = self
            .shares
            .iter()
            .position(|share| has_open(share) && !share.is_out());
        let at = own.or_else(|| self.shares.iter().position(has_open))?;
        let share = &mut self.shares[at];
        let withdrawn = share.is_out().then_some(at);
        if let Some(offer) = &mut share.offer {
            offer.is_withdrawn = true;
        }
        share.is_begun = true;
        let block = share.open.pop_front()?;
        Some(Next { block, withdrawn })
    }

    /// A share for others, and its blocks, if there is more left than one for the run itself.
    pub(super) fn offer(&mut self) -> Option<(usize, Vec<usize>)> {
        let is_free = |share: &&mut Share| !share.is_begun && share.offer.is_none();
        let mut free = self
            .shares
            .iter_mut()
            .enumerate()
            .rev()
            .filter(|(_, share)| is_free(share));
        let (at, share) = free.next()?;
        free.next()?;
        let blocks: Vec<usize> = share.open.iter().copied().collect();
        share.offer = Some(Offer {
            blocks: blocks.clone(),
            input: None,
            is_withdrawn: false,
        });
        Some((at, blocks))
    }

    /// Notes of which input the networks of a share will be.
    pub(super) fn offered(&mut self, share: usize, input: Identity) {
        if let Some(offer) = &mut self.shares[share].offer {
            offer.input = Some(input);
        }
    }

    /// Takes the networks of a share. What cannot be used is fitted by the run.
    pub(super) fn take(&mut self, share: usize, bytes: &[u8]) {
        let Some(share) = self.shares.get_mut(share) else {
            return;
        };
        let Some(offer) = &mut share.offer else {
            return;
        };
        let fitted = offer.input.map(|input| networks::<T>(bytes, &input));
        match fitted {
            Some(Ok(fitted)) if fitted.len() == offer.blocks.len() => {
                for (&k, fitted) in offer.blocks.iter().zip(fitted) {
                    self.done[k].get_or_insert(fitted);
                }
                share.open.clear();
            }
            _ => offer.is_withdrawn = true,
        }
    }
}
