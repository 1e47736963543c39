//! Which blocks are fitted, by whom, and which are next: the run goes through them from the first one on, and offers
//! others the last ones in shares.

use std::collections::VecDeque;

use super::fit::Done;
use super::input::Fitted;
use super::share::networks;
use crate::reconstruction::network::Scalar;
use crate::reconstruction::training::Identity;

/// Most blocks of a share. They take a core some seconds, much longer than their bytes are on their way, and a cloud that
/// is done in seconds has no share to offer.
const MOST: usize = 256;

/// Fewest blocks of a share, but for the first one: fewer would be fitted in little more time than they are on their way.
const FEWEST: usize = 64;

/// A share is so small a part of the blocks that come before its end. Others take shares from the end on until they meet
/// the run, which comes from the beginning, where as much is left as each of them fits in all: so the last share is at most
/// this part of that.
const PART: usize = 16;

/// Blocks and their networks.
pub(super) struct Board<T> {
    pub(super) done: Done<T>,
    /// How many of them are fitted.
    pub(super) fitted: usize,
    shares: Vec<Share>,
    /// Blocks of shares that others are to fit, whose places are to be asked about first: share and block.
    asking: VecDeque<(usize, usize)>,
    /// Whether others have fitted a share.
    pub(super) is_helped: bool,
}

/// A run of blocks.
struct Share {
    /// Those that the run has not begun.
    open: VecDeque<usize>,
    /// Whether it has begun any.
    is_begun: bool,
    offer: Option<Offer>,
}

/// What others are offered.
struct Offer {
    blocks: Vec<usize>,
    /// So many of these have places that are to be asked about before they are offered.
    unasked: usize,
    /// That of the bytes; none until they were offered.
    input: Option<Identity>,
    is_withdrawn: bool,
}

/// What a thread of the run is to do next.
pub(super) enum Next {
    /// Ask about the places of a block of a share that others are to fit.
    Places { share: usize, block: usize },
    /// Fit a block. A share that was offered is to be withdrawn for it.
    Fit {
        block: usize,
        withdrawn: Option<usize>,
    },
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
        let mut shares = Vec::new();
        let mut rest = &all[..];
        while !rest.is_empty() {
            let size = (rest.len() / PART).clamp(FEWEST, MOST).min(rest.len());
            let (before, blocks) = rest.split_at(rest.len() - size);
            shares.push(share(blocks));
            rest = before;
        }
        shares.reverse();
        Self {
            fitted: done.iter().flatten().count(),
            done,
            shares,
            asking: VecDeque::new(),
            is_helped: false,
        }
    }

    /// Takes the network of a block; the first one counts, and another would be the same.
    pub(super) fn put(&mut self, block: usize, fitted: Fitted<T>) {
        if self.done[block].is_none() {
            self.done[block] = Some(fitted);
            self.fitted += 1;
        }
    }

    /// A share that others wait for, and a block of it whose places are to be asked about.
    pub(super) fn next_places(&mut self) -> Option<(usize, usize)> {
        self.asking.pop_front()
    }

    /// What is next: places of shares that others wait for, and blocks. Once there are none but those of others, the run
    /// begins with these, too: the last offer first, with which nobody may have begun.
    pub(super) fn next(&mut self) -> Option<Next> {
        if let Some((share, block)) = self.next_places() {
            return Some(Next::Places { share, block });
        }
        let has_open = |share: &Share| !share.open.is_empty();
        let own = self
            .shares
            .iter()
            .position(|share| has_open(share) && !share.is_out());
        let at = own.or_else(|| self.shares.iter().position(has_open))?;
        let share = &mut self.shares[at];
        let mut withdrawn = None;
        if let Some(offer) = &mut share.offer {
            let was_offered = offer.input.is_some() && !offer.is_withdrawn;
            withdrawn = was_offered.then_some(at);
            offer.is_withdrawn = true;
        }
        share.is_begun = true;
        let block = share.open.pop_front()?;
        Some(Next::Fit { block, withdrawn })
    }

    /// Chooses so many shares for others, or fewer, if there is more left than one for the run itself.
    pub(super) fn choose(&mut self, wanted: usize) {
        for _ in 0..wanted {
            let is_free = |share: &&mut Share| !share.is_begun && share.offer.is_none();
            let numbered = self.shares.iter_mut().enumerate().rev();
            let mut free = numbered.filter(|(_, share)| is_free(share));
            let (Some((at, share)), Some(_)) = (free.next(), free.next()) else {
                return;
            };
            let blocks: Vec<usize> = share.open.iter().copied().collect();
            self.asking.extend(blocks.iter().map(|&block| (at, block)));
            share.offer = Some(Offer {
                unasked: blocks.len(),
                blocks,
                input: None,
                is_withdrawn: false,
            });
        }
    }

    /// Notes that the places of a block of this share were asked about.
    pub(super) fn asked(&mut self, share: usize) {
        if let Some(offer) = &mut self.shares[share].offer {
            offer.unasked -= 1;
        }
    }

    /// A chosen share, and its blocks, all of whose places were asked about.
    pub(super) fn ready(&self) -> Option<(usize, Vec<usize>)> {
        let mut chosen = self.shares.iter().enumerate().rev();
        chosen.find_map(|(at, share)| {
            let offer = share.offer.as_ref()?;
            let is_ready = offer.unasked == 0 && offer.input.is_none() && !offer.is_withdrawn;
            is_ready.then(|| (at, offer.blocks.clone()))
        })
    }

    /// Notes of which input the networks of a share will be. Whether it is to be offered: the run may have begun with it.
    pub(super) fn offered(&mut self, share: usize, input: Identity) -> bool {
        let offer = self.shares[share].offer.as_mut();
        let offer = offer.filter(|offer| !offer.is_withdrawn);
        offer.is_some_and(|offer| {
            offer.input = Some(input);
            true
        })
    }

    /// Takes the networks of a share. What cannot be used is fitted by the run.
    pub(super) fn take(&mut self, share: usize, bytes: &[u8]) {
        let offer = self.shares.get_mut(share);
        let Some(offer) = offer.and_then(|share| share.offer.as_mut()) else {
            return;
        };
        let fitted = offer.input.map(|input| networks::<T>(bytes, &input));
        match fitted {
            Some(Ok(fitted)) if fitted.len() == offer.blocks.len() => {
                let blocks = offer.blocks.clone();
                self.shares[share].open.clear();
                for (block, fitted) in blocks.into_iter().zip(fitted) {
                    self.put(block, fitted);
                }
                self.is_helped = true;
            }
            _ => offer.is_withdrawn = true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_become_smaller_towards_the_beginning() {
        for count in [1, FEWEST, 200, 3_000, 9_069, 45_432] {
            let board = Board::<f32>::new(vec![None; count]);
            let sizes: Vec<usize> = board.shares.iter().map(|share| share.open.len()).collect();
            assert!(
                sizes.is_sorted() && sizes.iter().all(|size| *size <= MOST),
                "{sizes:?}"
            );
            assert!(sizes[1..].iter().all(|size| *size >= FEWEST), "{sizes:?}");
            let blocks = board.shares.iter().flat_map(|share| &share.open);
            assert!(blocks.copied().eq(0..count));
        }
    }

    #[test]
    fn shares_are_offered_once_their_places_were_asked_about_unless_the_run_has_begun_with_them() {
        let mut board = Board::<f32>::new(vec![None; 3 * FEWEST]);
        // One is left for the run.
        board.choose(5);
        for expected in [2, 1] {
            for k in 0..FEWEST {
                assert!(expected == 1 || board.ready().is_none());
                let Some(Next::Places { share, block }) = board.next() else {
                    panic!("places come first");
                };
                assert_eq!((share, block), (expected, expected * FEWEST + k));
                board.asked(share);
            }
        }
        let (share, blocks) = board.ready().unwrap();
        assert_eq!((share, blocks[0], blocks.len()), (2, 2 * FEWEST, FEWEST));
        assert!(board.offered(share, Identity::of(b"input")));
        assert_eq!(board.ready().unwrap().0, 1);
        // The run goes through its own, then through the share that was not offered yet, then through the other.
        for k in 0..3 * FEWEST {
            let Some(Next::Fit { block, withdrawn }) = board.next() else {
                panic!("only blocks are left");
            };
            assert_eq!(block, k);
            assert_eq!(withdrawn, (k == 2 * FEWEST).then_some(2));
            if k == FEWEST {
                assert!(board.ready().is_none());
                assert!(!board.offered(1, Identity::of(b"late")));
            }
        }
        assert!(board.next().is_none());
    }
}
