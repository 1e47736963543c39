//! A set of lattice points as bits, in memory as its members, not as the volume.
//!
//! Numbers are grouped in pages; only those with a member have bits. Around a surface that is a small part of all.

use std::ops::Range;

/// Words of a page.
const WORDS: usize = 4;

/// Numbers of a page: a run along the rows of a lattice that is about as long as a surface stays near.
const PAGE: usize = 64 * WORDS;

/// In the table of pages: one without bits.
const NONE: u32 = u32::MAX;

/// The bits of a page.
pub(super) type Page = [u64; WORDS];

/// A set of numbers below a fixed length.
#[derive(Debug, Clone)]
pub(super) struct Bits {
    /// Where in `pages` each page is.
    table: Vec<u32>,
    /// Pages in the order in which they came to be.
    pages: Vec<Page>,
}

impl Bits {
    pub(super) fn new(length: usize) -> Self {
        Self {
            table: vec![NONE; length.div_ceil(PAGE)],
            pages: Vec::new(),
        }
    }

    pub(super) fn insert(&mut self, index: usize) {
        let (word, bit) = place(index);
        self.page_mut(index / PAGE)[word] |= bit;
    }

    /// Whether `index` is in the set; numbers beyond the length are not.
    pub(super) fn contains(&self, index: usize) -> bool {
        self.rank_in_page(index).is_some()
    }

    /// Takes all members out.
    pub(super) fn clear(&mut self) {
        self.table.fill(NONE);
        self.pages.clear();
    }

    pub(super) fn remove_all(&mut self, others: &Self) {
        for (place, other) in self.table.iter().zip(&others.table) {
            if *place != NONE && *other != NONE {
                let page = &mut self.pages[*place as usize];
                for (word, other) in page.iter_mut().zip(&others.pages[*other as usize]) {
                    *word &= !other;
                }
            }
        }
    }

    /// Adds all members of a set of the same length.
    pub(super) fn insert_all(&mut self, others: &Self) {
        for number in 0..others.page_count() {
            if let Some(other) = others.page(number) {
                for (word, other) in self.page_mut(number).iter_mut().zip(other) {
                    *word |= other;
                }
            }
        }
    }

    pub(super) fn count(&self) -> usize {
        self.pages.iter().map(members_in).sum()
    }

    /// Number of pages, those without bits among them.
    pub(super) fn page_count(&self) -> usize {
        self.table.len()
    }

    /// Number of pages with bits; each has a place below it.
    pub(super) fn places(&self) -> usize {
        self.pages.len()
    }

    /// Where the bits of page `number` are; none where it has none.
    pub(super) fn place_of(&self, number: usize) -> Option<usize> {
        let place = *self.table.get(number)?;
        (place != NONE).then_some(place as usize)
    }

    /// The bits of page `number`.
    pub(super) fn page(&self, number: usize) -> Option<&Page> {
        self.place_of(number).map(|place| &self.pages[place])
    }

    /// The same to be changed.
    pub(super) fn page_mut(&mut self, number: usize) -> &mut Page {
        let place = &mut self.table[number];
        if *place == NONE {
            *place = self.pages.len() as u32;
            self.pages.push([0; WORDS]);
        }
        &mut self.pages[*place as usize]
    }

    /// Place of the page that `index` is in, and how many members of that are below it; none where it is no member.
    pub(super) fn rank_in_page(&self, index: usize) -> Option<(usize, usize)> {
        let place_of_page = self.place_of(index / PAGE)?;
        let page = &self.pages[place_of_page];
        let (word, bit) = place(index);
        let within = (page[word] & (bit - 1)).count_ones();
        let before: u32 = page[..word].iter().map(|w| w.count_ones()).sum();
        (page[word] & bit != 0).then_some((place_of_page, (before + within) as usize))
    }

    /// The members, increasing.
    pub(super) fn members(&self) -> impl Iterator<Item = usize> {
        self.members_of(0..self.table.len())
    }

    /// Runs of pages to work through side by side, in order.
    pub(super) fn parts(&self) -> Vec<Range<usize>> {
        const PAGES: usize = 1 << 8;
        let pages = self.page_count();
        (0..pages)
            .step_by(PAGES)
            .map(|start| start..(start + PAGES).min(pages))
            .collect()
    }

    /// The members that lie in the given pages, increasing.
    pub(super) fn members_of(&self, pages: Range<usize>) -> impl Iterator<Item = usize> {
        pages.flat_map(|number| {
            let page = self.page(number).into_iter();
            page.flat_map(ones).map(move |bit| PAGE * number + bit)
        })
    }
}

/// The word of its page that a number is in, and its bit there.
fn place(index: usize) -> (usize, u64) {
    (index % PAGE / 64, 1 << (index % 64))
}

fn members_in(page: &Page) -> usize {
    page.iter().map(|word| word.count_ones() as usize).sum()
}

/// Positions of the bits of a page that are set, increasing.
pub(super) fn ones(page: &Page) -> impl Iterator<Item = usize> {
    (0..).zip(page).flat_map(|(number, word)| {
        let mut word = *word;
        std::iter::from_fn(move || {
            let bit = (word != 0).then(|| 64 * number + word.trailing_zeros() as usize);
            word &= word.wrapping_sub(1);
            bit
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_come_back_in_order() {
        let mut bits = Bits::new(2000);
        let members = [0, 63, 64, 130, 255, 256, 1999];
        for index in [1999, 256, 0, 63, 64, 130, 255] {
            bits.insert(index);
        }
        assert_eq!(bits.members().collect::<Vec<_>>(), members);
        assert_eq!(bits.members_of(1..2).collect::<Vec<_>>(), [256]);
        assert!(bits.contains(64) && !bits.contains(65));
        assert!(!bits.contains(700) && !bits.contains(10_000));
        let ranks = members.map(|index| bits.rank_in_page(index).unwrap().1);
        assert_eq!(ranks, [0, 1, 2, 3, 4, 0, 0]);

        let mut others = Bits::new(2000);
        others.insert(63);
        others.insert(700);
        bits.remove_all(&others);
        assert_eq!(bits.count(), 6);
        assert!(!bits.contains(63) && bits.contains(256));
        bits.insert_all(&others);
        assert!(bits.contains(63) && bits.contains(700) && bits.contains(256));
        bits.clear();
        assert_eq!((bits.count(), bits.members().next()), (0, None));
    }

    #[test]
    fn pages_without_members_take_no_bits() {
        let mut bits = Bits::new(1 << 20);
        for index in (0..1000).chain(1 << 19..(1 << 19) + 10) {
            bits.insert(index);
        }
        assert_eq!(bits.count(), 1010);
        assert_eq!((bits.places(), bits.page_count()), (5, (1 << 20) / PAGE));
    }
}
