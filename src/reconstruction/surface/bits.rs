//! A set of lattice points as bits: an eighth of a byte for each point of the volume.

use std::ops::Range;

/// A set of numbers below a fixed length.
#[derive(Debug, Clone)]
pub(super) struct Bits {
    pub(super) words: Vec<u64>,
}

impl Bits {
    pub(super) fn new(length: usize) -> Self {
        Self {
            words: vec![0; length.div_ceil(64)],
        }
    }

    pub(super) fn insert(&mut self, index: usize) {
        self.words[index / 64] |= 1 << (index % 64);
    }

    /// Whether `index` is in the set; numbers beyond the length are not.
    pub(super) fn contains(&self, index: usize) -> bool {
        self.words
            .get(index / 64)
            .is_some_and(|word| word >> (index % 64) & 1 == 1)
    }

    pub(super) fn remove_all(&mut self, others: &Self) {
        for (word, other) in self.words.iter_mut().zip(&others.words) {
            *word &= !other;
        }
    }

    pub(super) fn count(&self) -> usize {
        self.words.iter().map(|w| w.count_ones() as usize).sum()
    }

    /// The members, increasing.
    pub(super) fn members(&self) -> impl Iterator<Item = usize> {
        self.members_of(0..self.words.len())
    }

    /// The members that lie in the given words, increasing.
    pub(super) fn members_of(&self, words: Range<usize>) -> impl Iterator<Item = usize> {
        words.flat_map(|w| ones(self.words[w]).map(move |bit| 64 * w + bit))
    }
}

/// Positions of the bits that are set, increasing.
pub(super) fn ones(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = (word != 0).then(|| word.trailing_zeros() as usize);
        word &= word.wrapping_sub(1);
        bit
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_come_back_in_order() {
        let mut bits = Bits::new(200);
        for index in [199, 0, 63, 64, 130] {
            bits.insert(index);
        }
        assert_eq!(bits.members().collect::<Vec<_>>(), [0, 63, 64, 130, 199]);
        assert!(bits.contains(64) && !bits.contains(65) && !bits.contains(10_000));
        let mut others = Bits::new(200);
        others.insert(63);
        bits.remove_all(&others);
        assert_eq!(bits.count(), 4);
    }
}
